// Charts with uPlot: in the page's colours, as wide as their place, with a playhead, drawn again when the theme changes.

/** A colour of the page, as the style sheet has it now. */
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const FONT = "12px system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', sans-serif";

/** Colours of a sequence from sure to unsure, t from 0 to 1. */
function ramp(t) {
  const stops = [1, 2, 3, 4].map((k) => hex(colour(`sigma-${k}`)));
  const x = Math.max(0, Math.min(1, t)) * (stops.length - 1);
  const k = Math.min(stops.length - 2, Math.floor(x));
  const mix = stops[k].map((c, i) => Math.round(c + (x - k) * (stops[k + 1][i] - c)));
  return `rgb(${mix.join(" ")})`;
}

/** Red, green and blue of `#rrggbb`, 0 to 255. */
const hex = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));

/** Where an uncertainty stands between the smallest and the largest of the take, on a scale of ratios. */
function sigmaScale(take) {
  let low = Infinity, high = 0;
  for (const s of take.sigma) {
    if (s > high) high = s;
    if (s > 0 && s < low) low = s;
  }
  low = Math.max(low, 0.1);
  return { low, high, known: high > 0, at: (s) => (high > low ? Math.log(Math.max(s, low) / low) / Math.log(high / low) : 0.3) };
}

function axis(options = {}) {
  return {
    stroke: colour("quiet"),
    font: FONT,
    grid: { stroke: colour("line"), width: 1 },
    ticks: { show: false },
    border: { show: false },
    gap: 6,
    ...options,
  };
}

/** The axis of the file's own frame numbers. */
const frameAxis = (options = {}) =>
  axis({ incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 1e4, 2e4, 5e4, 1e5], values: (_, at) => at.map((x) => String(x)), space: 46, size: 28, ...options });

/** The frames of the take, or what of them was chosen by dragging; a double click brings all of them back. */
const frameRange = (take) => (_, low, high) => {
  const [first, last] = [take.label(-0.5), take.label(take.frames - 0.5)];
  return low === null || high - low < 3 ? [first, last] : [Math.max(first, low), Math.min(last, high)];
};
const ZOOMS = { drag: { x: true, y: false, dist: 6 } };

const charts = new Set();

/**
 * A chart in `host`. `options(width)` gives uPlot's options without its width; `data()` its data.
 * `jumps`: a click goes to that frame. `playhead`: a line follows the player. x is the file's own number of a frame for both.
 */
function chart(host, { options, data, label, take, playhead = false, jumps = false, onready }) {
  host.classList.add("chart");
  host.setAttribute("role", "img");
  if (label) host.setAttribute("aria-label", label);
  let plot = null, line = null;
  const width = () => Math.max(200, Math.floor(host.clientWidth));
  const place = () => {
    if (!line || !plot || plot.scales.x.min == null) return;
    const x = take.label(state.frame);
    const { min, max } = plot.scales.x;
    line.hidden = x < min || x > max;
    if (!line.hidden) line.style.transform = `translateX(${plot.valToPos(x, "x").toFixed(1)}px)`;
  };
  const build = () => {
    if (plot) plot.destroy();
    plot = null;
    if (host.clientWidth === 0) return;
    const all = options(width());
    plot = new uPlot(
      {
        width: width(),
        legend: { show: false },
        ...all,
        cursor: { drag: { x: false, y: false }, points: { show: false }, y: false, ...(all.cursor || {}) },
        hooks: { ...(all.hooks || {}), setScale: [place], ready: [place] },
      },
      data(),
      host,
    );
    if (playhead) {
      line = el("div", { className: "playhead" });
      plot.over.append(line);
      place();
    }
    if (jumps) {
      plot.over.addEventListener("click", (event) => {
        const box = plot.over.getBoundingClientRect();
        jump(take, take.frameOf(plot.posToVal(event.clientX - box.left, "x")));
      });
    }
    if (onready) onready(plot);
  };
  const made = {
    get plot() {
      return plot;
    },
    build,
    /** New data, old scales' rules. */
    redraw: build,
    fit() {
      if (plot && plot.width !== width()) build();
      else if (!plot) build();
    },
    place,
    close() {
      watch.disconnect();
      if (plot) plot.destroy();
      charts.delete(made);
    },
  };
  const watch = new ResizeObserver(() => made.fit());
  watch.observe(host);
  charts.add(made);
  return made;
}

listen("frame", () => charts.forEach((made) => made.place()));
listen("theme print", () => charts.forEach((made) => made.build()));

/** A key to the colours: pairs of class and text. */
function legend(...entries) {
  return el("ul", { className: "legend" }, entries.filter(Boolean).map(([kind, text]) => el("li", {}, el("span", { className: `swatch ${kind}`, "aria-hidden": "true" }), text)));
}
