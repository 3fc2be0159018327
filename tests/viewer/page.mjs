// The live page in a real browser: what it shows of a flight, and what becomes of it when something is gone.
//
//   NODE_PATH=FOLDER/node_modules node tests/viewer/page.mjs [--pictures FOLDER] [ADDRESS]
//
// Needs Node, Chromium and the npm package playwright-core (`npm install playwright-core` in any folder); says NOT TESTED without them.
// Without an address it flies a demonstration of target/release/jink of its own. Exit code 1: a promise is broken.

import { spawn } from "node:child_process";
import { existsSync, mkdirSync } from "node:fs";
import { createRequire } from "node:module";

const CHROMIUM = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].find(existsSync);
/** Nothing here takes longer (ms). */
const WATCHDOG_MS = 120_000;
const arguments_ = process.argv.slice(2);
const at = arguments_.indexOf("--pictures");
const pictures = at >= 0 ? arguments_.splice(at, 2)[1] : null;
let failures = 0;

function check(promise, holds, details = "") {
  console.log(`${holds ? "ok" : "FAILED"}: ${promise}${holds || !details ? "" : ` (${details})`}`);
  failures += holds ? 0 : 1;
}

function library() {
  try {
    return createRequire(`${process.cwd()}/`)("playwright-core");
  } catch {
    return null;
  }
}

const playwright = library();
if (!playwright || !CHROMIUM) {
  console.log(`NOT TESTED: the live page in a browser (${playwright ? "no Chromium" : "no playwright-core in NODE_PATH"})`);
  process.exit(0);
}

/** A flight to look at: its address, and how it is ended. */
async function fly() {
  const demo = spawn("target/release/jink", ["demo", "--instance", `page_${process.pid}`, "--legs", "6", "--set", "recorder.folder="], {
    stdio: ["ignore", "pipe", "inherit"],
    env: { ...process.env, DISPLAY: "", WAYLAND_DISPLAY: "" },
  });
  const ended = new Promise((resolve) => demo.on("exit", resolve));
  let output = "";
  const address = await new Promise((resolve, reject) => {
    setTimeout(() => reject(new Error(`no page within the time:\n${output}`)), WATCHDOG_MS).unref();
    demo.on("exit", () => reject(new Error(`the demonstration has ended:\n${output}`)));
    demo.stdout.on("data", (text) => {
      output += text;
      const line = output.match(/watch: (\S+)/);
      if (line) resolve(line[1]);
    });
  });
  return { address, stop: () => (demo.kill("SIGINT"), ended) };
}

const flight = arguments_[0] ? { address: arguments_[0], stop: async () => {} } : await fly();
const flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
const browser = await playwright.chromium.launch({ executablePath: CHROMIUM, headless: true, args: flags });

/** Opens the page; what went wrong on it is kept. */
async function open(options, before = async () => {}) {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  page.problems = [];
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("console", (message) => message.type() === "error" && page.problems.push(message.text()));
  page.on("request", (request) => {
    if (!request.url().startsWith(flight.address) && !request.url().startsWith("data:")) page.problems.push(`asks ${request.url()}`);
  });
  page.setDefaultTimeout(WATCHDOG_MS / 2);
  await before(page);
  await page.goto(flight.address);
  return page;
}

async function picture(page, name) {
  if (!pictures) return;
  mkdirSync(pictures, { recursive: true });
  // On a machine that draws by processor and is busy, a picture may take longer than anybody waits: the promises do not hang on it.
  await page.screenshot({ path: `${pictures}/${name}.png` }).catch(() => console.log(`no picture: ${name}`));
}

