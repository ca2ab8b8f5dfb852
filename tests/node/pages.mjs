// Makes the pages that are looked at, with the program itself.

import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";

/** Names that would do harm if any of them became markup or code. */
export const HOSTILE = ["</script><script>document.title='owned'</script>", "<img src=x onerror=document.title='owned'>", "<!--", "a\u2028b'\"`${1}", "{{scripts}}"];

function run(program, ...words) {
  try {
    execFileSync(program, words, { stdio: ["ignore", "pipe", "inherit"] });
  } catch (error) {
    // 3: the output is there, and somebody should look at it
    if (error.status !== 3) throw error;
  }
}

/** Path and size of each page, by name. */
export function makePages(program, folder) {
  mkdirSync(folder, { recursive: true });
  if (readdirSync(folder).length > 0) throw new Error(`${folder} is not empty: name a new folder`);
  const at = (name) => join(folder, name);
  run(program, "demo", "-o", folder);
  const repair = (name, input, ...options) => run(program, at(input), "-o", at(`${name}-repaired.csv`), "--report", at(`${name}.html`), ...options);
  repair("walk", "walk-gaps.c3d");
  repair("complete", "walk-truth.c3d");
  // 80 % missing, most of it filled, some left open
  const occluded = ["L*:20-330", "R*:300-690", "*:400-420", "*FIN:1-500", "C7:100-880", "*HD:100-180"].flatMap((what) => ["--missing", what]);
  repair("occluded", "walk-gaps.c3d", "--method", "lds", "--iterations", "12", "--max-gap", "380", ...occluded);
  repair("single", "walk-truth.c3d", "--method", "spline", "--missing", "LKNE:300-420");
  const lines = readFileSync(at("walk-gaps.csv"), "utf8").split("\n");
  const markers = ["LKNE", "LTHI", "RTOE", "LWRB", "RFWT"];
  markers.forEach((marker, k) => {
    lines[0] = lines[0].replaceAll(new RegExp(`${marker}-([xyz]) \\(mm\\)`, "g"), (_, axis) => `"${HOSTILE[k].replaceAll('"', '""')}-${axis} (mm)"`);
  });
  // a spike and an excursion, and a label of wide letters
  const spiked = readFileSync(at("walk-truth.csv"), "utf8").split("\n");
  const column = spiked[0].split(",").findIndex((name) => name.startsWith("LKNE-x"));
  [500, ...Array.from({ length: 12 }, (_, k) => 700 + k)].forEach((row) => {
    const cells = spiked[row].split(",");
    cells[column] = String(Number(cells[column]) + 180);
    spiked[row] = cells.join(",");
  });
  spiked[0] = spiked[0].replaceAll("RKNE-", "WMWMWMWM-");
  writeFileSync(at("spiked.csv"), spiked.join("\n"));
  repair("spiked", "spiked.csv", "--method", "linear", "--rate", "120", "--units", "mm", "--missing", "WMWMWMWM:100-140");
  const hostile = "<img src=x onerror=document.title='owned'>.csv";
  writeFileSync(at(hostile), lines.join("\n"));
  repair("hostile", hostile, "--method", "spline", "--rate", "120", "--units", "mm");
  // a body in clouds, two of which are not there
  run(program, "demo", "--kind", "body", "-o", at("body"), "--frames", "60");
  for (const frame of [20, 21]) rmSync(at(`body/clouds/frame_0${frame}.off`));
  const rig = ["skl", "off", "vj"].flatMap((kind) => [`--${kind}`, at(`body/body.${kind}`)]);
  run(program, "track", at("body/clouds/frame_%03d.off"), ...rig, "-o", at("body.bvh"), "--no-log", "--report", at("body.html"));
  return Object.fromEntries(["walk", "complete", "occluded", "single", "spiked", "hostile", "body"].map((name) => [name, { path: at(`${name}.html`), bytes: statSync(at(`${name}.html`)).size }]));
}
