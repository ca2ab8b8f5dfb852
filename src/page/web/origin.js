// Where this comes from: the file, the options, the program, and the libraries with their licences.

function origin({ model }) {
  const pairs = [
    ["File", model.source_name],
    ["SHA-256", model.source_sha256],
    ...(model.followed ? model.followed.files : []),
    ["Program", `mocap-repair ${model.version}`],
    ["Method", model.method],
    ["Seed", model.seed],
  ].filter(([, value]) => value);
  const list = (entries) => el("dl", { className: "facts-list" }, entries.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
  const options = Object.entries(model.options).map(([name, value]) => [name.replaceAll("_", " "), value]);
  return section("origin", "Where this comes from", null,
    list(pairs),
    options.length > 0 && [el("h3", {}, "Options"), el("div", { className: "options" }, list(options))],
    el("h3", {}, "Libraries in this page"),
    el("ul", { className: "libraries" }, model.libraries.map((library) =>
      el("li", {}, el("details", {}, el("summary", {}, `${library.name} ${library.version}, ${library.licence} licence, for ${library.what} (${library.home})`), el("pre", {}, library.text))))));
}
