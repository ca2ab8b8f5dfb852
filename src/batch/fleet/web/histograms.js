// How takes are spread: by what is missing, by how sure the worst sample is, by time. A bar shows its takes in the table.

/** Takes between bounds, each with how many. The last bound is open, the first bar is what is exactly nothing. */
function histogram(batch, { title, help, id, bounds, label, unit, none }) {
  const { numbers } = columnOf(batch, id);
  const edges = [...bounds, Infinity];
  const counts = edges.map(() => 0);
  let zero = 0, unknown = 0;
  for (const x of numbers) {
    if (x !== x) unknown++;
    else if (none && x === 0) zero++;
    else counts[edges.findIndex((edge) => x < edge)]++;
  }
  let bars = edges.map((to, k) => ({ from: k === 0 ? (none ? Number.MIN_VALUE : 0) : edges[k - 1], to, count: counts[k], title: (k === 0 ? `below ${label(to)}` : to === Infinity ? `${label(edges[k - 1])} or more` : `${label(edges[k - 1])} to ${label(to)}`) + unit, short: to === Infinity ? `≥ ${label(edges[k - 1])}` : `< ${label(to)}` }));
  // bars beyond the data are left out
  let last = bars.length - 1;
  while (last > 0 && bars[last].count === 0) last--;
  bars = bars.slice(0, last + 1);
  if (none) bars.unshift({ from: 0, to: Number.MIN_VALUE, count: zero, title: none, short: "0" });
  const most = Math.max(1, ...bars.map((bar) => bar.count));
  const known = bars.reduce((total, bar) => total + bar.count, 0);
  if (known === 0) return null;
  const nodes = bars.map((bar) => {
    const fill = el("span", { className: "bar-fill" });
    fill.style.height = `${bar.count > 0 ? Math.max(2, (100 * bar.count) / most) : 0}%`;
    const name = `${title.split(",")[0]}: ${bar.title}`;
    const button = el("button", { type: "button", className: "bar plain", disabled: bar.count === 0, title: `${bar.title}: ${counted(bar.count, "take")}`, "aria-label": `${bar.title}: ${counted(bar.count, "take")}`, onclick: () => showTakes({ range: { id, from: bar.from, to: bar.to, title: name }, sorted: id, down: true }) },
      el("span", { className: "bar-count" }, bar.count > 0 ? compact(bar.count) : ""), el("span", { className: "bar-room" }, fill), el("span", { className: "bar-label" }, bar.short));
    listen("range", () => button.classList.toggle("chosen", state.range?.title === name));
    return el("li", {}, button);
  });
  return el("div", { className: "spread keep" }, el("h3", {}, title), el("ul", { className: "bars" }, nodes), el("p", { className: "help" }, help, unknown > 0 && ` Not known of ${counted(unknown, "take")}.`));
}

const compact = (x) => (x < 10_000 ? whole(x) : x < 1e6 ? `${few(x / 1000).replace(/\.0+$/, "")} k` : `${few(x / 1e6)} M`);

function spread(batch) {
  const middle = (id, text) => orDash(median(columnOf(batch, id).numbers), text);
  const charts = [
    histogram(batch, { title: "Missing of a take, in percent", id: "share", bounds: [0.001, 0.003, 0.01, 0.03, 0.1, 0.3], label: (x) => String(Number((100 * x).toPrecision(3))), unit: " %", none: "nothing", help: `Half of the takes lack ${middle("share", percent)} or less.` }),
    histogram(batch, { title: "Worst uncertainty of a take, σ in mm", id: "sigma", bounds: [1, 2, 5, 10, 20, 50, 100], label: String, unit: " mm", help: `Half of the takes have at worst ${middle("sigma", mm)}.` }),
    histogram(batch, { title: "Worst bone of a take, in mm", id: "bone", bounds: [1, 2, 5, 10, 20, 50, 100], label: String, unit: " mm", help: `Half of the takes have at worst ${middle("bone", mm)}.` }),
    timeChart(batch),
  ].filter(Boolean);
  return charts.length > 0 ? section("spread", "How takes are spread", "A bar shows its takes in the table.", el("div", { className: "spreads" }, charts)) : null;
}
