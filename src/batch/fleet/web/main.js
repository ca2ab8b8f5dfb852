// Puts the page together, and keeps paper.

async function start() {
  if (typeof DecompressionStream === "undefined") {
    return apologise("This browser is too old for this report: it needs one from 2024 or later (Chrome or Edge 111, Firefox 121, Safari 16.4). The same numbers are in the table beside it, a CSV file of the same name.");
  }
  const batch = await load();
  columnOf(batch, "take");
  details(batch);
  head(batch);
  const main = document.getElementById("page");
  const table = takesTable(batch);
  main.replaceChildren(...[look(batch), table, heatMap(batch), markerTable(batch), spread(batch), origin(batch)].filter(Boolean));
  document.getElementById("foot").append(el("p", {}, "This file asks no other computer for anything. Reports of single takes are files of their own; they open as long as this page lies where it was written."));
  set({ ready: true });
  main.setAttribute("aria-busy", "false");
  window.addEventListener("beforeprint", () => set({ print: true }));
  window.addEventListener("afterprint", () => set({ print: false }));
}

themes();
start().catch((error) => {
  apologise(`This report cannot be shown: ${error.message}`);
  throw error;
});
