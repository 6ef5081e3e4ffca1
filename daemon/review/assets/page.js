// Shows a run from the data in the page. Nothing is fetched.
"use strict";
(async () => {
const data = JSON.parse(by("data").textContent), details = await unpacked(data.details);
for (const cycle of data.cycles) Object.assign(cycle, details.cycles[cycle.n] || { stops: [], decisions: [], bare: true });
let pictures = null;                                  // parsed when the first look is opened
const offset = data.utc_offset_s, zone = known(offset) ? "the cell's time" : "UTC";
const done = data.production, failed = done.tried - done.picked - done.released;
theme();

// ---- head: what was wrong with the night, in a sentence
const stops = Object.entries(done.stops);
const worst = data.strips.filter((s) => s.near === 2).map((s) => s.name);
by("verdict").append(...[
  done.tried ? `${done.picked} of ${done.tried} picked` : "Nothing was tried", notTried(done),
  stoppedBy(stops),
  worst.length ? `. Beyond the limit: ${worst.join(", ")}` : ""].filter(Boolean), ".");
by("verdict").className = failed ? "bad" : worst.length ? "" : "good";
const cell = data.cell;
const simulated_ = (c) => (known(c.times_life) && c.times_life !== 1 ? `simulated, ${atPace(c.times_life)}` : "simulated");
by("summary").append(...[
  cell.kind === "simulated" ? el("b", { class: "tag" }, simulated_(cell)) : cell.kind === "recorded" ? el("b", { class: "tag" }, "recorded pictures") : null,
  cell.name ? el("b", {}, `${cell.name} `) : null, `run ${data.run}, `,
  data.started ? el("time", { title: `${data.started.slice(0, 19).replace("T", " ")} UTC` }, `${dayAndTime(data.started, offset)} (${zone})`) : null,
  `, ${duration(data.seconds)}, `,
  data.going ? el("b", { class: "tag on" }, "still going") : data.end ? `ended: ${data.end}` : el("b", { class: "tag off" }, "cut off: killed, or the power failed"),
  el("br"), [cell.version ? `facetd ${cell.version}` : null, `model ${data.models.join(", then ") || "none"}`,
    data.kept.calibration ? `calibration ${data.kept.calibration}` : null, data.kept.config ? `configuration ${data.kept.config}` : null].filter(Boolean).join(" · "),
].filter(Boolean));
const warnings = [...data.skipped];
if (data.cycles_left_out) warnings.push(`${plural(data.cycles_left_out, "earlier cycle")} not in this page: facetctl export --csv ${data.run} lists them all (figures and measures are of all)`);
if (data.details_left_out) warnings.push(`${plural(data.details_left_out, "cycle")} here without looks, so that the page stays small: facetctl review ${data.run} --cycle N shows one`);
if (data.events_left_out) warnings.push(`${plural(data.events_left_out, "earlier event")} not in this page`);
if (data.pictures_left_out) warnings.push(`${plural(data.pictures_left_out, "picture")} not in this page (they are in the run folder)`);
if (data.against && data.against.paces.length > 1) warnings.push(`The two runs had different paces (${data.against.paces.map(atPace).join(", ")}): their times cannot be compared.`);
by("warnings").append(...warnings.map((w) => el("p", { class: "warn" }, w)));

// ---- tiles: each with the last run's and the last week's beside it
const { last, week } = data.before;
const beside = (of) => [last ? `last run ${of(last)}` : null, week ? `week ${of(week)}` : null].filter(Boolean).join(" · ");
const tile = (name, value, under, kind = "", title = null) => el("div", { class: `tile ${kind}`, title }, el("span", {}, name), el("b", {}, value), under ? el("small", {}, under) : null);
const partOf = (p, label) => (p.parts[label] ? share(p.parts[label]) : "–");
by("tiles").append(
  tile("picked of tried", `${done.picked} of ${done.tried}`, [done.released ? `${done.released} released, not confirmed` : null, done.uncounted ? `${done.uncounted} more likely in the bin` : null,
    done.aborted ? `${done.aborted} ended by a person` : null, done.interrupted ? `${done.interrupted} interrupted` : null, beside((p) => share([p.picked, p.tried]))].filter(Boolean).join(" · "), failed ? "bad" : done.uncounted || done.released ? "warn" : "", data.definition),
  tile("picks per hour", number(done.hourly), paceOf(done) || beside((p) => number(p.hourly))),
  tile("cycle time, median", duration(done.median_s), paceOf(done) || [`95th percentile: ${duration(done.p95_s)}`, beside((p) => duration(p.median_s))].filter(Boolean).join(" · ")),
  tile("OEE", percent(done.oee), paceOf(done) || oeeOf(done.times), "", OEE),
  tile("interventions by people", done.interventions, beside((p) => `${p.interventions}${p.runs > 1 ? ` in ${p.runs} runs` : ""}`), done.interventions ? "warn" : ""),
  tile("unidentified parts", done.nameless, beside((p) => `${p.nameless}${p.runs > 1 ? ` in ${p.runs} runs` : ""}`), done.nameless ? "warn" : ""),
  tile("error at the grasp", known(done.grasp_mm) ? `${number(done.grasp_mm)} mm` : "–",
    ["predicted, median", known(done.true_mm) ? `true ${number(done.true_mm)} mm` : null].filter(Boolean).join(" · ")),
  el("div", { class: "tile list" }, el("span", {}, "success by part"), ...Object.entries(done.parts).map(([label, [n, of]]) =>
    el("div", {}, el("i", { class: n < of ? "bad" : "good" }, `${n} of ${of}`), ` ${label} `, el("small", {}, beside((p) => partOf(p, label))))),
  Object.keys(done.parts).length ? null : el("b", {}, "–")),
  stoppedList(stops, data.remedies));
by("tiles").after(el("p", { class: "dim" }, data.definition));

// ---- the other run
if (data.against) {
  by("against").hidden = false;
  by("against-name").textContent = data.against.run;
  const shown = (row, value) => (Array.isArray(value) ? (value[1] ? `${value[0]} of ${value[1]}` : "–") : row.unit === "s" ? duration(value) : known(value) ? `${number(value)} ${row.unit}` : "–");
  const small = (row) => !Array.isArray(row.before) && Math.abs(row.delta) < Math.abs(row.before) / 100;
  const sign = (row) => (known(row.delta) ? small(row) ? "±0" : `${row.delta > 0 ? "+" : row.delta < 0 ? "−" : "±"}${number(Math.abs(row.delta))} ${row.unit}` : "");
  by("against-body").append(
    el("table", { class: "plain" }, el("thead", {}, el("tr", {}, ...["", data.against.run, "this run", "difference", ""].map((name) => el("th", {}, name)))),
      el("tbody", {}, ...data.against.rows.map((row) => el("tr", { class: row.matters }, el("td", {}, row.name),
        el("td", { class: "num" }, shown(row, row.before)), el("td", { class: "num" }, shown(row, row.now)), el("td", { class: "num delta" }, sign(row)),
        el("td", { class: "mark" }, row.matters ? (row.matters === "worse" ? "▼ worse" : "▲ better") : ""))))),
    el("p", { class: "dim" }, "Marked: a share that differs by more than two standard errors, or a time or error that differs by more than 10 %."),
    ...data.against.differences.filter((d) => !d.same && (d.before || d.after)).map((d) => el("details", { open: d.lines.length < 30 },
      el("summary", {}, `${d.name}: ${d.before || "–"} → ${d.after || "–"}`), d.lines.length ? el("pre", {}, d.lines.join("\n")) : null)));
}

// ---- the run on one axis: cycles, marks, and each measure with its limit
const WIDTH = 1000, all = Math.max(data.seconds, ...data.timeline.map((b) => b.to), 1), span = [0, all];
const width = () => span[1] - span[0], across = (s) => 100 * (s - span[0]) / width(), atS = (s) => (data.started ? new Date(Date.parse(data.started) + 1000 * s).toISOString() : null);
const placed = [];                                     // [element, from, to]: what stands at a time, moved when the time line is zoomed
const standing = (node, from, to = null) => { placed.push([node, from, to]); return node; };
const bars = el("div", { id: "timeline", role: "img", "aria-label": "cycles over time" }, ...data.timeline.map((bar) => standing(el("i", {
  class: bar.outcome.replace(" ", "-"), "data-cycle": bar.n, title: `cycle ${bar.n}: ${bar.label || "?"} ${bar.outcome}`, onclick: () => open(bar.n) }), bar.from, bar.to)));
const marks = el("div", { class: "marks" }, ...data.events.filter((e) => e.kind !== "run_end").map((e) => standing(el("i", { class: e.kind, title: `${clock(e.t, offset)} ${e.text}`,
  onclick: () => e.cycle !== null && open(e.cycle) }), e.s)));
const began = new Map(data.timeline.map((b) => [b.n, b.from]));
const looks = data.cycles.flatMap((c) => c.stops.map((stop, k) => ({ n: c.n, k, stop, s: began.get(c.n) + (Date.parse(stop.t) - Date.parse(c.t)) / 1000 })));
const lookMarks = el("div", { class: "marks looks" }, ...looks.map(({ n, k, stop, s }) => standing(el("i", { title: `${clock(stop.t, offset)} cycle ${n}: ${stop.purpose}`,
  onclick: () => open(n, k) }), s)));
const cursor = el("div", { id: "cursor", hidden: true });
const ends = el("div", { class: "ends" });
const row = (name, track, value = "", kind = "") => el("div", { class: `strip ${kind}` }, el("div", { class: "name" }, name), el("div", { class: "track" }, track), el("div", { class: "value" }, value));
const within = (strip) => (known(strip.limit) ? `${strip.above ? "most" : "least"} ${number(strip.worst)}, limit ${number(strip.limit)} ${strip.unit}` : `most ${strip.unit === "s" ? duration(strip.worst) : `${number(strip.worst)} ${strip.unit}`}`);
function stripRow(strip) {
  const opened = strip.near > 0, kind = ["calm", "near", "beyond"][strip.near];
  const track = el("div"), made = row(strip.name, track, within(strip), `${kind}${opened ? " open" : ""}`);
  const draw = () => {
    const height = made.classList.contains("open") ? 64 : 12, layer = svg("svg", { viewBox: `0 0 ${WIDTH} ${height}`, preserveAspectRatio: "none", height });
    const values = Object.values(strip.lines).flat().filter(known), top = Math.max(...values, strip.limit || 0) * 1.05 || 1, low = Math.min(0, ...values);
    if (height > 12) {
      const y = height - height * ((strip.limit || 0) - low) / (top - low);
      if (known(strip.limit)) layer.append(svg("rect", { x: 0, width: WIDTH, y: strip.above ? 0 : y, height: strip.above ? y : height - y, class: "beyond" }), svg("line", { x1: 0, x2: WIDTH, y1: y, y2: y, class: "limit" }));
      Object.values(strip.lines).forEach((line, k) => {
        const drawn = curve(strip.s.map((s, i) => [s, line[i]]), span, [low, top], WIDTH, height, WIDTH / 15 * all / width());
        layer.append(svg("path", { d: drawn.path, class: `line c${k}` }));
      });
      const names = Object.keys(strip.lines).filter(Boolean);
      track.replaceChildren(layer, names.length > 1 ? el("div", { class: "legend" }, ...names.map((name, k) => el("span", { class: `c${k}` }, name))) : "");
    } else {
      layer.append(svg("line", { x1: 0, x2: WIDTH, y1: 6, y2: 6, class: "still" }));
      track.replaceChildren(layer);
    }
  };
  made.querySelector(".name").addEventListener("click", () => { made.classList.toggle("open"); draw(); });
  return Object.assign(made, { strip, draw });
}
const strips = [...data.strips].sort((a, b) => b.near - a.near).map(stripRow);
by("strips").append(row("cycles", bars), looks.length ? row("looks", lookMarks) : "", data.events.length ? row("faults, changes", marks) : "", ...strips, row("", ends), cursor);
function show(from, to) {                             // the time line from one moment to another, s
  const wide = Math.min(Math.max(to - from, 1), all), begin = Math.min(Math.max(from, 0), all - wide);
  span.splice(0, 2, begin, begin + wide);
  for (const [node, at, until] of placed) {
    node.hidden = (until ?? at) < span[0] || at > span[1];
    node.style.left = `${across(at)}%`;
    if (until !== null) node.style.width = `${across(until) - across(at)}%`;
  }
  ends.replaceChildren(...[0, 0.25, 0.5, 0.75, 1].map((part) => {
    const s = span[0] + width() * part, at = atS(s);
    return el("span", { style: `left:${100 * part}%` }, at ? clock(at, offset).slice(0, width() < 600 ? 8 : 5) : duration(s));
  }));
  for (const made of strips) made.draw();
  for (const name of ["zoom-out", "zoom-all"]) by(name).disabled = wide === all;
}
const zoom = (factor, part = 0.5) => show(span[0] + part * width() * (1 - factor), span[0] + part * width() * (1 - factor) + width() * factor);
by("zoom-in").addEventListener("click", () => zoom(0.5));
by("zoom-out").addEventListener("click", () => zoom(2));
by("zoom-all").addEventListener("click", () => show(0, all));
by("strips").addEventListener("wheel", (e) => {
  const track = bars.getBoundingClientRect(), part = (e.clientX - track.left) / track.width;
  if (part < 0 || part > 1 || !(e.ctrlKey || e.shiftKey)) return;
  e.preventDefault();
  const turn = e.deltaY || e.deltaX;
  if (e.ctrlKey) zoom(turn > 0 ? 1.25 : 0.8, part); else show(span[0] + Math.sign(turn) * width() / 10, span[1] + Math.sign(turn) * width() / 10);
}, { passive: false });
show(0, all);
const calm = data.strips.filter((s) => s.near === 0 && known(s.limit)).length;
by("night").append(el("p", { class: "dim" }, `${calm === data.strips.filter((s) => known(s.limit)).length ? "All measures are well within their limits. " : ""}Click the name of a measure to plot it.${Math.max(1, ...data.strips.map((s) => s.each)) > 1 ? " Of so many looks each point is the worst of several." : ""} Click a bar or a look to open it with its images. Zoom with Ctrl and the wheel, move with Shift and the wheel.`));
const atPointer = (e) => {                            // what was there at the moment under the pointer
  const track = bars.getBoundingClientRect(), part = (e.clientX - track.left) / track.width;
  if (part < 0 || part > 1) { cursor.hidden = true; return; }
  const s = span[0] + part * width(), cycle = data.timeline.find((b) => b.from <= s && s <= b.to);
  cursor.hidden = false;
  cursor.style.left = `${track.left - by("strips").getBoundingClientRect().left + part * track.width}px`;
  cursor.replaceChildren(el("span", {}, `${clock(atS(s), offset)}${cycle ? ` cycle ${cycle.n} ${cycle.label || ""} ${cycle.outcome}` : ""}`));
  for (const made of strips) {
    const { strip } = made, k = nearest(strip.s, s);
    const here = Object.entries(strip.lines).filter(([, line]) => known(line[k])).map(([name, line]) => `${name} ${number(line[k])}`.trim());
    made.querySelector(".value").textContent = here.length ? `${here.join(", ")} ${strip.unit}` : within(strip);
  }
  for (const [n, line] of rows) line.classList.toggle("under", Boolean(cycle) && n === cycle.n);
  for (const bar of bars.children) bar.classList.toggle("under", Boolean(cycle) && Number(bar.dataset.cycle) === cycle.n);
};
by("strips").addEventListener("pointermove", atPointer);
by("strips").addEventListener("pointerleave", () => { cursor.hidden = true; for (const made of strips) made.querySelector(".value").textContent = within(made.strip); });
function nearest(sorted, s) {
  let low = 0, high = sorted.length - 1;
  while (low < high) { const middle = (low + high) >> 1; if (sorted[middle] < s) low = middle + 1; else high = middle; }
  return low > 0 && s - sorted[low - 1] < sorted[low] - s ? low - 1 : low;
}

// ---- table
const simulated = data.cycles.some((c) => known(c.true_mm));
const oneCamera = data.cycles.some((c) => c.cameras && c.cameras !== "both");
const columns = [["n", "cycle"], ["t", "at"], ["label", "part"], ["outcome", "outcome"], ["looks", "looks"], ...(oneCamera ? [["cameras", "cameras"]] : []), ["s", "time"], ["mm", "predicted mm"],
  ...(simulated ? [["true_mm", "true mm"]] : []), ["cause", "why"]];
const NUMBERS = ["n", "looks", "s", "mm", "true_mm"];
let order = "n", ascending = true, wanted = "all", opened = null;
const rows = new Map();
for (const cycle of data.cycles) cycle.cause = cycle.causes.length ? cycle.causes[0].name : "";
by("table").tHead.append(el("tr", {}, ...columns.map(([key, name]) => el("th", { class: `k-${key}${NUMBERS.includes(key) ? " num" : ""}`,
  onclick: () => { ascending = order === key ? !ascending : true; order = key; fill(); } }, name))));
const digits = (value, count, unit = "") => (known(value) ? `${value.toFixed(count)}${unit}` : "–");  // a column's numbers end under each other
const content = { t: (c) => time(c.t, offset), s: (c) => (c.s < 60 ? digits(c.s, 1, " s") : duration(c.s)), mm: (c) => digits(c.mm, 2), true_mm: (c) => digits(c.true_mm, 2),
  cause: (c) => (c.cause ? el("span", {}, el("b", {}, c.cause), ` ${c.why || ""}`) : c.why || "") };
for (const cycle of data.cycles) {
  const cells = columns.map(([key]) => el("td", { class: `k-${key}${NUMBERS.includes(key) ? " num" : ""}${key === "outcome" ? ` o ${cycle.outcome.replace(" ", "-")}` : ""}` },
    content[key] ? content[key](cycle) : cycle[key] ?? "–"));
  rows.set(cycle.n, el("tr", { tabindex: 0, "data-cycle": cycle.n, onclick: () => open(cycle.n), onkeydown: (e) => { if (e.key === "Enter") open(cycle.n); } }, ...cells));
}
const text = new Map(data.cycles.map((c) => [c.n, [c.n, c.label, c.outcome, c.why, ...c.causes.map((k) => k.name + k.e + k.stage),
  ...c.decisions.map((d) => `${d.text} ${d.why}`)].join(" ").toLowerCase()]));
function fill() {
  const words = by("search").value.toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = data.cycles.filter((c) => (wanted === "all" || c.outcome === wanted) && words.every((w) => text.get(c.n).includes(w)));
  const value = (c) => (known(c[order]) ? c[order] : NUMBERS.includes(order) ? Infinity : "");
  chosen.sort((a, b) => { const x = value(a), y = value(b); return (x < y ? -1 : x > y ? 1 : 0) * (ascending ? 1 : -1); });
  by("table").tBodies[0].replaceChildren(...chosen.map((c) => rows.get(c.n)));
  by("count").textContent = `${chosen.length} of ${data.cycles.length}`;
}
by("search").addEventListener("input", fill);
const counts = new Map();
for (const c of data.cycles) counts.set(c.outcome, (counts.get(c.outcome) || 0) + 1);
filters(by("filters"), [...counts.keys()], (name) => `${name} ${counts.get(name)}`, (name) => { wanted = name; fill(); });
fill();

// ---- one cycle
function open(number_, look = null) {
  const cycle = data.cycles.find((c) => c.n === number_);
  if (!cycle) return;
  if (opened !== null && rows.get(opened)) rows.get(opened).classList.remove("open");
  opened = number_;
  rows.get(number_).classList.add("open");
  const place = by("cycle"), body = el("div", { id: "stop" });
  const buttons = cycle.stops.map((stop, k) => el("button", { type: "button", class: "stop-button", "data-stop": k, onclick: () => choose(k) },
    stop.estimate ? `look ${stop.n}` : stop.purpose));
  let at = 0;
  const choose = (k) => {
    if (k < 0 || k >= cycle.stops.length) return;
    at = k;
    buttons.forEach((b, i) => b.setAttribute("aria-pressed", i === k));
    body.replaceChildren(lookView(cycle.stops[k]));
  };
  const step = (by_) => () => choose(at + by_);
  place.hidden = false;
  place.replaceChildren(...[
    el("h2", {}, `Cycle ${cycle.n}: ${cycle.label || "no part"} `, el("span", { class: `o ${cycle.outcome.replace(" ", "-")}` }, cycle.outcome)),
    el("p", { class: "dim" }, time(cycle.t, offset), `, ${duration(cycle.s)}, ${plural(cycle.looks, "look")} at the part${cycle.cameras && cycle.cameras !== "both" ? ` (cameras: ${cycle.cameras})` : ""}. ${cycle.why || ""}`),
    ...cycle.causes.map((c, k) => el("div", { class: `cause${k ? " less" : ""}` }, el("b", {}, c.name), k ? " (perhaps)" : "", `: ${c.e}`, el("br"), el("small", {}, c.r))),
    cycle.bare ? null : el("div", { class: "stops" }, el("button", { type: "button", id: "previous", onclick: step(-1) }, "‹"), ...buttons,
      el("button", { type: "button", id: "next", onclick: step(1) }, "next ›")), body,
    el("p", { class: "dim" }, cycle.bare ? "Its looks and decisions are not in this page. " : "", "Arm and parts in 3-D, joints, tool and speed over time: ", el("code", {}, `facetctl review ${data.run} --cycle ${cycle.n}`)),
    cycle.decisions.length ? el("details", { open: cycle.decisions.length < 8 }, el("summary", {}, plural(cycle.decisions.length, "decision")), el("ul", {}, ...cycle.decisions.map((d) => el("li", {}, el("b", {}, d.text), ` — ${d.why || ""}`)))) : null].filter(Boolean));
  if (cycle.stops.length) choose(look ?? telling(cycle));
  place.scrollIntoView({ behavior: "auto", block: "start" });
}
// The look to begin with: where the first cause shows; of a good pick the last estimate.
function telling(cycle) {
  const at = cycle.causes.length ? cycle.causes[0].at : 0, before = cycle.stops.filter((s) => s.seq <= at).length - 1;
  const estimated = cycle.stops.map((s, k) => [s.estimate, k]).filter(([e]) => e).map(([, k]) => k);
  return before >= 0 ? before : estimated.length ? estimated[0] : 0;
}
document.addEventListener("keydown", (e) => {
  if (e.target.tagName === "INPUT" || opened === null) return;
  if (e.key === "ArrowRight") by("next")?.click();
  if (e.key === "ArrowLeft") by("previous")?.click();
});

function lookView(stop) {
  pictures = pictures || JSON.parse(by("pictures").textContent);
  const info = el("dl");
  const add = (name, value) => { if (known(value) && value !== "") info.append(el("dt", {}, name), el("dd", {}, value)); };
  if (stop.estimate) {
    add("estimate", `${stop.estimate.label} at ${stop.estimate.at.map((x) => number(x)).join(", ")} mm, ±${number(stop.estimate.mm)} mm ±${number(stop.estimate.deg)}° at the grasp`);
    add("agreement", `chi-square ${number(stop.estimate.chi2)} against the looks before (limit 22.5)`);
  }
  for (const p of stop.parts) {
    add(p.label, [known(p.conf) ? `confidence ${share([p.conf, 1])}` : null, known(p.ratio) ? `match ratio ${number(p.ratio)}` : null, p.runner ? `runner-up ${p.runner}` : null,
      known(p.res) ? `residual ${number(p.res)} mm` : null, p.why].filter(Boolean).join(", "));
  }
  for (const g of stop.guesses) add("nearest", `${g.label}: ${Math.round(100 * g.share)} % of its edges show (solid lines); the others do not (dashed)`);
  const findings = Object.values(stop.health.findings || {});
  for (const f of findings) add("picture", typeof f === "string" ? f : f.advice || f.text);
  const measures = Object.entries(stop.health).filter(([, v]) => typeof v === "number").map(([k, v]) => `${k.replaceAll("_", " ")} ${number(v)}`).join(", ");
  return el("div", {}, stereoView(stop, (camera) => pictures[`${stop.seq}-${camera}`]), info,
    stop.moves.length ? el("div", {}, el("h3", {}, "What followed"), el("ul", {}, ...stop.moves.map((m) => el("li", { class: m.kind === "refusal" ? "warn" : null }, m.text)))) : null,
    stop.notes.length ? el("details", {}, el("summary", {}, plural(stop.notes.length, "note")), el("ul", {}, ...stop.notes.map((n) => el("li", {}, n)))) : null,
    stop.rejected.length ? el("details", {}, el("summary", {}, `${plural(stop.rejected.length, "rejected outline")}`),
      el("ul", {}, ...stop.rejected.map((r) => el("li", {}, `${r.camera}: ${r.why}`)))) : null,
    el("details", {}, el("summary", {}, "measures and times"), el("p", { class: "dim" }, measures), el("p", { class: "dim" }, Object.entries(stop.seconds).map(([k, v]) => `${k.replaceAll("_", " ")} ${Math.round(1000 * v)} ms`).join(", "))));
}

// ---- places: as they were last, how exactly parts came there, and each set-down with its pictures
if (data.places.last.length) {
  const every = new Map(data.cycles.flatMap((c) => c.stops.map((s) => [s.seq, s])));
  const picture = (seq, name) => {
    if (!known(seq) || !every.has(seq)) return el("div", { class: "camera" }, el("div", { class: "none" }, `${name}: no look`));
    pictures = pictures || JSON.parse(by("pictures").textContent);
    return el("div", {}, cameraView(every.get(seq), "left", "l", pictures[`${seq}-left`]), el("small", {}, name));
  };
  const bar = (value, limit, unit) => el("div", { class: "deviation" }, el("span", {}, known(value) ? `${number(value)} of ${number(limit)} ${unit}` : `not seen, ${unit}`),
    el("i", { class: known(value) && value <= limit ? "good" : "bad", style: `width:${known(value) ? Math.min(100, 100 * value / limit) : 0}%` }));
  const card = (m) => el("figure", { class: "set-down" },
    el("figcaption", {}, `${m.place}: ${m.label} `, el("span", { class: `o ${m.status === "seen right" ? "picked" : m.status === "set" ? "" : "missed"}` }, m.status), " ", el("a", { href: "#cycle", onclick: () => open(m.cycle) }, `cycle ${m.cycle}`)),
    el("div", { class: "pair" }, picture(m.before, "before: in the gripper"), picture(m.after, "after: at its place")),
    bar(m.off_mm, m.tolerance_mm, "mm"), bar(m.off_deg, m.tolerance_deg, "degrees"), m.status === "seen right" ? null : el("p", { class: "warn" }, m.why));
  const cards = el("div", { class: "set-downs" }), made = data.places.made.slice().reverse();
  const more = (count) => { cards.append(...made.splice(0, count).map(card)); rest.hidden = !made.length; rest.textContent = `show ${plural(made.length, "earlier set-down")}`; };
  const rest = el("button", { type: "button", onclick: () => more(24) });
  by("places").hidden = false;
  by("places-body").append(el("div", { class: "charts drawing-and-table" }, ...[placesDrawing(data.places.last), placingTable(data.places.figures)].filter(Boolean)), cards, rest);
  more(12);
}

// ---- events, other looks
const WARNED = ["fault", "refusal", "gap", "uncounted"];
const eventRows = data.events.map((e) => el("tr", {},
  el("td", {}, time(e.t, offset)), el("td", {}, e.cycle === null ? "" : el("a", { href: "#cycle", onclick: () => open(e.cycle) }, `cycle ${e.cycle}`)),
  el("td", { class: WARNED.includes(e.kind) ? "o" : null }, e.what),
  el("td", { class: "k-cause" }, el("b", {}, e.text), e.after && ["fault", "refusal"].includes(e.kind) ? ` after: ${e.after}` : null),
  el("td", {}, e.kind !== "fault" ? "" : e.cleared ? `${e.cleared.by || "somebody"}, after ${duration(e.cleared.s)}` : "not cleared")));
const whats = [...new Set(data.events.map((e) => e.what))];
const showEvents = (what) => by("event-table").tBodies[0].replaceChildren(...eventRows.filter((_, k) => what === "all" || data.events[k].what === what));
if (data.events.length) {
  filters(by("event-filters"), whats, (what) => `${what} ${data.events.filter((e) => e.what === what).length}`, showEvents);
  by("event-table").tHead.append(el("tr", {}, ...["at", "cycle", "kind", "what happened", "cleared by"].map((name) => el("th", {}, name))));
  showEvents("all");
} else by("events").append(el("p", { class: "dim" }, "none"));
const inAll = (parts) => {
  const count = {};
  for (const p of parts) count[p.label] = (count[p.label] || 0) + 1;
  const named = ([label, n]) => (label !== "unknown" ? (n > 1 ? `${n} × ${label}` : label) : n > 1 ? `${n} unidentified parts` : "an unidentified part");
  return Object.entries(count).map(named).join(", ") || "nothing seen";
};
by("other-list").append(...details.outside.map((stop) => {
  const box = el("details", {}, el("summary", {}, time(stop.t, offset), ` ${stop.purpose}: ${stop.pictures_only ? "pictures only" : inAll(stop.parts)}`));
  box.addEventListener("toggle", () => { if (box.open && box.children.length === 1) box.append(lookView(stop)); });
  return box;
}));
if (!details.outside.length) by("other-list").append(el("p", { class: "dim" }, "none"));

// ---- plots
const approached = data.cycles.map((c) => c.mms).filter((mms) => mms.length);
const most = Math.max(0, ...approached.map((c) => c.length)), limit = (data.strips.find((s) => s.name === "error at the grasp") || {}).limit;
const atLook = Array.from({ length: most }, (_, i) => approached.filter((c) => c.length > i).map((c) => c[i]).sort((a, b) => a - b));
const quantile = (sorted, q) => sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];
by("plot-list").append(...[
  downtime(done.times),
  chart("Predicted error at the grasp, look by look", [
    { name: "median", points: atLook.map((v, i) => [i + 1, quantile(v, 0.5), `of ${v.length} picks`]) },
    { name: "95 %", points: atLook.map((v, i) => [i + 1, quantile(v, 0.95), `of ${v.length} picks`]) },
  ], { x: "look at the part", y: "mm", limit, xs: atLook.map((_, i) => i + 1) }),
  Object.keys(data.states).length ? el("figure", { class: "chart" }, el("figcaption", {}, "Median time in each state of a pick"),
    el("div", { class: "states" }, ...Object.entries(data.states).filter(([, s]) => s > 0).map(([name, s]) => el("div", {}, el("span", {}, name.replaceAll("_", " ")),
      el("i", { style: `width:${60 * s / Math.max(...Object.values(data.states))}%` }), el("b", {}, duration(s)))))) : null,
].filter(Boolean));
if (!by("plot-list").children.length) by("plot-list").append(el("p", { class: "dim" }, "No part was approached."));
document.documentElement.dataset.ready = "yes";
})();
