// Which takes are in the table: by words, by state, by folder, by what was chosen in a chart.

/** What words are looked for in, made when somebody first looks. */
function haystack(batch) {
  batch.hay ??= batch.takes.paths.map((path, i) => {
    const c = batch.column, t = batch.takes;
    const word = (list, k) => (Number.isFinite(k) ? list[k] : "");
    const kinds = batch.notes(i).map((note) => note.kind).join(" ");
    return `${path} ${word(t.reasons, c.reason[i])} ${word(t.methods, c.method[i])} ${word(t.formats, c.format[i])} ${word(t.worst_bones, c.worst_bone[i])} ${kinds}`.toLowerCase();
  });
  return batch.hay;
}

/** The takes that are to be seen, in the order of their paths. */
function visible(batch) {
  const { query, only, folder, range } = state;
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  const hay = words.length > 0 ? haystack(batch) : null;
  const { state: states, folder: folders } = batch.column;
  const numbers = range?.id ? columnOf(batch, range.id).numbers : null;
  const found = new Uint32Array(batch.count);
  let count = 0;
  for (let i = 0; i < batch.count; i++) {
    if (only !== null && states[i] !== only) continue;
    if (folder !== null && folders[i] !== folder) continue;
    if (numbers && !(numbers[i] >= range.from && numbers[i] < range.to)) continue;
    if (range?.has && !range.has.has(i)) continue;
    if (hay && !words.every((word) => hay[i].includes(word))) continue;
    found[count++] = i;
  }
  return found.subarray(0, count);
}

Object.assign(state, { query: "", only: null, folder: null, range: null });

function filters(batch) {
  let waiting = 0;
  const search = el("input", { type: "search", className: "search", placeholder: "Name, reason, kind of note …", "aria-label": "Takes with these words", autocomplete: "off", spellcheck: false, oninput: () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => set({ query: search.value }), batch.count > 20_000 ? 120 : 0);
  } });
  const counts = countStates(batch);
  const chip = (title, value, count, tone) => {
    const button = el("button", { type: "button", className: `button chip ${tone || ""}`, onclick: () => set({ only: state.only === value ? null : value }) }, title, el("span", { className: "chip-count" }, whole(count)));
    listen("only", () => button.setAttribute("aria-pressed", String(state.only === value)));
    button.setAttribute("aria-pressed", String(state.only === value));
    return button;
  };
  const chips = el("div", { className: "chips", role: "group", "aria-label": "Takes in this state" },
    chip("All", null, batch.count), STATES.map((s, k) => counts[k] > 0 && chip(s.title, k, counts[k], s.tone)));

  const names = batch.takes.folders;
  const folder = names.length > 1 && el("select", { "aria-label": "Takes in this folder", onchange: () => set({ folder: folder.value === "" ? null : Number(folder.value) }) },
    el("option", { value: "" }, `All ${whole(names.length)} folders`),
    names.map((name, k) => [folderName(name), k]).sort(([a], [b]) => a.localeCompare(b, "en", { numeric: true })).map(([name, k]) => el("option", { value: String(k) }, name)));
  const range = el("button", { type: "button", className: "button chip range", title: "Show the others as well", onclick: () => set({ range: null }) });
  const clear = el("button", { type: "button", className: "button", onclick: () => set({ query: "", only: null, folder: null, range: null }) }, "Clear");
  const shown = () => {
    if (search.value !== state.query && document.activeElement !== search) search.value = state.query;
    if (state.query === "" && search.value !== "") search.value = "";
    if (folder) folder.value = state.folder === null ? "" : String(state.folder);
    range.hidden = state.range === null;
    range.replaceChildren(state.range?.title ?? "", el("span", { "aria-hidden": "true" }, "×"));
    clear.hidden = state.query === "" && state.only === null && state.folder === null && state.range === null;
  };
  listen("query only folder range", shown);
  shown();
  return el("div", { className: "filters screen" }, search, chips, folder, range, clear);
}
