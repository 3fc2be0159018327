// What pages of flights and of campaigns are put together from.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const main = document.querySelector("main");

/// An element with a class, and texts or elements in it.
function element(name, kind, ...content) {
  const made = document.createElement(name);
  if (kind) made.className = kind;
  made.append(...content.filter(part => part !== null && part !== undefined));
  return made;
}

/// A section with a heading, at the end of the page.
function section(heading, ...content) {
  const made = element("section", "", element("h2", "", heading), ...content);
  main.append(made);
  return made;
}

/// A number with so many decimals; a dash where there is none.
function number(value, decimals = 2, unit = "") {
  if (value === null || value === undefined) return "–";
  return value.toFixed(decimals) + (unit && " " + unit);
}

/// Figures side by side: value, what it is, a class.
function tiles(list) {
  const made = element("div", "tiles");
  for (const [value, about, kind] of list) made.append(element("div", "tile", element("b", kind ?? "", value), element("span", "", about)));
  main.append(made);
}

/// A table: column names (with a trailing # those of numbers), rows of texts and elements; `goes` is called with a row's index when it is chosen.
function table(columns, rows, goes) {
  const isNumber = columns.map(column => column.endsWith("#"));
  const cell = (name, content, index) => element(name, isNumber[index] ? "number" : "", content);
  const head = element("thead", "", element("tr", "", ...columns.map((column, index) => cell("th", column.replace("#", ""), index))));
  const body = element("tbody", "");
  rows.forEach((row, index) => {
    const line = element("tr", goes ? "goes" : "", ...row.map((content, column) => cell("td", content, column)));
    if (goes) line.addEventListener("click", () => goes(index));
    body.append(line);
  });
  return element("table", "", head, body);
}

/// A colour of the style sheet.
function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}
