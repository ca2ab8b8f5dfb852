// Time against samples, both on scales of ratios: one point for each take, or the darker the more takes.

const SPACE = { left: 46, right: 12, top: 10, bottom: 30 };

function timeChart(batch) {
  const secs = columnOf(batch, "elapsed").numbers, { samples } = batch.column;
  const takes = [];
  for (let i = 0; i < batch.count; i++) if (secs[i] > 0 && samples[i] > 0) takes.push(i);
  if (takes.length === 0) return null;
  const bounds = (numbers) => {
    let low = Infinity, high = 0;
    for (const i of takes) {
      low = Math.min(low, numbers[i]);
      high = Math.max(high, numbers[i]);
    }
    return [Math.log10(low) - 0.05, Math.max(Math.log10(high), Math.log10(low) + 0.5) + 0.05];
  };
  const [x0, x1] = bounds(samples), [y0, y1] = bounds(secs);
  const speed = median(takes.map((i) => (1e6 * secs[i]) / samples[i]));
  let slowest = takes[0];
  for (const i of takes) if (secs[i] > secs[slowest]) slowest = i;

  const canvas = el("canvas", { className: "scatter", role: "img", "aria-label": `Computing time of ${counted(takes.length, "take")} against their samples; the usual take takes ${duration(speed)} for a million samples` });
  const tip = el("div", { className: "tip", hidden: true });
  const holder = el("div", { className: "scatter-holder" }, canvas, tip);
  let width = 0, height = 0;
  const x = (i) => SPACE.left + ((Math.log10(samples[i]) - x0) / (x1 - x0)) * (width - SPACE.left - SPACE.right);
  const y = (i) => height - SPACE.bottom - ((Math.log10(secs[i]) - y0) / (y1 - y0)) * (height - SPACE.top - SPACE.bottom);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  function draw() {
    width = holder.clientWidth;
    height = holder.clientHeight;
    if (width === 0) return;
    const scale = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const pen = canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', sans-serif";
    pen.strokeStyle = colour("line");
    pen.fillStyle = colour("quiet");
    const px = (log) => SPACE.left + ((log - x0) / (x1 - x0)) * (width - SPACE.left - SPACE.right);
    const py = (log) => height - SPACE.bottom - ((log - y0) / (y1 - y0)) * (height - SPACE.top - SPACE.bottom);
    const line = (...at) => (pen.beginPath(), pen.moveTo(at[0], at[1]), pen.lineTo(at[2], at[3]), pen.stroke());
    pen.textAlign = "center";
    for (let k = Math.floor(x0); k <= x1; k++) {
      for (const digit of x1 - x0 < 2.5 ? [1, 2, 5] : [1]) {
        const number = digit * 10 ** k, at = px(Math.log10(number));
        if (at < SPACE.left || at > width - SPACE.right) continue;
        line(at, SPACE.top, at, height - SPACE.bottom);
        pen.fillText(number < 1e3 ? String(number) : number < 1e6 ? `${number / 1e3} k` : number < 1e9 ? `${number / 1e6} M` : `${number / 1e9} G`, at, height - SPACE.bottom + 14);
      }
    }
    pen.textAlign = "right";
    pen.fillText("samples", width - SPACE.right, height - 3);
    pen.textBaseline = "middle";
    const times = [0.01, 0.1, 1, 10, 60, 600, 3600, 36000].filter((t) => Math.log10(t) >= y0 && Math.log10(t) <= y1);
    for (const t of times) {
      line(SPACE.left, py(Math.log10(t)), width - SPACE.right, py(Math.log10(t)));
      pen.fillText(t < 60 ? `${t} s` : t < 3600 ? `${t / 60} min` : `${t / 3600} h`, SPACE.left - 6, py(Math.log10(t)));
    }
    pen.textBaseline = "alphabetic";
    pen.fillStyle = colour("measured");
    if (takes.length <= 3000) {
      pen.globalAlpha = 0.55;
      for (const i of takes) (pen.beginPath(), pen.arc(x(i), y(i), 2.5, 0, 7), pen.fill());
    } else {
      const size = 3, across = Math.ceil(width / size);
      const counts = new Uint32Array(across * Math.ceil(height / size));
      let most = 1;
      for (const i of takes) most = Math.max(most, ++counts[Math.floor(y(i) / size) * across + Math.floor(x(i) / size)]);
      for (let k = 0; k < counts.length; k++) {
        if (counts[k] === 0) continue;
        pen.globalAlpha = 0.25 + (0.75 * Math.log(1 + counts[k])) / Math.log(1 + most);
        pen.fillRect((k % across) * size, Math.floor(k / across) * size, size, size);
      }
    }
    pen.globalAlpha = 1;
  }
  function nearest(event) {
    const box = canvas.getBoundingClientRect();
    const [mx, my] = [event.clientX - box.left, event.clientY - box.top];
    let best = -1, distance = 14 ** 2;
    for (const i of takes) {
      const d = (x(i) - mx) ** 2 + (y(i) - my) ** 2;
      if (d < distance) [best, distance] = [i, d];
    }
    return best;
  }
  canvas.addEventListener("mousemove", (event) => {
    const i = nearest(event);
    tip.hidden = i < 0;
    canvas.style.cursor = i < 0 ? "default" : "pointer";
    if (i < 0) return;
    tip.textContent = `${batch.takes.paths[i]}: ${duration(secs[i])}, ${whole(samples[i])} samples`;
    tip.style.left = `${Math.max(0, Math.min(width - tip.offsetWidth, x(i) + 10))}px`;
    tip.style.top = `${Math.max(0, y(i) - tip.offsetHeight - 8)}px`;
  });
  canvas.addEventListener("mouseleave", () => (tip.hidden = true));
  canvas.addEventListener("click", (event) => {
    const i = nearest(event);
    if (i >= 0) set({ details: i });
  });
  if (typeof ResizeObserver !== "undefined") new ResizeObserver(draw).observe(holder);
  listen("theme print", draw);
  return el("div", { className: "spread keep" }, el("h3", {}, "Computing time and samples"), holder,
    el("p", { className: "help" }, `Usually ${duration(speed)} for a million samples. The longest took ${duration(secs[slowest])}: `, el("button", { type: "button", className: "plain link", onclick: () => set({ details: slowest }) }, split(batch.takes.paths[slowest])[1]), "."));
}
