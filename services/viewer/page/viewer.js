// The live page: a web socket brings what is new, the picture shows where, the panels say what and why.
//
// | message | has |
// |---|---|
// | text, `type` scene, status, events, parameters | JSON as services/viewer/src/spectator.rs posts it |
// | binary, first byte 4 to 8 | trail, map, border, cloud, far map: services/viewer/src/layers.rs |
//
// Nothing here invents a figure or a word: both come from jink.

const $ = (id) => document.getElementById(id);
const TRAIL = 4, MAP = 5, BORDER = 6, CLOUD = 7, FAR = 8;
/** Without a scene for so long (ms), what is shown is old: one comes ten times a second. */
const SILENCE_MS = 1500;
const RETRY_MS = [500, 1000, 2000, 4000];
const now = { scene: null, status: null, events: [], parameters: [], at: 0 };
let picture = null;

/** Makes an element; text never becomes markup. */
function h(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}
const fixed = (value, digits = 1) => (Number.isFinite(value) ? value.toFixed(digits) : "–");
function ago(seconds) {
  if (!Number.isFinite(seconds)) return "";
  if (seconds < 60) return `${Math.max(0, Math.round(seconds))} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min`;
  return seconds < 86400 ? `${Math.floor(seconds / 3600)} h` : `${Math.floor(seconds / 86400)} d`;
}

// ---------------------------------------------------------------- layers that can be switched

const LAYERS = [
  // name, label, on at first, part to ask for
  ["map", "map", true, "map"],
  ["far", "far map", true, "far"],
  ["cloud", "newest points", false, "cloud"],
  ["border", "border of the unknown", false, "border"],
  ["corridor", "corridor", true, null],
  ["guide", "guide", true, null],
  ["ring", "guard ring", true, null],
  ["trail", "trail", true, null],
];
const shown = Object.fromEntries(LAYERS.map(([name, , on]) => [name, on]));
try {
  Object.assign(shown, JSON.parse(localStorage.getItem("jink-layers") ?? "{}"));
} catch {
  // Without storage the layers are as they are at first.
}

function buildLayers() {
  for (const [name, label] of LAYERS) {
    const box = h("input", { type: "checkbox", checked: shown[name] });
    const age = h("small");
    age.dataset.age = name;
    box.addEventListener("change", () => {
      shown[name] = box.checked;
      try {
        localStorage.setItem("jink-layers", JSON.stringify(shown));
      } catch { /* as above */ }
      want();
      picture?.toggled(name);
    });
    $("layer-list").append(h("label", {}, box, label, age));
  }
  $("layers").open = innerWidth > 900;
}

// ---------------------------------------------------------------- the connection

let socket = null, failures = 0, lastScene = 0;

function want() {
  if (socket?.readyState === WebSocket.OPEN) {
    const parts = LAYERS.filter(([name, , , part]) => part && shown[name]).map(([, , , part]) => part);
    socket.send(JSON.stringify({ want: parts }));
  }
}

function connect() {
  let wasOpen = false;
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    wasOpen = true;
    failures = 0;
    want();
  };
  socket.onmessage = ({ data }) => (typeof data === "string" ? takeText(JSON.parse(data)) : takeBytes(data));
  socket.onclose = async () => {
    const pause = RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)];
    showLost();
    if (!wasOpen && (await isTokenMissing())) {
      const token = await askToken("This page is served to other hosts: reading it needs its token.");
      if (token) document.cookie = `jink_token=${token}; SameSite=Strict; Path=/`;
    }
    setTimeout(connect, pause);
  };
}

async function isTokenMissing() {
  try {
    return (await fetch("recordings.json", { method: "HEAD" })).status === 401;
  } catch {
    return false;
  }
}

function takeText(message) {
  if (message.type === "scene") {
    now.scene = message;
    now.at = lastScene = performance.now();
    showScene(message);
    picture?.scene(message);
  } else if (message.type === "status") {
    now.status = message;
    showStatus();
  } else if (message.type === "events") {
    now.events = message.events;
    showEvents();
  } else if (message.type === "parameters") {
    now.parameters = message.parameters;
    showParameters();
  }
}

/** Parts that came before there was a picture. */
const early = new Map();

function takeBytes(buffer) {
  const view = new DataView(buffer), code = view.getUint8(0);
  if (!picture) {
    early.set(code, buffer);
    return;
  }
  if (code === TRAIL) {
    const count = view.getUint32(4, true);
    picture?.trail(new Float32Array(buffer.slice(8, 8 + 12 * count)));
  } else if (code === CLOUD) {
    const origin = [4, 8, 12].map((at) => view.getFloat32(at, true)), count = view.getUint32(16, true);
    picture?.cloud(origin, new Int16Array(buffer.slice(20, 20 + 6 * count)));
  } else {
    const min = [8, 12, 16].map((at) => view.getInt32(at, true)), count = view.getUint32(20, true);
    const cells = { edge: view.getFloat32(4, true), min, count, offsets: new Uint8Array(buffer, 24, 3 * count) };
    picture?.cells({ [MAP]: "map", [BORDER]: "border", [FAR]: "far" }[code], cells);
  }
}

function showLost() {
  const silent_s = (performance.now() - lastScene) / 1000;
  const isLost = !lastScene || silent_s * 1000 > SILENCE_MS;
  document.body.classList.toggle("lost", isLost);
  $("lost").hidden = !isLost;
  if (isLost) {
    $("lost").textContent = lastScene
      ? `connection lost ${ago(silent_s)} ago, trying again; what is shown is old`
      : "no connection yet, trying again";
  }
}

// ---------------------------------------------------------------- words and figures

