// How the solver got there: likelihood, residual and bones by iteration, for every model that has them.

const WORST_CURVES = 6;

/** Line colours that people with any colour vision tell apart, as far as six can be. */
const CURVES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];

function solver({ model, take }) {
  const { stages } = model.summary;
  if (stages.length === 0) {
    return section("em", "The solver", null, el("p", { className: "empty" }, "Nothing was solved, because there was nothing to fill."));
  }
  const parts = stages.map((stage, number) => {
    const curve = model.curves.find((c) => c.stage === number);
    const ended = `${stage.method}: ${counted(stage.iterations, "iteration")}, ${stopWords(stage.stop)}`;
    const heading = el("h3", { className: "stage-title" }, stages.length > 1 ? `${number + 1}. ${ended}` : ended);
    if (!curve) return el("div", { className: "em-stage" }, heading, el("p", { className: "help" }, "This method has no likelihood, so there is no curve of it."));
    return el("div", { className: "em-stage" }, heading, el("div", { className: "em-plots" }, curvePlots(curve, model, take)));
  });
  return section("em", "The solver", null, parts);
}

function curvePlots(curve, model, take) {
  const steps = curve.iterations.map((_, k) => k);
  const made = [simplePlot(curve.method === "auto" ? "Log-likelihood of the simulated gaps, nats" : "Log-likelihood, nats", steps, [curve.iterations.map((i) => i.log_likelihood)], take, [colour("measured")])];
  if (curve.iterations.some((i) => i.rms_residual_mm !== null)) {
    made.push(simplePlot("Residual of what was measured, mm", steps, [curve.iterations.map((i) => i.rms_residual_mm)], take, [colour("measured")]));
  }
  const last = curve.iterations.at(-1).bones_um;
  const worst = last.map((um, bone) => [um, bone]).filter(([um]) => um > 0).sort((a, b) => b[0] - a[0] || a[1] - b[1]);
  if (worst.length > 0) made.push(bonePlot(curve, model, take, steps, worst));
  return made;
}

/** Residual per bone: the worst ones, and any other that is asked for. */
function bonePlot(curve, model, take, steps, worst) {
  const names = model.curve_bones;
  let shown = worst.slice(0, WORST_CURVES).map(([, bone]) => bone);
  const key = el("ul", { className: "legend" });
  const place = el("div");
  const pick = el("select", { "aria-label": "Another bone" }, el("option", { value: "" }, "Another bone…"), worst.slice(WORST_CURVES).map(([, bone]) => el("option", { value: bone }, names[bone])));
  const draw = () => {
    place.replaceChildren(simplePlot("Residual of bones, mm (root mean square)", steps, shown.map((bone) => curve.iterations.map((i) => i.bones_um[bone] / 1000)), take, CURVES, key));
    key.replaceChildren(...shown.map((bone, k) => {
      const swatch = el("span", { className: "swatch line", "aria-hidden": "true" });
      swatch.style.background = CURVES[k];
      return el("li", {}, swatch, `${names[bone]}, ${mm(curve.iterations.at(-1).bones_um[bone] / 1000)}`);
    }));
  };
  pick.addEventListener("change", () => {
    if (pick.value === "") return;
    shown = [Number(pick.value), ...shown.filter((bone) => bone !== Number(pick.value))].slice(0, WORST_CURVES);
    draw();
  });
  draw();
  return el("div", { className: "em-bones" }, place, worst.length > WORST_CURVES && el("p", { className: "controls" }, pick));
}

function simplePlot(title, steps, curves, take, colours, key) {
  const host = el("div");
  const last = curves[0].at(-1);
  chart(host, {
    take,
    label: `${title} by iteration, ${steps.length} iterations${curves.length === 1 && last !== null ? `, ends at ${short(last)}` : ""}`,
    options: () => ({
      height: 170,
      padding: [8, 10, 0, 0],
      scales: {
        x: { time: false, range: () => [0, Math.max(1, steps.length - 1)] },
        y: { range: (_, low, high) => {
          if (low === null) return [0, 1];
          const room = Math.max(0.06 * (high - low), 0.001 * Math.abs(high), 1e-3);
          return [low - room, high + room];
        } },
      },
      axes: [axis({ size: 28, space: 40, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000], values: (_, at) => at.map(String) }), axis({ size: 62, space: 30, values: (_, at) => at.map(compact) })],
      series: [{}, ...curves.map((_, k) => ({ stroke: colours.length === 1 ? colour("measured") : colours[k], width: 1.8, points: { show: steps.length < 3 } }))],
    }),
    data: () => [steps, ...curves],
  });
  return el("div", { className: "pane keep" }, el("h3", {}, title), host, key);
}

/** Large numbers short: 1.2M. */
function compact(x) {
  const size = Math.abs(x);
  if (size >= 1e6) return `${short(x / 1e6)}M`;
  if (size >= 1e4) return `${short(x / 1e3)}k`;
  return short(x);
}
