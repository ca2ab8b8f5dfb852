// What stands in a frame: points, lines and balls, as numbers that either renderer draws.

/** Numbers of one kind of shape, `size` of them for each. */
class Shapes {
  constructor(size, most) {
    this.size = size;
    this.data = new Float32Array(size * Math.max(1, most));
    this.count = 0;
  }

  add(...numbers) {
    if ((this.count + 1) * this.size > this.data.length) return;
    this.data.set(numbers, this.count * this.size);
    this.count++;
  }
}

const POINT = 8, LINE = 11, BALL = 8;

/** Larger balls than this, in metres, grow fainter, or they would hide the figure that they belong to. */
const SOLID = 0.15;

class Figure {
  constructor(take, turn, floor) {
    this.take = take;
    this.turn = turn;
    this.floor = floor;
    const markers = take.markers.length, bones = take.bones.length;
    const measured = take.cloud.reduce((most, points) => Math.max(most, points.length / 3), 0);
    this.points = new Shapes(POINT, 3 * markers + 2 + measured); // x y z, pixels, red green blue alpha
    this.lines = new Shapes(LINE, 3 * bones + markers + 4); // x y z, x y z, pixels, red green blue alpha
    this.balls = new Shapes(BALL, markers); // x y z, metres, red green blue alpha
    this.scene = new Float32Array(3 * markers);
    this.raw = new Float32Array(3 * markers);
  }

  /** The palette of the theme, red green blue from 0 to 1. */
  colours() {
    const rgb = (name) => hex(colour(name)).map((c) => c / 255);
    this.palette = { ink: rgb("ink"), bone: rgb("bone"), filled: rgb("filled"), accent: rgb("focus"), raw: rgb("measured"), suspect: rgb("suspect"), grid: rgb("grid"), stage: rgb("stage") };
  }

  /** Fills the shapes for a frame. `show`: which of `sigma`, `raw` and `cloud` are wanted; `mark`: a marker to point at. */
  update(frame, show, mark) {
    const { take, turn, scene, raw, palette } = this;
    this.points.count = this.lines.count = this.balls.count = 0;
    const state = (marker) => take.state[take.at(marker, frame)];
    for (let marker = 0; marker < take.markers.length; marker++) {
      const at = take.at(marker, frame);
      place(turn, take.mm, 3 * at, scene, 3 * marker);
      const before = take.raw.get(at);
      if (before) place(turn, before, 0, raw, 3 * marker);
      else if (take.state[at] === OBSERVED) raw.set(scene.subarray(3 * marker, 3 * marker + 3), 3 * marker);
      else raw.fill(NaN, 3 * marker, 3 * marker + 3);
    }
    if (show.cloud && take.cloud[frame]) {
      const points = take.cloud[frame], at = [0, 0, 0];
      for (let k = 0; k < points.length; k += 3) {
        place(turn, points, k, at, 0);
        this.points.add(...at, 3.5, ...palette.raw, 0.55);
      }
    }
    const known = (places, marker) => !Number.isNaN(places[3 * marker]);
    const xyz = (places, marker) => places.subarray(3 * marker, 3 * marker + 3);
    if (show.raw) {
      for (const { a, b } of take.bones) {
        if (known(raw, a) && known(raw, b)) this.lines.add(...xyz(raw, a), ...xyz(raw, b), 7, ...palette.raw, 0.22);
      }
      for (let marker = 0; marker < take.markers.length; marker++) {
        if (known(raw, marker)) this.points.add(...xyz(raw, marker), 15, ...palette.raw, 0.3);
      }
    }
    for (const { a, b } of take.bones) {
      if (!known(scene, a) || !known(scene, b)) continue;
      const filled = state(a) === FILLED || state(b) === FILLED;
      this.lines.add(...xyz(scene, a), ...xyz(scene, b), filled ? 2.4 : 1.7, ...(filled ? palette.filled : palette.bone), filled ? 0.9 : 0.75);
    }
    for (let marker = 0; marker < take.markers.length; marker++) {
      if (!known(scene, marker)) continue;
      const filled = state(marker) === FILLED;
      const at = xyz(scene, marker);
      if (marker === mark) this.points.add(...at, filled ? 20 : 17, ...palette.accent, 0.35);
      this.points.add(...at, filled ? 11 : 7, ...(filled ? palette.filled : palette.ink), 1);
      if (take.raw.has(take.at(marker, frame))) {
        this.lines.add(...at, ...xyz(raw, marker), 1.5, ...palette.suspect, 0.9);
        this.points.add(...xyz(raw, marker), 8, ...palette.suspect, 0.9);
      }
      const sigma = take.sigma[take.at(marker, frame)];
      if (show.sigma && filled && sigma > 0) {
        const radius = (2 * sigma) / 1000;
        this.balls.add(...at, radius, ...palette.filled, 0.3 * Math.min(1, SOLID / radius));
      }
    }
  }

  /** Lines of the floor around a place, 0.5 m apart, fainter with distance. */
  floorLines(target) {
    const lines = [];
    const reach = 4, step = 0.5;
    const x0 = Math.round(target[0] / step) * step, z0 = Math.round(target[2] / step) * step;
    for (let k = -reach / step; k <= reach / step; k++) {
      const strong = (value) => Math.abs(value / 2 - Math.round(value / 2)) < 1e-6;
      const x = x0 + k * step, z = z0 + k * step;
      lines.push([x, this.floor, z0 - reach, x, this.floor, z0 + reach, strong(x)], [x0 - reach, this.floor, z, x0 + reach, this.floor, z, strong(z)]);
    }
    return lines;
  }
}