function showScene(scene) {
  const { vehicle, route } = scene;
  $("instance").textContent = scene.instance;
  document.title = `jink ${scene.instance}`;
  const figure = (id, text, isStale) => {
    $(id).textContent = text;
    $(id).classList.toggle("stale", Boolean(isStale));
  };
  const at = vehicle?.at, goal = route && !route.stale ? route.goal : null;
  const stale = vehicle?.stale;
  figure("speed", vehicle ? fixed(vehicle.speed_mps) : "–", stale);
  figure("height", at ? fixed((vehicle.home_down_m ?? 0) - at[2]) : "–", stale);
  const toGoal = at && goal ? Math.hypot(...goal.map((x, axis) => x - at[axis])) : NaN;
  figure("distance", fixed(toGoal, toGoal < 100 ? 1 : 0), stale);
  const ages = [["state", vehicle], ["guard", scene.approved], ["plan", route], ["map", scene.map]]
    .filter(([, part]) => part?.stale)
    .map(([name, part]) => `${name} ${ago(part.age_s)}`);
  const lines = scene.lines.filter((line) => line.about !== "system");
  const system = scene.lines.find((line) => line.about === "system");
  if (system?.text.length > 22) lines.unshift(system);
  if (ages.length) lines.push({ about: "old", text: `shown as it was: ${ages.join(", ")} ago`, weight: "warning" });
  const latest = now.events[0];
  if (latest && scene.now_s - latest.at_s < 20) {
    lines.push({ about: "event", text: latest.text, weight: latest.code <= 4 ? "warning" : latest.code === 5 ? "note" : "good" });
  }
  $("lines").replaceChildren(...lines.map((line) => {
    const item = h("li", { className: line.weight }, h("b", {}, line.about), h("span", {}, line.text));
    item.dataset.about = line.about;
    return item;
  }));
  $("health").textContent = system ? system.text.split(":")[0].replace("the supervisor gives no status", "no status") : "…";
  $("health").className = `chip ${system?.weight ?? ""}`;
  for (const label of document.querySelectorAll("[data-age]")) {
    const part = scene[label.dataset.age];
    label.textContent = part?.stale ? `${ago(part.age_s)} old` : "";
  }
}

const isOpen = (tab) => !$(tab).hidden;
const stateWeight = (service) =>
  service.state === "active" ? "good" : ["starting", "standby", "degraded", "stopped"].includes(service.state) ? "note" : "warning";

function showStatus() {
  const { report, stale, age_s } = now.status ?? {};
  if (!report) return;
  const old = stale ? h("p", { className: "chip warning" }, `${ago(age_s)} old: the supervisor gives no status`) : null;
  if (isOpen("services")) showServices(report, old);
  if (isOpen("latency")) showLatency(report.link, report, old);
}

function table(head, rows) {
  const cell = (tag, [text, className]) => h(tag, { className: className ?? "" }, text);
  return h("table", {}, h("tr", {}, ...head.map((one) => cell("th", one))),
    ...rows.map((row) => h("tr", {}, ...row.map((one) => cell("td", one)))));
}

function showServices(report, old) {
  const rows = report.services.map((service) => {
    const swap = service.swap ? ` (swap: ${service.swap})` : service.shadow_pid ? " (shadow)" : "";
    const why = service.restarts && service.last_exit ? h("small", {}, `${service.last_exit}${service.reason ? `, ${service.reason}` : ""}`) : "";
    return [
      [service.name],
      [h("span", { className: `chip ${stateWeight(service)}` }, service.state + swap)],
      [`${fixed(service.cycle_p99_us / 1000)} / ${fixed(service.cycle_max_us / 1000)}`, "number"],
      [h("span", {}, `${service.restarts}`, why), "number"],
      [fixed(service.cpu_percent), "number"],
    ];
  });
  const { link, space, speed } = report;
  const pairs = h("dl", { className: "pairs" });
  const pair = (name, text) => pairs.append(h("dt", {}, name), h("dd", {}, text));
  if (link) {
    pair("autopilot", link.autopilot_alive ? `${link.system_id} connected` : "not connected");
    pair("avoidance", link.avoidance);
    pair("profile", link.unfit ? `NOT READY: ${link.unfit}` : link.profile || "not chosen yet");
    if (link.assist !== "off") pair("assisted flight", link.assist);
    pair("clock", link.timesync_converged ? `mapped (round trip ${fixed(link.round_trip_ms)} ms)` : "not mapped yet");
    pair("setpoints", `${link.setpoints}, largest gap ${fixed(link.setpoint_gap_max_ms, 0)} ms`);
    for (const one of link.links) pair(`link ${one.name}`, linkText(one));
  } else {
    pair("link", "the gateway has said nothing yet");
  }
  if (space) pair("space", space.declarations.length ? `declared, besides what is seen: ${space.declarations.join(", ")}` : "nothing is declared: it flies through what it has seen");
  if (space?.cannot_plan) pair("", `NOT READY: ${space.cannot_plan} -> ${space.remedy}`);
  if (speed) pair("speed", `plans reach ${fixed(speed.reached_mps)} of ${fixed(speed.allowed_mps)} m/s`);
  if (!report.logs_have_room) pair("logs", "full");
  const ends = report.ends.map((end) => h("p", { className: "soft" },
    `${end.process} (start ${end.generation}) ended with ${end.exit}, after ${ago(end.lived_s)}`));
  $("services").replaceChildren(...[old].filter(Boolean),
    table([["service"], ["state"], ["cycle ms", "number"], ["restarts", "number"], ["cpu %", "number"]], rows),
    h("p", { className: "soft" }, "cycle: 99th percentile and longest"),
    h("h2", {}, "Link and mode"), pairs,
    ...(ends.length ? [h("h2", {}, "Ended"), ...ends] : []),
    h("p", { className: "soft" }, `up ${ago(report.uptime_s)}; the same figures: `, h("a", { href: "status.json" }, "status.json")));
}

function linkText(one) {
  if (one.is_waited_for) return "waiting for its device";
  const sum = (counts) => Object.values(counts).reduce((all, count) => all + count, 0);
  const facts = [one.sent_bytes_per_s === null ? `${one.sent_bytes} bytes sent` : `${fixed(one.sent_bytes_per_s / 1000)} kB/s sent`];
  for (const [count, words] of [[sum(one.dropped), "left out"], [sum(one.refused), "refused"], [one.unknown_peers, "of unknown peers"], [one.reopened, "times opened again"]]) {
    if (count) facts.push(`${count} ${words}`);
  }
  return facts.join(", ");
}

