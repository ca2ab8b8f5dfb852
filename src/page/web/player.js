// The player: the stick figure, its transport, and what keys and fingers do to it.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

const KEYS = (followed) => [
  ["Space", "play or pause"],
  ["← →", "one frame back or on; with Shift ten"],
  ["P N", followed ? "to what happened before or after" : "to the gap before or after"],
  ["Home End", "first or last frame"],
  ["− +", "slower, faster"],
  ["F", "fit the view, follow the body"],
  followed ? ["G L C", "floor, labels, measured points"] : ["G L S R", "floor, labels, ±2 σ, raw data"],
  ["?", "these keys"],
];

const ICONS = {
  play: "M4 2.5v11l9.5-5.5z",
  pause: "M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z",
  before: "M3 3h2v10H3zM13.5 3v10L6 8z",
  after: "M11 3h2v10h-2zM2.5 3v10L10 8z",
};

function icon(name) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(space, "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

/** A button that is on or off, and says so. */
function toggle(text, title, on, change) {
  const button = el("button", { type: "button", className: "button", title, "aria-pressed": String(on) }, text);
  button.addEventListener("click", () => {
    const next = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(next));
    change(next);
  });
  return button;
}

function player({ model, take, gaps }) {
  const up = model.take.up || "+z";
  const view = new View(take, turnFor(up));
  const figure = new Figure(take, view.turn, view.floor);
  const show = { sigma: true, raw: false, cloud: true, labels: true, floor: true };
  const { followed } = model;
  const stop = followed ? "event" : "gap";
  const canvas = el("canvas", { className: "picture" });
  const over = el("canvas", { className: "labels", "aria-hidden": "true" });
  const still = el("img", { className: "still", alt: "The figure in the selected frame", hidden: true });
  const stage = el("div", {
    className: "stage", tabIndex: 0, role: "img",
    "aria-label": `Stick figure of ${counted(take.markers.length, followed ? "joint" : "marker")}; drag to turn, pinch or Ctrl and wheel to zoom, Shift and drag to move`,
  }, canvas, over, still);
  figure.colours();
  let renderer = webgl(canvas, figure);
  let plain = null;
  if (!renderer) {
    // a canvas that was asked for one kind of picture gives no other
    const fresh = el("canvas", { className: "picture" });
    canvas.replaceWith(fresh);
    renderer = flat(fresh, figure);
    plain = el("p", { className: "help" }, renderer ? "No WebGL here: a plain drawing." : "This browser draws neither WebGL nor canvas, so there is no picture; everything else works.");
  }
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());

  let width = 0, height = 0, queued = false, hover = null;
  const redraw = () => {
    if (queued) return;
    queued = true;
    requestAnimationFrame(() => {
      queued = false;
      draw();
    });
  };
  function draw() {
    if (!renderer || width === 0) return;
    const frame = take.nearest(state.frame);
    view.update(width / height, frame);
    figure.update(frame, show, hover ?? state.marker);
    renderer.draw(view, show);
    drawLabels(frame);
    stage.dataset.frame = frame;
  }
  const ink = over.getContext("2d");
  function drawLabels(frame) {
    if (!ink) return;
    const dpr = over.width / width;
    ink.setTransform(dpr, 0, 0, dpr, 0, 0);
    ink.clearRect(0, 0, width, height);
    ink.font = FONT;
    ink.textBaseline = "middle";
    ink.lineJoin = "round";
    const taken = [];
    for (let pass = 0; pass < 2; pass++) {
      for (let marker = 0; marker < take.markers.length; marker++) {
        const pointed = marker === hover || marker === state.marker;
        const filled = take.state[take.at(marker, frame)] === FILLED;
        if (pass === 0 ? !pointed : pointed || !filled || !show.labels) continue;
        const p = 3 * marker;
        if (Number.isNaN(figure.scene[p])) continue;
        const at = view.project(figure.scene[p], figure.scene[p + 1], figure.scene[p + 2], width, height);
        if (!at) continue;
        const text = take.markers[marker];
        const box = [at[0] + 9, at[1] - 7, at[0] + 9 + ink.measureText(text).width, at[1] + 7];
        // a label that would cover another one is not drawn
        if (pass === 1 && taken.some((b) => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3])) continue;
        taken.push(box);
        ink.lineWidth = 3.5;
        ink.strokeStyle = colour("stage");
        ink.strokeText(text, box[0], at[1]);
        ink.fillStyle = colour(filled ? "filled" : "ink");
        ink.fillText(text, box[0], at[1]);
      }
    }
  }
  function resize() {
    const box = stage.getBoundingClientRect();
    if (box.width === 0 || (box.width === width && box.height === height)) return;
    const first = width === 0;
    width = box.width;
    height = box.height;
    if (renderer) renderer.resize(width, height);
    const dpr = Math.min(2, window.devicePixelRatio || 1);
    over.width = Math.round(width * dpr);
    over.height = Math.round(height * dpr);
    if (first) view.fit(width / height);
    draw();
  }
  new ResizeObserver(resize).observe(stage);
  const fit = () => {
    view.fit(width / height);
    redraw();
  };
  steer(stage, view, redraw, () => height);
  stage.addEventListener("pointermove", (event) => {
    if (event.buttons) return;
    const box = stage.getBoundingClientRect();
    const near = nearestMarker(event.clientX - box.left, event.clientY - box.top);
    if (near !== hover) {
      hover = near;
      redraw();
    }
  });
  stage.addEventListener("pointerleave", () => {
    hover = null;
    redraw();
  });
  stage.addEventListener("click", (event) => {
    const box = stage.getBoundingClientRect();
    const near = nearestMarker(event.clientX - box.left, event.clientY - box.top);
    if (near !== null) set({ marker: near });
  });
  function nearestMarker(x, y) {
    let best = null, least = 14;
    for (let marker = 0; marker < take.markers.length; marker++) {
      const p = 3 * marker;
      if (Number.isNaN(figure.scene[p])) continue;
      const at = view.project(figure.scene[p], figure.scene[p + 1], figure.scene[p + 2], width, height);
      const far = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (far < least) [best, least] = [marker, far];
    }
    return best;
  }

  // The transport.
  const order = gaps.map((g) => g.index).sort((a, b) => gaps[a].start - gaps[b].start || a - b);
  function step(direction) {
    if (order.length === 0) return;
    const at = order.indexOf(state.gap);
    let next;
    if (at >= 0) next = order[(at + direction + order.length) % order.length];
    else if (direction > 0) next = order.find((g) => gaps[g].start > state.frame) ?? order[0];
    else next = order.findLast((g) => gaps[g].start < state.frame) ?? order.at(-1);
    selectGap(take, gaps, next);
  }
  const play = el("button", { type: "button", className: "button primary", id: "play", onclick: playOrPause });
  const scrub = el("input", { type: "range", id: "scrub", min: 0, max: Math.max(0, take.frames - 1), value: 0, "aria-label": "Frame" });
  scrub.addEventListener("input", () => jump(take, Number(scrub.value)));
  const readout = el("output", { id: "readout", className: "readout" });
  const speed = el("select", { "aria-label": "Speed" }, SPEEDS.map((s) => el("option", { value: s, selected: s === 1 }, `${s}×`)));
  speed.addEventListener("change", () => set({ speed: Number(speed.value) }));
  let clockWas = 0, exact = 0;
  function playOrPause() {
    if (!state.playing && state.frame >= take.frames - 1) set({ frame: 0 });
    set({ playing: !state.playing });
  }
  function tick(now) {
    if (!state.playing) return;
    const passed = Math.min(0.25, (now - clockWas) / 1000);
    clockWas = now;
    exact += passed * take.rate * state.speed;
    const frame = Math.min(take.frames - 1, Math.floor(exact));
    if (frame !== state.frame) set({ frame });
    if (frame >= take.frames - 1) set({ playing: false });
    requestAnimationFrame(tick);
  }
  listen("playing", () => {
    if (state.playing) {
      clockWas = performance.now();
      exact = state.frame;
      requestAnimationFrame(tick);
    }
    name();
  });
  listen("speed", () => {
    exact = state.frame;
    speed.value = state.speed;
  });
  function name() {
    play.replaceChildren(icon(state.playing ? "pause" : "play"));
    play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
  }
  function tell() {
    scrub.value = state.frame;
    scrub.setAttribute("aria-valuetext", `frame ${take.label(state.frame)}, ${seconds(take.seconds(state.frame))}`);
    readout.textContent = `Frame ${take.label(state.frame)} · ${clock(take.seconds(state.frame))}`;
  }
  listen("frame", tell);
  listen("frame marker gap", redraw);
  listen("theme print", () => {
    figure.colours();
    draw();
    strip.draw();
  });
  name();
  tell();

  const anyFilled = !followed && model.summary.samples_filled > 0;
  const toggles = {
    g: toggle("Floor", "Floor, 0.5 m a square", show.floor, (on) => ((show.floor = on), redraw())),
    l: (anyFilled || followed) && toggle("Labels", followed ? `Labels of joints that are ${followed.legend[1]}` : "Labels of filled markers", show.labels, (on) => ((show.labels = on), redraw())),
    s: anyFilled && toggle("±2 σ", "Where filled markers may be: balls of ±2 σ", show.sigma, (on) => ((show.sigma = on), redraw())),
    c: take.cloud.length > 0 && toggle("Points", `Some of the ${followed.legend[2]}`, show.cloud, (on) => ((show.cloud = on), redraw())),
    r: (anyFilled || take.raw.size > 0) && toggle("Raw", "What the file held, as a ghost", show.raw, (on) => ((show.raw = on), redraw())),
  };
  const strip = missingStrip(take);
  const help = keyHelp(followed);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open || event.defaultPrevented) return;
    const target = event.target;
    if (target.matches("select, input:not([type=range]), textarea")) return;
    const onButton = target.closest("button, summary, a, [role=button]");
    const by = event.shiftKey ? 10 : 1;
    const actions = {
      " ": () => !onButton && (playOrPause(), true),
      ArrowLeft: () => (jump(take, state.frame - by), true),
      ArrowRight: () => (jump(take, state.frame + by), true),
      Home: () => (jump(take, 0), true),
      End: () => (jump(take, take.frames - 1), true),
      n: () => (step(1), true),
      p: () => (step(-1), true),
      "+": () => (faster(1), true),
      "=": () => (faster(1), true),
      "-": () => (faster(-1), true),
      f: () => (fit(), true),
      "?": () => (help.showModal(), true),
    };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (toggles[key]) toggles[key].click();
    else if (!actions[key] || !actions[key]()) return;
    event.preventDefault();
  });
  function faster(by) {
    const at = SPEEDS.indexOf(state.speed);
    set({ speed: SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, at + by))] });
  }

  const upright = (!model.take.up || model.take.up_guessed) && el("select", { "aria-label": "The axis that points up", title: "The file does not say which axis points up" },
    ["+x", "+y", "+z", "-x", "-y", "-z"].map((axis) => el("option", { value: axis, selected: axis === up }, `${axis.replace("+", "").replace("-", "−")} up`)));
  if (upright) {
    upright.addEventListener("change", () => {
      view.turnTo(turnFor(upright.value));
      [figure.turn, figure.floor] = [view.turn, view.floor];
      fit();
    });
  }
  const node = section("player", "The take", null,
    stage, plain,
    el("div", { className: "transport controls" },
      el("div", { className: "scrubber" }, strip.node, scrub),
      el("div", { className: "row" },
        el("button", { type: "button", className: "button", "aria-label": `Previous ${stop}`, title: `Previous ${stop} (P)`, disabled: gaps.length === 0, onclick: () => step(-1) }, icon("before")),
        play,
        el("button", { type: "button", className: "button", "aria-label": `Next ${stop}`, title: `Next ${stop} (N)`, disabled: gaps.length === 0, onclick: () => step(1) }, icon("after")),
        speed, readout,
        el("button", { type: "button", className: "button ghost", "aria-label": "Keys", title: "Keys (?)", onclick: () => help.showModal() }, "?")),
      el("div", { className: "row" }, Object.values(toggles), el("button", { type: "button", className: "button", title: "Fit the view and follow the body (F)", onclick: fit }, "Fit"), upright)),
    followed
      ? legend(["dot joint-dot", followed.legend[0]], ["dot filled-dot", followed.legend[1]], take.cloud.length > 0 && ["dot cloud-dot", followed.legend[2]])
      : legend(["dot measured-dot", "measured"], anyFilled && ["dot filled-dot", "filled"], anyFilled && ["dot sigma-dot", "±2 σ"], take.raw.size > 0 && ["dot suspect-dot", "dropped"]),
    help);
  return {
    node,
    /** A still picture for paper, and back. */
    freeze(on) {
      if (!renderer) return;
      if (on) {
        draw();
        const both = el("canvas", { width: over.width, height: over.height });
        const paper = both.getContext("2d");
        paper.drawImage(renderer.canvas, 0, 0, both.width, both.height);
        paper.drawImage(over, 0, 0);
        still.src = both.toDataURL("image/png");
      }
      still.hidden = !on;
    },
    /** For tests and for whoever wonders: how it draws. */
    kind: renderer ? renderer.kind : "none",
  };
}

