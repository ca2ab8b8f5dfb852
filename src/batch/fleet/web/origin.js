// Where this comes from: plans, options, runs.

const RUN_ROWS = 12;
const STOP_WORDS = { complete: "complete", interrupted: "interrupted", disk_full: "no room on the disk", too_many_failures: "too many failures", engine: "the engine is gone" };

function origin({ about }) {
  const list = (entries) => el("dl", { className: "facts-list" }, entries.filter(([, value]) => value).map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, el("bdi", {}, value)))));
  const plans = about.plans.map((plan) => el("div", { className: "plan" },
    list([["Plan", plan.name], ["Takes", whole(plan.takes)], ["Program", plan.version && `mocap-repair ${plan.version}`], ["From", plan.sources.join(", ")], ["Options", plan.config_sha256 && `SHA-256 ${plan.config_sha256}`]]),
    plan.config && el("details", {}, el("summary", {}, "Options of this plan"), el("pre", {}, plan.config))));
  let shown = RUN_ROWS;
  const runs = about.attempts.slice().reverse();
  const several = runs.some((run) => run.shards > 1);
  const columns = [
    ["Begun, UTC", (run) => momentText(run.begun)],
    ["Last record", (run) => momentText(run.last)],
    ["Host", (run) => run.host],
    ["Engine", (run) => run.engine],
    ["At a time", (run) => whole(run.jobs), true],
    several && ["Part", (run) => `${run.shard}/${run.shards}`, true],
    ["Done", (run) => whole(run.done), true],
    ["Done already", (run) => whole(run.skipped), true],
    ["Quarantined", (run) => whole(run.quarantined), true],
    ["Failed", (run) => whole(run.failed), true],
    ["Ended", (run) => (run.stop ? STOP_WORDS[run.stop] || run.stop : "no word of its end")],
  ].filter(Boolean);
  const body = el("tbody");
  const more = el("button", { type: "button", className: "button", onclick: () => ((shown += 200), fill()) });
  function fill() {
    body.replaceChildren(...runs.slice(0, shown).map((run) => el("tr", {}, columns.map(([, text, number]) => el("td", { className: number ? "number" : "" }, text(run))))));
    more.hidden = shown >= runs.length;
    more.textContent = `Show more of ${counted(runs.length, "run")}`;
  }
  fill();
  return section("origin", "Where this comes from", null, plans,
    runs.length > 0 && [el("h3", {}, "Runs, the newest first"), el("div", { className: "wide-table", tabIndex: 0, role: "region", "aria-label": "Runs" }, el("table", { className: "runs" }, el("thead", {}, el("tr", {}, columns.map(([title, , number]) => el("th", { scope: "col", className: number ? "number" : "" }, title)))), body)), el("p", { className: "controls" }, more)]);
}
