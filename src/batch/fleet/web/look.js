// What needs a look: takes that are not done and why, and then the worst of those that are.

const LOOK_ROWS = 6;

/** A reason without what is of one take alone, so that equal reasons are seen to be equal. */
function bareReason(batch, i) {
  const path = batch.takes.paths[i], [, name] = split(path);
  let text = batch.takes.reasons[batch.column.reason[i]];
  for (const word of [batch.output(i), path, name].sort((a, b) => b.length - a.length)) if (word) text = text.replaceAll(word, "…");
  return text.replace(/^\S*…: /, "");
}

/** Takes that are not done, by reason: the most frequent first. */
function byReason(batch) {
  const groups = new Map();
  const { state: states, reason } = batch.column;
  for (let i = 0; i < batch.count; i++) {
    if (states[i] !== QUARANTINED && states[i] !== FAILED) continue;
    const text = Number.isFinite(reason[i]) ? bareReason(batch, i) : "no reason was given";
    const key = states[i] + text.replace(/\d+/g, "#");
    const group = groups.get(key);
    if (group) {
      group.takes.push(i);
      group.same &&= group.text === text;
    }
    else groups.set(key, { state: states[i], text, same: true, takes: [i] });
  }
  return [...groups.values()].sort((a, b) => a.state - b.state || b.takes.length - a.takes.length);
}

function reasons(batch) {
  const groups = byReason(batch);
  if (groups.length === 0) return null;
  const most = 8;
  const item = ({ state: value, text, same, takes }) => el("li", { className: "reason" },
    badge(batch, takes[0]),
    el("span", { className: "reason-count" }, counted(takes.length, "take")),
    el("div", { className: "reason-text" },
      el("p", {}, !same && el("span", { className: "help" }, "such as: "), text),
      el("p", { className: "reason-takes" }, takes.slice(0, 3).map((i) => el("span", {}, takeName(batch, i), detailsButton(batch, i))),
        takes.length > 3 && el("button", { type: "button", className: "plain link", onclick: () => showTakes({ only: value, sorted: "reason", down: false, range: { title: text, has: new Set(takes) } }) }, `all ${whole(takes.length)}`))));
  const list = el("ul", { className: "reasons" }, groups.slice(0, most).map(item));
  const more = el("button", { type: "button", className: "button", onclick: () => (list.replaceChildren(...groups.map(item)), more.remove()) }, `Show all ${whole(groups.length)} reasons`);
  return el("div", { className: "look-reasons" }, el("h3", {}, "Not done, and why"), list, groups.length > most && el("p", { className: "controls" }, more));
}

/** The worst takes by one number. */
function worst(batch, title, id, about) {
  const { numbers, text } = columnOf(batch, id);
  const order = [];
  for (let i = 0; i < batch.count; i++) if (numbers[i] > 0) order.push(i);
  order.sort((a, b) => numbers[b] - numbers[a] || a - b);
  if (order.length === 0) return null;
  const most = numbers[order[0]];
  const rows = order.slice(0, LOOK_ROWS).map((i) => {
    const bar = el("span", { className: "look-bar", "aria-hidden": "true" });
    bar.style.width = `${(100 * numbers[i]) / most}%`;
    return el("li", {}, el("div", { className: "look-row" }, takeName(batch, i), detailsButton(batch, i), el("span", { className: "look-value" }, text(i), about && el("span", { className: "look-about" }, about(i)))), bar);
  });
  return el("div", { className: "look-list" }, el("h3", {}, title), el("ol", {}, rows),
    order.length > LOOK_ROWS && el("p", {}, el("button", { type: "button", className: "plain link", onclick: () => showTakes({ sorted: id, down: true }) }, `all ${whole(order.length)}`)));
}

function look(batch) {
  const lists = [
    worst(batch, "Gaps left open", "open", (i) => `of ${whole(batch.column.gaps[i])}`),
    worst(batch, "Worst uncertainty, σ in mm", "sigma"),
    worst(batch, "Worst bone error in mm", "bone", (i) => (Number.isFinite(batch.column.worst_bone[i]) ? batch.takes.worst_bones[batch.column.worst_bone[i]] : "")),
    worst(batch, "Suspicious samples", "suspects"),
  ].filter(Boolean);
  const why = reasons(batch);
  const nothing = !why && lists.length === 0 && el("p", { className: "empty" }, batch.count > 0 ? "Nothing: no take is quarantined or failed, and no gap is left open." : "No take is planned and none was done.");
  return section("look", "What needs a look", null, why, lists.length > 0 && el("div", { className: "look-lists" }, lists), nothing);
}
