// The page of a flight: its course, charts over one time, what happened, figures.
"use strict";

const rows = data.rows;
const times = rows.t;
const column = name => rows[name] ?? null;
const last = times[times.length - 1];
const charts = [];
let chosen = null;

// From slow to fast; viridis, whose steps look equally large.
const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const CAUSES = {
  "what is allowed": "#009e7340", "the way to rest in known space": "#56b4e940", "the room here": "#e69f0050",
  "the end of what is approved": "#cc79a750", "a certified stop": "#d55e0060", "maximum braking, certificate lost": "#ff000080",
};

function ramp(share) {
  const place = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const low = Math.min(Math.floor(place), RAMP.length - 2);
  return `rgb(${RAMP[low].map((part, i) => Math.round(part + (RAMP[low + 1][i] - part) * (place - low))).join(",")})`;
}

function indexAt(time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1; else high = middle;
  }
  return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
}

/// Shows one moment in the course and in all charts.
function choose(index) {
  chosen = index;
  course.draw();
}

function chooseTime(time) {
  if (charts.length) {
    const left = charts[0].valToPos(time, "x");
    for (const chart of charts) chart.setCursor({ left, top: -10 });
  }
  choose(indexAt(time));
}

// ---------------------------------------------------------------- head
{
  const about = data.about;
  const began = Number(about.unix_ns) ? new Date(Number(about.unix_ns) / 1e6).toISOString().replace("T", " ").slice(0, 19) + " UTC" : null;
  main.append(element("h1", "", document.title));
  const facts = [began, data.figures.profile && "profile " + data.figures.profile, ...Object.entries(about)
    .filter(([key]) => !["unix_ns", "monotonic_ns"].includes(key)).map(([key, value]) => `${key.replaceAll("_", " ")} ${value}`)];
  main.append(element("p", "soft", facts.filter(Boolean).join(" · ")));
  main.append(element("p", "soft", data.declarations.length ? "declared, besides what is seen: " + data.declarations.join(", ") : "nothing was declared: it flew through what it had seen"));
  for (const damage of data.damage) main.append(element("p", "warning", damage));
  const lost = Object.entries(data.lost).filter(([, count]) => count > 0);
  if (lost.length) main.append(element("p", "note", "not in the recording: " + lost.map(([topic, count]) => `${count} of ${topic}`).join(", ")));
  if (data.log) {
    const { maker, name, apart_m, damage } = data.log;
    main.append(element("p", "", `laid over: ${name} (${maker}); its positions and those that jink had are ${number(apart_m, 3, "m")} apart in the median`));
    if (damage) main.append(element("p", "warning", `${name}: ${damage}`));
  }
  const f = data.figures;
  const restarts = data.timeline.processes.reduce((sum, process) => sum + process.restarts, 0);
  tiles([
    [number(f.duration_s, 1, "s"), "since the motors ran"],
    [number(f.way_m, 1, "m"), "flown"],
    [number(f.top_mps, 2, "m/s"), "top speed"],
    [number(f.nearest_m, 2, "m"), "nearest that was seen (level)"],
    ...(f.collisions === null ? [] : [
      [number(f.clearance_m, 2, "m"), "least true clearance (simulated)", f.clearance_m < 0.1 ? "warning" : ""],
      [String(f.collisions), "collisions (simulated)", f.collisions ? "warning" : "good"],
    ]),
    [number(f.off_m, 2, "m"), "furthest from what was sent"],
    [number(f.gap_sent_ms, 0, "ms"), "largest gap between setpoints sent"],
    ...(f.gap_received_ms === null ? [] : [[number(f.gap_received_ms, 0, "ms"), "between those received (simulated)"]]),
    [String(restarts), "processes replaced", restarts ? "note" : ""],
  ]);
}

