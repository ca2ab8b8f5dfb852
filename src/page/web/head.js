// The head of the page: which file, and the numbers that a supervisor asks for first.

/** The largest uncertainty of the take, and where. */
function worstSigma(take) {
  let at = -1, most = 0;
  for (let i = 0; i < take.sigma.length; i++) {
    if (take.sigma[i] > most) {
      most = take.sigma[i];
      at = i;
    }
  }
  return at < 0 ? null : { sigma: most, marker: Math.floor(at / take.frames), frame: at % take.frames };
}

/** For each bone, how far it is off where one of its ends was filled: the worst frame, and how many frames. */
function judgeBones(take) {
  return take.bones.map((bone, index) => {
    const judged = { index, bone, worst: 0, frame: null, touched: 0 };
    for (const frame of take.shown) {
      const a = take.state[take.at(bone.a, frame)], b = take.state[take.at(bone.b, frame)];
      if (a === MISSING || b === MISSING || (a !== FILLED && b !== FILLED)) continue;
      judged.touched++;
      const off = Math.abs(take.distance(bone.a, bone.b, frame) - bone.length_mm);
      if (off >= judged.worst) {
        judged.worst = off;
        judged.frame = frame;
      }
    }
    return judged;
  });
}

function head({ model, take, gaps, bones }) {
  const { summary, take: about } = model;
  const samples = about.markers.length * about.frames;
  const facts = model.followed ? model.followed.facts : [
    summary.format && summary.format.toUpperCase(),
    counted(about.markers.length, "marker"),
    `${counted(about.frames, "frame")} at ${short(about.rate_hz)} Hz`,
    seconds(about.frames / about.rate_hz),
    take.prefix ? `subject ${take.prefix.slice(0, -1)}` : null,
    about.up && !about.up_guessed ? `${about.up.replace("+", "")} up` : null,
    gaps.length > 0 ? `repaired by ${model.method}` : null,
  ];
  const longest = gaps.reduce((best, gap) => (!best || gap.frames > best.frames ? gap : best), null);
  const open = gaps.filter((gap) => gap.open);
  const sigma = worstSigma(take);
  const bone = bones.filter((b) => b.touched > 0).sort((a, b) => b.worst - a.worst)[0];
  const judged = summary.bone_judgement;
  const frameText = (frame) => `frame ${take.label(frame)}`;

  const tiles = model.followed ? followedTiles({ model, take, gaps }) : [
    tile("Gaps", whole(gaps.length), "", gaps.length ? `in ${counted(new Set(gaps.map((g) => g.marker)).size, "marker")}` : "nothing is missing"),
    tile("Missing", percent(samples ? summary.samples_missing / samples : 0).replace(" %", ""), "%", `${whole(summary.samples_missing)} of ${whole(samples)} samples`),
    longest
      ? tile("Longest gap", seconds(longest.frames / about.rate_hz).replace(" s", ""), "s", `${take.markers[longest.marker]}, ${counted(longest.frames, "frame")}`, () => selectGap(take, gaps, longest.index))
      : tile("Longest gap", "–", "", ""),
    open.length
      ? tile("Left open", whole(open.length), "", reasonsOf(open), () => selectGap(take, gaps, open[0].index), "warn")
      : tile("Left open", "0", "", gaps.length ? "every gap is filled" : ""),
    sigma
      ? tile("Worst uncertainty, σ", mm(sigma.sigma, false), "mm", `${take.markers[sigma.marker]}, ${frameText(sigma.frame)}`, () => {
          const gap = gaps.find((g) => g.marker === sigma.marker && g.start <= sigma.frame && sigma.frame < g.start + g.frames);
          jump(take, sigma.frame, { marker: sigma.marker, gap: gap ? gap.index : state.gap });
        })
      : tile("Worst uncertainty, σ", "–", "", summary.samples_filled ? "this method cannot say" : "nothing was filled"),
    bone
      ? tile("Worst bone error", mm(bone.worst, false), "mm", `${boneName(take, bone.bone)}, ${frameText(bone.frame)}`, () => jump(take, bone.frame, { bone: bone.index }))
      : judged
        ? tile("Worst bone error", mm(judged.worst_mm, false), "mm", judged.worst_bone)
        : tile("Worst bone error", "–", "", "no bone was touched"),
  ];

  document.getElementById("top").append(
    el("div", { className: "masthead" },
      el("div", {}, el("h1", {}, model.source_name || "unnamed take"), el("p", { className: "facts" }, facts.filter(Boolean).join(" · "))),
      el("div", { className: "tools screen" },
        el("button", { type: "button", className: "button", onclick: () => window.print() }, "Print"), themeButton())),
    el("ul", { className: "tiles", "aria-label": "Summary" }, tiles),
  );
  const said = notes(model, take, judged);
  if (said) document.getElementById("top").append(said);
}

