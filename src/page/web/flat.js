// Draws the figure on a plain canvas where there is no WebGL: the same shapes, seen by the same camera, far ones first.

function flat(canvas, figure) {
  const context = canvas.getContext("2d");
  if (!context) return null;
  const dpr = Math.min(2, window.devicePixelRatio || 1);
  let width = 1, height = 1;
  const css = ([r, g, b], a) => `rgb(${Math.round(r * 255)} ${Math.round(g * 255)} ${Math.round(b * 255)} / ${a})`;

  return {
    kind: "flat",
    canvas,
    resize(w, h) {
      width = w;
      height = h;
      canvas.width = Math.round(w * dpr);
      canvas.height = Math.round(h * dpr);
      canvas.style.width = `${w}px`;
      canvas.style.height = `${h}px`;
    },
    draw(view, show) {
      context.setTransform(dpr, 0, 0, dpr, 0, 0);
      context.clearRect(0, 0, width, height);
      context.lineCap = "round";
      const at = (x, y, z) => view.project(x, y, z, width, height);
      const stroke = (p, q, thick, style) => {
        if (!p || !q) return;
        context.strokeStyle = style;
        context.lineWidth = thick;
        context.beginPath();
        context.moveTo(p[0], p[1]);
        context.lineTo(q[0], q[1]);
        context.stroke();
      };
      const disc = (p, radius, style) => {
        context.fillStyle = style;
        context.beginPath();
        context.arc(p[0], p[1], radius, 0, 2 * Math.PI);
        context.fill();
      };
      if (show.floor) {
        for (const [x0, y, z0, x1, , z1, strong] of figure.floorLines(view.target)) stroke(at(x0, y, z0), at(x1, y, z1), strong ? 1 : 0.6, css(figure.palette.grid, strong ? 0.7 : 0.4));
      }
      const shapes = [];
      const { lines, points, balls } = figure;
      for (let k = 0; k < lines.count; k++) {
        const d = lines.data.subarray(k * LINE, k * LINE + LINE);
        const p = at(d[0], d[1], d[2]), q = at(d[3], d[4], d[5]);
        if (p && q) shapes.push([(p[2] + q[2]) / 2, () => stroke(p, q, d[6], css(d.subarray(7, 10), d[10]))]);
      }
      for (let k = 0; k < points.count; k++) {
        const d = points.data.subarray(k * POINT, k * POINT + POINT);
        const p = at(d[0], d[1], d[2]);
        if (p) shapes.push([p[2] - 0.01, () => disc(p, d[3] / 2, css(d.subarray(4, 7), d[7]))]);
      }
      const scale = height / 2 / Math.tan((view.camera.fov * Math.PI) / 360);
      for (let k = 0; k < balls.count; k++) {
        const d = balls.data.subarray(k * BALL, k * BALL + BALL);
        const p = at(d[0], d[1], d[2]);
        if (p) shapes.push([p[2] - 0.02, () => disc(p, (d[3] * scale) / p[2], css(d.subarray(4, 7), d[7]))]);
      }
      shapes.sort((a, b) => b[0] - a[0]);
      for (const [, draw] of shapes) draw();
    },
  };
}
