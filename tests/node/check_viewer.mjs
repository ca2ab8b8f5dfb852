// Opens logs in Foxglove Studio itself, the last one that was free, with the layout that each log brings along.
//
// node check_viewer.mjs LOG.mcap...: serves the viewer, the logs and their layouts on loopback, and counts what holds and what does not.
// The browser is Debian's chromium, or what CHROMIUM names; WebGL is drawn in software.

import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import { createReadStream, statSync } from "node:fs";
import { open, readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { basename, dirname, join } from "node:path";
import { chromium } from "playwright-core";

const require = createRequire(import.meta.url);
const place = (name) => dirname(require.resolve(`${name}/package.json`));
const FOLDERS = [join(place("@foxglove/studio-base"), "assets"), join(place("react"), "umd"), join(place("react-dom"), "umd")];

let passed = 0, failed = 0;
function check(what, holds, found) {
  if (holds) passed++;
  else failed++;
  if (!holds) console.log(`failed: ${what}${found === undefined ? "" : `: ${JSON.stringify(found)}`}`);
}

/** The page that holds the viewer: one layout, one source of data, nothing remembered. */
const PAGE = `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><style>html,body,#root{height:100%;margin:0}</style><div id="root"></div>
<script>window.process = { env: {} }; window.global = window;</script>
<script src="react.production.min.js"></script><script src="react-dom.production.min.js"></script>
<script>window.react = React; window["react-dom"] = ReactDOM;</script><script src="index.js"></script>
<script type="module">
const data = await (await fetch("layout.json" + location.search)).json();
const layout = { id: "own", name: "own", permission: "CREATOR_WRITE", baseline: { data, savedAt: new Date().toISOString() } };
localStorage.setItem("studio.profile-data", JSON.stringify({ currentLayoutId: "own" }));
const layoutStorage = { list: async () => [layout], get: async () => layout, put: async (_, changed) => changed, delete: async () => {}, importLayouts: async () => {} };
const appConfiguration = { get: (key) => ({ colorScheme: "light" })[key], set: async () => {}, addChangeListener() {}, removeChangeListener() {} };
await initI18n();
const deepLinks = [location.origin + "/?ds=remote-file&ds.url=" + encodeURIComponent(location.origin + "/log.mcap" + location.search)];
ReactDOM.render(React.createElement(App, { deepLinks, appConfiguration, layoutStorage, dataSources: [new RemoteDataSourceFactory()], extensionLoaders: [], enableGlobalCss: true }), document.getElementById("root"));
</script>`;

/** The layout that a log brings along. */
async function layoutOf(log) {
  const file = await open(log);
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const bytes = new Uint8Array(Number(length));
      await file.read(bytes, 0, bytes.length, Number(offset));
      return bytes;
    },
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) } });
  for await (const attachment of reader.readAttachments({ name: "layout.json" })) {
    await file.close();
    return JSON.parse(new TextDecoder().decode(attachment.data));
  }
  throw new Error(`${log} has no layout`);
}

/** How a line of the log begins in the panel of words. */
const LOG_LINE = /\[\s*(INFO|WARN)\]\[/;

/** Where the bar of time is in the middle of the take. */
const TIME_BAR = [640, 744];

const served = new Map();
const TYPES = { html: "text/html", js: "text/javascript", wasm: "application/wasm", json: "application/json" };
const server = createServer((request, response) => {
  const { pathname, search } = new URL(request.url, "http://localhost");
  const answer = (type, body) => response.writeHead(200, { "content-type": type }).end(body);
  if (pathname === "/") return answer("text/html", PAGE);
  if (pathname === "/layout.json") return answer("application/json", JSON.stringify(served.get(search).layout));
  const path = pathname === "/log.mcap" ? served.get(search).log : FOLDERS.map((folder) => join(folder, basename(pathname))).find((p) => statSync(p, { throwIfNoEntry: false }));
  if (!path) return response.writeHead(404).end();
  const size = statSync(path).size;
  const range = /bytes=(\d+)-(\d*)/.exec(request.headers.range ?? "");
  const start = range ? Number(range[1]) : 0, end = range && range[2] ? Math.min(Number(range[2]), size - 1) : size - 1;
  const head = { "content-type": TYPES[path.split(".").at(-1)] ?? "application/octet-stream", "accept-ranges": "bytes", "content-length": end - start + 1 };
  response.writeHead(range ? 206 : 200, range ? { ...head, "content-range": `bytes ${start}-${end}/${size}` } : head);
  if (request.method === "HEAD") response.end();
  else createReadStream(path, { start, end }).pipe(response);
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
  headless: true,
  args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});

/** Opens a log, and watches that the viewer does not complain. Without `own` changes of the layout it is the log's. */
async function look(name, log, layout) {
  const key = `?${served.size}`;
  served.set(key, { log, layout });
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 800 } })).newPage();
  const complaints = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  await page.goto(`http://127.0.0.1:${server.address().port}/${key}`);
  await page.getByText("/skeleton").first().waitFor({ timeout: 60_000 });
  await page.locator("canvas").first().waitFor({ timeout: 60_000 });
  // the panel of words speaks when the log's messages have come; if it never does, a check says so
  await page.getByText(LOG_LINE).first().waitFor({ timeout: 60_000 }).catch(() => {});
  await settle(page);
  return {
    page,
    async close() {
      check(`${name}: the viewer has no complaint`, complaints.length === 0, complaints);
      await page.context().close();
    },
  };
}

