// What the file holds: texts as JSON, and a number of every kind for each take. `src/batch/fleet/takes.rs` and `markers.rs` pack what is unpacked here.

const DONE = 0, REMARKS = 1, QUARANTINED = 2, FAILED = 3, WAITING = 4;
const HAS_REPORT = 1, HAS_LOG = 2, SKIPPED = 4, HAS_NUMBERS = 8;

/** Streams in which 0 stands for what is not known, and every number is one more than it is. */
const MAYBE = new Set(["exit_code", "elapsed_ms", "peak_kib", "time", "reason", "format", "method", "sigma", "bone_worst", "bone_rms", "worst_bone"]);

/** Streams that are only known of takes of whose repair the numbers are there. */
const OF_REPAIRS = ["rate", "frames", "markers", "bones", "samples", "missing", "filled", "gaps", "open", "longest", "suspects"];

/** Everything: `count` takes, their columns as arrays with NaN for what is not known, and the markers. */
async function load() {
  const model = JSON.parse(new TextDecoder().decode(await inflate("model")));
  const bytes = await inflate("numbers");
  const { takes, about, base } = model;
  const count = takes.paths.length;
  const streams = {};
  let from = 0;
  for (const { name, bytes: length } of model.streams) {
    streams[name] = reader(bytes.subarray(from, from + length));
    from += length;
  }
  const column = {};
  const special = new Set(["notes", "all_of_marker", "cells"]);
  for (const [name, stream] of Object.entries(streams)) {
    if (special.has(name)) continue;
    const numbers = new Float64Array(count);
    const less = MAYBE.has(name) ? 1 : 0;
    for (let i = 0; i < count; i++) {
      const value = stream.next() - less;
      numbers[i] = value < 0 ? NaN : value;
    }
    column[name] = numbers;
  }
  for (let i = 0; i < count; i++) {
    if (!(column.flags[i] & HAS_NUMBERS)) for (const name of OF_REPAIRS) column[name][i] = NaN;
    column.rate[i] /= 1000;
    column.sigma[i] *= takes.step_mm;
    column.bone_worst[i] *= takes.step_mm;
    column.bone_rms[i] *= takes.step_mm;
  }
  // notes of a take are those from firstNote[i] up to firstNote[i + 1]
  const firstNote = new Uint32Array(count + 1), matters = new Float64Array(count), noted = new Float64Array(count);
  const allNotes = [];
  for (let i = 0; i < count; i++) {
    for (let rest = streams.notes.next(); rest > 0; rest--) {
      const note = streams.notes.next();
      allNotes.push(note);
      if (takes.notes[note].matters) matters[i]++;
      noted[i]++;
    }
    firstNote[i + 1] = allNotes.length;
    if (!(column.flags[i] & HAS_NUMBERS)) matters[i] = noted[i] = NaN;
  }
  const share = column.missing.map((missing, i) => (column.samples[i] > 0 ? missing / column.samples[i] : NaN));
  const length = column.frames.map((frames, i) => (column.rate[i] > 0 ? frames / column.rate[i] : NaN));
  const longest_secs = column.longest.map((frames, i) => (column.rate[i] > 0 ? frames / column.rate[i] : NaN));
  return {
    count,
    about,
    takes,
    column: { ...column, share, length, longest_secs, matters, noted },
    notes: (i) => allNotes.slice(firstNote[i], firstNote[i + 1]).map((note) => takes.notes[note]),
    output: (i) => takes.outputs[i] ?? takes.paths[i],
    /** The link to a file beside the output of a take, if a page can link there. */
    link: (i, extension) => (base === null ? null : base + (takes.outputs[i] ?? takes.paths[i]).split("/").map(encodeURIComponent).join("/") + extension),
    ...markersOf(model, streams),
  };
}

function markersOf(model, streams) {
  const numbers = (stream) => {
    const [takes, samples, missing, missing_ms, gaps, filled, longest_ms, sigma] = Array.from({ length: 8 }, () => stream.next());
    return {
      takes,
      samples,
      missing,
      gaps,
      filled,
      share: samples > 0 ? missing / samples : NaN,
      mean_secs: gaps > 0 ? missing_ms / 1000 / gaps : NaN,
      longest_secs: gaps > 0 ? longest_ms / 1000 : NaN,
      sigma: sigma > 0 ? (sigma - 1) * model.takes.step_mm : NaN,
    };
  };
  const maybe = (value) => (value > 0 ? value - 1 : NaN);
  const markers = model.markers.names.map((name) => {
    const marker = { name, ...numbers(streams.all_of_marker) };
    marker.median_secs = maybe(streams.all_of_marker.next()) / 1000;
    marker.worst = maybe(streams.all_of_marker.next());
    marker.cells = [];
    return marker;
  });
  const places = model.markers.folders.map((name) => ({ name, samples: 0, missing: 0, cells: new Map() }));
  while (streams.cells.more) {
    const place = places[streams.cells.next()], marker = markers[streams.cells.next()];
    const cell = { place, marker, ...numbers(streams.cells) };
    place.cells.set(marker, cell);
    marker.cells.push(cell);
    place.samples += cell.samples;
    place.missing += cell.missing;
  }
  return { markers, places };
}