function showLatency(link, report, old) {
  const p99 = link?.capture_to_wire_p99_ms;
  if (p99 === null || p99 === undefined) {
    $("latency").replaceChildren(h("p", { className: "empty" }, "Nothing was measured yet: no planned setpoint has been sent."));
    return;
  }
  const most = Math.max(...link.stages.map((stage) => stage.p99_ms), 1);
  const bar = (stage) => {
    const wide = (ms) => `${Math.min(100, (100 * ms) / most)}%`;
    const [outer, inner] = ["p99", "p50"].map((className) => h("i", { className }));
    outer.style.width = wide(stage.p99_ms);
    inner.style.width = wide(stage.p50_ms);
    return h("div", { className: "bar" }, outer, inner);
  };
  const rows = link.stages.map((stage, index) => [
    [stage.stage],
    [bar(stage)],
    [`${fixed(stage.p50_ms)} / ${fixed(stage.p99_ms)}`, "number"],
    [index ? `${fixed(stage.hop_p50_ms)} / ${fixed(stage.hop_p99_ms)}` : "", "number"],
  ]);
  const late = report.services.filter((service) => service.late_outputs > 0).map((service) => `${service.name} ${service.late_outputs}`);
  $("latency").replaceChildren(...[old].filter(Boolean),
    h("h2", {}, "Capture to wire"),
    h("p", {}, `${fixed(link.capture_to_wire_p50_ms)} / ${fixed(p99)} / ${fixed(link.capture_to_wire_max_ms)} ms p50/p99/max`),
    h("h2", {}, "What each stage adds, waiting included"),
    table([["stage"], [""], ["ms p50/p99", "number"], ["begun after", "number"]], rows),
    h("p", { className: "soft" }, late.length ? `late outputs since the start: ${late.join(", ")}` : "no late outputs since the start"));
}

function showEvents() {
  if (!isOpen("events")) return;
  const at = now.scene?.now_s;
  const weight = (code) => (code <= 3 ? "warning" : code <= 5 ? "note" : "good");
  $("events").replaceChildren(...(now.events.length
    ? now.events.map((event) => h("div", { className: "event" },
        h("span", { className: `chip ${weight(event.code)}` }, event.severity),
        h("p", {}, event.text),
        h("span", { className: "soft" }, `${ago(at - event.at_s)} ago`),
        h("p", { className: "soft" }, `${event.process}${event.action && event.action !== "None." ? `: ${event.action}` : ""}`)))
    : [h("p", { className: "empty" }, "Nothing has been reported since this page is served.")]));
}

// ---------------------------------------------------------------- parameters

let token = null;
try {
  token = sessionStorage.getItem("jink-token");
} catch { /* it is asked for each time */ }

function showParameters() {
  const tab = $("parameters");
  if (!now.parameters.length) {
    tab.replaceChildren(h("p", { className: "empty" }, "The parameter server has said nothing yet."));
    return;
  }
  if (tab.querySelector("form")) {
    for (const row of now.parameters) updateParameter(row);
    return;
  }
  tab.replaceChildren(h("p", { className: "soft" }, "A change needs the token of this instance (docs/viewer.md). A star marks what is not the default."),
    ...now.parameters.map(parameter));
}

function updateParameter(row) {
  const form = document.querySelector(`form[data-name="${CSS.escape(row.name)}"]`);
  if (!form) return;
  form.parentElement.classList.toggle("changed", row.value !== row.default);
  if (!form.classList.contains("edited")) form.value.value = row.value;
}

function parameter(row) {
  const input = h("input", { name: "value", type: "number", value: row.value, min: row.min, max: row.max, step: "any" });
  input.setAttribute("aria-label", row.name);
  const form = h("form", {}, h("b", {}, row.name), h("button", { type: "submit" }, "Set"), input, h("span", { className: "unit" }, row.unit));
  const answer = h("p", { className: "answer" });
  form.dataset.name = row.name;
  input.addEventListener("input", () => form.classList.toggle("edited", input.value !== ""));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const [text, isRefused] = await setParameter(row.name, Number(input.value));
    answer.textContent = text;
    answer.classList.toggle("refused", isRefused);
    if (!isRefused) form.classList.remove("edited");
  });
  const facts = `${row.min} to ${row.max}${row.unit ? ` ${row.unit}` : ""}, default ${row.default}, takes effect ${row.apply === "live" ? "at once" : "after a restart"}`;
  return h("div", { className: `parameter${row.value !== row.default ? " changed" : ""}` }, form, h("p", {}, row.help), h("p", {}, facts), answer);
}

/** What became of it, and whether it was refused. */
async function setParameter(name, value) {
  token ??= await askToken("Changing a parameter needs the token: the one line in viewer.token of the instance's folder, or the file that [viewer] names.");
  if (!token) return ["not changed: no token", true];
  try {
    const answer = await fetch("parameter", {
      method: "POST",
      headers: { Authorization: `Bearer ${token}`, "Content-Type": "application/json" },
      body: JSON.stringify({ name, value }),
    });
    if (answer.ok) return [`${name} = ${(await answer.json()).value}`, false];
    if (answer.status === 401) keepToken(null);
    return [(await answer.text()).replace(/^jink: /, ""), true];
  } catch {
    return ["not changed: no connection", true];
  }
}

function keepToken(value) {
  token = value;
  try {
    value ? sessionStorage.setItem("jink-token", value) : sessionStorage.removeItem("jink-token");
  } catch { /* as above */ }
}

function askToken(text) {
  const dialog = $("ask");
  $("ask-text").textContent = text;
  $("ask-token").value = "";
  if (!dialog.open) dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => {
      const given = dialog.returnValue === "yes" ? $("ask-token").value.trim().replace(/[^\w-]/g, "") : "";
      keepToken(given || null);
      resolve(given || null);
    };
  });
}

async function showRecordings() {
  const tab = $("recordings");
  try {
    const listed = await (await fetch("recordings.json")).json();
    const size = (bytes) => (bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);
    const rows = listed.map((one) => [
      [h("a", { href: `recordings/${one.name}`, download: one.name }, one.name)],
      [size(one.bytes), "number"],
      [one.age_s < 5 ? "now" : `${ago(one.age_s)} ago`, "number"],
    ]);
    tab.replaceChildren(rows.length
      ? table([["recording"], ["size", "number"], ["written", "number"]], rows)
      : h("p", { className: "empty" }, "No recordings: [recorder] of jink.toml names no folder, or it is empty (docs/recordings.md)."));
  } catch {
    tab.replaceChildren(h("p", { className: "empty" }, "The list cannot be read now."));
  }
}

function buildTabs() {
  const buttons = [...document.querySelectorAll("#tabs button")];
  for (const button of buttons) {
    button.addEventListener("click", () => {
      for (const other of buttons) {
        other.setAttribute("aria-selected", other === button);
        $(other.dataset.tab).hidden = other !== button;
      }
      ({ services: showStatus, latency: showStatus, events: showEvents, parameters: showParameters, recordings: showRecordings })[button.dataset.tab]();
    });
  }
}

// ---------------------------------------------------------------- colours