const scene = async (page) => (await page.locator("canvas").first().screenshot()).toString("base64");

/** Waits until the picture of the take has stood still for a while. */
async function settle(page) {
  for (let before = "", now, still = 0, k = 0; still < 2 && k < 60; k++, before = now) {
    await page.waitForTimeout(500);
    now = await scene(page);
    still = now === before ? still + 1 : 0;
  }
}

/**
 * The colours near the beginning of the take, as soon as they are as they should be; after a while, as they are.
 * Sometimes the viewer asks for the first frame before its panels listen, and shows nothing until somebody moves to another time.
 */
async function beginning(page, shown) {
  for (let k = 0; ; k++) {
    // going to where it is already would tell a panel nothing
    await page.mouse.click(...TIME_BAR);
    await settle(page);
    await page.mouse.click(30, TIME_BAR[1]);
    await settle(page);
    const told = await colours(await scene(page));
    if (shown(told) || k === 5) return told;
  }
}

/** Pixels of colours that are told apart: those that a second picture has otherwise, bluish, and of any other strong colour. */
const desk = await (await browser.newContext()).newPage();
function colours(png, other = png) {
  return desk.evaluate(async ([a, b]) => {
    const pixels = async (png) => {
      const image = new Image();
      image.src = `data:image/png;base64,${png}`;
      await image.decode();
      const canvas = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      return context.getImageData(0, 0, image.width, image.height).data;
    };
    const [p, q] = [await pixels(a), await pixels(b)];
    const told = { different: 0, blue: 0, strange: 0 };
    for (let at = 0; at < p.length; at += 4) {
      const [red, green, blue] = p.subarray(at, at + 3);
      const strong = Math.max(red, green, blue) - Math.min(red, green, blue) > 60;
      told.different += Math.abs(red - q[at]) + Math.abs(green - q[at + 1]) + Math.abs(blue - q[at + 2]) > 60;
      told.blue += strong && blue > green && green > red;
      // orange is what was filled
      told.strange += strong && !(blue > green && green > red) && !(red > green && green > blue);
    }
    return told;
  }, [png, other]);
}

for (const log of process.argv.slice(2)) {
  const name = basename(log);
  const layout = await layoutOf(log);
  const { page, close } = await look(name, log, layout);
  const text = await page.locator("body").innerText();
  // panels of words have no title
  const titles = Object.entries(layout.configById).filter(([id]) => /^(3D|Plot|StateTransitions)!/.test(id)).map(([, panel]) => panel.foxglovePanelTitle);
  check(`${name}: the panels are there`, titles.length >= 5 && titles.every((title) => text.includes(title)), [titles, text.slice(0, 2000)]);
  check(`${name}: the log is told`, LOG_LINE.test(text), text.slice(0, 3000));
  const first = await scene(page);
  await page.mouse.click(...TIME_BAR);
  await settle(page);
  const seen = await colours(first, await scene(page));
  check(`${name}: the take moves`, seen.different > 500, seen);
  await page.getByText("Problems", { exact: true }).click();
  await page.waitForTimeout(300);
  check(`${name}: the viewer finds no problem`, /No (issues|problems)/i.test(await page.locator("body").innerText()), (await page.locator("body").innerText()).slice(0, 600));
  await close();
}

// What is drawn, and in which colours; what stands at the origin is not of the take.
{
  const log = process.argv[2], name = basename(log);
  const layout = await layoutOf(log);
  const space = layout.configById["3D!take"];
  space.scene = { ...space.scene, transforms: { visible: false, axisScale: 0 } };
  const marks = {};
  for (const [visible, shown] of [[false, (told) => told.blue > 300], [true, (told) => told.blue > marks.false.blue + 300]]) {
    space.topics["/skeleton"].visible = visible;
    const { page, close } = await look(name, log, structuredClone(layout));
    marks[visible] = await beginning(page, shown);
    await close();
  }
  check(`${name}: markers have the colours that the log gives them`, marks.false.blue > 300 && marks.false.strange < 20, marks);
  check(`${name}: bones are drawn, and blue`, marks.true.blue > marks.false.blue + 300 && marks.true.strange < 20, marks);
}

await browser.close();
server.close();
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
