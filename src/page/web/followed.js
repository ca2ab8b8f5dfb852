// A body that was followed: its numbers, what happened to it when, and values over frames. Instead of gaps, bones and a solver.

const EVENT_ROWS = 12;

/** Events as the player steps through them. */
const eventList = (model) => model.followed.events.map((event, index) => ({ ...event, index, worst: null }));

/** The numbers on top. */
const followedTiles = ({ model, take, gaps }) =>
  model.followed.tiles.map((t) => tile(t.title, t.value, t.unit, t.about, t.frame === undefined ? null : () => {
    const index = gaps.findIndex((event) => event.start === t.frame);
    jump(take, t.frame, t.warn && index >= 0 ? { gap: index, marker: gaps[index].marker } : {});
  }, t.warn ? "warn" : ""));

/** What happened, as a table: each row leads to its frames. */
function eventTable({ model, take, gaps }) {
  if (!model.followed) return null;
  if (gaps.length === 0) return section("events", "What happened", null, el("p", { className: "empty" }, model.followed.uneventful));
  let shown = EVENT_ROWS;
  const body = el("tbody");
  const columns = [["What", ""], ["Of what", ""], ["First", "number"], ["Last", "number wide"], ["Frames", "number"], ["Seconds", "number wide"]];
  const more = el("button", { type: "button", className: "button", onclick: () => ((shown += 100), fill()) });
  function row(event) {
    const cells = [
      el("button", { type: "button", className: "plain link", onclick: () => selectGap(take, gaps, event.index, event.start) }, event.kind),
      event.about,
      String(take.label(event.start)),
      String(take.label(event.start + event.frames - 1)),
      whole(event.frames),
      seconds(event.frames / take.rate),
    ];
    const line = el("tr", {}, cells.map((cell, at) => el("td", { className: columns[at][1] }, cell)));
    line.dataset.gap = event.index;
    return line;
  }
  function fill() {
    body.replaceChildren(...gaps.slice(0, state.print ? gaps.length : shown).map(row));
    more.hidden = shown >= gaps.length;
    more.textContent = `Show ${whole(Math.min(100, gaps.length - shown))} more of ${whole(gaps.length)}`;
    mark();
  }
  function mark() {
    for (const line of body.children) {
      if (Number(line.dataset.gap) === state.gap) line.setAttribute("aria-current", "true");
      else line.removeAttribute("aria-current");
    }
  }
  fill();
  listen("print", fill);
  listen("gap", mark);
  return section("events", "What happened", null, el("div", { className: "gap-table" },
    el("table", {}, el("caption", { className: "visually-hidden" }, "What happened, in order"),
      el("thead", {}, el("tr", {}, columns.map(([title, className]) => el("th", { scope: "col", className }, title)))), body),
    el("p", { className: "controls" }, more)));
}

/** Stretches of frames with events, each frame once: several parts may be lost in it. */
function eventGrounds(take, events) {
  const kinds = new Uint8Array(take.frames + 1);
  for (const { kind, start, frames } of events) {
    for (let frame = start; frame < start + frames; frame++) kinds[frame] = Math.max(kinds[frame], kind === "searched" ? 1 : 2);
  }
  const grounds = [];
  for (let frame = 0, start = 0; frame < take.frames; frame++) {
    if (kinds[frame] === kinds[frame + 1] && frame + 1 < take.frames) continue;
    if (kinds[frame] > 0) grounds.push({ start, frames: frame + 1 - start, searched: kinds[frame] === 1 });
    start = frame + 1;
  }
  return grounds;
}

/** A range with some room above and below. */
const roomy = (_, low, high) => {
  if (low === null) return [0, 1];
  const room = Math.max(0.08 * (high - low), 1e-4 * Math.abs(high), 1e-4);
  return [low - room, high + room];
};

/** A value over frames, `values()`, with what it is at the playhead; frames with events stand on a ground of their own. */
function framePane(take, grounds, title, values) {
  const host = el("div");
  const value = el("output", { className: "track-value" });
  const tell = () => {
    const x = values()[state.frame];
    value.textContent = `${x === null || x === undefined ? "unknown" : short(x)}  at frame ${take.label(state.frame)}`;
  };
  const shade = (plot) => {
    const { ctx, bbox } = plot;
    for (const { start, frames, searched } of grounds) {
      const left = Math.max(bbox.left, plot.valToPos(take.label(start - 0.5), "x", true));
      const right = Math.min(bbox.left + bbox.width, plot.valToPos(take.label(start + frames - 0.5), "x", true));
      ctx.fillStyle = alpha(colour(searched ? "band" : "filled"), 0.16);
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
  };
  const labels = Array.from({ length: take.frames }, (_, frame) => take.label(frame));
  const made = chart(host, {
    take,
    playhead: true,
    jumps: true,
    label: `${title} over frames`,
    options: () => ({
      height: 116,
      padding: [6, 16, 0, 0],
      cursor: { sync: { key: "followed", setSeries: false }, ...ZOOMS },
      scales: { x: { time: false, range: frameRange(take) }, y: { range: roomy } },
      axes: [frameAxis({ size: 24 }), axis({ size: 58, space: 26, values: (_, at) => at.map(compact) })],
      series: [{}, { stroke: colour("measured"), width: 1.6, points: { show: take.frames < 3 } }],
      hooks: { drawClear: [shade] },
    }),
    data: () => [labels, values()],
  });
  listen("frame", tell);
  tell();
  const again = () => (made.build(), tell());
  return { node: el("div", { className: "pane keep" }, el("h3", {}, title, value), host), again };
}

/** Values over frames, one below the other. */
function followedCurves({ model, take, gaps }) {
  if (!model.followed) return null;
  const grounds = eventGrounds(take, gaps);
  const panes = model.followed.curves.map((series) => framePane(take, grounds, series.title, () => series.values).node);
  return section("curves", "Frame by frame", "A click goes to a frame; dragging zooms, a double click shows all.", el("div", { className: "bone-plots" }, panes));
}
