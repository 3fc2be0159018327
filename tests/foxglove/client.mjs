// What `jink-foxglove live` serves, as a client that others wrote reads it.
//
//   NODE_PATH=FOLDER/node_modules node tests/foxglove/client.mjs
//
// Needs Node, the npm packages @foxglove/ws-protocol and ws (`npm install @foxglove/ws-protocol ws` in any folder), target/release/jink with
// jink-lab, and services/foxglove/target/release/jink-foxglove; says NOT TESTED without them. Exit code 1: a promise is broken.

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { createRequire } from "node:module";

const JINK = "target/release/jink";
const FOXGLOVE = "services/foxglove/target/release/jink-foxglove";
/** The newest version of the protocol that the server speaks. */
const SUBPROTOCOL = "foxglove.sdk.v1";
/** Nothing here takes longer (ms). */
const WATCHDOG_MS = 120_000;
/** Messages of each channel that are waited for. */
const MESSAGES = 10;
const INSTANCE = `foxglove_${process.pid}`;
/** Every channel that always has something to say while a vehicle with a lidar flies, and its schema. */
const CHANNELS = {
  "/tf": "foxglove.FrameTransforms",
  "/vehicle/state": "foxglove.PoseInFrame",
  "/vehicle/state/numbers": "jink.vehicle.state.numbers",
  "/vehicle/body": "foxglove.SceneUpdate",
  "/plan/route": "foxglove.SceneUpdate",
  "/plan/route/numbers": "jink.plan.route.numbers",
  "/guard/approved": "foxglove.SceneUpdate",
  "/guard/approved/poses": "foxglove.PosesInFrame",
  "/guard/approved/numbers": "jink.guard.approved.numbers",
  "/guard/ring": "foxglove.LaserScan",
  "/guard/ring/numbers": "jink.guard.ring.numbers",
  "/map/local": "foxglove.PointCloud",
  "/map/far": "foxglove.PointCloud",
  "/map/moving": "foxglove.SceneUpdate",
};
let failures = 0;

function check(promise, holds, details = "") {
  console.log(`${holds ? "ok" : "FAILED"}: ${promise}${holds || !details ? "" : ` (${details})`}`);
  failures += holds ? 0 : 1;
}

function library(name) {
  try {
    return createRequire(`${process.cwd()}/`)(name);
  } catch {
    return null;
  }
}

const protocol = library("@foxglove/ws-protocol");
const WebSocket = library("ws");
const missing = [
  [!protocol || !WebSocket, "no @foxglove/ws-protocol or no ws in NODE_PATH"],
  [!existsSync(JINK), `no ${JINK}`],
  [!existsSync(FOXGLOVE), `no ${FOXGLOVE}`],
].find(([isMissing]) => isMissing);
if (missing) {
  console.log(`NOT TESTED: jink-foxglove with a client of others (${missing[1]})`);
  process.exit(0);
}

/** A program: its output so far, and its end. */
function start(program, args) {
  const child = spawn(program, args, { env: { ...process.env, DISPLAY: "", WAYLAND_DISPLAY: "" } });
  const started = { child, output: "", stop: (signal = "SIGINT") => (child.kill(signal), started.ended) };
  for (const stream of [child.stdout, child.stderr]) stream.on("data", (text) => (started.output += text));
  started.ended = new Promise((resolve) => child.on("exit", (code) => resolve(code)));
  return started;
}

