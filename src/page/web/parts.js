// How each part of a body was followed through clouds: a map of parts and time, the curves of one part, and the rounds of EM of a frame.

/** Where a value of the map stands between good and bad, and how it is said. */
const SHOWN = {
  coverage: { name: "Covered share of the surface", scale: () => 100, bad: (x, most) => 1 - x / most, say: (x) => `${short(x)} %`, ends: (most) => [`${most} %`, "0 %"] },
  residual_cm: { name: "Distance of points", scale: (all) => all.flat().reduce((most, x) => Math.max(most, x ?? 0), 0.5), bad: (x, most) => x / most, say: (x) => `${short(x)} cm`, ends: (most) => ["0 cm", `${short(most)} cm`] },
};

function partMap({ model, take, gaps }) {
  const parts = model.followed.by_part;
  if (!parts || parts.markers.length === 0) return null;
  const names = parts.markers.map((marker) => take.markers[marker]);
  const most = Object.fromEntries(Object.entries(SHOWN).map(([key, { scale }]) => [key, scale(parts[key])]));
  const lost = gaps.filter((event) => event.kind === "lost").map((event) => ({ ...event, row: parts.markers.indexOf(event.marker) })).filter(({ row }) => row >= 0);
  let shown = "coverage", row = Math.max(0, lost.length > 0 ? lost[0].row : 0);
  const height = names.length <= 30 ? 18 : 11;
  const host = el("div", { className: "part-map" });
  const tip = el("div", { className: "tip", hidden: true, "aria-hidden": "true" });
  const lostAt = (k, frame) => lost.some((event) => event.row === k && event.start <= frame && frame < event.start + event.frames);

  let tints = new Map();
  function tint(x) {
    const step = Math.round(40 * SHOWN[shown].bad(x, most[shown]));
    if (!tints.has(step)) tints.set(step, ramp(step / 40));
    return tints.get(step);
  }
  function paint(plot) {
    tints = new Map();
    const { ctx, bbox } = plot;
    const px = window.devicePixelRatio || 1;
    const left = (frame) => plot.valToPos(take.label(frame - 0.5), "x", true);
    const tall = Math.max(2, Math.round(height * px * 0.78));
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const columns = Math.max(1, Math.round(bbox.width));
    const frameAt = (k) => plot.posToVal((k / columns) * plot.over.clientWidth, "x");
    const place = (label) => Math.floor((label - take.label(-0.5)) / (take.label(1) - take.label(0)));
    parts[shown].forEach((values, k) => {
      const top = Math.round(plot.valToPos(k, "y", true) - tall / 2);
      let from = 0, last = null;
      // one colour for each column of pixels: its worst frame
      for (let column = 0; column <= columns; column++) {
        let next = null;
        if (column < columns) {
          const start = Math.max(0, place(frameAt(column))), end = Math.min(take.frames, Math.max(start + 1, place(frameAt(column + 1))));
          let worst = null;
          for (let frame = start; frame < end; frame++) {
            const x = values[frame];
            if (x !== null && (worst === null || SHOWN[shown].bad(x, most[shown]) > SHOWN[shown].bad(worst, most[shown]))) worst = x;
          }
          next = worst === null ? null : tint(worst);
        }
        if (next === last) continue;
        if (last) {
          ctx.fillStyle = last;
          ctx.fillRect(bbox.left + from, top, column - from, tall);
        }
        [from, last] = [column, next];
      }
      if (k === row) {
        ctx.fillStyle = colour("accent");
        ctx.fillRect(bbox.left, top - 2 * px, bbox.width, px);
        ctx.fillRect(bbox.left, top + tall + px, bbox.width, px);
      }
    });
    // a light line inside of the frame, or it could not be told from a dark ground
    for (const event of lost) {
      const x = left(event.start), y = Math.round(plot.valToPos(event.row, "y", true) - tall / 2), width = left(event.start + event.frames) - x;
      for (const [name, line, inset] of [["card", 1.5, 2.5], ["suspect", 2, 1]]) {
        ctx.strokeStyle = colour(name);
        ctx.lineWidth = line * px;
        ctx.strokeRect(x + inset * px, y + inset * px, Math.max(1, width - 2 * inset * px), tall - 2 * inset * px);
      }
    }
    ctx.restore();
  }

  const widest = Math.max(...names.map((name) => widthOf(name, FONT)));
  const grounds = eventGrounds(take, gaps);
  const made = chart(host, {
    take,
    playhead: true,
    label: `Map of ${counted(names.length, "part")} over ${counted(take.frames, "frame")}, coloured by how much of each has points beside it, or how far these are`,
    options: (width) => ({
      height: names.length * height + 40,
      padding: [4, 16, 0, 0],
      cursor: { sync: { key: "followed", setSeries: false }, ...ZOOMS },
      scales: { x: { time: false, range: frameRange(take) }, y: { dir: -1, range: () => [-0.6, names.length - 0.4] } },
      axes: [
        frameAxis({ grid: { show: false } }),
        axis({
          grid: { show: false },
          size: Math.min(Math.max(58, widest + BESIDE), width * 0.32),
          splits: () => names.map((_, k) => k),
          values: (_, at) => at.map((k) => cutLabel(names[k], width * 0.32 - BESIDE, FONT)),
          gap: 6,
        }),
      ],
      series: [{}, { show: false }],
      hooks: { draw: [paint] },
    }),
    data: () => [[take.label(-0.5), take.label(take.frames - 0.5)], [0, 0]],
    onready(plot) {
      plot.over.style.cursor = "pointer";
      const at = (event) => {
        const box = plot.over.getBoundingClientRect();
        const k = Math.round(plot.posToVal(event.clientY - box.top, "y"));
        return [Math.max(0, Math.min(names.length - 1, k)), take.frameOf(plot.posToVal(event.clientX - box.left, "x"))];
      };
      plot.over.addEventListener("click", (event) => {
        const [k, frame] = at(event);
        choose(k);
        jump(take, frame, { marker: parts.markers[k] });
      });
      plot.over.addEventListener("pointermove", (event) => {
        const [k, frame] = at(event);
        tip.hidden = false;
        tip.textContent = describe(k, frame);
        const box = host.getBoundingClientRect();
        tip.style.left = `${Math.max(0, Math.min(event.clientX - box.left + 12, host.clientWidth - tip.offsetWidth))}px`;
        tip.style.top = `${event.clientY - box.top + 16}px`;
      });
      plot.over.addEventListener("pointerleave", () => (tip.hidden = true));
    },
  });
  function describe(k, frame) {
    const said = ["coverage", "residual_cm"].map((key) => {
      const x = parts[key][k][frame];
      return x === null || x === undefined ? null : `${SHOWN[key].say(x)} ${key === "coverage" ? "covered" : "from its points"}`;
    });
    const words = said.filter(Boolean);
    return `${names[k]}, frame ${take.label(frame)}: ${words.length > 0 ? words.join(", ") : "no points"}${lostAt(k, frame) ? ", lost" : ""}`;
  }

  const ends = el("span", { className: "ramp-legend" });
  const key = () => {
    const [good, bad] = SHOWN[shown].ends(most[shown]);
    ends.replaceChildren(el("span", {}, good), el("span", { className: "ramp", role: "img", "aria-label": "colours from good to bad" }), el("span", {}, bad));
  };
  key();
  const what = el("select", { "aria-label": "What the colours show" }, Object.entries(SHOWN).map(([name, { name: text }]) => el("option", { value: name }, text)));
  what.addEventListener("change", () => {
    shown = what.value;
    key();
    if (made.plot) made.plot.redraw(false, false);
  });
  const pick = el("select", { "aria-label": "The part whose curves are shown" }, names.map((name, k) => el("option", { value: k }, name)));
  const panes = [["Covered share of its surface, %", "coverage"], ["Distance of its points, cm (root mean square)", "residual_cm"]]
    .map(([title, name]) => framePane(take, grounds, title, () => parts[name][row]));
  function choose(k) {
    row = k;
    pick.value = String(k);
    if (made.plot) made.plot.redraw(false, false);
    panes.forEach((pane) => pane.again());
  }
  pick.addEventListener("change", () => choose(Number(pick.value)));
  pick.value = String(row);
  return section("parts", "Part by part", "A click goes to a frame and shows the curves of the part.",
    el("p", { className: "controls" }, what),
    el("div", { className: "map-holder" }, host, tip),
    el("div", { className: "legend-row" }, ends, legend(lost.length > 0 && ["suspect-box", "lost"])),
    el("p", { className: "controls" }, pick),
    el("div", { className: "bone-plots" }, panes.map((pane) => pane.node)));
}

