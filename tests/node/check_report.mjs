// Opens real reports in a browser, without a network, and does to them what people do.
//
// node check_report.mjs PROGRAM FOLDER: makes the reports in FOLDER with PROGRAM, and counts what holds and what does not.
// The browser is Debian's chromium, or what CHROMIUM names; WebGL is drawn in software.

import { chromium } from "playwright-core";
import { pathToFileURL } from "node:url";
import { HOSTILE, makePages } from "./pages.mjs";

const [program, folder] = process.argv.slice(2);
const pages = makePages(program, folder);

let passed = 0, failed = 0;
function check(what, holds, found) {
  if (holds) passed++;
  else failed++;
  if (!holds) console.log(`failed: ${what}${found === undefined ? "" : `: ${JSON.stringify(found)}`}`);
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
  headless: true,
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});

/** Opens a report in a context of its own, and watches that it neither complains nor asks anybody for anything. */
async function open(name, { width = 1400, height = 900, scheme = "light", before, touch = false } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: scheme, offline: true, hasTouch: touch, reducedMotion: "reduce" });
  const page = await context.newPage();
  const complaints = [], requests = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("request", (request) => requests.push(request.url()));
  page.on("dialog", (dialog) => (complaints.push(`dialog ${dialog.message()}`), dialog.dismiss()));
  if (before) await page.addInitScript(before);
  await page.goto(pathToFileURL(pages[name].path).href);
  await page.waitForSelector("main[aria-busy=false]", { timeout: 60_000 });
  await page.waitForTimeout(300);
  return {
    page,
    async close() {
      const outside = requests.slice(1).filter((url) => !url.startsWith("data:"));
      check(`${name} at ${width}, ${scheme}: no complaint in the console`, complaints.length === 0, complaints);
      check(`${name} at ${width}, ${scheme}: no request`, outside.length === 0, outside);
      await context.close();
    },
  };
}

/** Pictures of the stage are compared in a page of their own: pixels that differ, and the number of colours of the second. */
const desk = await (await browser.newContext()).newPage();
async function compare(a, b) {
  return desk.evaluate(async ([a, b]) => {
    const pixels = async (png) => {
      const image = new Image();
      image.src = `data:image/png;base64,${png}`;
      await image.decode();
      const canvas = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      return new Uint32Array(context.getImageData(0, 0, image.width, image.height).data.buffer);
    };
    const [p, q] = [await pixels(a), await pixels(b)];
    return { different: p.reduce((sum, value, k) => sum + (value !== q[k]), 0), colours: new Set(q).size };
  }, [a.toString("base64"), b.toString("base64")]);
}

const stage = (page) => page.locator(".stage").screenshot();
const frame = async (page) => Number((await page.locator("#readout").textContent()).match(/Frame (-?\d+)/)[1]);
const gapTitle = (page) => page.locator("#gap-title").textContent();
const fits = (page) => page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth);

for (const [name, { bytes }] of Object.entries(pages)) check(`${name}: below 1 MB`, bytes < 1e6, bytes);

