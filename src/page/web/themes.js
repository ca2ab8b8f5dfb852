// Light and dark: what the system wants, until somebody chooses; and what is said if there is nothing to show.

function themes() {
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const key = "mocap-repair-theme";
  let chosen = null;
  try {
    chosen = localStorage.getItem(key);
  } catch {
    // a file may not be allowed to remember anything
  }
  state.theme = chosen === "dark" || chosen === "light" ? chosen : system.matches ? "dark" : "light";
  dress();
  system.addEventListener("change", () => chosen || set({ theme: system.matches ? "dark" : "light" }));
  listen("theme", () => {
    chosen = state.theme;
    try {
      localStorage.setItem(key, state.theme);
    } catch {
      // as above
    }
  });
}

function apologise(text) {
  const main = document.getElementById("page");
  main.replaceChildren(el("p", { className: "apology" }, text));
  main.setAttribute("aria-busy", "false");
}

/** Changes from light to dark and back. */
function themeButton() {
  const theme = el("button", { type: "button", className: "button screen", onclick: () => set({ theme: state.theme === "dark" ? "light" : "dark" }) });
  const name = () => (theme.textContent = state.theme === "dark" ? "Light" : "Dark");
  listen("theme", name);
  name();
  return theme;
}