const mix = (from, to, share) => from.map((x, i) => x + (to[i] - x) * share);
const SPEED_COLOURS = [[0.23, 0.42, 0.94], [0.1, 0.72, 0.79], [0.34, 0.78, 0.33], [0.95, 0.76, 0.19]];
const STOP_COLOUR = [0.95, 0.33, 0.18];
function ofRamp(ramp, share) {
  const place = Math.min(0.9999, Math.max(0, share)) * (ramp.length - 1), index = Math.floor(place);
  return mix(ramp[index], ramp[index + 1], place - index);
}
const isDark = matchMedia("(prefers-color-scheme: dark)");
/** From the ground up: soil, trunk, leaves, light. */
const heights = () => (isDark.matches
  ? [[0.2, 0.25, 0.2], [0.4, 0.32, 0.22], [0.28, 0.42, 0.24], [0.3, 0.55, 0.32], [0.5, 0.7, 0.5]]
  : [[0.66, 0.68, 0.55], [0.55, 0.42, 0.28], [0.42, 0.52, 0.26], [0.34, 0.6, 0.3], [0.55, 0.75, 0.45]]);
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
/** Height above the ground (m) that has the last colour. */
const HIGHEST_M = 6;
/** Cells below this height (m) are ground that the sensors see. */
const GROUND_M = 0.35;
const maxSpeed = () => Math.max(0.5, now.status?.report.speed?.allowed_mps ?? 3);

function lineColours({ line, stop_from }) {
  return line.map(([, , , mps], index) => (index > stop_from ? STOP_COLOUR : ofRamp(SPEED_COLOURS, mps / maxSpeed())));
}

// ---------------------------------------------------------------- how the picture is looked at

const look = { view: "follow", pitch: 0.36, distance: 8, turn: 0 };
const DISTANCES = { follow: 8, orbit: 20, top: 34 };

function buildViews(canvas) {
  const buttons = [...document.querySelectorAll("#views button")];
  for (const button of buttons) {
    button.addEventListener("click", () => {
      look.view = button.dataset.view;
      Object.assign(look, { turn: 0, distance: DISTANCES[look.view], pitch: look.view === "orbit" ? 0.65 : 0.36 });
      buttons.forEach((other) => other.setAttribute("aria-pressed", other === button));
    });
  }
  const fingers = new Map();
  const spread = () => {
    const [one, other] = [...fingers.values()];
    return Math.hypot(one.x - other.x, one.y - other.y);
  };
  const zoom = (factor) => (look.distance = Math.min(120, Math.max(2, look.distance * factor)));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const finger = fingers.get(event.pointerId);
    if (!finger) return;
    const before = fingers.size > 1 ? spread() : 0;
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    if (fingers.size > 1) {
      zoom(before / Math.max(1, spread()));
    } else {
      look.turn += dx * 0.006;
      look.pitch = Math.min(1.5, Math.max(-0.1, look.pitch + dy * 0.005));
    }
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.001));
  }, { passive: false });
}

/** The vehicle between two scenes: it is drawn more often than it is reported. */
class Motion {
  at = null;
  yaw = 0;
  attitude = [1, 0, 0, 0];

  step(vehicle, seconds) {
    if (!vehicle?.at || vehicle.at.includes(null)) return;
    const age_s = (performance.now() - now.at) / 1000;
    const ahead_s = vehicle.stale ? 0 : Math.min(age_s, 0.3);
    const target = vehicle.at.map((x, axis) => x + (vehicle.velocity?.[axis] ?? 0) * ahead_s);
    const share = this.at ? 1 - Math.exp(-seconds * 14) : 1;
    const isFar = this.at && Math.hypot(...target.map((x, axis) => x - this.at[axis])) > 5;
    this.at = this.at && !isFar ? mix(this.at, target, share) : target;
    if (!vehicle.attitude.includes(null)) {
      const sign = vehicle.attitude.reduce((sum, x, i) => sum + x * this.attitude[i], 0) < 0 ? -1 : 1;
      const mixed = mix(this.attitude, vehicle.attitude.map((x) => x * sign), share);
      const length = Math.hypot(...mixed) || 1;
      this.attitude = mixed.map((x) => x / length);
    }
    if (vehicle.yaw_rad !== null) {
      const turn = Math.atan2(Math.sin(vehicle.yaw_rad - this.yaw), Math.cos(vehicle.yaw_rad - this.yaw));
      this.yaw += turn * (1 - Math.exp(-seconds * 2.5));
    }
  }
}

// ---------------------------------------------------------------- the picture in three dimensions

/** North, east, down become x east, y up, z south. */
const toScene = ([north, east, down]) => [east, -down, -north];

class Picture3D {
  static async open(canvas) {
    const THREE = await import("./three.module.min.js");
    return new Picture3D(THREE, canvas);
  }

