// Opens reports on batches in a browser, without a network, and does to them what people do.
//
// node check_fleet.mjs PROGRAM FOLDER: makes the reports in FOLDER with PROGRAM, which is examples/fleet.rs, and counts what holds and what does not.
// The browser is Debian's chromium, or what CHROMIUM names.

import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, readFileSync, readdirSync, statSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [program, folder] = process.argv.slice(2);
mkdirSync(folder, { recursive: true });
if (readdirSync(folder).length > 0) throw new Error(`${folder} is not empty: name a new folder`);
const make = (...words) => execFileSync(program, words, { stdio: ["ignore", "inherit", "inherit"] });
const at = (name) => join(folder, name);
const pages = {
  some: at("some.html"),
  one: at("one.html"),
  none: at("none.html"),
  many: at("many.html"),
  odd: at("tree/out #1/report.html"),
  elsewhere: at("tree/elsewhere/report.html"),
};
for (const [name, takes] of [["some", 2000], ["one", 1], ["none", 0], ["many", 100_000]]) make("rows", String(takes), pages[name]);
make("tree", at("tree"));
make("rows", "2000", at("again.html"));

let passed = 0, failed = 0;
function check(what, holds, found) {
  if (holds) passed++;
  else failed++;
  if (!holds) console.log(`failed: ${what}${found === undefined ? "" : `: ${JSON.stringify(found)}`}`);
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
  headless: true,
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});

/** Opens a report in a context of its own, and watches that it neither complains nor asks anybody for anything. */
async function open(name, { width = 1400, height = 900, scheme = "light", before, scripts = true } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: scheme, offline: true, reducedMotion: "reduce", javaScriptEnabled: scripts });
  const page = await context.newPage();
  const complaints = [], requests = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("request", (request) => requests.push(request.url()));
  page.on("dialog", (dialog) => (complaints.push(`dialog ${dialog.message()}`), dialog.dismiss()));
  if (before) await page.addInitScript(before);
  const began = Date.now();
  await page.goto(pathToFileURL(pages[name]).href);
  if (scripts) await page.waitForSelector("main[aria-busy=false]", { timeout: 60_000 });
  const took = Date.now() - began;
  return {
    page,
    took,
    async close() {
      const outside = requests.slice(1).filter((url) => !url.startsWith("data:") && !url.startsWith("blob:"));
      check(`${name} at ${width}, ${scheme}: no complaint in the console`, complaints.length === 0, complaints);
      check(`${name} at ${width}, ${scheme}: no request`, outside.length === 0, outside);
      await context.close();
    },
  };
}

const fits = (page) => page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth);
const said = (page) => page.locator(".said").textContent();
const shown = async (page) => Number((await said(page)).match(/^[\d,]+/)[0].replaceAll(",", ""));
const heads = (page) => page.locator(".takes thead th").allTextContents();
/** What is in a column of the rows that are drawn. */
const column = async (page, title) => page.locator(`.takes tbody tr:not(.space) > :nth-child(${(await heads(page)).indexOf(title) + 1})`).allTextContents();
const sort = (page, title) => page.locator(".takes thead button", { hasText: new RegExp(`^${title}$`) }).click();
const number = (text) => (text === "–" ? NaN : parseFloat(text.replace(/^< /, "").replaceAll(",", "")));
async function download(page, button) {
  const [file] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return readFileSync(await file.path(), "utf8");
}

// The files themselves.
{
  const [some, again] = [pages.some, at("again.html")].map((path) => readFileSync(path));
  check("the same takes give the same page", some.equals(again));
  const [table, same] = ["some.csv", "again.csv"].map((name) => readFileSync(at(name), "utf8"));
  check("and the same table", table === same);
  const lines = table.split("\r\n");
  check("the table has one row for each take", lines.length === 2002 && lines[2001] === "", lines.length);
  check("its columns are words for scripts", lines[0].split(",").every((name) => /^[a-z_]+$/.test(name)), lines[0]);
  check("a page on 2,000 takes is below 0.4 MB", some.length < 4e5, some.length);
  const many = statSync(pages.many).size;
  check("a page on 100,000 takes is below 8 MB", many < 8e6, many);
}

