// The camera of the player: it orbits a point of the body. The scene is in metres and y points up, whatever the take's axes.

/** From the take's axes to the scene's: which coordinate becomes x, y, z, and its sign. A signed permutation that keeps the hand. */
function turnFor(up) {
  const axis = { x: 0, y: 1, z: 2 }[up.slice(-1)];
  const sign = up.startsWith("-") ? -1 : 1;
  const a = (axis + 1) % 3, b = (axis + 2) % 3;
  // (b, up, a) is an even permutation of the axes for every axis; a negative axis turns a second one as well
  return [[b, 1], [axis, sign], [a, sign]];
}

/** Turns a position in mm into the scene; writes 3 numbers at `to`. */
function place(turn, mm, from, out, to) {
  for (let k = 0; k < 3; k++) out[to + k] = (turn[k][1] * mm[from + turn[k][0]]) / 1000;
}

/** Where the body is in every frame: the mean of what is known, smoothed over about a second, in the scene. Three numbers a frame. */
function centres(take, turn) {
  const means = new Float32Array(3 * take.frames).fill(NaN);
  const p = [0, 0, 0];
  for (const frame of take.shown) {
    const sum = [0, 0, 0];
    let count = 0;
    for (let marker = 0; marker < take.markers.length; marker++) {
      const i = 3 * take.at(marker, frame);
      if (Number.isNaN(take.mm[i])) continue;
      place(turn, take.mm, i, p, 0);
      for (let k = 0; k < 3; k++) sum[k] += p[k];
      count++;
    }
    if (count) for (let k = 0; k < 3; k++) means[3 * frame + k] = sum[k] / count;
  }
  const half = Math.max(1, Math.round(take.rate / 2));
  const smooth = new Float32Array(3 * take.frames);
  for (let k = 0; k < 3; k++) {
    let sum = 0, count = 0, last = 0;
    const add = (frame, sign) => {
      const x = frame < 0 || frame >= take.frames ? NaN : means[3 * frame + k];
      if (Number.isNaN(x)) return;
      sum += sign * x;
      count += sign;
    };
    for (let frame = -half; frame < take.frames; frame++) {
      add(frame + half, 1);
      add(frame - half - 1, -1);
      if (count > 0) last = sum / count;
      if (frame >= 0) smooth[3 * frame + k] = last;
    }
  }
  return smooth;
}

class View {
  constructor(take, turn) {
    this.take = take;
    this.camera = new ogl.Camera(null, { fov: 30, near: 0.02, far: 400 });
    this.azimuth = 0.75;
    this.elevation = 0.2;
    this.offset = [0, 0, 0];
    this.target = [0, 1, 0];
    this.distance = 5;
    this.follow = true;
    this.held = 0;
    this.turnTo(turn);
  }

  /** Another axis points up. */
  turnTo(turn) {
    this.turn = turn;
    this.centres = centres(this.take, turn);
    this.floor = this.lowest();
  }

  /** The height of the floor: what almost all samples are above. */
  lowest() {
    const { take, turn } = this;
    const heights = [], p = [0, 0, 0];
    const stride = Math.max(1, Math.floor(take.state.length / 50000));
    for (let i = 0; i < take.state.length; i += stride) {
      if (Number.isNaN(take.mm[3 * i])) continue;
      place(turn, take.mm, 3 * i, p, 0);
      heights.push(p[1]);
    }
    heights.sort((a, b) => a - b);
    const low = heights[Math.floor(heights.length * 0.002)] || 0;
    // the floor of the laboratory is at 0, unless the take says otherwise
    return low > -0.15 && low < 0.6 ? 0 : low;
  }

  /** How far markers are from the middle of the body, in most frames. */
  radius() {
    const { take, turn } = this;
    const found = [], p = [0, 0, 0];
    for (let k = 0; k < 40; k++) {
      const frame = take.shown[Math.floor(((k + 0.5) * take.shown.length) / 40)];
      if (frame === undefined) continue;
      let most = 0;
      for (let marker = 0; marker < take.markers.length; marker++) {
        const i = 3 * take.at(marker, frame);
        if (Number.isNaN(take.mm[i])) continue;
        place(turn, take.mm, i, p, 0);
        most = Math.max(most, Math.hypot(...p.map((x, k) => x - this.centres[3 * frame + k])));
      }
      if (most > 0) found.push(most);
    }
    found.sort((a, b) => a - b);
    return Math.max(0.1, found[Math.floor(found.length * 0.7)] || 1);
  }

  /** The body in view, from a little to the side. */
  fit(aspect) {
    const half = (this.camera.fov * Math.PI) / 360;
    this.offset = [0, 0, 0];
    this.follow = true;
    this.distance = (1.05 * this.radius()) / Math.sin(Math.atan(Math.tan(half) * Math.min(1, aspect)));
  }

  orbit(dx, dy) {
    this.azimuth -= dx * 0.008;
    this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + dy * 0.008));
  }

  zoom(factor) {
    this.distance = Math.max(0.1, Math.min(150, this.distance * factor));
  }

  /** Moves the target in the plane of the picture; dx and dy in pixels of a picture `height` high. */
  pan(dx, dy, height) {
    const scale = (2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360)) / height;
    const m = this.camera.worldMatrix;
    for (let k = 0; k < 3; k++) this.offset[k] += (-dx * m[k] + dy * m[4 + k]) * scale;
  }

  /** Puts the camera where it belongs; needed before drawing and before `project`. */
  update(aspect, frame) {
    if (this.follow) this.held = frame;
    for (let k = 0; k < 3; k++) this.target[k] = this.centres[3 * this.held + k] + this.offset[k];
    const { camera, target, azimuth, elevation, distance } = this;
    camera.perspective({ aspect, near: Math.max(0.01, distance / 100), far: distance * 20 + 50 });
    camera.position.set(
      target[0] + distance * Math.cos(elevation) * Math.sin(azimuth),
      target[1] + distance * Math.sin(elevation),
      target[2] + distance * Math.cos(elevation) * Math.cos(azimuth),
    );
    camera.lookAt(new ogl.Vec3(...target));
    camera.updateMatrixWorld();
  }

  /** Pixels of a point of the scene in a picture of this size, and how far away it is; null if it is behind. */
  project(x, y, z, width, height) {
    const m = this.camera.projectionViewMatrix;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w <= 0) return null;
    return [
      ((m[0] * x + m[4] * y + m[8] * z + m[12]) / w * 0.5 + 0.5) * width,
      (0.5 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w * 0.5) * height,
      w,
    ];
  }
}
