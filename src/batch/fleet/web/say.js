// How takes, times and sizes are said.

const STATES = [
  { word: "done", title: "Complete", tone: "good" },
  { word: "remarks", title: "With remarks", tone: "remark" },
  { word: "quarantined", title: "Quarantined", tone: "bad" },
  { word: "failed", title: "Failed", tone: "warn" },
  { word: "waiting", title: "Not yet done", tone: "idle" },
];

const DASH = "–";

/** What is not known is a dash. */
const orDash = (x, text) => (Number.isFinite(x) ? text(x) : DASH);

/** A time, as exact as it deserves. */
function duration(secs) {
  if (!Number.isFinite(secs)) return DASH;
  if (secs === 0) return "0 s";
  if (secs < 10) return `${secs.toFixed(secs < 1 ? 2 : 1)} s`;
  if (secs < 120) return `${Math.round(secs)} s`;
  const minutes = Math.round(secs / 60);
  if (minutes < 120) return `${minutes} min`;
  const hours = Math.round(secs / 3600);
  if (hours < 48) return minutes < 600 && minutes % 60 ? `${Math.floor(minutes / 60)} h ${minutes % 60} min` : `${hours} h`;
  return `${whole(secs / 86400)} days`;
}

function bytesText(bytes) {
  if (!Number.isFinite(bytes)) return DASH;
  for (const unit of ["B", "kB", "MB", "GB"]) {
    if (bytes < 999.5) return `${unit === "B" || bytes >= 100 ? bytes.toFixed(0) : bytes.toFixed(1)} ${unit}`;
    bytes /= 1000;
  }
  return `${bytes.toFixed(1)} TB`;
}

/** A number with few digits: 1,234 or 12.3 or 0.45. */
const few = (x) => (x >= 100 ? whole(x) : x >= 10 ? x.toFixed(1) : x.toFixed(2));

/** Large numbers in words: 3.2 million. */
function large(x) {
  if (x < 1e5) return whole(x);
  for (const [size, word] of [[1e12, "trillion"], [1e9, "billion"], [1e6, "million"]]) if (x >= size) return `${few(x / size)} ${word}`;
  return `${whole(x / 1000)} thousand`;
}

const moment = (secs) => (Number.isFinite(secs) ? new Date(secs * 1000).toISOString().slice(0, 16).replace("T", " ") : DASH);
const momentText = (text) => text.slice(0, 16).replace("T", " ");

/** The folders of a path, and its name. */
function split(path) {
  const at = path.lastIndexOf("/") + 1;
  return [path.slice(0, at), path.slice(at)];
}

const folderName = (name) => name || "(no folder)";

/** What a take is called: its folders quietly, then its name, which leads to its report if it has one, or else to its details. */
function takeName(batch, i, { folders = true } = {}) {
  const path = batch.takes.paths[i];
  const [folder, name] = split(path);
  const inside = [folders && folder && el("span", { className: "take-folder" }, folder), el("span", { className: "take-file" }, name)];
  const href = batch.column.flags[i] & HAS_REPORT ? batch.link(i, ".html") : null;
  return href !== null
    ? el("a", { className: "take-name link", href, title: `${path}: its report` }, el("bdi", {}, inside))
    : el("button", { type: "button", className: "take-name plain", title: path, onclick: () => set({ details: i }) }, el("bdi", {}, inside));
}

/** Opens the details of a take. */
const detailsButton = (batch, i) =>
  el("button", { type: "button", className: "plain more", "aria-label": `Details of ${batch.takes.paths[i]}`, title: "Details", onclick: () => set({ details: i }) }, "⋯");

const badge = (batch, i) => el("span", { className: `badge ${STATES[batch.column.state[i]].tone}` }, STATES[batch.column.state[i]].title);

/** Shows takes in the table: what is to be seen, and in which order. */
function showTakes(changes) {
  set({ query: "", only: null, folder: null, range: null, ...changes });
  const place = document.getElementById("takes");
  place.scrollIntoView({ behavior: calm() ? "auto" : "smooth", block: "start" });
}

/** Saves a text as a file, without asking anybody for anything. */
function save(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  const link = el("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** Rows of cells as RFC 4180 has them; what is not known is empty. */
function csv(rows) {
  const cell = (value) => {
    if (typeof value === "number") return Number.isFinite(value) ? String(Number(value.toPrecision(10))) : "";
    return /[",\r\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value;
  };
  return rows.map((row) => row.map(cell).join(",") + "\r\n").join("");
}