// The head, and what needs a look.
{
  const { page, close } = await open("some");
  const tiles = await page.locator(".tiles li").allInnerTexts();
  check("the head has twelve numbers", tiles.length === 12, tiles);
  const states = await page.locator(".chips button").allTextContents();
  const count = (name) => Number((states.find((text) => text.startsWith(name)) ?? "0").replace(/\D/g, ""));
  check("states add up", count("Complete") + count("With remarks") + count("Quarantined") + count("Failed") + count("Not yet done") === 2000, states);
  const order = await page.evaluate(() => [...document.querySelectorAll("main section")].map((section) => section.id));
  check("what needs a look comes first", order[0] === "look" && order.join() === "look,takes,heat,markers,spread,origin", order);
  const reasons = await page.locator(".reason-count").allTextContents();
  check("every quarantined and failed take has a reason", reasons.reduce((sum, text) => sum + parseInt(text, 10), 0) === count("Quarantined") + count("Failed"), reasons);
  await page.locator(".reason-takes button.link").first().click();
  check("a reason shows its takes", (await shown(page)) === parseInt(reasons[0], 10), await said(page));
  check("and says so", (await page.locator(".chip.range").isVisible()));
  await page.locator(".tiles button", { hasText: "Gaps left open" }).click();
  check("a number of the head shows its takes", (await page.locator(".takes th[aria-sort=descending]").textContent()) === "Left open" && (await shown(page)) === 2000);
  await close();
}

// The table sorts and filters.
{
  const { page, close } = await open("some");
  check("the table says how it is sorted", (await page.locator(".takes th[aria-sort=ascending]").allTextContents()).join() === "Take");
  const sizes = { B: 1, kB: 1e3, MB: 1e6, s: 1, min: 60, h: 3600, "%": 1 };
  const value = (text) => number(text) * (sizes[text.match(/[a-zA-Z%]+$/)?.[0]] ?? 1);
  for (const title of ["Missing", "Gaps", "Left open", "Longest gap", "Filled", "Worst σ, mm", "Worst bone, mm", "Length", "Frames", "Samples", "Time", "Memory", "Size"]) {
    for (const direction of ["descending", "ascending"]) {
      await sort(page, title);
      check(`${title}: sorted ${direction}`, (await page.locator(`.takes th[aria-sort=${direction}]`).textContent()) === title);
      const values = (await column(page, title)).map(value);
      const holds = values.length > 20 && values.every((x, k) => k === 0 || (direction === "descending" ? values[k - 1] >= x : values[k - 1] <= x));
      check(`${title}: rows are ${direction}`, holds, values);
    }
  }
  for (const title of (await heads(page)).filter((title) => title !== "Take")) {
    await sort(page, title);
    check(`${title} sorts`, (await page.locator(".takes th[aria-sort=ascending], .takes th[aria-sort=descending]").allTextContents()).join() === title);
  }
  await sort(page, "Missing");
  await page.locator(".scroller").evaluate((scroller) => (scroller.scrollTop = scroller.scrollHeight));
  await page.waitForTimeout(200);
  check("what is not known comes last", (await column(page, "Missing")).at(-1) === "–", (await column(page, "Missing")).at(-1));

  await page.locator(".search").fill("dance SESSION\u002012 .c3d");
  await page.waitForTimeout(100);
  const names = await column(page, "Take");
  check("words are looked for, whatever their case", names.length > 0 && names.every((name) => name.includes("dance") && name.includes("12")), names);
  await page.locator(".search").fill("POINT:LABELS");
  await page.waitForTimeout(100);
  check("words of reasons as well", (await column(page, "State")).every((text) => text === "Quarantined") && (await shown(page)) > 0, await said(page));
  await page.locator(".search").fill("no such take");
  await page.waitForTimeout(100);
  check("nothing found is said", await page.locator("#takes .empty").isVisible());
  await page.getByRole("button", { name: "Clear", exact: true }).click();
  check("Clear brings all of them back", (await shown(page)) === 2000 && (await page.locator(".search").inputValue()) === "");

  const chip = page.locator(".chips button", { hasText: "Quarantined" });
  await chip.click();
  check("a state filters", (await column(page, "State")).every((text) => text === "Quarantined") && (await chip.getAttribute("aria-pressed")) === "true");
  await chip.click();
  check("and does no more", (await shown(page)) === 2000);
  await page.locator("#takes select").selectOption({ label: "session 07" });
  check("a folder filters", (await column(page, "Take")).every((name) => name.startsWith("session 07/")), (await column(page, "Take")).slice(0, 3));
  await page.getByRole("button", { name: "Clear", exact: true }).click();

  const bar = page.locator("#spread .bar:enabled").nth(3);
  const expected = Number((await bar.getAttribute("aria-label")).match(/([\d,]+) takes?$/)[1].replaceAll(",", ""));
  await bar.click();
  check("a bar shows its takes", (await shown(page)) === expected, [await said(page), expected]);
  const text = await download(page, page.locator("#takes").getByRole("button", { name: "Save as CSV" }));
  check("what is shown is saved", text.split("\r\n").length === expected + 2 && text.startsWith("path,state,missing_share,"), text.slice(0, 100));
  await page.locator(".chip.range").click();
  check("the choice of a chart can be taken back", (await shown(page)) === 2000);
  await page.locator("#heat tbody th button").first().click();
  const name = await page.locator("#heat tbody th button").first().textContent();
  check("a folder of the map shows its takes", (await column(page, "Take")).every((take) => take.startsWith(`${name}/`)), name);
  await close();
}