// The player draws, plays, stops and follows the keys.
{
  const { page, close } = await open("walk");
  check("it is drawn with WebGL", (await page.locator("main").getAttribute("data-player")) === "webgl");
  await page.keyboard.press("Home");
  check("Home goes to the first frame", (await frame(page)) === 1, await frame(page));
  await page.waitForTimeout(200);
  const first = await stage(page);
  await page.keyboard.press("ArrowRight");
  check("→ goes one frame on", (await frame(page)) === 2, await frame(page));
  await page.keyboard.press("Shift+ArrowRight");
  check("Shift and → go ten frames on", (await frame(page)) === 12, await frame(page));
  await page.keyboard.press("ArrowLeft");
  check("← goes one frame back", (await frame(page)) === 11, await frame(page));
  await page.keyboard.press("End");
  check("End goes to the last frame", (await frame(page)) === 900, await frame(page));
  await page.waitForTimeout(200);
  const seen = await compare(first, await stage(page));
  check("the figure is not blank", seen.colours > 20, seen);
  check("frames look different", seen.different > 500, seen);

  await page.keyboard.press("Home");
  await page.keyboard.press("Space");
  await page.waitForTimeout(900);
  await page.keyboard.press("Space");
  const played = await frame(page);
  check("Space plays", played > 20 && played < 600, played);
  await page.waitForTimeout(300);
  check("Space pauses", (await frame(page)) === played);
  await page.keyboard.press("Home");
  await page.keyboard.press("n");
  const gap = await gapTitle(page);
  await page.keyboard.press("n");
  check("N goes to the next gap", (await gapTitle(page)) !== gap, gap);
  await page.keyboard.press("p");
  check("P goes to the gap before", (await gapTitle(page)) === gap, await gapTitle(page));
  await page.keyboard.press("-");
  check("− plays slower", (await page.locator("#player select").first().inputValue()) === "0.5");
  await page.keyboard.press("?");
  check("? shows the keys", await page.locator("dialog").evaluate((dialog) => dialog.open));
  await page.keyboard.press("Escape");
  check("Escape hides them", !(await page.locator("dialog").evaluate((dialog) => dialog.open)));

  const before = await stage(page);
  const box = await page.locator(".stage").boundingBox();
  await page.mouse.move(box.x + 100, box.y + 30);
  await page.mouse.down();
  await page.mouse.move(box.x + 220, box.y + 60, { steps: 4 });
  await page.mouse.up();
  await page.waitForTimeout(200);
  check("dragging turns the figure", (await compare(before, await stage(page))).different > 500);
  const turned = await stage(page);
  await page.mouse.wheel(0, -400); // the picture has the focus now
  await page.waitForTimeout(200);
  check("the wheel zooms", (await compare(turned, await stage(page))).different > 500);
  for (const toggle of ["Floor", "Raw", "Labels"]) {
    const was = await stage(page);
    const button = page.locator("#player").getByRole("button", { name: toggle, exact: true });
    const on = await button.getAttribute("aria-pressed");
    await button.click();
    await page.mouse.move(5, 5);
    await page.waitForTimeout(150);
    check(`${toggle} says whether it is on`, (await button.getAttribute("aria-pressed")) !== on);
    check(`${toggle} changes the picture`, (await compare(was, await stage(page))).different > 10);
  }
  await close();
}

// A click on a gap in the map, arrows in it, the table, the tiles, the charts.
{
  const { page, close } = await open("walk");
  await page.locator("#map").scrollIntoViewIfNeeded();
  const over = page.locator("#map .u-over");
  const box = await over.boundingBox();
  let hit = null;
  for (let y = 4; y < box.height && !hit; y += 5) {
    for (let x = box.width * 0.6; x < box.width && !hit; x += 12) {
      await page.mouse.move(box.x + x, box.y + y);
      const tip = page.locator("#map .tip");
      if (!(await tip.isHidden())) hit = { x, y, text: await tip.textContent() };
    }
  }
  check("a gap in the map says what it is", hit !== null && /^\S+, \d+ – \d+ \(\d+ frames?\), filled/.test(hit.text), hit);
  await page.keyboard.press("Home");
  await page.mouse.click(box.x + hit.x, box.y + hit.y);
  const [, marker, first, last] = hit.text.match(/^(\S+), (\d+) – (\d+)/);
  const now = await frame(page);
  check("a click on a gap moves the playhead into it", now >= Number(first) && now <= Number(last), [now, hit.text]);
  check("and selects it", (await gapTitle(page)) === `Gap of ${marker}`, await gapTitle(page));
  check("its row in the table says so, or is not shown yet", (await page.locator("tr[aria-current=true]").count()) <= 1);

  const title = await gapTitle(page);
  await page.locator("#map .gap-map").focus();
  await page.keyboard.press("ArrowDown");
  check("↓ goes to a gap of another marker", (await gapTitle(page)) !== title, title);
  await page.keyboard.press("ArrowUp");
  check("↑ goes back to the marker", (await gapTitle(page)) === title, await gapTitle(page));

  const link = page.locator("#map tbody button").nth(3);
  await link.click();
  check("the table selects a gap", (await gapTitle(page)) === `Gap of ${await link.textContent()}`);
  const sorter = page.locator("#map thead button", { hasText: "Frames" });
  await sorter.click();
  const lengths = await page.locator("#map tbody tr td:nth-child(4)").allTextContents();
  check("the table sorts", lengths.map(Number).every((x, k, all) => k === 0 || all[k - 1] >= x), lengths);
  check("and says how", (await page.locator("#map th[aria-sort=descending]").count()) === 1);

  await page.keyboard.press("Home");
  await page.locator("#bones .u-over").first().click({ position: { x: 300, y: 30 } });
  check("a click on a bone's length moves the playhead", (await frame(page)) > 100, await frame(page));
  await page.locator("button.tile", { hasText: "Worst uncertainty" }).click();
  check("the worst uncertainty is a jump", (await page.locator("button.tile", { hasText: "Worst uncertainty" }).textContent()).includes(`frame ${await frame(page)}`));
  await page.locator("button.tile", { hasText: "Worst bone" }).click();
  check("the worst bone error is a jump", (await page.locator("button.tile", { hasText: "Worst bone" }).textContent()).includes(`frame ${await frame(page)}`));
  await close();
}

