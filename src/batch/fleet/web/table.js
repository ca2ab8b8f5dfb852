// The takes as a table that sorts. Only the rows in sight are in the document, so that a hundred thousand takes are no more work than a hundred.

const ROW = 34;
const AHEAD = 12;
/** Browsers do not lay out more than some millions of pixels. */
const MOST_ROWS = 400_000;
const PRINTED = 60;

Object.assign(state, { sorted: "take", down: false, details: null });

function takesTable(batch) {
  columnOf(batch, "take");
  const { columns } = batch;
  let order = new Uint32Array(0), rows = new Map(), tops = columns.map(() => 0);

  const heads = columns.map((column) =>
    el("th", { scope: "col", className: column.number ? "number" : "" }, el("button", { type: "button", className: "plain sorter", title: column.help, onclick: () => {
      if (state.sorted === column.id) set({ down: !state.down });
      else set({ sorted: column.id, down: Boolean(column.down) });
    } }, column.title)));
  const above = el("tr", { className: "space", "aria-hidden": "true" }, el("td", { colSpan: columns.length }));
  const below = el("tr", { className: "space", "aria-hidden": "true" }, el("td", { colSpan: columns.length }));
  const body = el("tbody", {}, above, below);
  const table = el("table", { className: "takes" }, el("caption", { className: "visually-hidden" }, "Takes"),
    el("colgroup", {}, columns.map((column) => {
      const col = el("col");
      col.style.width = `${column.width}px`;
      return col;
    })), el("thead", {}, el("tr", { "aria-rowindex": "1" }, heads)), body);
  table.style.width = `${columns.reduce((width, column) => width + column.width, 0)}px`;
  const scroller = el("div", { className: "scroller", tabIndex: 0, role: "region", "aria-label": "Takes" }, table);
  const said = el("p", { className: "help said", role: "status" });

  function row(at) {
    const i = order[at];
    const cells = columns.map((column, k) => {
      const cell = el(k === 0 ? "th" : "td", { className: [column.number && "number", column.marks?.(i) && "marked", column.bar && "has-bar"].filter(Boolean).join(" ") }, column.node ? column.node(i) : column.text(i));
      if (k === 0) cell.setAttribute("scope", "row");
      if (column.id === "reason" && Number.isFinite(batch.column.reason[i])) cell.title = column.text(i);
      if (column.bar && column.numbers[i] > 0) {
        const bar = el("span", { className: "cell-bar", "aria-hidden": "true" });
        bar.style.width = `${Math.max(1, (100 * column.numbers[i]) / tops[k])}%`;
        cell.append(bar);
      }
      return cell;
    });
    return el("tr", { "aria-rowindex": String(at + 2), onclick: (event) => event.target.closest("a, button") || String(getSelection()) || set({ details: i }) }, cells);
  }

  /** Puts the rows from `first` up to `end` into the document; rows that stay are not touched, or they would lose the focus. */
  function draw(first, end) {
    for (const [at, line] of rows) {
      if (at >= first && at < end) continue;
      line.remove();
      rows.delete(at);
    }
    let after = below;
    for (let at = end - 1; at >= first; at--) {
      let line = rows.get(at);
      if (!line) {
        line = row(at);
        rows.set(at, line);
        body.insertBefore(line, after);
      }
      after = line;
    }
    above.firstChild.style.height = `${first * ROW}px`;
    below.firstChild.style.height = `${(Math.min(order.length, MOST_ROWS) - end) * ROW}px`;
    above.hidden = first === 0;
    below.hidden = state.print || end >= Math.min(order.length, MOST_ROWS);
  }

  function inSight() {
    const length = Math.min(order.length, MOST_ROWS);
    if (state.print) return draw(0, Math.min(PRINTED, length));
    const top = Math.max(0, scroller.scrollTop), height = scroller.clientHeight || 600;
    const first = Math.max(0, Math.min(length, Math.floor(top / ROW)) - AHEAD);
    draw(first, Math.min(length, Math.ceil((top + height) / ROW) + AHEAD));
  }

  let asked = false;
  scroller.addEventListener("scroll", () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      inSight();
    });
  }, { passive: true });
  if (typeof ResizeObserver !== "undefined") new ResizeObserver(inSight).observe(scroller);

  let takes = null;
  function show(again) {
    if (again || takes === null) takes = visible(batch);
    const column = columnOf(batch, state.sorted);
    order = inOrder(takes, column.numbers, state.down);
    for (const line of rows.values()) line.remove();
    rows = new Map();
    table.setAttribute("aria-rowcount", String(order.length + 1));
    heads.forEach((th, k) => th.setAttribute("aria-sort", columns[k] !== column ? "none" : state.down ? "descending" : "ascending"));
    const cut = order.length > MOST_ROWS ? `; the table shows the first ${whole(MOST_ROWS)}` : "";
    said.textContent = order.length === batch.count ? `${counted(batch.count, "take")}${cut}` : `${whole(order.length)} of ${counted(batch.count, "take")}${cut}`;
    empty.hidden = order.length > 0;
    scroller.style.height = `min(70vh, 620px, ${(Math.min(order.length, 100) + 1) * ROW + 20}px)`;
    scroller.scrollTop = 0;
    inSight();
    printed.textContent = order.length > PRINTED ? `The first ${PRINTED} of ${counted(order.length, "take")}; all of them are in the table that lies beside this page.` : "";
  }
  const empty = el("p", { className: "empty", hidden: true }, "No take is like that.");
  const printed = el("p", { className: "help on-paper" });
  for (const column of columns) if (column.bar) tops[columns.indexOf(column)] = column.numbers.reduce((most, x) => (x > most ? x : most), 0) || 1;
  show(true);
  listen("query only folder range", () => show(true));
  listen("sorted down", () => show(false));
  listen("print", inSight);

  const take = el("button", { type: "button", className: "button", title: "The takes that are in the table now, in this order", onclick: () => save("takes.csv", shownAsCsv(batch, order)) }, "Save as CSV");
  return section("takes", "Takes", null, filters(batch), el("div", { className: "table-line screen" }, said, take), scroller, empty, printed);
}

/** The table as it is shown, in plain numbers. */
function shownAsCsv(batch, order) {
  const words = new Set(["take", "state", "method", "format", "reason", "time"]);
  const plain = { memory: (x) => x * 1024, notes: (x) => Math.round((x % 1) * 1e6) };
  const rows = [batch.columns.map((column) => ({ longest: "longest_gap_secs", sigma: "worst_sigma_mm", bone: "bone_worst_mm", rms: "bone_rms_mm", share: "missing_share", open: "gaps_left_open", elapsed: "elapsed_secs", memory: "peak_bytes", size: "input_bytes", take: "path", length: "length_secs" })[column.id] ?? column.id)];
  for (const i of order) {
    rows.push(batch.columns.map((column) => {
      if (!words.has(column.id)) return (plain[column.id] ?? ((x) => x))(column.numbers[i]);
      const text = column.text(i);
      return text === DASH ? "" : column.id === "state" ? STATES[batch.column.state[i]].word : text;
    }));
  }
  return csv(rows);
}
