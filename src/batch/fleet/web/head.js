// The head of the page: how far the batch is, and the numbers that the head of a lab asks for first.

/** Sum of a column over the takes of which it is known. */
const sum = (numbers) => numbers.reduce((total, x) => (Number.isFinite(x) ? total + x : total), 0);

/** Index of the largest number; -1 if none is known. */
function largest(numbers) {
  let at = -1;
  for (let i = 0; i < numbers.length; i++) if (Number.isFinite(numbers[i]) && (at < 0 || numbers[i] > numbers[at])) at = i;
  return at;
}

function median(numbers) {
  const known = Float64Array.from(numbers).filter(Number.isFinite).sort();
  return known.length > 0 ? known[(known.length - 1) >> 1] : NaN;
}

/** Number of takes in each state. */
function countStates(batch) {
  const counts = STATES.map(() => 0);
  for (const value of batch.column.state) counts[value]++;
  return counts;
}

function head(batch) {
  const { about, column, count } = batch;
  const counts = countStates(batch);
  const share = (part, of = count) => (of > 0 ? percent(part / of) : DASH);
  const only = (value, changes = {}) => (counts[value] > 0 ? () => showTakes({ only: value, ...changes }) : null);

  const samples = sum(column.samples), missing = sum(column.missing), filled = sum(column.filled);
  const open = sum(column.open), withOpen = column.open.filter((x) => x > 0).length;
  const sigma = largest(column.sigma);
  const elapsed = sum(column.elapsed_ms) / 1000, usual = median(column.elapsed_ms) / 1000;
  const recorded = sum(column.length);
  const perHour = about.wall_secs > 0 ? (about.done_in_runs / about.wall_secs) * 3600 : NaN;

  const first = [
    tile("Done", whole(counts[DONE] + counts[REMARKS]), "", `${share(counts[DONE] + counts[REMARKS])} of ${counted(count, "take")}`, null, counts[DONE] + counts[REMARKS] === count && count > 0 ? "fine" : ""),
    tile("Of these with remarks", whole(counts[REMARKS]), "", counts[REMARKS] ? "something to look at" : "nothing to look at", only(REMARKS, { sorted: "notes", down: true })),
    tile("Quarantined", whole(counts[QUARANTINED]), "", counts[QUARANTINED] ? "not tried again" : "none", only(QUARANTINED), counts[QUARANTINED] ? "bad" : ""),
    tile("Failed", whole(counts[FAILED]), "", counts[FAILED] ? "the next run tries again" : "none", only(FAILED), counts[FAILED] ? "warn" : ""),
    tile("Not yet done", whole(counts[WAITING]), "", counts[WAITING] ? `${share(counts[WAITING])} of all` : "nothing is waiting", only(WAITING)),
    tile("Recorded", recorded > 0 ? duration(recorded).split(" ")[0] : DASH, recorded > 0 ? duration(recorded).split(" ").slice(1).join(" ") : "", `${large(samples)} samples`),
  ];
  const numberOf = (text) => text.replace(/ %$/, "");
  const second = [
    tile("Missing", samples > 0 ? numberOf(share(missing, samples)) : DASH, samples > 0 ? "%" : "", `${large(missing)} samples`, missing > 0 ? () => showTakes({ sorted: "share", down: true }) : null),
    tile("Filled of that", missing > 0 ? numberOf(share(filled, missing)) : DASH, missing > 0 ? "%" : "", missing > 0 ? `${large(filled)} samples` : samples > 0 ? "nothing is missing" : "not known"),
    tile("Gaps left open", samples > 0 ? whole(open) : DASH, "", open ? `in ${counted(withOpen, "take")}` : samples > 0 ? "every gap is filled" : "not known", open > 0 ? () => showTakes({ sorted: "open", down: true }) : null, open ? "warn" : ""),
    tile("Worst uncertainty, σ", sigma < 0 ? DASH : mm(column.sigma[sigma], false), sigma < 0 ? "" : "mm", sigma < 0 ? "not known" : split(batch.takes.paths[sigma])[1], sigma < 0 ? null : () => set({ details: sigma })),
    tile("Computing", elapsed > 0 ? duration(elapsed).split(" ")[0] : DASH, elapsed > 0 ? duration(elapsed).split(" ").slice(1).join(" ") : "", Number.isFinite(usual) ? `${duration(usual)} for the usual take` : "not known", Number.isFinite(usual) ? () => showTakes({ sorted: "elapsed", down: true }) : null),
    tile("Throughput", orDash(perHour, few), Number.isFinite(perHour) ? "takes/h" : "", Number.isFinite(perHour) ? `${counted(about.done_in_runs, "repair")} in ${duration(about.wall_secs)}` : "not known"),
  ];

  const versions = [...new Set([...about.plans.map((p) => p.version), ...about.attempts.map((a) => a.version)].filter(Boolean))];
  const configs = [...new Set(about.plans.map((p) => p.config_sha256).filter(Boolean))];
  const last = about.attempts.map((a) => a.last).filter(Boolean).sort().at(-1);
  const facts = [
    counted(count, "take"),
    batch.takes.folders.length > 1 ? `${whole(batch.takes.folders.length)} folders` : null,
    bytesText(sum(column.bytes)),
    versions.length > 0 ? `mocap-repair ${versions.join(", ")}` : null,
    configs.length === 1 ? `configuration ${configs[0].slice(0, 8)}` : configs.length > 1 ? `${configs.length} configurations` : null,
    last ? `last record ${momentText(last)} UTC` : null,
  ];
  document.getElementById("top").append(
    el("div", { className: "masthead" },
      el("div", {}, el("h1", {}, el("bdi", {}, about.name || "Batch")), el("p", { className: "facts" }, facts.filter(Boolean).join(" · "))),
      el("div", { className: "tools screen" }, el("button", { type: "button", className: "button", onclick: () => window.print() }, "Print"), themeButton())),
    count > 0 ? progress(counts, count) : "",
    el("ul", { className: "tiles fleet-tiles", "aria-label": "Summary" }, first, second),
    remarks(batch),
  );
}

/** How far it is, as one line of colours. */
function progress(counts, count) {
  const text = STATES.map((s, k) => [s.title.toLowerCase(), counts[k]]).filter(([, n]) => n > 0).map(([title, n]) => `${whole(n)} ${title}`).join(", ");
  return el("div", { className: "progress", role: "img", "aria-label": text, title: text }, STATES.map((s, k) => {
    if (counts[k] === 0) return null;
    const part = el("span", { className: s.tone });
    part.style.flexGrow = String(counts[k] / count);
    return part;
  }));
}

/** What the report itself has to say. */
function remarks({ about, column, takes }) {
  const lines = about.remarks.map((text) => [true, sentence(text)]);
  let unknown = 0;
  for (let i = 0; i < column.state.length; i++) if (column.state[i] <= REMARKS && !(column.flags[i] & HAS_NUMBERS)) unknown++;
  if (unknown > 0) lines.push([true, `Of ${counted(unknown, "take")} that ${unknown === 1 ? "is" : "are"} done no sidecar is there, or it is of another repair: the numbers of ${unknown === 1 ? "it" : "these"} are not known.`]);
  if (takes.notes_cut) lines.push([false, "There are more notes than this page can carry: of some only the kind is told, their texts are in the sidecars."]);
  if (lines.length === 0) return "";
  return el("ul", { className: "notes", "aria-label": "Remarks on this report" },
    lines.map(([matters, text]) => el("li", { className: matters ? "matters" : "" }, el("span", { className: "note-kind" }, matters ? "Look at" : "Note"), el("span", {}, text))));
}