// ---------------------------------------------------------------- course
const course = (() => {
  const canvas = element("canvas", "course");
  const top = Math.max(data.figures.top_mps ?? 0, 0.1);
  const scale = element("i", "ramp");
  scale.style.background = `linear-gradient(90deg, ${[0, 0.25, 0.5, 0.75, 1].map(ramp).join(",")})`;
  const key = (name, words) => { const i = element("i"); i.style.background = colour(name); return element("span", "", i, words); };
  const words = element("p", "soft");
  const place = section("", canvas, words, element("div", "keys", element("span", "", "0 ", scale, ` ${number(top, 1)} m/s`),
    key("cell", "occupied cells of the map near the height of flight"), key("second", "goals"),
    ...(column("log_n") ? [key("accent", "the autopilot's own log")] : [])));
  const { cell_m, cells, goals } = data.map;
  const n = [...column("n"), ...goals.map(goal => goal[0])], e = [...column("e"), ...goals.map(goal => goal[1])];
  const range = values => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  const [south, north] = range(n), [west, east] = range(e);
  const margin = 5, isTurned = north - south > east - west;
  const [wide, high] = (isTurned ? [north - south, east - west] : [east - west, north - south]).map(length => length + 2 * margin);
  place.firstChild.textContent = "Course from above, north " + (isTurned ? "to the right" : "up");
  let pixels = 1, at = null;

  function draw() {
    const width = canvas.clientWidth, height = Math.min(Math.max(width * high / wide, 180), 640);
    const ratio = devicePixelRatio;
    canvas.style.height = height + "px";
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    pixels = Math.min(width / wide, height / high);
    const left = (width - wide * pixels) / 2, above = (height - high * pixels) / 2;
    at = (n, e) => isTurned
      ? [left + (n - south + margin) * pixels, above + (e - west + margin) * pixels]
      : [left + (e - west + margin) * pixels, above + (north + margin - n) * pixels];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.fillStyle = colour("cell");
    for (const [x, y] of cells) {
      const [px, py] = at((isTurned ? x : x + 1) * cell_m, y * cell_m);
      pen.fillRect(px, py, cell_m * pixels + 0.5, cell_m * pixels + 0.5);
    }
    if (column("log_n")) {
      pen.strokeStyle = colour("accent");
      pen.lineWidth = 6;
      pen.globalAlpha = 0.35;
      path(pen, column("log_n"), column("log_e"));
      pen.globalAlpha = 1;
    }
    pen.lineWidth = 2.5;
    pen.lineCap = "round";
    for (let i = 1; i < times.length; i++) {
      pen.strokeStyle = ramp(column("speed")[i] / top);
      pen.beginPath();
      pen.moveTo(...at(column("n")[i - 1], column("e")[i - 1]));
      pen.lineTo(...at(column("n")[i], column("e")[i]));
      pen.stroke();
    }
    pen.fillStyle = colour("second");
    for (const goal of goals) { pen.beginPath(); pen.arc(...at(...goal), 4, 0, 7); pen.fill(); }
    bar(pen, width, height);
    if (chosen !== null) mark(pen);
    words.textContent = chosen === null ? "Point at the course or at a chart." : inWords(chosen);
  }

  function path(pen, norths, easts) {
    pen.beginPath();
    let draws = false;
    norths.forEach((north, i) => {
      if (north === null) { draws = false; return; }
      pen[draws ? "lineTo" : "moveTo"](...at(north, easts[i]));
      draws = true;
    });
    pen.stroke();
  }

  function bar(pen, width, height) {
    const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(metres => metres * pixels > 60) ?? 1000;
    pen.strokeStyle = pen.fillStyle = colour("soft");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(10, height - 10);
    pen.lineTo(10 + metres * pixels, height - 10);
    pen.stroke();
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(metres + " m", 12, height - 16);
  }

  function mark(pen) {
    const place = [column("n")[chosen], column("e")[chosen]];
    const yaw = column("yaw_deg")[chosen] * Math.PI / 180;
    const nearest = column("nearest")?.[chosen];
    if (nearest !== null && nearest !== undefined) {
      const bearing = yaw + column("bearing")[chosen] * Math.PI / 180;
      pen.strokeStyle = colour("warning");
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.moveTo(...at(...place));
      pen.lineTo(...at(place[0] + nearest * Math.cos(bearing), place[1] + nearest * Math.sin(bearing)));
      pen.stroke();
    }
    const [x, y] = at(...place);
    pen.save();
    pen.translate(x, y);
    pen.rotate(isTurned ? yaw + Math.PI / 2 : yaw);
    pen.fillStyle = colour("ink");
    pen.beginPath();
    pen.moveTo(0, -9);
    pen.lineTo(6, 7);
    pen.lineTo(-6, 7);
    pen.fill();
    pen.restore();
  }

  canvas.addEventListener("pointermove", move => {
    const box = canvas.getBoundingClientRect();
    const [x, y] = [move.clientX - box.left, move.clientY - box.top];
    let best = 0, least = Infinity;
    for (let i = 0; i < times.length; i++) {
      const [px, py] = at(column("n")[i], column("e")[i]);
      const away = (px - x) ** 2 + (py - y) ** 2;
      if (away < least) { least = away; best = i; }
    }
    chooseTime(times[best]);
  });
  return { draw };
})();