  constructor(THREE, canvas) {
    this.THREE = THREE;
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.world = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(55, 1, 0.1, 400);
    this.motion = new Motion();
    this.sun = new THREE.DirectionalLight(0xffffff, 1.6);
    this.sun.position.set(40, 90, 30);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x777766, 1.5);
    this.world.add(this.sun, this.sky);
    this.ground = new THREE.Mesh(new THREE.CircleGeometry(260, 48).rotateX(-Math.PI / 2), new THREE.MeshBasicMaterial());
    this.world.add(this.ground);
    const box = new THREE.BoxGeometry(1, 1, 1);
    this.boxes = {
      map: this.instanced(box, new THREE.MeshLambertMaterial(), 8192),
      far: this.instanced(box, new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.55 }), 8192),
    };
    this.dots = {
      border: this.points(0x4a90e2, 0.07, 0.35),
      cloud: this.points(0xffa726, 0.05, 0.95),
    };
    this.paint = new THREE.MeshBasicMaterial({ vertexColors: true });
    this.tubes = {
      line: new THREE.Mesh(new THREE.BufferGeometry(), this.paint),
      trail: new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ color: 0xffffff, transparent: true, opacity: 0.75 })),
      guide: new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ color: 0xb07cff, transparent: true, opacity: 0.8 })),
    };
    const thin = (colour, opacity) => new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity });
    this.corridor = new THREE.LineSegments(new THREE.BufferGeometry(), thin(0x24a0ed, 0.75));
    this.ring = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({
      vertexColors: true, transparent: true, opacity: 0.6, side: THREE.DoubleSide, depthWrite: false,
    }));
    this.rest = new THREE.Mesh(new THREE.TorusGeometry(0.32, 0.05, 8, 28).rotateX(Math.PI / 2), new THREE.MeshBasicMaterial({ color: 0xf2542d }));
    this.goal = this.makeGoal();
    this.drone = this.makeDrone();
    // Seen through what stands before it: the vehicle as a circle, its way as a pale line.
    this.mark = new THREE.Mesh(new THREE.RingGeometry(0.36, 0.4, 40), new THREE.MeshBasicMaterial({
      color: 0xff5a36, transparent: true, opacity: 0.55, depthTest: false, fog: false,
    }));
    this.ghost = new THREE.Mesh(this.tubes.line.geometry, new THREE.MeshBasicMaterial({
      vertexColors: true, transparent: true, opacity: 0.3, depthTest: false, side: THREE.DoubleSide,
    }));
    this.moving = new THREE.Group();
    this.shadow = new THREE.Mesh(new THREE.CircleGeometry(0.5, 24).rotateX(-Math.PI / 2),
      new THREE.MeshBasicMaterial({ color: 0x000000, transparent: true, opacity: 0.28, depthWrite: false }));
    this.world.add(...Object.values(this.tubes), this.corridor, this.ring, this.rest, this.goal, this.drone, this.mark, this.ghost, this.moving, this.shadow);
    this.world.traverse((part) => (part.frustumCulled = false));
    this.trailPoints = [];
    this.corridorOf = null;
    this.window = null;
    this.cellsOf = {};
    this.colours();
    isDark.addEventListener("change", () => this.colours());
    Object.assign(this, { before: performance.now(), pace: 0.03, coarse: 0 });
    this.renderer.setAnimationLoop(() => this.draw());
  }

  colours() {
    const { THREE } = this;
    this.ground.material.color = new THREE.Color(css("--ground"));
    this.world.fog = new THREE.Fog(new THREE.Color(css("--sky-low")), 22, 85);
    if (this.grid) this.world.remove(this.grid, this.fineGrid);
    const colour = new THREE.Color(css("--grid"));
    this.grid = new THREE.GridHelper(200, 20, colour, colour);
    this.fineGrid = new THREE.GridHelper(200, 100, colour, colour);
    for (const [grid, opacity] of [[this.grid, 0.9], [this.fineGrid, 0.35]]) {
      Object.assign(grid.material, { transparent: true, opacity, depthWrite: false });
      grid.frustumCulled = false;
    }
    this.world.add(this.grid, this.fineGrid);
    this.tubes.trail.material.color = new THREE.Color(isDark.matches ? 0xdfe9ff : 0x31506f);
    this.sun.intensity = isDark.matches ? 1.1 : 2.0;
    this.sky.intensity = isDark.matches ? 0.9 : 1.7;
    for (const name of Object.keys(this.cellsOf)) this.cells(name, this.cellsOf[name]);
  }

  instanced(geometry, material, room) {
    const mesh = new this.THREE.InstancedMesh(geometry, material, room);
    mesh.instanceColor = new this.THREE.InstancedBufferAttribute(new Float32Array(3 * room), 3);
    Object.assign(mesh, { count: 0, frustumCulled: false });
    this.world.add(mesh);
    return mesh;
  }

  points(colour, size, opacity) {
    const { THREE } = this;
    const material = new THREE.PointsMaterial({ color: colour, size, transparent: true, opacity, depthWrite: false });
    const points = new THREE.Points(new THREE.BufferGeometry(), material);
    points.frustumCulled = false;
    this.world.add(points);
    return points;
  }

  makeDrone() {
    const { THREE } = this;
    const drone = new THREE.Group(), radius_m = 0.3;
    const dark = new THREE.MeshLambertMaterial({ color: 0x2b3138 }), bright = new THREE.MeshLambertMaterial({ color: 0xe8edf2 });
    const add = (geometry, material, x, y, z) => {
      const mesh = new THREE.Mesh(geometry, material);
      mesh.position.set(x, y, z);
      drone.add(mesh);
      return mesh;
    };
    add(new THREE.BoxGeometry(0.17, 0.07, 0.24), bright, 0, 0.01, 0);
    add(new THREE.BoxGeometry(0.11, 0.05, 0.13), dark, 0, 0.06, 0.01);
    // What shows where its front is.
    add(new THREE.ConeGeometry(0.05, 0.12, 14).rotateX(-Math.PI / 2), new THREE.MeshBasicMaterial({ color: 0xff5a36 }), 0, 0.02, -0.18);
    this.rotors = [];
    for (const [x, z] of [[1, -1], [1, 1], [-1, 1], [-1, -1]]) {
      const reach = radius_m * 0.62;
      const arm = add(new THREE.BoxGeometry(0.035, 0.028, 0.4), dark, (x * reach) / 2, 0, (z * reach) / 2);
      arm.rotation.y = Math.atan2(x, z);
      arm.scale.z = 0.7;
      add(new THREE.CylinderGeometry(0.028, 0.034, 0.07, 10), dark, x * reach, 0.03, z * reach);
      const disc = new THREE.MeshBasicMaterial({ color: z < 0 ? 0xff8a65 : 0x9fb8cc, transparent: true, opacity: 0.38, side: THREE.DoubleSide, depthWrite: false });
      add(new THREE.CircleGeometry(0.135, 22).rotateX(-Math.PI / 2), disc, x * reach, 0.072, z * reach);
      this.rotors.push(add(new THREE.BoxGeometry(0.26, 0.008, 0.02), dark, x * reach, 0.073, z * reach));
    }
    for (const x of [-0.1, 0.1]) add(new THREE.BoxGeometry(0.015, 0.11, 0.2), dark, x, -0.06, 0);
    drone.matrixAutoUpdate = false;
    return drone;
  }

  makeGoal() {
    const { THREE } = this;
    const goal = new THREE.Group(), colour = 0x18b26b;
    const beam = new THREE.Mesh(new THREE.CylinderGeometry(0.28, 0.28, 60, 20, 1, true),
      new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.2, side: THREE.DoubleSide, depthWrite: false, fog: false }));
    const target = new THREE.Mesh(new THREE.TorusGeometry(0.5, 0.07, 10, 32).rotateX(Math.PI / 2), new THREE.MeshBasicMaterial({ color: colour, fog: false }));
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.16, 16, 12), new THREE.MeshBasicMaterial({ color: colour, fog: false }));
    goal.add(beam, target, ball);
    goal.beam = beam;
    goal.visible = false;
    return goal;
  }

  /** Cells as boxes (map, far) or dots (border). */
  cells(name, cells) {
    this.cellsOf[name] = cells;
    const { edge, min, count, offsets } = cells;
    const centre = (index, axis) => (min[axis] + offsets[3 * index + axis] + 0.5) * edge;
    if (name === "border") {
      const places = new Float32Array(3 * count);
      for (let i = 0; i < count; i++) places.set(toScene([centre(i, 0), centre(i, 1), centre(i, 2)]), 3 * i);
      this.setDots("border", places);
      return;
    }
    if (name === "map") this.window = [0, 1, 2].map((axis) => [min[axis] * edge, (min[axis] + [128, 128, 64][axis]) * edge]);
    let mesh = this.boxes[name];
    if (mesh.instanceMatrix.count < count) {
      this.world.remove(mesh);
      mesh.dispose();
      mesh = this.boxes[name] = this.instanced(mesh.geometry, mesh.material, Math.ceil(count * 1.5));
      mesh.visible = shown[name];
    }
    const places = mesh.instanceMatrix.array, colours = mesh.instanceColor.array, ramp = heights();
    const size = edge * 0.97, ground = this.groundDown(), isFar = name === "far";
    let used = 0;
    for (let i = 0; i < count; i++) {
      const at = [centre(i, 0), centre(i, 1), centre(i, 2)];
      if (isFar && this.window && this.window.every(([low, high], axis) => at[axis] > low && at[axis] < high)) continue;
      const [x, y, z] = toScene(at), height = ground - at[2];
      // Ground that is seen is no obstacle to look at: tiles instead of boxes.
      const isGround = height < GROUND_M, thick = isGround ? size * 0.25 : size;
      places.set([size, 0, 0, 0, 0, thick, 0, 0, 0, 0, size, 0, x, y - (size - thick) / 2, z, 1], 16 * used);
      // The same cell has the same shade in every map, so that nothing flickers.
      const grain = ((Math.imul(min[0] + offsets[3 * i], 73856093) ^ Math.imul(min[1] + offsets[3 * i + 1], 19349663) ^ Math.imul(min[2] + offsets[3 * i + 2], 83492791)) >>> 8) % 100;
      const colour = isGround ? ramp[0] : ofRamp(ramp.slice(1), (height - GROUND_M) / HIGHEST_M);
      const shade = 0.86 + 0.28 * (grain / 100);
      for (let c = 0; c < 3; c++) colours[3 * used + c] = colour[c] * colour[c] * shade;
      used++;
    }
    mesh.count = used;
    mesh.instanceMatrix.needsUpdate = mesh.instanceColor.needsUpdate = true;
  }

  cloud(origin, offsets) {
    const places = new Float32Array(offsets.length);
    for (let i = 0; i < offsets.length; i += 3) {
      places.set(toScene([0, 1, 2].map((axis) => origin[axis] + offsets[i + axis] / 100)), i);
    }
    this.setDots("cloud", places);
  }

  setDots(name, places) {
    const { geometry } = this.dots[name];
    geometry.setAttribute("position", new this.THREE.BufferAttribute(places, 3));
  }

  trail(points) {
    this.trailPoints = Array.from({ length: points.length / 3 }, (_, i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]]);
    this.tube("trail", this.trailPoints, 0.02);
  }

  toggled(name) {
    if (name === "corridor") this.corridorOf = null;
    if (this.boxes[name]) this.boxes[name].visible = shown[name];
    if (this.dots[name]) this.dots[name].visible = shown[name];
  }

  groundDown() {
    const vehicle = now.scene?.vehicle;
    return vehicle?.home_down_m ?? 0;
  }

  /** A tube with four sides along points; colours, if there are any, one for each. */
  tube(name, points, radius, colours) {
    const { THREE } = this, mesh = this.tubes[name];
    const count = points.length;
    const geometry = new THREE.BufferGeometry();
    if (count > 1) {
      const places = new Float32Array(count * 12), paint = new Float32Array(count * 12), faces = [];
      const at = points.map((point) => new THREE.Vector3(...toScene(point)));
      const along = new THREE.Vector3(), side = new THREE.Vector3(1, 0, 0), over = new THREE.Vector3();
      for (let i = 0; i < count; i++) {
        along.subVectors(at[Math.min(i + 1, count - 1)], at[Math.max(i - 1, 0)]);
        if (along.lengthSq() > 1e-8) {
          along.normalize();
          over.set(0, 1, 0);
          if (Math.abs(along.y) > 0.98) over.set(1, 0, 0);
          side.crossVectors(along, over).normalize();
          over.crossVectors(side, along);
        }
        [[1, 0], [0, 1], [-1, 0], [0, -1]].forEach(([a, b], corner) => {
          const place = at[i].clone().addScaledVector(side, a * radius).addScaledVector(over, b * radius);
          place.toArray(places, 12 * i + 3 * corner);
          if (colours) paint.set(colours[i].map((x) => x * x), 12 * i + 3 * corner);
          if (i + 1 < count) {
            const [p, q] = [4 * i + corner, 4 * i + ((corner + 1) % 4)];
            faces.push(p, q, p + 4, q, q + 4, p + 4);
          }
        });
      }
      geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
      if (colours) geometry.setAttribute("color", new THREE.BufferAttribute(paint, 3));
      geometry.setIndex(faces);
    }
    mesh.geometry.dispose();
    mesh.geometry = geometry;
    mesh.visible = count > 1;
    mesh.material.side = THREE.DoubleSide;
  }

  scene(scene) {
    const { approved, route, ring, moving, vehicle } = scene;
    const line = approved && !approved.stale ? approved.line : [];
    this.tube("line", line, 0.055, lineColours(approved ?? { line: [] }));
    Object.assign(this.ghost, { geometry: this.tubes.line.geometry, visible: line.length > 1 });
    this.rest.visible = line.length > 0;
    if (line.length) this.rest.position.set(...toScene(line[line.length - 1]));
    const guide = route && shown.guide ? route.guide.filter((point) => !point.includes(null)) : [];
    this.tube("guide", guide, 0.025);
    this.goal.visible = Boolean(route?.goal);
    if (route?.goal) this.goal.position.set(...toScene(route.goal));
    this.showCorridor(shown.corridor && route && !route.stale ? route : null);
    this.showRing(shown.ring ? ring : null);
    this.showMoving(moving && !moving.stale ? moving.obstacles : []);
    if (vehicle?.at && !vehicle.at.includes(null) && !vehicle.stale) this.follow(vehicle.at);
    this.tubes.trail.visible = shown.trail && this.trailPoints.length > 1;
  }

  /** Adds where it is to the trail; the whole comes every few seconds. */
  follow(at) {
    const last = this.trailPoints.at(-1);
    if (last && Math.hypot(...at.map((x, axis) => x - last[axis])) < 0.15) return;
    this.trailPoints.push(at);
    this.tube("trail", this.trailPoints, 0.02);
  }

  showCorridor(route) {
    const { THREE } = this;
    this.corridor.visible = Boolean(route);
    if (!route || this.corridorOf === route.plan) return;
    this.corridorOf = route.plan;
    const ends = route.corridor.flatMap(edgesOf).flatMap((edge) => edge.map(toScene)).flat();
    this.corridor.geometry.dispose();
    this.corridor.geometry = new THREE.BufferGeometry();
    this.corridor.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(ends), 3));
  }

  showRing(ring) {
    const { THREE } = this;
    this.ring.visible = Boolean(ring) && ring.yaw_rad !== null;
    if (!this.ring.visible) return;
    const places = [], paint = [], faces = [];
    ring.sectors.forEach((sector, index) => {
      if (!sector || sector[0] <= 0) return;
      const [far_m, isHit] = sector, shownAt = Math.min(far_m, isHit ? 30 : 10);
      const colour = ring.stale ? [0.5, 0.5, 0.5] : isHit ? ofRamp([[0.95, 0.2, 0.12], [0.98, 0.7, 0.2], [0.5, 0.75, 0.6]], (far_m - 1) / 7) : [0.45, 0.62, 0.55];
      const first = places.length / 3;
      for (const edge of [-0.47, 0.47]) {
        const bearing = ring.yaw_rad + (index + edge) * ring.width_rad;
        for (const reach of [shownAt, Math.max(0, shownAt - (isHit ? 0.22 : 0.05))]) {
          places.push(...toScene([ring.at[0] + Math.cos(bearing) * reach, ring.at[1] + Math.sin(bearing) * reach, ring.at[2]]));
          paint.push(...colour);
        }
      }
      faces.push(first, first + 1, first + 2, first + 1, first + 3, first + 2);
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(paint), 3));
    geometry.setIndex(faces);
    this.ring.geometry.dispose();
    this.ring.geometry = geometry;
  }

  showMoving(obstacles) {
    const { THREE } = this;
    for (const child of [...this.moving.children]) {
      child.geometry?.dispose();
      this.moving.remove(child);
    }
    this.movingPaint ??= new THREE.MeshLambertMaterial({ color: 0xff9d1f, transparent: true, opacity: 0.6 });
    for (const { at, velocity, radius_m, half_height_m } of obstacles) {
      const body = new THREE.Mesh(new THREE.CylinderGeometry(radius_m, radius_m, 2 * half_height_m, 18), this.movingPaint);
      body.position.set(...toScene(at));
      const speed = Math.hypot(...velocity);
      this.moving.add(body);
      if (speed > 0.1) {
        const along = new THREE.Vector3(...toScene(velocity)).normalize();
        this.moving.add(new THREE.ArrowHelper(along, body.position, radius_m + speed, 0xff9d1f, 0.3, 0.2));
      }
    }
  }

  draw() {
    if (document.hidden) return;
    const { THREE, canvas, camera, motion } = this;
    const time = performance.now(), seconds = Math.min(0.2, (time - this.before) / 1000);
    this.before = time;
    const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
    if (!wide || !high) return;
    // A machine that draws slowly draws coarsely, rather than late.
    this.pace = 0.9 * this.pace + 0.1 * seconds;
    if (this.pace > 0.07 && this.coarse < 2) Object.assign(this, { coarse: this.coarse + 1, pace: 0.03 });
    const ratio = Math.min(devicePixelRatio, 2) / (1 + 0.4 * this.coarse);
    if (this.size !== `${wide} ${high} ${ratio}`) {
      this.size = `${wide} ${high} ${ratio}`;
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(wide, high, false);
      camera.aspect = wide / high;
      camera.updateProjectionMatrix();
    }
    const vehicle = now.scene?.vehicle;
    motion.step(vehicle, seconds);
    this.drone.visible = this.shadow.visible = this.mark.visible = Boolean(motion.at);
    const ground = this.groundDown();
    if (motion.at) {
      this.poseDrone(motion, vehicle, time);
      this.shadow.position.set(...toScene([motion.at[0], motion.at[1], ground - 0.02]));
    }
    const centre = motion.at ?? [0, 0, -2];
    const snap = (x) => Math.round(x / 10) * 10;
    for (const part of [this.grid, this.fineGrid]) part.position.set(snap(centre[1]), -ground + 0.01, -snap(centre[0]));
    this.ground.position.set(centre[1], -ground - 0.02, -centre[0]);
    this.aim(centre);
    this.mark.quaternion.copy(camera.quaternion);
    this.renderer.render(this.world, camera);
  }

  poseDrone(motion, vehicle, time) {
    const { THREE } = this;
    const axis = (x, y, z) => new THREE.Vector3(...toScene(turned(motion.attitude, [x, y, z])));
    const [forward, right, down] = [axis(1, 0, 0), axis(0, 1, 0), axis(0, 0, 1)];
    // Larger where it is seen from afar: it is what one looks for.
    const scale = Math.max(1.5, look.distance / 10);
    this.drone.matrix.makeBasis(right.multiplyScalar(scale), down.multiplyScalar(-scale), forward.multiplyScalar(-scale));
    this.drone.matrix.setPosition(...toScene(motion.at));
    this.mark.position.set(...toScene(motion.at));
    this.mark.scale.setScalar(scale);
    if (vehicle?.armed) this.rotors.forEach((rotor, i) => (rotor.rotation.y = (i % 2 ? 1 : -1) * time * 0.03));
  }

  aim(centre) {
    const { camera } = this;
    const isTop = look.view === "top";
    this.goal.beam.visible = !isTop;
    const pitch = isTop ? 1.55 : look.pitch;
    const yaw = look.view === "follow" ? this.motion.yaw + look.turn : look.turn + (isTop ? 0 : 0.6);
    // A narrow picture needs more distance to show as much.
    const distance = look.distance * Math.max(1, 1.15 / camera.aspect);
    const back = [-Math.cos(yaw) * Math.cos(pitch), -Math.sin(yaw) * Math.cos(pitch), -Math.sin(pitch)];
    const lift = look.view === "follow" ? 0.35 : 0;
    const eye = centre.map((x, i) => x + back[i] * distance);
    eye[2] = Math.min(eye[2], this.groundDown() - 0.3);
    camera.position.set(...toScene(eye));
    camera.lookAt(...toScene([centre[0], centre[1], centre[2] - lift]));
  }
}