/** Why gaps stay open: the most frequent reason. */
function reasonsOf(open) {
  const counts = new Map();
  for (const gap of open) counts.set(gap.open, (counts.get(gap.open) || 0) + 1);
  const [[most], ...others] = [...counts].sort((a, b) => b[1] - a[1]);
  return others.length ? `${reason(most)}, and others` : reason(most);
}

/** What the program noted, in its own words. */
function notes(model, take, judged) {
  const lines = [];
  for (const stage of model.summary.stages.slice(-1)) {
    if (stage.stop !== "converged" && stage.stop !== "complete") lines.push([true, `${stage.method} ${stopWords(stage.stop)} after ${counted(stage.iterations, "iteration")}, before it converged.`]);
  }
  for (const note of model.notes) lines.push([note.matters, sentence(note.text)]);
  if (take.thinned) {
    lines.push([false, `The log holds the positions of ${whole(take.shown.length)} of ${counted(take.frames, "frame")} (it was thinned with --log-rate); only these are drawn.`]);
  }
  if (judged) {
    lines.push([false, `In filled frames bones are off by ${mm(judged.rms_mm)} (root mean square); where both ends were measured, by ${mm(judged.measured_rms_mm)}.`]);
  }
  if (lines.length === 0) return null;
  lines.sort((a, b) => b[0] - a[0]);
  return el("ul", { className: "notes", "aria-label": "Notes" },
    lines.map(([matters, text]) => el("li", { className: matters ? "matters" : "" }, el("span", { className: "note-kind" }, matters ? "Look at" : "Note"), el("span", {}, text))));
}

/** Samples that no body makes, if there are any: the largest first, a few at once. */
function suspects({ model, take }) {
  if (model.suspects.length === 0) return null;
  const order = model.suspects.slice().sort((a, b) => b.size_mm - a.size_mm || a.start - b.start);
  const list = el("ul", { className: "suspects" });
  const more = el("button", { type: "button", className: "button", onclick: () => ((shown += 50), fill()) });
  let shown = 6;
  function fill() {
    list.replaceChildren(...order.slice(0, state.print ? order.length : shown).map((s) =>
      el("li", {},
        el("span", { className: "suspect-kind" }, s.kind.charAt(0).toUpperCase() + s.kind.slice(1)),
        el("span", {}, el("button", { type: "button", className: "plain link", onclick: () => jump(take, s.start, { marker: s.marker }) }, take.prefix ? s.text.replaceAll(take.prefix, "") : s.text),
          el("span", { className: "help" }, s.dropped ? " Dropped and taken for a gap." : s.ignored ? " Kept as measured, and nothing was filled from it." : " Kept as measured.")))));
    more.hidden = shown >= order.length;
    more.textContent = `Show more of ${whole(order.length)}`;
  }
  fill();
  listen("print", fill);
  return section("suspects", "Suspicious samples", "Measured, but no body moves like this.", list, el("p", { className: "controls" }, more));
}