function direction(bearing) {
  const side = bearing < 0 ? "left" : "right", far = Math.abs(bearing);
  if (far < 10) return "ahead";
  return far > 170 ? "behind" : `${Math.round(far)}° to the ${side}`;
}

function inWords(i) {
  const value = name => column(name)?.[i] ?? null;
  const limit = value("limit"), cause = data.causes[i], nearest = value("nearest");
  return [`${number(times[i], 1)} s`, `${number(value("speed"), 2)} m/s`,
    limit === null ? "nothing planned is flown" : `limit ${number(limit, 2)} m/s by ${cause}`,
    nearest === null ? "nothing seen near" : `nearest ${number(nearest, 2)} m, ${direction(value("bearing"))}`,
    value("off") === null ? null : `${number(value("off"), 2)} m from what was sent`].filter(Boolean).join(" · ");
}

// ---------------------------------------------------------------- charts
/// Charts of one time: they are moved and enlarged together.
function chart(heading, unit, series, more = {}) {
  const shown = series.filter(one => column(one.name));
  if (!shown.length) return;
  const place = section(heading);
  const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 } };
  const options = {
    width: place.clientWidth - 30, height: more.height ?? 190,
    cursor: { sync: { key: "flight" }, y: false },
    scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low), Math.max(high, more.least ?? 0.1) * 1.05] } },
    axes: [axis, { ...axis, label: unit, size: 46, labelSize: 18 }],
    series: [{ label: "s", value: (_, v) => number(v, 1) }, ...shown.map(one => ({
      label: one.label, stroke: colour(one.colour), width: one.width ?? 1.6, dash: one.dash, value: (_, v) => number(v, 2), spanGaps: false,
    }))],
    hooks: {
      setCursor: [made => { if (made.cursor.idx !== null && made.cursor.idx !== chosen) choose(made.cursor.idx); }],
      setScale: [(made, key) => { if (key === "x") follow(made); }],
      ...more.hooks,
    },
  };
  charts.push(new uPlot(options, [times, ...shown.map(one => column(one.name))], place));
  return place;
}

let following = false;
function follow(made) {
  if (following) return;
  following = true;
  const { min, max } = made.scales.x;
  for (const other of charts) if (other !== made) other.setScale("x", { min, max });
  following = false;
}

const causes = made => {
  const pen = made.ctx;
  pen.save();
  let from = 0;
  for (let i = 1; i <= times.length; i++) {
    if (i < times.length && data.causes[i] === data.causes[from]) continue;
    if (data.causes[from]) {
      const left = Math.max(made.valToPos(times[from], "x", true), made.bbox.left);
      const right = Math.min(made.valToPos(times[Math.min(i, times.length - 1)], "x", true), made.bbox.left + made.bbox.width);
      pen.fillStyle = CAUSES[data.causes[from]];
      if (right > left) pen.fillRect(left, made.bbox.top, right - left, made.bbox.height);
    }
    from = i;
  }
  pen.restore();
};

