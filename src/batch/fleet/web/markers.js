// What is missing of each marker over all takes.

const MARKER_ROWS = 15;

/** The folder in which most of a marker is missing. */
function worstPlace(marker) {
  return marker.cells.reduce((most, cell) => (cell.missing > 0 && (!most || cell.share > most.share) ? cell : most), null);
}

function markerTable(batch) {
  const { markers } = batch;
  if (markers.length === 0) return null;
  for (const marker of markers) {
    marker.where = worstPlace(marker);
    marker.filled_share = marker.missing > 0 ? marker.filled / marker.missing : NaN;
  }
  const many = batch.places.length > 1;
  const top = markers.reduce((most, m) => Math.max(most, m.share || 0), 0) || 1;
  const plain = (id, title, text, help) => ({ id, title, help, number: true, down: true, by: (m) => m[id], text: (m) => orDash(m[id], text) });
  const columns = [
    { id: "name", title: "Marker", text: (m) => m.name, words: true },
    plain("takes", "Takes", whole),
    { ...plain("share", "Missing", percent), bar: true },
    plain("missing", "Samples", large, "that were missing"),
    plain("gaps", "Gaps", whole),
    plain("mean_secs", "Mean gap", duration),
    plain("median_secs", "Usual longest", duration, "the longest gap of a take, half of the takes with gaps having a shorter one"),
    plain("longest_secs", "Longest gap", duration),
    plain("filled_share", "Filled", percent),
    plain("sigma", "Worst σ, mm", (x) => mm(x, false)),
    many && { id: "where", title: "Most in", down: true, by: (m) => (m.where ? m.where.share : NaN), text: (m) => (m.where ? `${folderName(m.where.place.name)}, ${percent(m.where.share)}` : DASH) },
    { id: "worst", title: "Worst take", by: (m) => m.worst, node: (m) => (Number.isFinite(m.worst) ? el("button", { type: "button", className: "plain link", title: batch.takes.paths[m.worst], onclick: () => set({ details: m.worst }) }, split(batch.takes.paths[m.worst])[1]) : DASH) },
  ].filter(Boolean);
  let sorted = "share", down = true, shown = MARKER_ROWS;
  const body = el("tbody");
  const heads = columns.map((column) => el("th", { scope: "col", className: column.number ? "number" : "" }, el("button", { type: "button", className: "plain sorter", title: column.help, onclick: () => {
    down = sorted === column.id ? !down : Boolean(column.down);
    sorted = column.id;
    fill();
  } }, column.title)));
  const more = el("button", { type: "button", className: "button", onclick: () => ((shown = shown >= markers.length ? MARKER_ROWS : Math.max(200, shown + 200)), fill()) });
  function order() {
    const column = columns.find((c) => c.id === sorted), sign = down ? -1 : 1;
    const byName = (a, b) => a.name.localeCompare(b.name, "en", { numeric: true });
    if (column.words) return markers.slice().sort((a, b) => sign * byName(a, b));
    return markers.slice().sort((a, b) => {
      const [p, q] = [column.by(a), column.by(b)];
      if (!Number.isFinite(p) || !Number.isFinite(q)) return Number.isFinite(q) - Number.isFinite(p) || byName(a, b);
      return sign * (p - q) || byName(a, b);
    });
  }
  function fill() {
    body.replaceChildren(...order().slice(0, shown).map((m) => el("tr", {}, columns.map((column, k) => {
      const cell = el(k === 0 ? "th" : "td", { className: [column.number && "number", column.bar && "has-bar"].filter(Boolean).join(" "), scope: k === 0 ? "row" : null }, column.node ? column.node(m) : column.words ? el("bdi", {}, column.text(m)) : column.text(m));
      if (column.bar && m.share > 0) {
        const bar = el("span", { className: "cell-bar", "aria-hidden": "true" });
        bar.style.width = `${Math.max(1, (100 * m.share) / top)}%`;
        cell.append(bar);
      }
      return cell;
    }))));
    heads.forEach((th, k) => th.setAttribute("aria-sort", columns[k].id !== sorted ? "none" : down ? "descending" : "ascending"));
    more.hidden = markers.length <= MARKER_ROWS;
    more.textContent = shown >= markers.length ? "Show fewer" : `Show more of ${counted(markers.length, "marker")}`;
  }
  fill();
  const take = el("button", { type: "button", className: "button", onclick: () => save("markers.csv", markersAsCsv(batch)) }, "Save as CSV");
  return section("markers", "Markers", "Over all takes, by name without a subject's prefix.", el("div", { className: "wide-table", tabIndex: 0, role: "region", "aria-label": "Markers" }, el("table", { className: "marker-table" }, el("caption", { className: "visually-hidden" }, "Markers over all takes"), el("thead", {}, el("tr", {}, heads)), body)), el("p", { className: "controls row" }, more, take));
}

/** Every marker over all takes, and in each folder. */
function markersAsCsv(batch) {
  const row = (folder, name, m, median) => [folder, name, m.takes, m.samples, m.missing, m.share, m.gaps, m.mean_secs, median, m.longest_secs, m.filled, m.sigma];
  const rows = [["folder", "marker", "takes", "samples", "samples_missing", "missing_share", "gaps", "mean_gap_secs", "median_longest_gap_secs", "longest_gap_secs", "samples_filled", "worst_sigma_mm"]];
  for (const m of batch.markers) rows.push(row("*", m.name, m, m.median_secs));
  for (const place of batch.places) for (const [m, cell] of place.cells) rows.push(row(place.name, m.name, cell, NaN));
  return csv(rows);
}
