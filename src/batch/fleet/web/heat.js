// Which folder loses which marker: the missing share of each marker in each folder, those that lose most first.

const HEAT = { folders: 25, markers: 60 };

/** Where a share stands between a thousandth and everything, on a scale of ratios. */
const heatOf = (share) => Math.max(0, Math.min(1, 1 + Math.log10(share) / 3));

function heatMap(batch) {
  const { markers } = batch;
  const places = batch.places.filter((place) => place.missing > 0).sort((a, b) => b.missing / b.samples - a.missing / a.samples);
  const columns = markers.filter((m) => m.missing > 0).sort((a, b) => b.share - a.share);
  if (columns.length === 0 || batch.places.length < 2) return null;
  let shown = { ...HEAT };
  const holder = el("div", { className: "wide-table heat-holder", tabIndex: 0, role: "region", "aria-label": "Missing share by folder and marker" });
  const more = el("button", { type: "button", className: "button", onclick: () => {
    shown = shown.folders >= places.length && shown.markers >= columns.length ? { ...HEAT } : { folders: Math.min(places.length, 300), markers: Math.min(columns.length, 300) };
    fill();
  } });
  const short = (share) => (share >= 0.095 ? String(Math.round(100 * share)) : share >= 0.0005 ? (100 * share).toFixed(1).replace(/^0/, "") : "·");
  function cell(place, marker) {
    const found = place.cells.get(marker);
    if (!found) return el("td", { className: "absent" }, el("span", { className: "visually-hidden" }, "no such marker"));
    const about = `${folderName(place.name)}, ${marker.name}: ${percent(found.share)} missing, ${counted(found.gaps, "gap")} in ${counted(found.takes, "take")}${found.gaps ? `, longest ${duration(found.longest_secs)}` : ""}`;
    const heat = found.missing > 0 ? heatOf(found.share) : 0;
    const node = el("td", { title: about, className: heat > 0.52 ? "hot" : "" }, found.missing > 0 ? short(found.share) : "");
    node.style.setProperty("--heat", `${(100 * heat).toFixed(1)}%`);
    return node;
  }
  function fill() {
    const [rows, across] = [places.slice(0, shown.folders), columns.slice(0, shown.markers)];
    holder.replaceChildren(el("table", { className: "heat" }, el("caption", { className: "visually-hidden" }, "Missing share in percent, by folder and marker"),
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, el("span", { className: "visually-hidden" }, "Folder")), el("th", { scope: "col", className: "all" }, el("span", {}, "all")), across.map((m) => el("th", { scope: "col", title: `${m.name}: ${percent(m.share)} missing over all takes` }, el("span", {}, el("bdi", {}, m.name)))))),
      el("tbody", {}, rows.map((place) => el("tr", {},
        el("th", { scope: "row" }, el("button", { type: "button", className: "plain link", title: `${folderName(place.name)}: show its takes`, onclick: () => {
          const at = batch.takes.folders.indexOf(place.name);
          showTakes({ folder: at < 0 ? null : at, sorted: "share", down: true });
        } }, el("bdi", {}, folderName(place.name)))),
        el("td", { className: "all" }, short(place.missing / place.samples)),
        across.map((m) => cell(place, m)))))));
    more.hidden = places.length <= HEAT.folders && columns.length <= HEAT.markers;
    more.textContent = shown.folders > HEAT.folders || shown.markers > HEAT.markers ? "Show fewer" : `Show more of ${counted(places.length, "folder")} and ${counted(columns.length, "marker")}`;
  }
  fill();
  const scale = el("ul", { className: "legend" }, el("li", {}, "missing, in percent"), [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1].map((share) => {
    const swatch = el("span", { className: "swatch heat-swatch" });
    swatch.style.setProperty("--heat", `${100 * heatOf(share)}%`);
    return el("li", {}, swatch, `${Number((100 * share).toPrecision(2))}`);
  }), el("li", {}, el("span", { className: "swatch heat-swatch absent" }), "no such marker"));
  return section("heat", "Which folder loses which marker", "Those that lose most come first. A folder shows its takes in the table.", holder, scale, el("p", { className: "controls" }, more));
}