// Markers and details.
{
  const { page, close } = await open("some");
  const rows = page.locator(".marker-table tbody tr");
  check("some markers are shown at first", (await rows.count()) === 15);
  await page.locator("#markers").getByRole("button", { name: "Show more" }).click();
  check("and all when asked", (await rows.count()) === 41);
  const share = (await page.locator(".marker-table tbody td:nth-child(3)").allTextContents()).map(number);
  check("those that lack most come first", share.every((x, k) => k === 0 || share[k - 1] >= x), share);
  check("labels have no subject", (await page.locator(".marker-table tbody th").allTextContents()).every((label) => /^[A-Z0-9]+$/.test(label)));
  await page.locator(".marker-table thead button", { hasText: "Marker" }).click();
  check("markers sort by name", (await page.locator(".marker-table tbody th").first().textContent()) === "C7");
  check("and say so", (await page.locator(".marker-table th[aria-sort=ascending]").textContent()) === "Marker");
  const text = await download(page, page.locator("#markers").getByRole("button", { name: "Save as CSV" }));
  const lines = text.trim().split("\r\n").map((line) => line.split(","));
  check("markers are saved, over all takes and by folder", lines.length === 1 + 41 * 31 && lines.every((cells) => cells.length === 12), lines.length);
  const [, , , , missing] = lines[0].keys();
  const total = (of) => lines.slice(1).filter(of).reduce((sum, cells) => sum + Number(cells[missing]), 0);
  check("folders add up to the whole", total((cells) => cells[0] === "*") === total((cells) => cells[0] !== "*") && total(() => true) > 0);
  const heat = await page.locator("#heat tbody tr").count();
  check("the map shows the worst folders", heat === 25, heat);
  const all = (await page.locator("#heat tbody td.all").allTextContents()).map(Number);
  check("in order", all.every((x, k) => k === 0 || all[k - 1] >= x), all);
  await page.locator("#heat .controls button").click();
  check("and all of them when asked", (await page.locator("#heat tbody tr").count()) === 30);

  await page.locator(".takes .more").nth(2).click();
  const dialog = page.locator("dialog.details");
  check("details open", await dialog.evaluate((d) => d.open));
  const words = await dialog.innerText();
  check("details are whole", /Missing/.test(words) && /Exit code/.test(words) && !/null|undefined|NaN|false/.test(words), words);
  await page.keyboard.press("Escape");
  check("Escape closes them", !(await dialog.evaluate((d) => d.open)));
  await page.locator(".takes .more").nth(2).click();
  check("and they open again", await dialog.evaluate((d) => d.open));
  await dialog.getByRole("button", { name: "Close" }).click();
  await page.locator(".takes tbody tr:not(.space) td").nth(30).click();
  check("a click on a row opens them", await dialog.evaluate((d) => d.open));
  await close();
}

