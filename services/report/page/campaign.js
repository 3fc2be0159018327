// The page of a campaign: figures by cell, success by difficulty, what failed.
"use strict";

const percent = (part, whole) => whole ? 100 * part / whole : 0;

main.append(element("h1", "", document.title), element("p", "soft", data.command));
tiles(data.whole.flatMap(({ name, flights, successes, interval }) => [
  [String(flights), name],
  [number(percent(successes, flights), 1, "%"), `did what they could (95 % interval ${number(interval[0], 1)} to ${number(interval[1], 1)})`, successes === flights ? "good" : "note"],
]));

const [columns, ...cells] = data.cells;
section("By cell", table(columns.map((name, i) => i ? name + "#" : name), cells));

function bars(shares) {
  return table(["", "flights#", "did what they could#", "", "95 % interval#"], shares.map(({ name, flights, successes, interval }) => {
    const bar = element("span", "bar");
    bar.style.width = percent(successes, flights) + "%";
    return [name, String(flights), number(percent(successes, flights), 1, "%"), element("span", "bars", bar), `${number(interval[0], 1)} to ${number(interval[1], 1)}`];
  }));
}
if (data.difficulty.shares.length) section("By difficulty: " + data.difficulty.by, bars(data.difficulty.shares));

if (data.failures.length) {
  section("What failed", ...data.failures.map(({ words, svg }) => {
    const made = element("figure", "", element("figcaption", "", words));
    if (svg) {
      const picture = element("img");
      picture.src = "data:image/svg+xml," + encodeURIComponent(svg);
      picture.alt = words;
      picture.loading = "lazy";
      made.append(picture);
    }
    return made;
  }));
}
section("Flights", element("details", "", element("summary", "", `${data.flights.length} flights`), element("pre", "", data.flights.join("\n"))));
