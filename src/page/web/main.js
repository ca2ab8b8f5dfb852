// Puts the page together, and keeps paper.

async function start() {
  if (typeof DecompressionStream === "undefined") {
    return apologise("This browser is too old for this report: it needs one from 2023 or later (Chrome or Edge 80, Firefox 113, Safari 16.4).");
  }
  const { model, take } = await load();
  const gaps = model.followed ? eventList(model) : gapList(model, take);
  const parts = { model, take, gaps, bones: judgeBones(take), scale: sigmaScale(take) };
  if (gaps.length > 0 && !model.followed) {
    const first = gaps.reduce((best, gap) => ((gap.sigma_mm ?? gap.frames / 1e6) > (best.sigma_mm ?? best.frames / 1e6) ? gap : best));
    Object.assign(state, { gap: first.index, frame: first.worst ?? first.start + Math.floor(first.frames / 2) });
  }
  head(parts);
  const main = document.getElementById("page");
  const play = player(parts);
  const columns = el("div", { className: "columns" });
  main.replaceChildren(play.node, columns);
  for (const part of model.followed ? [eventTable, followedCurves, partMap, roundPlots, origin] : [suspects, gapMap, tracks, bonePlots, solver, origin]) {
    const node = part(parts);
    if (node) columns.append(node);
  }
  document.getElementById("foot").append(el("p", {}, "This file is complete: it asks no other computer for anything."));
  main.setAttribute("aria-busy", "false");
  main.dataset.player = play.kind;
  window.addEventListener("beforeprint", () => {
    set({ print: true, playing: false });
    play.freeze(true);
  });
  window.addEventListener("afterprint", () => {
    play.freeze(false);
    set({ print: false });
  });
}

themes();
start().catch((error) => {
  apologise(`This report cannot be shown: ${error.message}`);
  throw error;
});
