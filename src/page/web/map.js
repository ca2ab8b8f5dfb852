// The gap map: one row for each marker that has something to show, time from left to right.

const MOST_ROWS = 400;

/** Gaps as the page needs them, in the order of the model. */
function gapList(model, take) {
  return model.gaps.map((gap, index) => {
    let worst = null, most = 0;
    for (let frame = gap.start; frame < gap.start + gap.frames; frame++) {
      const sigma = take.sigma[take.at(gap.marker, frame)];
      if (sigma > most) [worst, most] = [frame, sigma];
    }
    return { ...gap, index, worst };
  });
}

function gapMap({ model, take, gaps, scale }) {
  if (gaps.length === 0 && model.suspects.length === 0) {
    return section("map", "Gaps", null,
      el("p", { className: "empty" }, `Nothing is missing: all ${counted(take.markers.length, "marker")} were seen in all ${counted(take.frames, "frame")}. There was nothing to fill.`));
  }
  const rows = [...new Set([...gaps.map((g) => g.marker), ...model.suspects.map((s) => s.marker)])].sort((a, b) => a - b).slice(0, MOST_ROWS);
  const rowOf = new Map(rows.map((marker, row) => [marker, row]));
  const rowHeight = rows.length <= 12 ? 22 : rows.length <= 40 ? 15 : rows.length <= 80 ? 11 : 7;
  const font = rowHeight < 15 ? FONT.replace("12px", "10px") : FONT;
  const widest = Math.max(...rows.map((marker) => widthOf(take.markers[marker], font)));
  const complete = take.markers.length - rows.length;
  const host = el("div", { className: "gap-map" });
  const tip = el("div", { className: "tip", hidden: true, "aria-hidden": "true" });
  const live = el("p", { className: "visually-hidden", role: "status" });

  /** The gap at a place of the picture. A narrow one may be missed by a few pixels. */
  function gapAt(plot, x, y) {
    const row = Math.round(plot.posToVal(y, "y"));
    const frame = take.frameOf(plot.posToVal(x, "x"));
    const slack = Math.ceil((4 / plot.over.clientWidth) * take.frames);
    let best = null, least = Infinity;
    for (const gap of gaps) {
      if (rowOf.get(gap.marker) !== row) continue;
      const off = Math.max(gap.start - frame, frame - (gap.start + gap.frames - 1), 0);
      if (off <= slack && off < least) [best, least] = [gap, off];
    }
    return best ? { gap: best, frame: Math.max(best.start, Math.min(best.start + best.frames - 1, frame)) } : null;
  }

  function paint(plot) {
    const { ctx, bbox } = plot;
    const px = window.devicePixelRatio || 1;
    const unit = Math.abs(plot.valToPos(take.label(1), "x", true) - plot.valToPos(take.label(0), "x", true));
    const height = Math.max(2, Math.round(rowHeight * px * 0.68));
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const box = (start, frames, row) => {
      const x = plot.valToPos(take.label(start), "x", true) - unit / 2;
      const y = plot.valToPos(row, "y", true) - height / 2;
      return [x, Math.round(y), Math.max(1.5 * px, unit * frames), height];
    };
    ctx.fillStyle = colour("line");
    for (const [, row] of rowOf) ctx.fillRect(bbox.left, Math.round(plot.valToPos(row, "y", true)), bbox.width, Math.max(1, px / 2));
    for (const gap of gaps) {
      const row = rowOf.get(gap.marker);
      if (row === undefined) continue;
      const [x, y, width, tall] = box(gap.start, gap.frames, row);
      if (gap.open) {
        ctx.save();
        ctx.beginPath();
        ctx.rect(x, y, width, tall);
        ctx.clip();
        ctx.fillStyle = colour("card");
        ctx.fillRect(x, y, width, tall);
        ctx.strokeStyle = colour("open");
        ctx.lineWidth = px;
        ctx.beginPath();
        for (let k = Math.floor((x - tall) / (4 * px)) * 4 * px; k < x + width; k += 4 * px) {
          ctx.moveTo(k, y + tall);
          ctx.lineTo(k + tall, y);
        }
        ctx.stroke();
        ctx.strokeRect(x + px / 2, y + px / 2, width - px, tall - px);
        ctx.restore();
        continue;
      }
      // one colour for each column of pixels: its least sure frame
      const first = Math.round(x), pixels = Math.max(1, Math.round(x + width) - first);
      let from = 0, tint = null;
      for (let k = 0; k <= pixels; k++) {
        const next = k < pixels ? tintOf(gap, k / pixels, (k + 1) / pixels) : null;
        if (next === tint) continue;
        if (tint) {
          ctx.fillStyle = tint;
          ctx.fillRect(first + from, y, k - from, tall);
        }
        [from, tint] = [k, next];
      }
    }
    ctx.strokeStyle = colour("suspect");
    ctx.lineWidth = 1.5 * px;
    for (const suspect of model.suspects) {
      const row = rowOf.get(suspect.marker);
      if (row === undefined) continue;
      const [x, y, width, tall] = box(suspect.start, suspect.frames, row);
      ctx.strokeRect(x - px, y - px, width + 2 * px, tall + 2 * px);
    }
    const chosen = gaps[state.gap];
    if (chosen && rowOf.has(chosen.marker)) {
      const [x, y, width, tall] = box(chosen.start, chosen.frames, rowOf.get(chosen.marker));
      ctx.strokeStyle = colour("ink");
      ctx.lineWidth = 1.5 * px;
      ctx.strokeRect(x - 2 * px, y - 2 * px, width + 4 * px, tall + 4 * px);
    }
    ctx.restore();
  }
  const tints = new Map();
  function tintOf(gap, a, b) {
    let most = -1;
    const from = gap.start + Math.floor(a * gap.frames), to = gap.start + Math.max(Math.floor(a * gap.frames) + 1, Math.ceil(b * gap.frames));
    for (let frame = from; frame < to; frame++) most = Math.max(most, take.sigma[take.at(gap.marker, frame)] || -1);
    const step = most < 0 ? 20 : Math.round(40 * scale.at(most));
    const key = 2 * step + (document.documentElement.dataset.theme === "dark" ? 1 : 0);
    if (!tints.has(key)) tints.set(key, ramp(step / 40));
    return tints.get(key);
  }

  const made = chart(host, {
    take,
    playhead: true,
    label: `Gap map: ${counted(gaps.length, "gap")} of ${counted(rows.length, "marker")} over ${counted(take.frames, "frame")}; the table below lists them`,
    options: (width) => ({
      height: rows.length * rowHeight + 40,
      padding: [4, 16, 0, 0],
      cursor: ZOOMS,
      scales: {
        x: { time: false, range: frameRange(take) },
        y: { dir: -1, range: () => [-0.6, rows.length - 0.4] },
      },
      axes: [
        frameAxis({ grid: { show: false } }),
        axis({
          grid: { show: false },
          size: Math.min(Math.max(44, widest + BESIDE), width * 0.32),
          splits: () => rows.map((_, row) => row).filter((row) => rowHeight >= 11 || row % Math.ceil(11 / rowHeight) === 0),
          values: (_, at) => at.map((row) => cutLabel(take.markers[rows[row]], width * 0.32 - BESIDE, font)),
          font,
          gap: 6,
        }),
      ],
      series: [{}, { show: false }],
      hooks: { draw: [paint] },
    }),
    data: () => [[take.label(-0.5), take.label(take.frames - 0.5)], [0, 0]],
    onready(plot) {
      plot.over.style.cursor = "pointer";
      const place = (event) => {
        const box = plot.over.getBoundingClientRect();
        return [event.clientX - box.left, event.clientY - box.top];
      };
      plot.over.addEventListener("click", (event) => {
        const [x, y] = place(event);
        const found = gapAt(plot, x, y);
        if (found) selectGap(take, gaps, found.gap.index, found.frame);
        else jump(take, take.frameOf(plot.posToVal(x, "x")));
      });
      plot.over.addEventListener("pointermove", (event) => {
        const [x, y] = place(event);
        const found = gapAt(plot, x, y);
        tip.hidden = !found;
        if (!found) return;
        tip.textContent = describe(found.gap);
        const box = host.getBoundingClientRect();
        const left = event.clientX - box.left;
        tip.style.left = `${Math.max(0, Math.min(left + 12, host.clientWidth - tip.offsetWidth))}px`;
        tip.style.top = `${event.clientY - box.top + 16}px`;
      });
      plot.over.addEventListener("pointerleave", () => (tip.hidden = true));
    },
  });
  function describe(gap) {
    const span = gap.frames > 1 ? `${take.label(gap.start)} – ${take.label(gap.start + gap.frames - 1)}` : String(take.label(gap.start));
    const what = gap.open ? `left open: ${reason(gap.open)}` : gap.sigma_mm == null ? "filled" : `filled, worst σ ${mm(gap.sigma_mm)}`;
    return `${take.markers[gap.marker]}, ${span} (${counted(gap.frames, "frame")}), ${what}`;
  }
  listen("gap", () => {
    if (made.plot) made.plot.redraw(false, false);
    if (gaps[state.gap]) live.textContent = describe(gaps[state.gap]);
  });

  // arrows go along a row, or to the gap of another row that is nearest in time
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-roledescription", "gap map");
  host.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
    const move = moves[event.key];
    if (!move || event.ctrlKey || event.metaKey || event.altKey || gaps.length === 0) return;
    event.preventDefault();
    const now = gaps[state.gap];
    if (!now) return selectGap(take, gaps, 0);
    const [dRow, dTime] = move;
    if (dTime) {
      const row = gaps.filter((g) => g.marker === now.marker);
      const next = row[row.indexOf(now) + dTime];
      if (next) selectGap(take, gaps, next.index);
      return;
    }
    const middle = (g) => g.start + g.frames / 2;
    const start = rows.indexOf(now.marker);
    for (let row = start + dRow; row >= 0 && row < rows.length; row += dRow) {
      const there = gaps.filter((g) => g.marker === rows[row]);
      if (there.length === 0) continue;
      there.sort((a, b) => Math.abs(middle(a) - middle(now)) - Math.abs(middle(b) - middle(now)));
      return selectGap(take, gaps, there[0].index);
    }
  });

  const open = gaps.some((g) => g.open), filled = gaps.some((g) => !g.open);
  const rest = complete > 0 ? `${counted(complete, "marker")} without gaps not shown.` : null;
  return section("map", "Gaps", "Click one to go there; drag to look closer, double-click to see all.",
    el("div", { className: "map-holder" }, host, tip), live,
    el("div", { className: "legend-row" },
      filled && scale.known && el("span", { className: "ramp-legend" }, el("span", {}, `σ ${mm(scale.low)}`), el("span", { className: "ramp", role: "img", "aria-label": "colours from sure to unsure" }), el("span", {}, mm(scale.high))),
      legend(filled && !scale.known && ["sigma-none", "filled"], open && ["hatch", "left open"], model.suspects.length > 0 && ["suspect-box", "suspicious"]),
      rest && el("span", { className: "help" }, rest)),
    gapTable({ model, take, gaps }));
}

/** What an axis takes besides its labels, in px. */
const BESIDE = 14;

const pen = document.createElement("canvas").getContext("2d");

/** How wide a text is, in px. */
function widthOf(text, font) {
  pen.font = font;
  return pen.measureText(text).width;
}

/** A label that fits beside the map: what tells labels apart is at either end. */
function cutLabel(label, room, font) {
  const cut = (kept) => `${label.slice(0, kept - Math.floor(0.6 * kept))}…${label.slice(-Math.floor(0.6 * kept))}`;
  if (widthOf(label, font) <= room) return label;
  let kept = label.length - 1;
  while (kept > 2 && widthOf(cut(kept), font) > room) kept--;
  return cut(kept);
}