const speed = chart("Speed, and the limit in force", "m/s", [
  { name: "speed", label: "speed", colour: "accent", width: 2 },
  { name: "limit", label: "limit", colour: "second" },
], { hooks: { drawClear: [causes] } });
if (speed) {
  const used = new Set(data.causes.filter(Boolean));
  speed.append(element("div", "keys", element("span", "", "limited by"), ...Object.keys(CAUSES).filter(cause => used.has(cause)).map(cause => {
    const i = element("i");
    i.style.background = CAUSES[cause];
    return element("span", "", i, cause);
  })));
}
chart("Clearance", "m", [
  { name: "nearest", label: "nearest seen by the guard, level, from the vehicle's centre", colour: "accent", width: 2 },
  { name: "clearance", label: "true clearance of the hull (simulated)", colour: "second" },
], { least: 3 });
chart("Did it fly what was sent?", "m", [
  { name: "off", label: "vehicle from the approved trajectory", colour: "accent", width: 2 },
  { name: "tube", label: "tracking tube", colour: "soft", dash: [6, 4] },
  { name: "log_was_off", label: "the autopilot's estimate from it, by its log", colour: "second" },
  { name: "log_wanted_off", label: "what its controller wanted from it", colour: "third" },
], { least: 0.3 });
chart("Height above the local origin", "m", [{ name: "up", label: "height", colour: "accent", width: 2 }], { height: 130 });

// ---------------------------------------------------------------- what happened
{
  const GOOD = new Set(["active", "healthy", "standby"]);
  const lanes = [["mode", data.timeline.modes, []], ["health", data.timeline.health, []],
    ...data.timeline.processes.map(process => [process.name, process.states, process.marks])];
  const HEIGHT = 20;
  const events = data.timeline.events.filter(event => event.t >= -1);
  const draw = made => {
    const pen = made.ctx, ratio = devicePixelRatio, { left, top, width } = made.bbox;
    const x = time => Math.min(Math.max(made.valToPos(time, "x", true), left), left + width);
    pen.save();
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    pen.fillStyle = colour("ink");
    lanes.forEach(([name], lane) => pen.fillText(name, left - 6 * ratio, top + (lane + 0.5) * HEIGHT * ratio));
    pen.textAlign = "left";
    lanes.forEach(([, states, marks], lane) => {
      const above = top + lane * HEIGHT * ratio, middle = above + HEIGHT * ratio / 2;
      states.forEach(([time, state], i) => {
        const from = x(time), to = x(states[i + 1]?.[0] ?? last);
        if (to <= from) return;
        pen.globalAlpha = 0.35;
        pen.fillStyle = lane === 0 ? colour(i % 2 ? "third" : "accent") : GOOD.has(state) ? colour("good") : colour("warning");
        pen.fillRect(from, above + 2 * ratio, to - from, (HEIGHT - 4) * ratio);
        pen.globalAlpha = 1;
        pen.fillStyle = colour("ink");
        if ((lane === 0 || !GOOD.has(state)) && to - from > pen.measureText(state).width + 8 * ratio) pen.fillText(state, from + 4 * ratio, middle);
      });
      for (const [time, why] of marks) {
        const at = x(time);
        pen.fillStyle = colour("warning");
        pen.fillRect(at - ratio, above, 2 * ratio, HEIGHT * ratio);
        pen.fillText(why, at + 4 * ratio, middle);
      }
    });
    pen.fillStyle = colour("soft");
    for (const event of events) pen.fillRect(x(event.t), top, ratio, lanes.length * HEIGHT * ratio);
    pen.restore();
  };
  data.rows.nothing = times.map(() => 0);
  const place = section("What happened");
  const axis = { stroke: colour("soft"), grid: { show: false }, ticks: { stroke: colour("line"), width: 1 } };
  charts.push(new uPlot({
    width: place.clientWidth - 30, height: lanes.length * HEIGHT + 58,
    cursor: { sync: { key: "flight" }, y: false }, legend: { show: false },
    scales: { x: { time: false }, y: { range: [0, lanes.length] } },
    axes: [axis, { ...axis, size: 136, ticks: { show: false }, values: (_, splits) => splits.map(() => "") }],
    series: [{}, { show: true, stroke: "transparent" }],
    hooks: {
      draw: [draw],
      setCursor: [made => { if (made.cursor.idx !== null && made.cursor.idx !== chosen) choose(made.cursor.idx); }],
      setScale: [(made, key) => { if (key === "x") follow(made); }],
    },
  }, [times, data.rows.nothing], place));
  place.append(element("p", "soft", "A thin line is an event; a red one a process that was replaced."));
  const grave = severity => ["emergency", "alert", "critical", "error"].includes(severity) ? "warning" : severity === "warning" ? "note" : "";
  if (events.length) {
    place.append(table(["s#", "severity", "process", "text", "what to do"], events.map(event =>
      [number(event.t, 1), element("span", grave(event.severity), event.severity), event.process, event.text, event.action]), i => chooseTime(events[i].t)));
  }
}

