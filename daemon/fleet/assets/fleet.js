// Shows all cells of a fleet from the data in the page. Nothing is fetched.
"use strict";
(() => {
const data = JSON.parse(by("data").textContent), cells = data.cells, days = data.days;
theme();
const well = cells.filter((c) => c.state === "well").length, ill = cells.filter((c) => c.state !== "well");
const sum = (of) => of.reduce((a, b) => a + b, 0);
const all = [sum(cells.map((c) => c.picked)), sum(cells.map((c) => c.tried))];
const percent = ([part, of]) => (of ? `${(100 * part / of).toFixed(1)} %` : "–");
const rate = ([part, of]) => (of ? 100 * part / of : null);
const thousands = (n) => n.toLocaleString("en").replaceAll(",", "\u202f");
const kindOf = (c) => c.state.replaceAll(" ", "-");
const placing = sum(cells.flatMap((c) => c.placed)) > 0, inAll = [0, 1, 2].map((k) => sum(cells.map((c) => c.placed[k])));
const placed = (list) => (sum(list) ? list.map(thousands).join(" / ") : "");
const lasts = (list) => [...list].reverse().find(known);

by("verdict").textContent = ill.length ? `${ill.length} of ${plural(cells.length, "cell")} ${ill.length === 1 ? "needs" : "need"} attention` : cells.length === 1 ? "The one cell is in order" : `All ${plural(cells.length, "cell")} are in order`;
by("verdict").className = ill.some((c) => c.state === "misses" || c.state === "faults") ? "bad" : ill.length ? "" : "good";
by("summary").append(...[data.simulated ? el("b", { class: "tag" }, "simulated") : null, `${days[0]} to ${days[days.length - 1]} (UTC)`].filter(Boolean));
by("ill").append(...ill.flatMap((c) => [el("button", { type: "button", onclick: () => open(c) }, c.name), el("span", { class: `state ${kindOf(c)}` }, c.state),
  el("span", {}, c.findings.map(([, text]) => text).join("; "))]));

const tile = (name, value, under, kind) => el("div", { class: `tile ${kind || ""}` }, el("span", {}, name), el("b", {}, value), under ? el("small", {}, under) : null);
const count = (state) => cells.filter((c) => c.findings.some(([kind]) => kind === state)).length;
const bars = (name, entries) => el("div", { class: "tile list" }, el("span", {}, name), ...(entries.length ? entries : [el("b", {}, "nothing")]));
by("tiles").append(
  tile("picked", percent(all), `${thousands(all[0])} of ${thousands(all[1])}`), tile("cells that miss parts", count("misses"), "significantly more than the others", count("misses") ? "bad" : ""),
  tile("cameras that drift", count("drifts"), `by ${number(data.limits.near * data.limits.drift)}° and more`, count("drifts") ? "warn" : ""), tile("cells that are too dark", count("dark"), `near ${number(data.limits.light)} grey levels`, count("dark") ? "warn" : ""),
  tile("cells with faults", count("faults"), `${plural(sum(cells.map((c) => sum(Object.values(c.faults)))), "fault")} in all`, count("faults") ? "bad" : ""), tile("interventions by people", thousands(sum(cells.map((c) => c.interventions)))),
  ...(placing ? [tile("seen right at their places", percent([inAll[0], sum(inAll)]), `${thousands(inAll[1])} off, ${thousands(inAll[2])} lost, of ${thousands(sum(inAll))} set down`, inAll[1] + inAll[2] ? "warn" : "")] : []),
  bars("success by part", Object.entries(data.parts).map(([label, of]) => el("div", {}, el("i", { class: rate(of) < 99 ? "bad" : "good" }, percent(of)), ` ${label.replaceAll("_", " ")} `, el("small", {}, `${thousands(of[0])} of ${thousands(of[1])}`)))),
  bars("causes of stops", Object.entries(data.causes).slice(0, 6).map(([name, n]) => el("div", {}, el("i", { class: "bad" }, thousands(n)), ` ${name}`))));

by("tiles").after(el("p", { class: "dim" }, data.definition));

// ---- the cells: a card each, its days as a line on one scale for all
const rates = cells.flatMap((c) => c.success.map(rate)).filter(known), low = Math.min(98, ...rates);
by("cells").append(...cells.map((c) => {
  const layer = svg("svg", { viewBox: "0 0 100 26", preserveAspectRatio: "none" });
  layer.append(svg("path", { d: curve(c.success.map((of, k) => [k, rate(of)]), [0, Math.max(days.length - 1, 1)], [low, 100], 100, 26).path }));
  return el("button", { type: "button", class: `cell ${kindOf(c)}`, "data-cell": c.name, "aria-pressed": "false", onclick: () => open(c) },
    el("b", {}, el("span", {}, c.name), el("span", {}, percent([c.picked, c.tried]))), layer, el("small", {}, c.findings.length ? c.findings[0][1] : `${thousands(c.tried)} tried`));
}));

// ---- one cell
function open(c) {
  const one = by("one"), at = days.map((_, k) => k);
  const points = (list) => list.map((y, k) => [k, y, days[k]]);
  const own = (title, y, series, limit, fit) => chart(title, series.map(([name, list]) => ({ name, points: points(list) })), { x: "day", y, limit, fit, xs: at, xName: (k) => days[k].slice(5) });
  one.replaceChildren(el("h2", {}, `${c.name} `, el("span", { class: `state ${kindOf(c)}` }, c.state)),
    ...(c.findings.length ? c.findings.map(([kind, text]) => el("div", { class: `cause ${kind === "misses" || kind === "faults" ? "" : "less"}` }, `${kind}: ${text}`)) : [el("p", {}, "No significant difference to the other cells, and no measure near its limit.")]),
    el("dl", {}, ...[["picked", `${thousands(c.picked)} of ${thousands(c.tried)}, ${percent([c.picked, c.tried])}${c.before[1] ? `; ${percent(c.before)} in the four weeks before` : ""}`],
      ["parts", Object.entries(c.parts).map(([label, of]) => `${label.replaceAll("_", " ")} ${percent(of)}`).join(", ")], ...(sum(c.placed) ? [["set down", `${thousands(c.placed[0])} seen right, ${thousands(c.placed[1])} off, ${thousands(c.placed[2])} lost`]] : []), ["causes of stops", Object.entries(c.causes).map(([name, n]) => `${n} ${name}`).join(", ") || "nothing"],
      ["faults", Object.entries(c.faults).map(([name, n]) => `${n} ${name}`).join(", ") || "none"], ["time of a look", known(c.ms) ? `${number(c.ms)} ms` : "–"], ["last run until", `${c.last.slice(0, 16).replace("T", " ")}, facetd ${c.release || "–"}`]].flatMap(([name, text]) => [el("dt", {}, name), el("dd", {}, text)])),
    el("div", { class: "charts" }, ...[own("Success", "% of tried", [["", c.success.map(rate)]], null, [low, 100]), own("Stereo rotation against the calibration", "degrees", Object.entries(c.turn)),
      own("Brightness, 99th percentile", "grey levels", [["", c.light]], data.limits.light), own("Epipolar error", "px", [["", c.epipolar]], data.limits.epipolar),
      own("Predicted error at the grasp", "mm", [["", c.mm]]), own("Cycle time, median", "s", [["", c.seconds]])].filter(Boolean)));
  one.hidden = false;
  document.querySelectorAll("#cells .cell").forEach((card) => card.setAttribute("aria-pressed", String(card.dataset.cell === c.name)));
  history.replaceState(null, "", `#${encodeURIComponent(c.name)}`);  // a cell's own address, to be sent to somebody
  one.scrollIntoView({ block: "nearest" });
}

// ---- who misses what
const labels = Object.keys(data.parts), missed = (of) => (of && of[1] ? 100 * (1 - of[0] / of[1]) : null);
const worst = Math.max(3, ...cells.flatMap((c) => labels.map((label) => missed(c.parts[label]) || 0)));
const shade = (value) => (known(value) ? `background: color-mix(in srgb, var(--bad) ${Math.round(70 * Math.min(value / worst, 1))}%, transparent)` : "");
by("miss").tHead.append(el("tr", {}, el("th", {}, "cell"), el("th", {}, "all"), ...labels.map((label) => el("th", {}, label.replaceAll("_", " "))), ...(placing ? [el("th", {}, "set down: right / off / lost")] : [])));
by("miss").tBodies[0].append(...cells.map((c) => el("tr", { onclick: () => open(c) }, el("td", {}, c.name),
  ...[[missed([c.picked, c.tried]), false], ...labels.map((label) => [missed(c.parts[label]), c.weak.includes(label)])].map(([value, weak]) =>
    el("td", { class: weak ? "weak" : "", style: shade(value) }, known(value) ? value.toFixed(1) : "")), ...(placing ? [el("td", {}, placed(c.placed))] : []))));

// ---- all cells on one chart a measure: those that are well in grey, below
const shownFirst = [...cells].sort((a, b) => (a.state === "well" ? 0 : 1) - (b.state === "well" ? 0 : 1));
function trend(title, y, kinds, of, limit, fit) {
  const noted = cells.filter((c) => c.findings.some(([kind]) => kinds.includes(kind))).slice(0, 6);
  const series = shownFirst.map((c) => ({ name: noted.includes(c) ? c.name : "", colour: noted.includes(c) ? noted.indexOf(c) : "dim", points: of(c).map((value, k) => [k, value, `${c.name}, ${days[k]}`]), dotless: !noted.includes(c) }));
  series.sort((a, b) => (a.colour === "dim" ? 0 : 1) - (b.colour === "dim" ? 0 : 1));
  const made = chart(title, series, { x: "day", y, limit, fit, xs: days.map((_, k) => k), xName: (k) => days[k].slice(5) });
  if (made) made.querySelectorAll("circle").forEach((dot) => {
    const name = dot.querySelector("title").textContent.split(", ").slice(-2)[0], cell = cells.find((c) => c.name === name);
    if (cell) { dot.classList.add("leads"); dot.addEventListener("click", () => open(cell)); }
  });
  return made;
}
const turned = (c) => days.map((_, k) => { const off = Object.entries(c.turn).map(([axis, list]) => (known(list[k]) ? Math.abs(list[k] - (c.usual[axis] || 0)) : null)).filter(known); return off.length ? Math.max(...off) : null; });
by("trends").append(...[
  trend("Success", "% of tried", ["misses", "faults"], (c) => c.success.map(rate), null, [low, 100]),
  trend("Stereo rotation drift since calibration", "degrees", ["drifts"], turned, data.limits.drift),
  trend("Brightness, 99th percentile", "grey levels", ["dark"], (c) => c.light, data.limits.light),
  trend("Epipolar error", "px", ["drifts"], (c) => c.epipolar, data.limits.epipolar),
  trend("Predicted error at the grasp", "mm", ["misses"], (c) => c.mm), trend("Cycle time, median", "s", ["misses"], (c) => c.seconds),
].filter(Boolean));

by("models").tHead.append(el("tr", {}, ...["model", "since", "cells", "picked", "of tried", "error mm"].map((name) => el("th", {}, name))));
by("models").tBodies[0].append(...data.models.map((m) => el("tr", {}, ...[m.model || "none", m.since, m.cells, percent(m.picked), thousands(m.picked[1]), number(m.mm)].map((text) => el("td", {}, text)))));
by("causes").tHead.append(el("tr", {}, ...["cause", "times", "most at"].map((name) => el("th", {}, name))));
by("causes").tBodies[0].append(...Object.entries(data.causes).map(([name, n]) => {
  const most = cells.filter((c) => c.causes[name]).sort((a, b) => b.causes[name] - a.causes[name]).slice(0, 4);
  return el("tr", {}, el("td", { class: "remedy" }, name, el("br"), el("small", {}, data.remedies[name])), el("td", {}, thousands(n)), el("td", { class: "k-cause" }, ...most.flatMap((c, k) => [k ? ", " : "", el("b", {}, c.name), ` ${c.causes[name]}`])));
}));
if (!Object.keys(data.causes).length) by("causes").replaceWith("No pick failed.");
const asked = cells.find((c) => c.name === decodeURIComponent(window.location.hash.slice(1)));
if (asked) open(asked);
document.documentElement.dataset.ready = "yes";
})();