// With the keyboard alone.
{
  const { page, close } = await open("some");
  const reached = [];
  for (let k = 0; k < 400; k++) {
    await page.keyboard.press("Tab");
    const focus = await page.evaluate(() => {
      const e = document.activeElement, style = getComputedStyle(e), section = e.closest("section, header");
      return { place: section ? section.id : e.className || e.tagName, row: e.closest(".takes tbody tr")?.ariaRowIndex, seen: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0, name: e.getAttribute("aria-label") || e.textContent };
    });
    reached.push(focus);
    if (focus.row === "40") break;
  }
  check("the first stop skips to the takes", reached[0].place === "skip", reached[0]);
  const order = [...new Set(reached.map((f) => f.place))].filter((place) => ["top", "look", "takes"].includes(place));
  check("the keyboard reaches the parts in order", order.join() === "top,look,takes", order);
  check("focus can be seen", reached.every((f) => f.seen), reached.filter((f) => !f.seen).slice(0, 3));
  const rows = [...new Set(reached.map((f) => f.row).filter(Boolean))].map(Number);
  check("it goes on beyond the rows in sight, row by row", rows.at(-1) === 40 && rows.every((row, k) => row === k + 2), rows);
  await page.keyboard.press("Tab"); // behind the name is what opens the details
  await page.keyboard.press("Enter");
  check("Enter opens the details", await page.locator("dialog.details").evaluate((d) => d.open));
  await page.keyboard.press("Escape");
  const nameless = await page.evaluate(() => [...document.querySelectorAll("button, select, input, a, [role=img], [role=region], [role=group]")].filter((e) => !(e.textContent.trim() || e.getAttribute("aria-label"))).map((e) => e.outerHTML.slice(0, 80)));
  check("every control has a name", nameless.length === 0, nameless);
  const tables = await page.evaluate(() => [...document.querySelectorAll(".takes, .marker-table, .heat")].map((t) => [t.querySelectorAll("thead th:not([scope=col])").length, t.querySelectorAll("tbody tr:not(.space) > :first-child:not(th[scope=row])").length, Boolean(t.caption)]));
  check("tables have captions, and heads with a scope", tables.length === 3 && tables.every(([a, b, caption]) => a === 0 && b === 0 && caption), tables);
  await close();
}

// Links lead to the reports of takes, whatever they are called.
for (const name of ["odd", "elsewhere"]) {
  const { page, close } = await open(name);
  await page.locator("#takes select").selectOption({ label: "All 6 folders" });
  const links = await page.locator(".takes tbody a").evaluateAll((all) => all.map((a) => [a.href, a.textContent]));
  const wrong = links.filter(([href]) => !href.startsWith("file:") || !existsSync(fileURLToPath(href)));
  check(`${name}: every link leads somewhere`, links.length >= 12 && wrong.length === 0, wrong);
  check(`${name}: to the report of this take`, links.every(([href, text]) => decodeURIComponent(href).endsWith(`${text}.html`)), links);
  const without = await page.locator(".takes tbody tr:not(.space) th:not(:has(a))").allTextContents();
  check(`${name}: takes without a report have no link`, without.length > 0 && without.every((text) => !existsSync(join(at("tree/out #1"), `${text.replace("⋯", "")}.html`))), without);
  for (const [href, text] of links.slice(0, 8)) {
    const other = await page.context().newPage();
    await other.goto(href);
    check(`${name}: ${text} opens`, /^take \d+$/.test(await other.title()), await other.title());
    await other.close();
  }
  await close();
}