/** Mouse, fingers and wheel. One finger up and down scrolls the page; the wheel zooms only once the picture was clicked, or with Ctrl. */
function steer(stage, view, redraw, height) {
  const fingers = new Map();
  stage.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    stage.setPointerCapture(event.pointerId);
  });
  const gone = (event) => fingers.delete(event.pointerId);
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) stage.addEventListener(name, gone);
  stage.addEventListener("pointermove", (event) => {
    const was = fingers.get(event.pointerId);
    if (!was) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - was[0], now[1] - was[1]];
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const before = Math.hypot(was[0] - other[0], was[1] - other[1]);
      const after = Math.hypot(now[0] - other[0], now[1] - other[1]);
      if (before > 0 && after > 0) view.zoom(before / after);
      view.pan(dx / 2, dy / 2, height());
    } else if (event.shiftKey || event.buttons === 2 || event.buttons === 4) {
      view.pan(dx, dy, height());
    } else {
      view.orbit(dx, dy);
    }
    fingers.set(event.pointerId, now);
    redraw();
  });
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== stage) return;
    event.preventDefault();
    view.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.004));
    redraw();
  }, { passive: false });
}

/** Under the slider: how many markers are missing when. */
function missingStrip(take) {
  const node = el("canvas", { className: "strip", "aria-hidden": "true" });
  const draw = () => {
    const width = Math.round(node.clientWidth), height = Math.round(node.clientHeight);
    const context = node.getContext("2d");
    if (!context || width === 0) return;
    const dpr = Math.min(2, window.devicePixelRatio || 1);
    node.width = width * dpr;
    node.height = height * dpr;
    const filled = new Float32Array(width), open = new Float32Array(width);
    for (let frame = 0; frame < take.frames; frame++) {
      let f = 0, o = 0;
      for (let marker = 0; marker < take.markers.length; marker++) {
        const s = take.state[take.at(marker, frame)];
        f += s === FILLED;
        o += s === MISSING;
      }
      const x = Math.min(width - 1, Math.floor((frame / take.frames) * width));
      filled[x] = Math.max(filled[x], f);
      open[x] = Math.max(open[x], o);
    }
    const most = Math.max(1, ...filled.map((f, x) => f + open[x]));
    context.scale(dpr, dpr);
    for (let x = 0; x < width; x++) {
      const f = (filled[x] / most) * height, o = (open[x] / most) * height;
      context.fillStyle = colour("filled");
      context.fillRect(x, height - f, 1, f);
      context.fillStyle = colour("open");
      context.fillRect(x, height - f - o, 1, o);
    }
  };
  new ResizeObserver(draw).observe(node);
  return { node, draw };
}

function keyHelp(followed) {
  const dialog = el("dialog", { "aria-labelledby": "keys-title" });
  dialog.append(
    el("h2", { id: "keys-title" }, "Keys"),
    el("dl", { className: "keys" }, KEYS(followed).map(([keys, what]) => [el("dt", {}, keys.split(" ").map((key) => [el("kbd", {}, key), " "])), el("dd", {}, what)])),
    el("p", { className: "help" }, `${followed ? "" : "In the gap map, arrows go from gap to gap. "}Drag the figure to turn it; Shift and drag, or two fingers, to move it; Ctrl and wheel, or the wheel after a click, to zoom.`),
    el("form", { method: "dialog" }, el("button", { className: "button primary", autofocus: true }, "Close")),
  );
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return dialog;
}
