// The selected gap: what was measured around it and what was filled, axis by axis, with the band of ±2 σ.

function tracks({ model, take, gaps }) {
  if (gaps.length === 0) return null;
  const title = el("h2", { id: "gap-title" });
  const facts = el("p", { className: "facts" });
  const panes = ["x", "y", "z"].map((axis) => ({ axis, host: el("div", { className: "track" }), value: el("output", { className: "track-value" }) }));
  const why = el("div", { className: "why" });
  const node = el("section", { id: "gap", className: "card", "aria-labelledby": "gap-title" },
    el("div", { className: "card-head" }, title, facts),
    panes.map(({ axis, host, value }) => el("div", { className: "pane keep" }, el("h3", {}, `${axis}, mm`, value), host)),
    legend(["line measured-line", "measured"], ["line filled-line", "filled"], ["band", "±2 σ"], take.raw.size > 0 && ["dot suspect-dot", "dropped"]), why);
  let gap = gaps[0], table = null;

  /** Frames around the gap, and for each axis: measured, filled, upper and lower edge of the band, dropped. */
  function read() {
    const around = Math.max(20, Math.round(0.6 * gap.frames), Math.round(take.rate / 4));
    const from = Math.max(0, gap.start - around), to = Math.min(take.frames, gap.start + gap.frames + around);
    const frames = take.shown.filter((frame) => frame >= from && frame < to);
    const at = frames.map((frame) => take.at(gap.marker, frame));
    const labels = frames.map((frame) => take.label(frame));
    const series = [0, 1, 2].map((axis) => {
      const value = (i) => {
        const x = take.mm[3 * i + axis];
        return Number.isNaN(x) ? null : x;
      };
      const seen = at.map((i) => (take.state[i] === OBSERVED ? value(i) : null));
      // the filled line touches its neighbours, so that it can be seen where it joins
      const filled = at.map((i, k) => (take.state[i] === FILLED || [at[k - 1], at[k + 1]].some((j) => take.state[j] === FILLED) ? value(i) : null));
      const edge = (sign) => at.map((i, k) => {
        if (filled[k] === null) return null;
        return filled[k] + sign * 2 * (take.state[i] === FILLED && take.sigma[i] > 0 ? take.sigma[i] : 0);
      });
      const dropped = at.map((i) => (take.raw.has(i) ? take.raw.get(i)[axis] : null));
      return [labels, seen, filled, edge(1), edge(-1), dropped];
    });
    return { frames, series };
  }

  const made = panes.map(({ host, axis: name }, k) =>
    chart(host, {
      take,
      playhead: true,
      jumps: true,
      label: `${name} of the selected marker over time`,
      options: () => ({
        height: k === 2 ? 146 : 120,
        padding: [6, 16, 0, 0],
        cursor: { sync: { key: "gap", setSeries: false } },
        scales: {
          x: { time: false, range: (_, low, high) => [low, high] },
          y: { range: (_, low, high) => (low === null ? [0, 1] : [low - Math.max(2, 0.06 * (high - low)), high + Math.max(2, 0.06 * (high - low))]) },
        },
        axes: [frameAxis(k === 2 ? {} : { values: (_, at) => at.map(() => ""), size: 4 }), axis({ size: 58, space: 28 })],
        bands: [{ series: [3, 4], fill: alpha(colour("band"), 0.28) }],
        series: [
          {},
          { stroke: colour("measured"), width: 1.6, points: { show: false } },
          { stroke: colour("filled"), width: 2, points: { show: gap.frames < 3, size: 5, fill: colour("filled") } },
          { stroke: alpha(colour("band"), 0.55), width: 0.8, points: { show: false } },
          { stroke: alpha(colour("band"), 0.55), width: 0.8, points: { show: false } },
          { stroke: colour("suspect"), paths: () => null, points: { show: true, size: 5, stroke: colour("suspect"), fill: colour("suspect") } },
        ],
        hooks: { drawClear: [shade] },
      }),
      data: () => table.series[k],
    }));
  /** The gap's own frames stand on a ground of their own. */
  function shade(plot) {
    const { ctx, bbox } = plot;
    const left = Math.max(bbox.left, plot.valToPos(take.label(gap.start) - 0.5, "x", true));
    const right = Math.min(bbox.left + bbox.width, plot.valToPos(take.label(gap.start + gap.frames - 1) + 0.5, "x", true));
    ctx.fillStyle = alpha(colour(gap.open ? "open" : "filled"), gap.open ? 0.12 : 0.06);
    if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
  }

  function tell() {
    const frame = take.nearest(state.frame);
    const i = take.at(gap.marker, frame);
    panes.forEach(({ value }, axis) => {
      const x = take.mm[3 * i + axis];
      const sigma = take.sigma[i];
      const text = Number.isNaN(x) ? "missing" : `${x.toFixed(1)}${sigma > 0 ? ` ± ${(2 * sigma).toFixed(1)}` : ""}`;
      value.textContent = `${text}  at frame ${take.label(frame)}`;
    });
  }
  function choose() {
    if (state.gap !== null && gaps[state.gap]) gap = gaps[state.gap];
    const last = gap.start + gap.frames - 1;
    title.textContent = `Gap of ${take.markers[gap.marker]}`;
    const words = [
      gap.frames > 1 ? `frames ${take.label(gap.start)} – ${take.label(last)}` : `frame ${take.label(gap.start)}`,
      `${counted(gap.frames, "frame")}, ${seconds(gap.frames / take.rate)}`,
      gap.open ? `left open: ${reason(gap.open)}` : gap.sigma_mm == null ? null : `worst σ ${mm(gap.sigma_mm)}${gap.worst === null ? "" : ` at frame ${take.label(gap.worst)}`}`,
    ];
    facts.textContent = words.filter(Boolean).join(" · ");
    table = read();
    made.forEach((one) => one.build());
    why.replaceChildren(...(gap.explanation || []).map((part) => stretch(take, part, gap.explanation.length > 1)));
    if (!gap.open && gap.sigma_mm == null) why.append(el("p", { className: "help" }, `${model.method} does not say how sure it is, so there is no band.`));
    tell();
  }
  listen("gap", choose);
  listen("frame", tell);
  choose();
  return node;
}