/** The rounds of EM of the frame at the playhead. */
function roundPlots({ model, take }) {
  const parts = model.followed.by_part;
  if (!parts) return null;
  const most = parts.rounds.reduce((most, rounds) => Math.max(most, rounds.length), 1);
  const now = () => parts.rounds[state.frame] || [];
  const title = el("p", { className: "help", role: "status" });
  const panes = ["Log-likelihood, nats", "Standard deviation, cm", "Share of points that belong to the body"].map((name, k) => {
    const host = el("div");
    const value = el("output", { className: "track-value" });
    const data = () => [now().map((_, round) => round + 1), now().map((round) => round[k])];
    const made = chart(host, {
      take,
      label: `${name}, round by round`,
      options: () => ({
        height: 130,
        padding: [6, 10, 0, 0],
        scales: { x: { time: false, range: () => [0.7, most + 0.3] }, y: { range: roomy } },
        axes: [axis({ size: 24, space: 24, incrs: [1, 2, 5, 10, 20, 50, 100, 200], values: (_, at) => at.map(String) }), axis({ size: 58, space: 26, values: (_, at) => at.map(compact) })],
        series: [{}, { stroke: colour("measured"), width: 1.6, points: { show: true, size: 5, fill: colour("measured") } }],
      }),
      data,
    });
    const tell = () => {
      if (made.plot) made.plot.setData(data());
      const ways = now().map((round) => round[k]).filter((x) => x !== null);
      value.textContent = ways.length > 0 ? `${short(ways[0])} → ${short(ways.at(-1))}` : "";
    };
    return { node: el("div", { className: "pane keep" }, el("h3", {}, name, value), host), tell };
  });
  const tell = () => {
    const rounds = now().length;
    title.textContent = `Frame ${take.label(state.frame)}: ${rounds > 0 ? counted(rounds, "round") : "no rounds, because it has no points"}.`;
    panes.forEach((pane) => pane.tell());
  };
  listen("frame", tell);
  tell();
  return section("rounds", "Round by round", "How EM came to the pose of the frame that the player shows.", title, el("div", { className: "em-plots" }, panes.map((pane) => pane.node)));
}