// With the keyboard alone, everything is reached in order and can be seen to be.
{
  const { page, close } = await open("single");
  const reached = [];
  for (let k = 0; k < 60; k++) {
    await page.keyboard.press("Tab");
    const focus = await page.evaluate(() => {
      const e = document.activeElement;
      const style = getComputedStyle(e);
      const section = e.closest("section, header");
      return { place: section ? section.id : e.className || e.tagName, seen: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0, name: e.getAttribute("aria-label") || e.textContent || e.tagName };
    });
    if (focus.place === "BODY") break;
    reached.push(focus);
  }
  check("the first stop skips to the player", reached[0].place === "skip", reached[0]);
  const order = [...new Set(reached.map((f) => f.place))];
  check("the keyboard reaches the parts in order", ["top", "player", "map", "bones"].every((part, k, all) => k === 0 || order.indexOf(part) > order.indexOf(all[k - 1])), order);
  check("focus can be seen", reached.every((f) => f.seen), reached.filter((f) => !f.seen));
  const nameless = await page.evaluate(() => [...document.querySelectorAll("button, select, input, [role=img], [role=group]")].filter((e) => !(e.textContent.trim() || e.getAttribute("aria-label") || e.closest("label"))).map((e) => e.outerHTML.slice(0, 80)));
  check("every control has a name", nameless.length === 0, nameless);
  await close();
}

// Nothing is cut, and no word is broken.
for (const name of ["walk", "occluded", "spiked", "hostile"]) {
  for (const width of [360, 1600]) {
    const watching = () => {
      window.cut = [];
      window.drawn = 0;
      const fillText = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...rest) {
        const { width } = this.measureText(text);
        const start = { right: -width, end: -width, center: -width / 2 }[this.textAlign] ?? 0;
        const { a, b, e } = this.getTransform();
        window.drawn++;
        if (b === 0 && a * (x + start) + e < -1) window.cut.push(text);
        return fillText.call(this, text, x, y, ...rest);
      };
    };
    const { page, close } = await open(name, { width, before: watching });
    await page.waitForTimeout(300);
    const { cut, drawn } = await page.evaluate(() => ({ cut: window.cut, drawn: window.drawn }));
    check(`${name} at ${width}: labels of charts are whole`, drawn > 20 && cut.length === 0, [drawn, cut]);
    const lines = await page.evaluate(() => [...document.querySelectorAll("#suspects li > :first-child")].map((word) => {
      const range = document.createRange();
      range.selectNodeContents(word);
      return [word.textContent, range.getClientRects().length];
    }));
    check(`${name} at ${width}: kinds of suspicious samples stand on one line`, (lines.length > 0) === (name === "spiked") && lines.every(([, count]) => count === 1), lines);
    await close();
  }
}

