// What the file holds: the model as JSON, the positions as streams of integers. `src/page/positions.rs` packs what is unpacked here.

const OBSERVED = 0, FILLED = 1, MISSING = 2;

/** The model, and the samples of the take in mm. */
async function load() {
  const model = JSON.parse(new TextDecoder().decode(await inflate("model")));
  return { model, take: unpackTake(model, await inflate("positions")) };
}

/** The subject's name with its colon, if every label begins with it and goes on. */
function sharedPrefix(labels) {
  const colon = labels.length > 0 ? labels[0].lastIndexOf(":") : -1;
  const prefix = labels.length > 0 ? labels[0].slice(0, colon + 1) : "";
  return labels.every((label) => label.startsWith(prefix) && label.length > prefix.length) ? prefix : "";
}

function unpackTake(model, bytes) {
  const streams = {};
  let from = 0;
  for (const { name, bytes: length } of model.streams) {
    streams[name] = reader(bytes.subarray(from, from + length));
    from += length;
  }
  const { frames, first_frame: first, frame_step: step } = model.take;
  const prefix = sharedPrefix(model.take.markers);
  const markers = model.take.markers.map((label) => label.slice(prefix.length));
  const shown = [];
  for (let frame = -1; streams.frames.more; ) shown.push((frame += streams.frames.next()));

  const count = markers.length * frames;
  const state = new Uint8Array(count);
  const mm = new Float32Array(3 * count).fill(NaN);
  const sigma = new Float32Array(count).fill(NaN);
  for (let at = 0; at < count; ) {
    const value = streams.states.next(), run = streams.states.next();
    state.fill(value, at, at + run);
    at += run;
  }
  for (let axis = 0; axis < 3; axis++) {
    const stream = streams["xyz"[axis]];
    for (let marker = 0; marker < markers.length; marker++) {
      let last = 0, move = 0;
      for (const frame of shown) {
        const at = marker * frames + frame;
        if (state[at] === MISSING) {
          move = 0;
          continue;
        }
        move += stream.next();
        last += move;
        mm[3 * at + axis] = last * model.position_step_mm;
      }
    }
  }
  let last = 0;
  for (let at = 0; at < count; at++) {
    if (state[at] !== FILLED) continue;
    last += streams.sigma.next();
    if (last > 0) sigma[at] = (last - 1) * model.sigma_step_mm;
  }
  const raw = new Map();
  const entry = [0, 0, 0, 0, 0];
  while (streams.raw.more) {
    for (let k = 0; k < 5; k++) entry[k] += streams.raw.next();
    raw.set(entry[0] * frames + shown[entry[1]], entry.slice(2).map((x) => x * model.position_step_mm));
  }
  // points of what was measured, frame by frame
  const cloud = [];
  const point = [0, 0, 0];
  while (streams.cloud?.more) {
    const points = new Float32Array(3 * streams.cloud.next());
    for (let k = 0; k < points.length; k++) points[k] = (point[k % 3] += streams.cloud.next()) * model.cloud_step_mm;
    cloud.push(points);
  }
  return {
    frames,
    markers,
    prefix,
    bones: model.take.bones,
    rate: model.take.rate_hz,
    shown,
    thinned: shown.length < frames,
    state,
    mm,
    sigma,
    raw,
    cloud,
    /** Index of a sample in `state`, `sigma` and, times 3, `mm`. */
    at: (marker, frame) => marker * frames + frame,
    /** The file's own number of a frame, and back. */
    label: (frame) => first + frame * (step || 1),
    frameOf: (label) => Math.max(0, Math.min(frames - 1, Math.round((label - first) / (step || 1)))),
    seconds: (frame) => frame / model.take.rate_hz,
    /** The frame nearest to `frame` of which the positions are here. */
    nearest(frame) {
      if (!this.thinned || shown.length === 0) return frame;
      let low = 0, high = shown.length - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (shown[middle] <= frame) low = middle;
        else high = middle - 1;
      }
      const next = shown[low + 1];
      return next !== undefined && next - frame < frame - shown[low] ? next : shown[low];
    },
    distance(a, b, frame) {
      const p = 3 * this.at(a, frame), q = 3 * this.at(b, frame);
      return Math.hypot(mm[p] - mm[q], mm[p + 1] - mm[q + 1], mm[p + 2] - mm[q + 2]);
    },
  };
}