/** A vector of the body as one of the local frame. */
function turned([w, x, y, z], [a, b, c]) {
  const [tx, ty, tz] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
}

/** The edges of a convex piece of space: for each pair of planes what is left of their line within all others. */
function edgesOf(planes) {
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
  const edges = [];
  for (let i = 0; i < planes.length; i++) {
    for (let j = i + 1; j < planes.length; j++) {
      const [p, q] = [planes[i], planes[j]], along = cross(p, q), square = dot(along, along);
      if (square < 1e-6) continue;
      const [pq, qp] = [cross(along, p), cross(q, along)];
      const start = [0, 1, 2].map((k) => (p[3] * qp[k] + q[3] * pq[k]) / square);
      let [low, high] = [-1e3, 1e3];
      for (let k = 0; k < planes.length && low < high; k++) {
        if (k === i || k === j) continue;
        const [slope, room] = [dot(planes[k], along), planes[k][3] - dot(planes[k], start)];
        if (Math.abs(slope) < 1e-9) {
          if (room < -1e-3) high = low;
        } else if (slope > 0) high = Math.min(high, room / slope);
        else low = Math.max(low, room / slope);
      }
      if (high - low > 1e-3 && high - low < 1e3) edges.push([low, high].map((t) => start.map((x, k) => x + along[k] * t)));
    }
  }
  return edges;
}

