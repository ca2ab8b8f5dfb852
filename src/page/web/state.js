// What is selected and where the playhead is. Parts listen to names of what they show; nobody calls anybody else.

const state = { frame: 0, gap: null, marker: null, playing: false, speed: 1, theme: "light", print: false };
const listeners = new Map();

/** Calls `tell` after one of `names` has changed. */
function listen(names, tell) {
  for (const name of names.split(" ")) {
    if (!listeners.has(name)) listeners.set(name, new Set());
    listeners.get(name).add(tell);
  }
}

/** Changes the state and tells whoever listens, each once. */
function set(changes) {
  const tell = new Set();
  for (const [name, value] of Object.entries(changes)) {
    if (state[name] === value) continue;
    state[name] = value;
    for (const listener of listeners.get(name) || []) tell.add(listener);
  }
  for (const listener of tell) listener(state);
}

/** Paper is always light. The first to hear of it, so that whoever draws asks for the new colours. */
const dress = () => {
  document.documentElement.dataset.theme = state.print ? "light" : state.theme;
  document.documentElement.classList.toggle("paper", state.print);
};
listen("theme print", dress);

/** Puts the playhead somewhere, and stops it there. */
function jump(take, frame, changes = {}) {
  set({ playing: false, ...changes, frame: Math.max(0, Math.min(take.frames - 1, Math.round(frame))) });
}

/** Selects a gap and goes to where it is least sure, or to its middle. */
function selectGap(take, gaps, index, frame) {
  const gap = gaps[index];
  if (gap) jump(take, frame ?? gap.worst ?? gap.start + Math.floor(gap.frames / 2), { gap: index, marker: gap.marker });
}

const calm = () => window.matchMedia("(prefers-reduced-motion: reduce)").matches;