// ---------------------------------------------------------------- figures
if (data.latency.whole.count) {
  const { whole, stages } = data.latency;
  const ran = stages.filter(stage => stage.took.count);
  const longest = Math.max(...ran.map(stage => stage.took.p99), 0.001);
  const bars = of => {
    const first = element("span", "bar"), rest = element("span", "bar second");
    first.style.width = 100 * of.p50 / longest + "%";
    rest.style.width = 100 * (of.p99 - of.p50) / longest + "%";
    return element("span", "bars", first, rest);
  };
  section("From the capture of a range to the wire (ms)", table(["stage", "", "p50#", "p99#", "max#", "of that waited: p50#", "p99#"],
    [...ran.map(({ name, took, waited }) => [name, bars(took), number(took.p50), number(took.p99), number(took.max), number(waited.p50), number(waited.p99)]),
      [element("b", "", "whole"), "", number(whole.p50), number(whole.p99), number(whole.max), "", ""]]),
  element("p", "soft", `${whole.count} setpoints of new plans; a stage counts from the end of the one before.`));
}
section("Processes", table(["process", "replaced#", "back after ms#", "cycle p50 ms#", "worst p99#", "max#", "budget#", "over budget#", "CPU s#"],
  data.timeline.processes.map(p => [p.name, String(p.restarts), p.restarts ? number(p.recovery_ms, 0) : "–", number(p.p50_us === null ? null : p.p50_us / 1e3),
    number(p.p99_us / 1e3), number(p.max_us / 1e3), p.budget_us ? number(p.budget_us / 1e3, 1) : "–", String(p.budget_misses), number(p.cpu_s, 1)])));
if (data.parameters) {
  const value = p => element("span", p.value === p.default ? "" : "note", `${p.value} ${p.unit}`);
  const place = section("Parameters", table(["parameter", "value", "default", "meaning"], data.parameters.map(p => [p.name, value(p), `${p.default}`, p.help])));
  if (data.changes.length) {
    place.append(element("h2", "", "Changed in flight"), table(["s#", "parameter", "from", "to"],
      data.changes.map(c => [number(c.t, 1), c.name, `${c.from} ${c.unit}`, `${c.to} ${c.unit}`]), i => chooseTime(data.changes[i].t)));
  }
}
section("Configuration that it was started with", ...Object.entries(data.configuration).map(([name, text]) =>
  element("details", "", element("summary", "", name), element("pre", "", text))));

course.draw();
addEventListener("resize", () => {
  for (const made of charts) made.setSize({ width: made.root.parentElement.clientWidth - 30, height: made.height });
  course.draw();
});
// Colours are read once.
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => location.reload());
