// Bone lengths over time: the expected length, how much it varies where both ends were measured, and what filling made of it.

const FIRST_BONES = 4;
const MOST_BONES = 12;

function bonePlots({ take, bones }) {
  if (bones.length === 0) {
    return section("bones", "Bones", null, el("p", { className: "empty" }, "No two markers keep their distance, so there are no bones to look at."));
  }
  const order = bones.slice().sort((a, b) => b.worst - a.worst || b.touched - a.touched || a.index - b.index);
  const touched = order.some((b) => b.touched > 0);
  const chosen = new Set(order.filter((b) => b.touched > 0 || !touched).slice(0, FIRST_BONES).map((b) => b.index));
  const holder = el("div", { className: "bone-plots" });
  const open = new Map();

  function plot(judged) {
    const { bone } = judged;
    const host = el("div", { className: "bone-plot" });
    const value = el("output", { className: "track-value" });
    const labels = take.shown.map((frame) => take.label(frame));
    const lengths = take.shown.map((frame) => {
      const length = take.distance(bone.a, bone.b, frame);
      return Number.isNaN(length) ? null : length;
    });
    const isFilled = take.shown.map((frame) => take.state[take.at(bone.a, frame)] === FILLED || take.state[take.at(bone.b, frame)] === FILLED);
    const seen = lengths.map((length, k) => (isFilled[k] ? null : length));
    const filled = lengths.map((length, k) => (isFilled[k] || isFilled[k - 1] || isFilled[k + 1] ? length : null));
    const made = chart(host, {
      take,
      playhead: true,
      jumps: true,
      label: `Length of ${boneName(take, bone)} over time: expected ${mm(bone.length_mm)}, worst error in filled frames ${mm(judged.worst)}`,
      options: () => ({
        height: 104,
        padding: [6, 16, 0, 0],
        cursor: { sync: { key: "bones", setSeries: false }, ...ZOOMS },
        scales: {
          x: { time: false, range: frameRange(take) },
          y: { range: (_, low, high) => {
            const l = Math.min(low ?? bone.length_mm, bone.length_mm - 2 * bone.spread_mm), h = Math.max(high ?? bone.length_mm, bone.length_mm + 2 * bone.spread_mm);
            const room = Math.max(1, 0.08 * (h - l));
            return [l - room, h + room];
          } },
        },
        axes: [frameAxis({ size: 24 }), axis({ size: 58, space: 26 })],
        series: [
          {},
          { stroke: colour("bone"), width: 1.2, points: { show: false } },
          { stroke: colour("filled"), width: 1.8, points: { show: false } },
        ],
        hooks: { drawClear: [reference] },
      }),
      data: () => [labels, seen, filled],
    });
    function reference(p) {
      const { ctx, bbox } = p;
      const y = (length) => Math.max(bbox.top, Math.min(bbox.top + bbox.height, p.valToPos(length, "y", true)));
      const top = y(bone.length_mm + bone.spread_mm), bottom = y(bone.length_mm - bone.spread_mm);
      ctx.fillStyle = alpha(colour("measured"), 0.14);
      ctx.fillRect(bbox.left, top, bbox.width, Math.max(1, bottom - top));
      ctx.strokeStyle = alpha(colour("measured"), 0.8);
      ctx.lineWidth = window.devicePixelRatio || 1;
      ctx.setLineDash([5, 4]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y(bone.length_mm));
      ctx.lineTo(bbox.left + bbox.width, y(bone.length_mm));
      ctx.stroke();
      ctx.setLineDash([]);
    }
    const worst = judged.touched > 0
      ? el("button", { type: "button", className: "plain link", onclick: () => jump(take, judged.frame) }, `worst ${mm(judged.worst)} off at frame ${take.label(judged.frame)}`)
      : el("span", {}, "never filled");
    const node = el("div", { className: "pane keep" }, el("h3", {}, el("strong", {}, boneName(take, bone)), ` ${mm(bone.length_mm)} ± ${bone.spread_mm.toFixed(1)} · `, worst, value), host);
    const tell = () => {
      const frame = take.nearest(state.frame);
      const length = take.distance(bone.a, bone.b, frame);
      value.textContent = Number.isNaN(length) ? "missing" : mm(length);
    };
    return { node, made, tell };
  }
  function show() {
    for (const [index, one] of open) {
      if (chosen.has(index)) continue;
      one.made.close();
      one.node.remove();
      open.delete(index);
    }
    for (const judged of order) {
      if (!chosen.has(judged.index) || open.has(judged.index)) continue;
      open.set(judged.index, plot(judged));
    }
    holder.append(...order.filter((b) => open.has(b.index)).map((b) => open.get(b.index).node));
    tell();
  }
  const tell = () => open.forEach((one) => one.tell());
  listen("frame", tell);

  const boxes = new Map();
  const choices = el("ul", { className: "choices" }, order.map((judged) => {
    const box = el("input", { type: "checkbox", checked: chosen.has(judged.index) });
    boxes.set(judged.index, box);
    box.addEventListener("change", () => {
      if (box.checked && chosen.size >= MOST_BONES) {
        const oldest = chosen.values().next().value;
        chosen.delete(oldest);
        boxes.get(oldest).checked = false;
      }
      if (box.checked) chosen.add(judged.index);
      else chosen.delete(judged.index);
      show();
    });
    return el("li", {}, el("label", {}, box, el("span", {}, boneName(take, judged.bone)), el("span", { className: "number help" }, judged.touched ? mm(judged.worst) : "")));
  }));
  listen("bone", () => {
    if (state.bone === undefined || chosen.has(state.bone)) return;
    boxes.get(state.bone).checked = true;
    chosen.add(state.bone);
    show();
  });
  show();
  return section("bones", "Bones", touched ? "Lengths over time, the worst ones first." : "Lengths over time. None was touched by filling.",
    holder,
    legend(["line bone-line", "both ends measured"], touched && ["line filled-line", "an end filled"], ["length-band", "expected length ± measured spread"]),
    el("details", { className: "controls" }, el("summary", {}, `Choose among ${counted(bones.length, "bone")}`), choices));
}