try {
  const desktop = { viewport: { width: 1440, height: 900 } };
  const phone = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 };
  const page = await open({ ...desktop, colorScheme: "light" });
  await page.waitForFunction(() => document.querySelector("#health").className.includes("good"));
  await page.waitForFunction(() => Number(document.querySelector("#speed").textContent) > 0.5);
  check("a flight is shown with its words", (await page.locator("#lines li").count()) >= 3);
  check("there is a picture", await page.evaluate(() => document.querySelector("#no-picture").hidden));
  check("services are listed", (await page.locator("#services tr").count()) > 8);
  await page.waitForTimeout(6000);
  await picture(page, "desktop_light_follow");
  for (const view of ["orbit", "top"]) {
    await page.click(`[data-view=${view}]`);
    await page.waitForTimeout(1200);
    await picture(page, `desktop_light_${view}`);
  }
  await page.click("[data-view=follow]");
  for (const layer of ["newest points", "border of the unknown"]) await page.getByText(layer).click();
  await page.waitForTimeout(1500);
  await picture(page, "desktop_light_layers");
  for (const tab of ["latency", "events", "parameters", "recordings"]) {
    await page.click(`[data-tab=${tab}]`);
    await page.waitForTimeout(700);
    await picture(page, `desktop_light_${tab}`);
    check(`the tab ${tab} says something`, (await page.locator(`#${tab}`).innerText()).length > 20);
  }
  // Both change several times a second: one moment at which they agree is looked for, among many.
  await page.click("[data-tab=services]");
  const differing = async () =>
    page.evaluate(async () => {
      const figures = await (await fetch("status.json")).json();
      const shown = Object.fromEntries([...document.querySelectorAll("#services tr")].map((row) => [row.cells[0]?.textContent, row]));
      const wrong = figures.services.filter((service) => {
        const cells = [...(shown[service.name]?.cells ?? [])].map((cell) => cell.textContent.trim());
        const cycles = `${(service.cycle_p99_us / 1000).toFixed(1)} / ${(service.cycle_max_us / 1000).toFixed(1)}`;
        return cells[1] !== service.state || cells[2] !== cycles || cells[3] !== String(service.restarts);
      });
      return wrong.map((service) => service.name);
    });
  let wrong = ["not looked at"];
  for (let look = 0; look < 50 && wrong.length; look++) {
    wrong = await differing();
    await page.waitForTimeout(100);
  }
  check("the page shows the figures of status.json", wrong.length === 0, wrong.join(", "));
  check("nothing went wrong on the page, and nothing was asked of others", page.problems.length === 0, page.problems.join("; "));
  // One page at a time: each is drawn by the processor that flies.
  await page.context().close();

  const dark = await open({ ...desktop, colorScheme: "dark" });
  await dark.waitForTimeout(4000);
  await picture(dark, "desktop_dark_follow");
  await dark.context().close();
  for (const colorScheme of ["light", "dark"]) {
    const small = await open({ ...phone, colorScheme });
    await small.waitForTimeout(4000);
    await picture(small, `phone_${colorScheme}`);
    const overflow = await small.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    check(`the phone's page is as wide as the phone (${colorScheme})`, overflow <= 0, `${overflow} px`);
    await small.context().close();
  }

  const plain = await open(desktop, (page) => page.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = new Proxy(HTMLCanvasElement.prototype.getContext, {
      apply: (target, canvas, given) => (given[0].startsWith("webgl") ? null : Reflect.apply(target, canvas, given)),
    });
  }));
  await plain.waitForFunction(() => !document.querySelector("#no-picture").hidden);
  await plain.waitForFunction(() => document.querySelectorAll("#lines li").length >= 3);
  await plain.waitForTimeout(1500);
  await picture(plain, "desktop_without_webgl");
  check("without WebGL there are a plan, all words, and the reason", true);
  await flight.stop();
  if (!arguments_[0]) {
    await plain.waitForFunction(() => document.body.classList.contains("lost"));
    await picture(plain, "desktop_lost");
    check("a connection that is lost is said", (await plain.locator("#lost").innerText()).includes("connection lost"));
  }
} finally {
  await browser.close();
  await flight.stop();
}
console.log(failures ? `${failures} promises are broken` : "all promises are kept");
process.exit(failures ? 1 : 0);
