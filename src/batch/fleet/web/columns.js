// The columns of the table of takes: what is sorted by, and what is shown. A number that is not known is NaN, and comes last however it is sorted.

/** Of a column of words: the place of each word in their order. */
function ranks(words) {
  const order = words.map((_, k) => k).sort((a, b) => words[a].localeCompare(words[b], "en"));
  const rank = new Float64Array(words.length);
  order.forEach((k, place) => (rank[k] = place));
  return rank;
}

function columnsOf(batch) {
  const c = batch.column, { takes } = batch;
  const ofWords = (numbers, words) => {
    const rank = ranks(words);
    return { numbers: numbers.map((k) => (Number.isFinite(k) ? rank[k] : NaN)), text: (i) => (Number.isFinite(numbers[i]) ? words[numbers[i]] : DASH) };
  };
  const wholes = (numbers) => ({ numbers, text: (i) => orDash(numbers[i], whole), number: true, down: true });
  const lengths = (numbers) => ({ numbers, text: (i) => orDash(numbers[i], (x) => mm(x, false)), number: true, down: true });
  const times = (numbers) => ({ numbers, text: (i) => duration(numbers[i]), number: true, down: true });
  const bar = (numbers, text) => ({ numbers, text, number: true, down: true, bar: true });
  return [
    { id: "take", title: "Take", numbers: Float64Array.from({ length: batch.count }, (_, i) => i), text: (i) => takes.paths[i], width: 330, node: (i) => el("div", { className: "take-cell" }, takeName(batch, i), detailsButton(batch, i)) },
    { id: "state", title: "State", numbers: c.state, text: (i) => STATES[c.state[i]].title, width: 124, node: (i) => badge(batch, i) },
    { id: "share", title: "Missing", width: 96, ...bar(c.share, (i) => orDash(c.share[i], percent)) },
    { id: "gaps", title: "Gaps", width: 76, ...wholes(c.gaps) },
    { id: "open", title: "Left open", width: 108, ...wholes(c.open), marks: (i) => c.open[i] > 0 },
    { id: "longest", title: "Longest gap", width: 128, ...times(c.longest_secs) },
    { id: "filled", title: "Filled", width: 84, help: "samples", ...wholes(c.filled) },
    { id: "sigma", title: "Worst σ, mm", width: 132, ...lengths(c.sigma) },
    { id: "bone", title: "Worst bone, mm", width: 156, ...lengths(c.bone_worst) },
    { id: "rms", title: "Bones, mm", width: 118, help: "root mean square of the errors of all bones", ...lengths(c.bone_rms) },
    { id: "notes", title: "Notes", width: 88, help: "those that matter, of all", numbers: c.noted.map((all, i) => c.matters[i] + all / 1e6), text: (i) => (Number.isFinite(c.noted[i]) ? (c.matters[i] > 0 ? `${whole(c.matters[i])} of ${whole(c.noted[i])}` : whole(c.noted[i])) : DASH), number: true, down: true, marks: (i) => c.matters[i] > 0 },
    { id: "suspects", title: "Suspects", width: 106, help: "stretches that no body makes", ...wholes(c.suspects) },
    { id: "length", title: "Length", width: 90, ...times(c.length) },
    { id: "frames", title: "Frames", width: 92, ...wholes(c.frames) },
    { id: "markers", title: "Markers", width: 98, ...wholes(c.markers) },
    { id: "samples", title: "Samples", width: 104, ...wholes(c.samples) },
    { id: "elapsed", title: "Time", width: 82, help: "computing, all tries", ...times(c.elapsed_ms.map((x) => x / 1000)) },
    { id: "memory", title: "Memory", width: 102, numbers: c.peak_kib, text: (i) => bytesText(c.peak_kib[i] * 1024), number: true, down: true },
    { id: "tries", title: "Tries", width: 76, numbers: c.tries.map((x, i) => (c.state[i] === WAITING ? NaN : x)), text: (i) => (c.state[i] === WAITING ? DASH : whole(c.tries[i])), number: true, down: true },
    { id: "size", title: "Size", width: 88, help: "of the input", numbers: c.bytes, text: (i) => bytesText(c.bytes[i]), number: true, down: true },
    { id: "method", title: "Method", width: 100, ...ofWords(c.method, takes.methods) },
    { id: "format", title: "Format", width: 92, ...ofWords(c.format, takes.formats) },
    { id: "time", title: "When, UTC", width: 150, numbers: c.time, text: (i) => moment(c.time[i]), number: true, down: true },
    { id: "reason", title: "Reason", width: 420, ...ofWords(c.reason, takes.reasons) },
  ];
}

/** A column by its name; they are made once. */
function columnOf(batch, id) {
  batch.columns ??= columnsOf(batch);
  return batch.columns.find((column) => column.id === id);
}

/** The takes in the order of a column, those of which it is not known last, and otherwise by path. */
function inOrder(takes, numbers, down) {
  const known = takes.filter((i) => numbers[i] === numbers[i]), unknown = takes.filter((i) => numbers[i] !== numbers[i]);
  known.sort(down ? (a, b) => numbers[b] - numbers[a] || a - b : (a, b) => numbers[a] - numbers[b] || a - b);
  const order = new Uint32Array(takes.length);
  order.set(known);
  order.set(unknown, known.length);
  return order;
}