/** Why a stretch was filled as it was: experts by share, and who judged them. */
function stretch(take, part, several) {
  const span = several ? `Frames ${part.first_frame} – ${part.last_frame}: ` : "";
  const judged = part.simulated_gaps > 0
    ? `expected error ${mm(part.predicted_mm)}, judged by ${counted(part.simulated_gaps, "simulated gap")} of ${counted(part.simulated_frames, "frame")}`
    : `expected error ${mm(part.predicted_mm)}; nothing could judge it, too little was seen`;
  const bars = part.experts.map((expert) => {
    const bar = el("span", { className: "share-bar" });
    bar.style.width = `${Math.max(2, Math.round(100 * expert.share))}%`;
    return el("li", {},
      el("span", { className: "share" }, `${Math.round(100 * expert.share)} %`),
      el("span", { className: "share-track", "aria-hidden": "true" }, bar),
      el("span", {}, expert.expert),
      el("span", { className: "help" }, expert.error_mm == null ? "" : `${mm(expert.error_mm)} on simulated gaps`));
  });
  return el("div", { className: "stretch keep" },
    el("h3", {}, `${span}${span ? judged : judged.charAt(0).toUpperCase() + judged.slice(1)}`),
    el("ul", { className: "shares" }, bars),
    part.neighbours.length > 0 && el("p", { className: "help" }, `Predicted from ${part.neighbours.map((label) => bare(take, label)).join(", ")}.`));
}

/** A colour of the page with an opacity. */
function alpha(text, a) {
  return `rgb(${hex(text).join(" ")} / ${a})`;
}