// Narrow and wide, light and dark.
for (const name of Object.keys(pages)) {
  const colours = new Set();
  for (const scheme of ["light", "dark"]) {
    const { page, close } = await open(name, { width: 360, height: 740, scheme });
    check(`${name}, ${scheme}: nothing to scroll sideways at 360 px`, await fits(page));
    for (const details of await page.locator("details").all()) await details.evaluate((d) => (d.open = true));
    check(`${name}, ${scheme}: nor with everything unfolded`, await fits(page));
    colours.add(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
    await page.getByRole("button", { name: scheme === "light" ? "Dark" : "Light", exact: true }).click();
    colours.add(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
    await close();
  }
  check(`${name}: light and dark differ, and the button changes them`, colours.size === 2, [...colours]);
}

// Fingers.
{
  const { page, close } = await open("walk", { width: 390, height: 800, touch: true });
  await page.locator(".stage").scrollIntoViewIfNeeded();
  const box = await page.locator(".stage").boundingBox();
  const session = await page.context().newCDPSession(page);
  const touch = (type, ...points) => session.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x: box.x + x, y: box.y + y, id })) });
  const before = await stage(page);
  await touch("touchStart", [60, 100]);
  for (let x = 80; x <= 200; x += 20) await touch("touchMove", [x, 100]);
  await touch("touchEnd");
  await page.waitForTimeout(200);
  const turned = await stage(page);
  check("a finger turns the figure", (await compare(before, turned)).different > 300);
  await touch("touchStart", [140, 120], [180, 120]);
  for (let k = 10; k <= 60; k += 10) await touch("touchMove", [140 - k, 120], [180 + k, 120]);
  await touch("touchEnd");
  await page.waitForTimeout(200);
  check("two fingers zoom", (await compare(turned, await stage(page))).different > 300);
  await close();
}

// Paper.
for (const name of ["walk", "complete"]) {
  const { page, close } = await open(name, { scheme: "dark" });
  await page.evaluate(() => window.addEventListener("beforeprint", () => {
    const charts = [...document.querySelectorAll(".uplot")].map((chart) => chart.getBoundingClientRect().width);
    const still = document.querySelector(".stage img");
    window.printed = { widest: Math.max(0, ...charts), rows: document.querySelectorAll("#map tbody tr").length, still: still.src.length, theme: document.documentElement.dataset.theme };
  }));
  const pdf = await page.pdf({ format: "A4", printBackground: true });
  const printed = await page.evaluate(() => window.printed);
  check(`${name}: prints`, pdf.subarray(0, 5).toString() === "%PDF-" && pdf.length > 30_000, pdf.length);
  check(`${name}: charts fit the paper`, printed.widest > 300 && printed.widest <= 690, printed);
  check(`${name}: the figure is a still picture on paper, and light`, printed.still > 5_000 && printed.theme === "light", printed);
  check(`${name}: every gap is listed on paper`, printed.rows === (name === "walk" ? 93 : 0), printed);
  check(`${name}: and dark again afterwards`, (await page.evaluate(() => document.documentElement.dataset.theme)) === "dark");
  await close();
}

// Balls of ±2 σ: of a method that is not that sure, or they are smaller than the markers.
{
  const { page, close } = await open("occluded");
  await page.mouse.move(5, 5);
  const was = await stage(page);
  await page.getByRole("button", { name: "±2 σ" }).click();
  await page.mouse.move(5, 5);
  await page.waitForTimeout(200);
  check("±2 σ changes the picture", (await compare(was, await stage(page))).different > 100);
  check("what is left open says why", (await page.locator("button.tile", { hasText: "Left open" }).textContent()).includes("longer than --max-gap"));
  await close();
}

// A take without gaps says so and does not pretend.
{
  const { page, close } = await open("complete");
  check("without gaps: says so", (await page.locator("#map").textContent()).includes("Nothing is missing"));
  check("without gaps: no selected gap", (await page.locator("#gap").count()) === 0);
  check("without gaps: the buttons between gaps rest", await page.getByRole("button", { name: "Next gap" }).isDisabled());
  await page.keyboard.press("n");
  await page.keyboard.press("Home");
  await page.waitForTimeout(200);
  const first = await stage(page);
  await page.keyboard.press("End");
  await page.waitForTimeout(200);
  check("without gaps: the player draws", (await compare(first, await stage(page))).different > 500);
  await close();
}

// Methods that know no likelihood or uncertainty do not show any.
{
  const { page, close } = await open("single");
  check("no likelihood, no curve", (await page.locator("#em").textContent()).includes("has no likelihood") && (await page.locator("#em canvas").count()) === 0);
  check("no uncertainty, no number", (await page.locator("#top").textContent()).includes("this method cannot say"));
  await close();
}