async function until(what, holds) {
  const begin = Date.now();
  while (!holds()) {
    if (Date.now() - begin > WATCHDOG_MS) throw new Error(`not within the time: ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

const fly = async () => {
  const demo = start(JINK, ["demo", "--headless", "--instance", INSTANCE, "--legs", "20", "--set", "recorder.folder="]);
  await until("a flight", () => /mode mission/.test(demo.output) || demo.child.exitCode !== null);
  return demo;
};
const live = (listen) => start(FOXGLOVE, ["live", "--instance", INSTANCE, "--listen", listen]);

/** A client that subscribes to everything, counts, and keeps the last message of each channel. */
function connect(address) {
  const client = new protocol.FoxgloveClient({ ws: new WebSocket(address, [SUBPROTOCOL]) });
  const seen = { client, channels: new Map(), counts: new Map(), last: new Map(), times: 0, isClosed: false };
  const topics = new Map();
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      seen.channels.set(channel.topic, channel);
      topics.set(client.subscribe(channel.id), channel.topic);
    }
  });
  client.on("message", ({ subscriptionId, data }) => {
    const topic = topics.get(subscriptionId);
    seen.counts.set(topic, (seen.counts.get(topic) ?? 0) + 1);
    seen.last.set(topic, data);
  });
  client.on("time", () => (seen.times += 1));
  client.on("close", () => (seen.isClosed = true));
  client.on("error", () => {});
  return seen;
}

const none = live("127.0.0.1:0");
check("nothing runs: exit code 3 and one line", (await none.ended) === 3 && none.output === `jink ${INSTANCE}: not running\n`, none.output);

let demo = await fly();
let server;
try {
  server = live("127.0.0.1:0");
  await until("an address", () => /ws:\S+\d/.test(server.output) || server.child.exitCode !== null);
  const address = server.output.match(/ws:\S+\d/)[0];
  const listen = address.replace("ws://", "");

  const taken = live(listen);
  const code = await taken.ended;
  check("the port is in use: exit code 1 and one line", code === 1 && taken.output.split("\n").length === 2 && taken.output.includes(listen), taken.output);
  const open = live("0.0.0.0:0");
  check("beyond loopback only with the flag", (await open.ended) === 1 && open.output.includes("--unprotected"), open.output);

  const refused = await new Promise((resolve) => {
    const socket = new WebSocket(address, ["foxglove.websocket.v1"]);
    socket.onopen = () => resolve(false);
    socket.onerror = () => resolve(true);
  });
  check("a client of the protocol before this one is refused", refused);

  const seen = connect(address);
  const enough = () => Object.keys(CHANNELS).filter((topic) => (seen.counts.get(topic) ?? 0) < MESSAGES);
  await until("channels", () => seen.channels.size >= Object.keys(CHANNELS).length);
  for (const [topic, schema] of Object.entries(CHANNELS)) {
    check(`${topic} is ${schema}`, seen.channels.get(topic)?.schemaName === schema, seen.channels.get(topic)?.schemaName);
  }
  const clouds = [...seen.channels.keys()].filter((topic) => topic.startsWith("/range/cloud/"));
  check("there is a cloud of a sensor", clouds.length > 0);
  await until(`messages, ${enough()}`, () => enough().length === 0 && clouds.every((topic) => seen.counts.get(topic) >= MESSAGES));
  check(`${MESSAGES} messages of each channel`, true);
  check("the time of the board is sent", seen.times > 0);
  for (const topic of Object.keys(CHANNELS).filter((topic) => topic.endsWith("/numbers"))) {
    const schema = JSON.parse(seen.channels.get(topic).schema);
    const numbers = JSON.parse(new TextDecoder().decode(seen.last.get(topic)));
    const known = Object.entries(numbers).every(([name, value]) => typeof value === "number" && name in schema.properties);
    check(`${topic} are numbers of their schema`, known, JSON.stringify(numbers));
  }

  const countAgain = async (what) => {
    seen.counts.clear();
    await until(`${what}: ${enough()}`, () => ["/plan/route", "/guard/approved", "/map/local"].every((topic) => seen.counts.get(topic) >= MESSAGES));
    check(what, true);
  };
  await start(JINK, ["restart", "--instance", INSTANCE, "planner"]).ended;
  await countAgain("a service that was started anew is shown again");
  await demo.stop();
  check("the server outlives the instance", server.child.exitCode === null && !seen.isClosed, server.output);
  demo = await fly();
  await countAgain("an instance that was started anew is shown again, to the same client");
  console.log([...seen.counts].map(([topic, count]) => `  ${topic} ${count}`).join("\n"));

  check("Ctrl-C ends it with exit code 0", (await server.stop()) === 0, server.output);
  await until("the end of the connection", () => seen.isClosed);
} finally {
  await server?.stop();
  await demo.stop();
}
console.log(failures ? `${failures} promises are broken` : "all promises are kept");
process.exit(failures ? 1 : 0);
