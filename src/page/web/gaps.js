// The gaps as a table: what the map shows, for readers, keyboards and paper.

const PAGE_ROWS = 12;

function gapTable({ model, take, gaps }) {
  if (gaps.length === 0) return null;
  const sigmaKnown = gaps.some((g) => g.sigma_mm != null);
  const explained = gaps.some((g) => g.explanation?.length);
  const open = gaps.some((g) => g.open);
  const name = (g) => take.markers[g.marker];
  const columns = [
    { title: "Marker", by: (a, b) => name(a).localeCompare(name(b)) || a.start - b.start },
    { title: "First", number: true, by: (a, b) => a.start - b.start },
    { title: "Last", number: true, wide: true, by: (a, b) => a.start + a.frames - (b.start + b.frames) },
    { title: "Frames", number: true, by: (a, b) => a.frames - b.frames, down: true },
    { title: "Seconds", number: true, wide: true, by: (a, b) => a.frames - b.frames, down: true },
    sigmaKnown && { title: "Worst σ", number: true, by: (a, b) => (a.sigma_mm ?? -1) - (b.sigma_mm ?? -1), down: true },
    (explained || open) && { title: explained ? "How" : "Why open", wide: true, by: (a, b) => how(a).localeCompare(how(b)) },
  ].filter(Boolean);
  let sorted = sigmaKnown ? 5 : 3, down = true, shown = PAGE_ROWS;
  const body = el("tbody");
  const heads = columns.map((column, at) =>
    el("th", { scope: "col", className: kind(column) }, el("button", { type: "button", className: "plain sorter", onclick: () => {
      down = sorted === at ? !down : Boolean(column.down);
      sorted = at;
      fill();
    } }, column.title)));
  const more = el("button", { type: "button", className: "button", onclick: () => ((shown += 100), fill()) });
  function kind(column) {
    return [column.number && "number", column.wide && "wide"].filter(Boolean).join(" ");
  }
  function how(gap) {
    if (gap.open) return explained ? `left open: ${reason(gap.open)}` : reason(gap.open);
    return explain(take, gap.explanation?.[0]) + (gap.explanation?.length > 1 ? ` (and ${gap.explanation.length - 1} more stretches)` : "");
  }
  function row(gap) {
    const cells = [
      el("button", { type: "button", className: "plain link", onclick: () => selectGap(take, gaps, gap.index) }, name(gap)),
      String(take.label(gap.start)),
      String(take.label(gap.start + gap.frames - 1)),
      whole(gap.frames),
      seconds(gap.frames / take.rate),
      sigmaKnown && (gap.sigma_mm == null ? "–" : mm(gap.sigma_mm)),
      (explained || open) && how(gap),
    ].filter((cell) => cell !== false);
    const line = el("tr", { "aria-current": gap.index === state.gap ? "true" : null }, cells.map((cell, at) => el("td", { className: kind(columns[at]) }, cell)));
    line.dataset.gap = gap.index;
    return line;
  }
  function fill() {
    const order = gaps.slice().sort((a, b) => (down ? -1 : 1) * columns[sorted].by(a, b) || a.index - b.index);
    body.replaceChildren(...order.slice(0, state.print ? order.length : shown).map(row));
    heads.forEach((th, at) => th.setAttribute("aria-sort", at !== sorted ? "none" : down ? "descending" : "ascending"));
    more.hidden = shown >= order.length;
    more.textContent = `Show ${whole(Math.min(100, order.length - shown))} more of ${counted(order.length, "gap")}`;
  }
  fill();
  listen("print", fill);
  listen("gap", () => {
    for (const line of body.children) {
      if (Number(line.dataset.gap) === state.gap) line.setAttribute("aria-current", "true");
      else line.removeAttribute("aria-current");
    }
  });
  return el("div", { className: "gap-table" }, el("table", {}, el("caption", { className: "visually-hidden" }, "All gaps"), el("thead", {}, el("tr", {}, heads)), body), el("p", { className: "controls" }, more));
}