// A body in clouds: parts over time, and the rounds of the frame that is shown.
{
  const { page, close } = await open("body");
  check("clouds that are not there are told", (await page.locator("#events").textContent()).includes("no file"));
  const map = page.locator("#parts .part-map .u-over");
  await map.scrollIntoViewIfNeeded();
  const box = await map.boundingBox();
  const hover = async (x, y) => {
    await page.mouse.move(box.x + x * box.width, box.y + y * box.height);
    return page.locator("#parts .tip").textContent();
  };
  check("a part says how it was followed", /^\S+, frame \d+: \d+ % covered, [\d.]+ cm from its points$/.test(await hover(0.8, 0.3)), await hover(0.8, 0.3));
  check("and that it had no points", (await hover(20.5 / 60 + 0.005, 0.3)).endsWith(": no points"), await hover(20.5 / 60 + 0.005, 0.3));
  const pick = page.getByLabel("The part whose curves are shown");
  const was = await pick.inputValue();
  await page.mouse.click(box.x + 0.8 * box.width, box.y + 0.9 * box.height);
  check("a click on a part shows its curves", (await pick.inputValue()) !== was, was);
  check("and goes to the frame", Math.abs((await frame(page)) - 48) < 3, await frame(page));
  const picture = () => page.locator("#parts .part-map").screenshot();
  const coverage = await picture();
  await page.getByLabel("What the colours show").selectOption("residual_cm");
  await page.mouse.move(5, 5);
  await page.waitForTimeout(200);
  const seen = await compare(coverage, await picture());
  check("the colours can show distances", seen.different > 500 && seen.colours > 10, seen);

  const rounds = page.locator("#rounds");
  check("the rounds of the frame are told", new RegExp(`Frame ${await frame(page)}: \\d+ rounds`).test(await rounds.textContent()), await rounds.textContent());
  check("with how they began and ended", (await rounds.locator(".track-value").allTextContents()).every((text) => text.includes("→")));
  const before = await rounds.locator("canvas").first().screenshot();
  await page.keyboard.press("Shift+ArrowLeft");
  await page.waitForTimeout(200);
  check("another frame has other rounds", (await compare(before, await rounds.locator("canvas").first().screenshot())).different > 20);
  for (let k = 0; k < 100 && (await frame(page)) > 20; k++) await page.keyboard.press("ArrowLeft");
  check("a frame without a cloud has none", (await rounds.textContent()).includes("Frame 20: no rounds"), await rounds.textContent());
  await close();
}

// Names are text.
{
  const { page, close } = await open("hostile");
  await page.locator("#map button", { hasText: "more of" }).click();
  const text = await page.locator("body").innerText();
  check("hostile names are shown as they are", text.includes(HOSTILE[0]) && text.includes("<img src=x onerror=document.title='owned'>.csv"), text.slice(0, 400));
  check("hostile names do nothing", !(await page.title()).startsWith("owned") && (await page.locator("body img:not(.still), body script:not([type])").count()) === 3, await page.title());
  await page.keyboard.press("n");
  await page.keyboard.press("n");
  check("hostile names are selected like others", (await page.title()) !== "owned");
  await close();
}

// Nothing runs that was not written by us, even if it got in.
{
  const { page, close } = await open("walk");
  const ran = await page.evaluate(() => {
    const script = document.createElement("script");
    script.textContent = "window.intruder = true";
    document.body.append(script);
    return window.intruder === true;
  });
  check("the policy keeps other scripts from running", !ran);
  await page.context().close();
  void close; // the browser complains about the intruder, as it should
}

// Without WebGL.
{
  const without = () => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind.startsWith("webgl") ? null : get.call(this, kind, ...rest);
    };
  };
  const { page, close } = await open("walk", { before: without });
  check("without WebGL it draws plainly", (await page.locator("main").getAttribute("data-player")) === "flat");
  await page.keyboard.press("Home");
  await page.waitForTimeout(200);
  const first = await stage(page);
  await page.keyboard.press("End");
  await page.waitForTimeout(200);
  const seen = await compare(first, await stage(page));
  check("without WebGL: frames look different, and not blank", seen.different > 500 && seen.colours > 20, seen);
  check("without WebGL it says so", (await page.locator("#player").textContent()).includes("No WebGL"));
  await close();
}

// With hardly any browser at all.
{
  const { page, close } = await open("walk", { before: () => delete window.DecompressionStream });
  check("an old browser is told why", (await page.locator("main").textContent()).includes("too old"));
  await close();
}

await browser.close();
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
