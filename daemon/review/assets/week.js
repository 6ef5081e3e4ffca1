// Shows a week of runs from the data in the page. Nothing is fetched.
"use strict";
(() => {
const data = JSON.parse(by("data").textContent), runs = data.runs, done = data.production, offset = data.utc_offset_s;
const stops = Object.entries(done.stops);
theme();
by("verdict").textContent = runs.length ? `${done.picked} of ${done.tried} picked${notTried(done)} in ${plural(runs.length, "run")}${stoppedBy(stops)}.` : "No pick was tried in this week.";
by("summary").append(...[data.cell.kind === "simulated" ? el("b", { class: "tag" }, "simulated") : null, data.cell.name ? el("b", {}, `${data.cell.name} `) : null,
  runs.length ? `${dayAndTime(runs[0].t, offset)} to ${dayAndTime(runs[runs.length - 1].t, offset)} (${known(offset) ? "the cell's time" : "UTC"})` : ""].filter(Boolean));
const tile = (name, value, under) => el("div", { class: "tile" }, el("span", {}, name), el("b", {}, value), under ? el("small", {}, under) : null);
by("tiles").append(
  tile("success", share([done.picked, done.tried]), `${done.picked} of ${done.tried}`), tile("cycle time, median", duration(done.median_s), paceOf(done) || `95th percentile: ${duration(done.p95_s)}`),
  tile("OEE", percent(done.oee), paceOf(done) || oeeOf(done.times)), tile("interventions by people", done.interventions), tile("unidentified parts", done.nameless),
  el("div", { class: "tile list" }, el("span", {}, "success by part"), ...Object.entries(done.parts).map(([label, of]) => el("div", {}, el("i", { class: of[0] < of[1] ? "bad" : "good" }, share(of)), ` ${label} `, el("small", {}, `${of[0]} of ${of[1]}`)))),
  stoppedList(stops, data.remedies));
by("tiles").after(el("p", { class: "dim" }, data.definition));

const day = (t) => Date.parse(t) / 86400000 + (offset || 0) / 86400;
const at = runs.map((r) => day(r.t));
const days = [...new Set(at.map((d) => Math.floor(d)))].sort((a, b) => a - b).map((d) => Math.max(d, Math.min(...at)));
const open = (i) => { window.location.href = runs[i].link; };
const trend = (title, y, lines, limit, fit) => chart(title, lines.map(([name, of]) => ({ name, points: runs.map((r, i) => [at[i], of(r), dayAndTime(r.t, offset)]) })),
  { x: "day", y, limit, fit, on: open, xs: days, xName: (d) => new Date(Math.floor(d) * 86400000).toISOString().slice(5, 10) });
const success = (of) => (of && of[1] ? 100 * of[0] / of[1] : null);
const labels = Object.keys(done.parts);
by("trends").append(...[
  downtime(done.times),
  trend("OEE", "%", [["", (r) => (known(r.production.oee) ? 100 * r.production.oee : null)]], null, [0, 100]),
  trend("Success", "% of tried", [["all", (r) => success([r.production.picked, r.production.tried])]], null, [0, 100]),
  trend("Success by part", "% of tried", labels.map((label) => [label, (r) => success(r.production.parts[label])]), null, [0, 100]),
  trend("Predicted error at the grasp, median", "mm", [["predicted", (r) => r.production.grasp_mm], ["true (simulated)", (r) => r.production.true_mm]].filter(([, of]) => runs.some((r) => known(of(r))))),
  trend("Cycle time", "s", [["median", (r) => r.production.median_s], ["95th percentile", (r) => r.production.p95_s]]),
  trend("Stereo rotation drift", "degrees", ["pitch", "roll", "vergence"].map((axis) => [axis, (r) => r.drift[axis]]), data.stop_deg),
  trend("Epipolar error, median", "px", [["", (r) => r.epipolar_px]], 0.6),
  trend("Brightness, 99th percentile, median", "grey levels", ["left", "right"].map((camera) => [camera, (r) => r.light[camera]])),
  trend("Edge width (focus), median", "px", ["left", "right"].map((camera) => [camera, (r) => r.focus_px[camera]]), 1.5),
].filter(Boolean));

if (data.placing.length) {
  by("placing").hidden = false;
  by("placing-body").append(placingTable(data.placing));
}

const columns = ["run", "picked", "per hour", "cycle time", "error mm", "causes of stops", "model"];
by("table").tHead.append(el("tr", {}, ...columns.map((name) => el("th", {}, name))));
by("table").tBodies[0].append(...runs.map((r) => el("tr", { onclick: () => { window.location.href = r.link; } },
  el("td", {}, el("a", { href: r.link }, dayAndTime(r.t, offset))), el("td", {}, `${r.production.picked} of ${r.production.tried}`), el("td", { class: "num", "data-name": "per hour" }, number(r.production.hourly)),
  el("td", { class: "num", "data-name": "cycle time" }, duration(r.production.median_s)), el("td", { class: "num", "data-name": "error mm" }, number(r.production.grasp_mm)),
  el("td", { class: "k-cause" }, Object.entries(r.production.stops).map(([name, n]) => `${n} ${name}`).join(", ") || "none"), el("td", {}, r.models.join(", then ")))));
document.documentElement.dataset.ready = "yes";
})();