// Names are text.
{
  const { page, close } = await open("odd");
  await page.locator("#markers").getByRole("button", { name: "Show more" }).click();
  const text = await page.locator("body").innerText();
  for (const name of ["<img src=x onerror=document.title='owned'>", "{{scripts}}<!--", "a'b\"`${1}", "javascript:alert(1)", "<b>c3d</b>: the header is cut off", "<i>host</i>", "/data/<b>in</b>"]) {
    check(`${name} is shown as it is`, text.includes(name));
  }
  for (let k = 0; k < 8; k++) {
    await page.locator(".takes .more").nth(k).click();
    await page.keyboard.press("Escape");
  }
  check("hostile names do nothing", !(await page.title()).startsWith("owned") && (await page.locator("body img, body script:not([type]), body b, body i").count()) === 1, await page.title());
  const saved = await download(page, page.locator("#takes").getByRole("button", { name: "Save as CSV" }));
  check("a name with quotes is saved as one cell", saved.includes('"odd 1/=1+1, ""quoted"".c3d",'), saved.slice(0, 900));
  const planned = (await page.locator(".chips button", { hasText: "Not yet done" }).textContent()).replace(/\D/g, "");
  check("planned takes of which nothing is told are not yet done", planned === "4", planned);
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

// Narrow and wide, light and dark.
for (const name of ["some", "odd", "one", "none"]) {
  const colours = new Set();
  for (const width of [360, 1600]) {
    for (const scheme of ["light", "dark"]) {
      const { page, close } = await open(name, { width, height: 740, scheme });
      check(`${name}, ${scheme}: nothing to scroll sideways at ${width} px`, await fits(page));
      for (const details of await page.locator("details").all()) await details.evaluate((d) => (d.open = true));
      check(`${name}, ${scheme}: nor with everything unfolded at ${width} px`, await fits(page));
      const cut = await page.evaluate(() => [...document.querySelectorAll(".takes thead button, .tile-title, .bar-label, .badge")].filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflow !== "visible").map((e) => e.textContent));
      const debris = (await page.locator("body").innerText()).match(/\b(null|undefined|NaN|false|true|Infinity)\b/);
      check(`${name}, ${scheme}: nothing is said that means nothing`, !debris, debris);
      check(`${name}, ${scheme}: no title is cut at ${width} px`, cut.length === 0, cut);
      colours.add(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
      await page.getByRole("button", { name: scheme === "light" ? "Dark" : "Light", exact: true }).click();
      colours.add(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
      await close();
    }
  }
  check(`${name}: light and dark differ, and the button changes them`, colours.size === 2, [...colours]);
}

// A hundred thousand takes.
{
  const { page, took, close } = await open("many", { width: 1600 });
  console.log(`100,000 takes: open after ${took} ms`);
  check("100,000 takes open within 8 s", took < 8000, took);
  const times = await page.evaluate(() => [...document.querySelectorAll(".takes thead button")].map((button) => {
    const began = performance.now();
    button.click();
    void document.body.offsetHeight;
    return [button.textContent, Math.round(performance.now() - began)];
  }));
  console.log(`100,000 takes: sorted in ${times.map(([title, ms]) => `${title} ${ms}`).join(", ")} ms`);
  check("they are sorted within a second", times.every(([, ms]) => ms < 1000), times);
  const nodes = await page.evaluate(() => document.querySelectorAll(".takes tbody tr").length);
  check("only rows in sight are drawn", nodes < 80, nodes);
  await sort(page, "Take");
  check("all of them are there", (await shown(page)) === 100_000 && (await page.locator(".takes").getAttribute("aria-rowcount")) === "100001");
  await page.locator(".scroller").focus();
  await page.keyboard.press("End");
  await page.waitForTimeout(500);
  const last = page.locator(".takes tbody tr:not(.space)").last();
  check("End goes to the last one", (await last.getAttribute("aria-rowindex")) === "100001" && (await last.textContent()).includes("trial 99999"), await last.textContent());
  await page.locator(".search").fill("trial 54321");
  await page.waitForTimeout(1000);
  check("one of them is found", (await shown(page)) === 1);
  await close();
}

// Paper, old browsers, no scripts.
{
  const { page, close } = await open("some", { width: 700, scheme: "dark" });
  await page.emulateMedia({ media: "print" });
  await page.evaluate(() => window.dispatchEvent(new Event("beforeprint")));
  check("on paper the first takes stand in the table", (await page.locator(".takes tbody tr:not(.space)").count()) === 60);
  check("and how many there are", (await page.locator(".on-paper").innerText()).includes("2,000 takes"));
  check("nothing is wider than the paper", await fits(page));
  check("paper is light", await page.evaluate(() => document.documentElement.dataset.theme === "light"));
  await page.evaluate(() => window.dispatchEvent(new Event("afterprint")));
  check("and afterwards it is dark again", await page.evaluate(() => document.documentElement.dataset.theme === "dark"));
  await close();
}
{
  const { page, close } = await open("one", { before: () => delete window.DecompressionStream });
  check("an old browser is told why", (await page.locator("main").textContent()).includes("too old"));
  await close();
}
{
  const { page, close } = await open("one", { scripts: false });
  check("without scripts the page says what to do", (await page.locator("main").innerText()).includes("allow scripts"), await page.locator("main").innerHTML());
  await close();
}

await browser.close();
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