// ---------------------------------------------------------------- the picture as a plan from above, without WebGL

class Picture2D {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.motion = new Motion();
    this.parts = {};
    this.way = [];
    this.before = performance.now();
    // A plan that is drawn by the processor: five times a second are enough.
    setInterval(() => this.draw(), 200);
  }

  cells(name, cells) {
    this.parts[name] = cells;
  }

  cloud() {}
  scene() {}
  toggled() {}

  trail(points) {
    this.way = Array.from({ length: points.length / 3 }, (_, i) => [points[3 * i], points[3 * i + 1]]);
  }

  draw() {
    const { canvas, pen, motion } = this, scene = now.scene;
    if (document.hidden || !scene || !pen) return;
    const time = performance.now();
    motion.step(scene.vehicle, Math.min(1, (time - this.before) / 1000));
    this.before = time;
    const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
    Object.assign(canvas, { width: wide, height: high });
    pen.fillStyle = css("--ground");
    pen.fillRect(0, 0, wide, high);
    const centre = motion.at ?? [0, 0, 0], scale = Math.min(wide, high) / (look.distance * 1.1);
    const place = ([north, east]) => [wide / 2 + (east - centre[1]) * scale, high / 2 - (north - centre[0]) * scale];
    const ground = scene.vehicle?.home_down_m ?? 0, ramp = heights();
    for (const name of ["far", "border", "map"]) {
      const cells = this.parts[name];
      if (!cells || !shown[name]) continue;
      pen.globalAlpha = name === "map" ? 1 : 0.35;
      for (let i = 0; i < cells.count; i++) {
        const at = [0, 1, 2].map((axis) => (cells.min[axis] + cells.offsets[3 * i + axis] + 0.5) * cells.edge);
        const height = ground - at[2];
        if (height < GROUND_M) continue;
        const [x, y] = place(at);
        const colour = name === "border" ? [0.29, 0.56, 0.89] : ofRamp(ramp.slice(1), (height - GROUND_M) / HIGHEST_M);
        pen.fillStyle = `rgb(${colour.map((c) => Math.round(255 * c)).join()})`;
        pen.fillRect(x - (cells.edge * scale) / 2, y - (cells.edge * scale) / 2, cells.edge * scale + 0.5, cells.edge * scale + 0.5);
      }
    }
    pen.globalAlpha = 1;
    const stroke = (points, style, width) => {
      pen.beginPath();
      points.forEach((point, i) => pen[i ? "lineTo" : "moveTo"](...place(point)));
      Object.assign(pen, { strokeStyle: style, lineWidth: width, lineJoin: "round" });
      pen.stroke();
    };
    if (shown.trail) stroke(this.way, css("--soft"), 2);
    if (shown.guide && scene.route) stroke(scene.route.guide, "#b07cff", 2);
    const { approved } = scene;
    if (approved && !approved.stale) {
      lineColours(approved).forEach((colour, i) => {
        if (i) stroke(approved.line.slice(i - 1, i + 1), `rgb(${colour.map((c) => Math.round(255 * c)).join()})`, 4);
      });
    }
    if (scene.route?.goal) {
      pen.beginPath();
      pen.arc(...place(scene.route.goal), 9, 0, 7);
      Object.assign(pen, { strokeStyle: "#18b26b", lineWidth: 3 });
      pen.stroke();
    }
    for (const { at, radius_m } of scene.moving?.obstacles ?? []) {
      pen.beginPath();
      pen.arc(...place(at), radius_m * scale, 0, 7);
      pen.fillStyle = "#ff9d1f99";
      pen.fill();
    }
    if (motion.at) {
      pen.save();
      pen.translate(...place(motion.at));
      pen.rotate(motion.yaw);
      pen.fillStyle = "#ff5a36";
      pen.beginPath();
      [[0, -14], [9, 10], [0, 5], [-9, 10]].forEach((corner, i) => pen[i ? "lineTo" : "moveTo"](...corner));
      pen.fill();
      pen.restore();
    }
  }
}

// ---------------------------------------------------------------- begin

async function openPicture() {
  let canvas = $("picture");
  try {
    picture = await Picture3D.open(canvas);
  } catch (problem) {
    // A canvas that was asked for WebGL once gives nothing else any more.
    const plain = canvas.cloneNode();
    canvas.replaceWith(plain);
    canvas = plain;
    picture = new Picture2D(canvas);
    $("no-picture").hidden = false;
    $("no-picture").textContent = `A plan from above instead of the picture: this browser gives no WebGL (${problem.message}).`;
    $("views").hidden = true;
    look.distance = DISTANCES.top;
  }
  buildViews(canvas);
  for (const [name] of LAYERS) picture.toggled(name);
  early.forEach(takeBytes);
  early.clear();
}

buildLayers();
buildTabs();
connect();
setInterval(() => {
  showLost();
  if (isOpen("events")) showEvents();
  if (isOpen("recordings")) showRecordings();
  $("ramp-max").textContent = `${fixed(maxSpeed())} m/s`;
}, 1000);
await openPicture();
