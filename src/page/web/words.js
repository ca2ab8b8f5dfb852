// Elements, numbers and reasons: how things are said. Everything that comes from the take becomes text, never markup.

/** An element with properties, attributes (`aria-...`, `data-...`, `role`) and children; strings become text. */
function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && !name.includes("-") && name !== "list") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== undefined && child !== null && child !== false));
  return element;
}

/** A section with its heading; `help` stands below it, small. */
function section(id, title, help, ...children) {
  const heading = el("h2", { id: `${id}-title` }, title);
  return el("section", { id, className: "card", "aria-labelledby": `${id}-title` },
    el("div", { className: "card-head" }, heading, help && el("p", { className: "help" }, help)), ...children);
}

const grouped = new Intl.NumberFormat("en-US");
const whole = (x) => grouped.format(Math.round(x));

/** A length in mm, as exact as it deserves. */
function mm(x, unit = true) {
  if (x === undefined || x === null || !Number.isFinite(x)) return "unknown";
  const size = Math.abs(x);
  const text = size >= 1000 ? whole(x) : size >= 100 ? x.toFixed(0) : x.toFixed(1);
  return unit ? `${text} mm` : text;
}

/** A number of things: `1 gap`, `2 gaps`. */
const counted = (number, what) => `${whole(number)} ${what}${number === 1 ? "" : "s"}`;

function percent(share) {
  const x = 100 * share;
  if (x === 0) return "0 %";
  if (x < 0.01) return "< 0.01 %";
  return `${x < 1 ? x.toFixed(2) : x.toFixed(1)} %`;
}

const seconds = (s) => `${s < 10 ? s.toFixed(2) : s.toFixed(1)} s`;

/** A rate or another number without trailing zeros. */
const short = (x) => String(Number(x.toFixed(4)));

/** `m:ss.cc` for the clock of the player. */
function clock(s) {
  const minutes = Math.floor(s / 60);
  const rest = (s - 60 * minutes).toFixed(2).padStart(5, "0");
  return `${minutes}:${rest}`;
}

/** One big number: what it is, the number, what it is about; a button if it leads somewhere. */
function tile(title, value, unit, about, go, tone) {
  const content = [
    el("span", { className: "tile-title" }, title),
    el("span", { className: "tile-value" }, value, unit && el("span", { className: "tile-unit" }, unit)),
    el("span", { className: "tile-about" }, about || "\u00a0"),
  ];
  const className = `tile ${tone || ""}`;
  return el("li", {}, go ? el("button", { type: "button", className, onclick: go }, content) : el("div", { className }, content));
}

/** With a capital and a full stop. */
function sentence(text) {
  const trimmed = text.trim();
  return trimmed.charAt(0).toUpperCase() + trimmed.slice(1) + (/[.!?]$/.test(trimmed) ? "" : ".");
}

const REASONS = {
  "never-seen": "the marker never appears",
  "at-end": "reaches the first or last frame",
  "too-long": "longer than --max-gap",
  "not-asked-for": "not among --markers",
  "too-few-seen": "seen in too few frames to predict it",
  "too-unsure": "less sure than --max-sigma",
  unsolved: "the method found no position",
};

/** Why a gap stays open, in words. */
const reason = (word) => REASONS[word] || String(word).replaceAll("-", " ");

const STOPS = {
  converged: "converged",
  complete: "complete",
  "step-limit": "stopped at its limit",
  interrupted: "interrupted",
  failed: "failed",
};
const stopWords = (word) => STOPS[word] || String(word).replaceAll("-", " ");

/** How a stretch of a gap was predicted, in one line. */
function explain(take, part) {
  if (!part) return "";
  const from = part.neighbours.length > 0 ? `from ${part.neighbours.slice(0, 3).map((label) => bare(take, label)).join(", ")}; ` : "";
  return from + (part.simulated_gaps > 0 ? counted(part.simulated_gaps, "simulated gap") : "not judged");
}

/** A label without the prefix that all labels share. */
const bare = (take, label) => (label.startsWith(take.prefix) ? label.slice(take.prefix.length) : label);

function boneName(take, bone) {
  return `${take.markers[bone.a]} – ${take.markers[bone.b]}`;
}
