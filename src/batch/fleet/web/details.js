// Everything that is known of one take.

function details(batch) {
  const dialog = el("dialog", { className: "details", "aria-labelledby": "details-title", onclose: () => set({ details: null }), onclick: (event) => event.target === dialog && dialog.close() });
  document.body.append(dialog);
  const c = batch.column, { takes } = batch;
  const text = (id, i) => columnOf(batch, id).text(i);
  const word = (list, k) => (Number.isFinite(k) ? list[k] : null);
  const list = (pairs) => el("dl", { className: "facts-list" }, pairs.filter(([, value]) => value && value !== DASH).map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));

  function fill(i) {
    const [folder, name] = split(takes.paths[i]);
    const report = c.flags[i] & HAS_REPORT ? batch.link(i, ".html") : null;
    const quoted = (file) => `'${file.replaceAll("'", "'\\''")}'`;
    const output = batch.output(i);
    const bone = word(takes.worst_bones, c.worst_bone[i]);
    const notes = batch.notes(i).sort((a, b) => b.matters - a.matters);
    const known = Boolean(c.flags[i] & HAS_NUMBERS);
    const reason = word(takes.reasons, c.reason[i]);
    dialog.replaceChildren(el("div", {},
      el("div", { className: "details-head" },
        el("div", {}, el("h2", { id: "details-title" }, el("bdi", {}, name)), folder && el("p", { className: "help" }, el("bdi", {}, folder))),
        el("button", { type: "button", className: "button", "aria-label": "Close", onclick: () => dialog.close() }, "×")),
      el("p", { className: "row" }, badge(batch, i), Boolean(c.flags[i] & SKIPPED) && el("span", { className: "help" }, "done already when the last run came by"), report !== null && el("a", { className: "button primary", href: report }, "Open its report")),
      reason && el("p", { className: "details-reason" }, reason),
      c.state[i] === WAITING && el("p", { className: "help" }, "It is planned, and no run has got to it."),
      c.state[i] <= REMARKS && !known && el("p", { className: "help" }, "No sidecar of this repair lies beside its output, so that its numbers are not known."),
      notes.length > 0 && el("ul", { className: "notes", "aria-label": "Notes" }, notes.map((note) => el("li", { className: note.matters ? "matters" : "" }, el("span", { className: "note-kind" }, note.matters ? "Look at" : "Note"), el("span", {}, sentence(note.text || note.kind.replaceAll("_", " ")))))),
      el("div", { className: "details-columns" },
        known && el("div", {}, el("h3", {}, "What was missing"), list([
          ["Missing", `${percent(c.share[i])}, ${whole(c.missing[i])} of ${whole(c.samples[i])} samples`],
          ["Gaps", `${whole(c.gaps[i])}${c.open[i] ? `, ${whole(c.open[i])} left open` : ""}`],
          ["Longest", c.gaps[i] ? `${duration(c.longest_secs[i])}, ${counted(c.longest[i], "frame")}` : null],
          ["Filled", `${whole(c.filled[i])} samples`],
          ["Suspects", c.suspects[i] ? counted(c.suspects[i], "stretch").replace("stretchs", "stretches") : null],
          ["Worst σ", orDash(c.sigma[i], mm)],
          ["Worst bone", Number.isFinite(c.bone_worst[i]) ? `${mm(c.bone_worst[i])}${bone ? `, ${bone}` : ""}` : null],
          ["All bones", Number.isFinite(c.bone_rms[i]) ? `${mm(c.bone_rms[i])} root mean square` : null],
        ])),
        el("div", {}, el("h3", {}, "The take"), list([
          ["Frames", known ? `${whole(c.frames[i])} at ${short(c.rate[i])} Hz, ${duration(c.length[i])}` : null],
          ["Markers", known ? `${whole(c.markers[i])}, ${counted(c.bones[i], "bone")}` : null],
          ["Format", known ? text("format", i) : null],
          ["Size", bytesText(c.bytes[i])],
          ["Output", output !== takes.paths[i] ? output : null],
        ]), el("h3", {}, "The repair"), list([
          ["Method", known ? text("method", i) : null],
          ["Time", text("elapsed", i)],
          ["Memory", text("memory", i)],
          ["Tries", c.state[i] === WAITING ? null : whole(c.tries[i])],
          ["Exit code", orDash(c.exit_code[i], String)],
          ["When", Number.isFinite(c.time[i]) ? `${moment(c.time[i])} UTC` : null],
        ]))),
      report === null && c.flags[i] & HAS_LOG ? [el("h3", {}, "A report of this take can be made from its log, in the output folder"), el("pre", { className: "command" }, `mocap-repair report ${quoted(`${output}.mcap`)} -o ${quoted(`${output}.html`)}`)] : null,
    ));
  }
  listen("details", () => {
    if (state.details === null) return;
    fill(state.details);
    if (!dialog.open) dialog.showModal();
    dialog.scrollTop = 0;
  });
}
