// Shows a run from the data in the page. Nothing is fetched; texts go in as text, never as markup.
"use strict";
(() => {
const data = JSON.parse(document.getElementById("data").textContent);
let pictures = null;                                  // parsed when the first look is opened
const by = (id) => document.getElementById(id);
const el = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((c) => c !== null && c !== undefined).map((c) => (c instanceof Node ? c : String(c))));
  return node;
};
const svg = (tag, attributes = {}, text = null) => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text !== null) node.textContent = text;
  return node;
};
const show = (value, unit = "") => (value === null || value === undefined ? "–" : `${value}${unit}`);
const clock = (t) => (t ? t.slice(11, 19) : "–");

// ---- theme
const root = document.documentElement;
const setTheme = (name) => { root.dataset.theme = name; restylePlots(); };
by("theme").addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));

// ---- head
const stats = data.stats;
by("run").textContent = stats.run;
by("summary").textContent =
  `${stats.started ? stats.started.replace("T", " ").slice(0, 19) + " UTC" : ""}, ${stats.seconds} s, ` +
  `model ${show(stats.model)}, calibration ${show(stats.calibration)}, configuration ${show(stats.config)}` +
  `${data.end ? `, ended: ${data.end}` : ", without an end: the daemon was killed or the power failed"}`;
const warnings = [...data.skipped];
if (data.pictures_left_out) warnings.push(`${data.pictures_left_out} pictures are not in this page (they are in the run folder)`);
by("warnings").append(...warnings.map((w) => el("p", { class: "warn" }, w)));
const tiles = [["cycles", stats.cycles], ["picked", stats.picked], ["missed", stats.missed], ["faults", stats.faults],
  ["refusals", stats.refusals], ["looks a pick", show(stats.mean_looks)], ["s a pick", show(stats.mean_cycle_s)],
  ["mm predicted", show(stats.predicted_mm)], ["mm true", show(stats.true_mm)]];
by("tiles").append(...tiles.map(([name, value]) => el("div", { class: "tile" }, el("b", {}, value), el("span", {}, name))));

// ---- the other run
if (data.against) {
  by("against").hidden = false;
  const other = data.against.stats;
  by("against-name").textContent = other.run;
  const rows = ["cycles", "picked", "missed", "faults", "refusals", "mean_looks", "mean_cycle_s", "predicted_mm", "true_mm",
    "model", "calibration", "config"];
  by("against-body").append(
    el("table", {}, el("thead", {}, el("tr", {}, el("th"), el("th", {}, other.run), el("th", {}, stats.run))),
      el("tbody", {}, ...rows.map((name) => el("tr", {}, el("td", {}, name.replaceAll("_", " ")),
        el("td", { class: "num" }, show(other[name])), el("td", { class: "num" }, show(stats[name])))))),
    ...data.against.differences.filter((d) => !d.same).map((d) => el("details", { open: true },
      el("summary", {}, `${d.name}: ${show(d.before)} → ${show(d.after)}`), d.lines.length ? el("pre", {}, d.lines.join("\n")) : null)));
}

// ---- timeline
const span = Math.max(...data.timeline.map((b) => b.to), 1);
by("timeline").append(...data.timeline.map((bar) => el("i", {
  class: bar.outcome, title: `cycle ${bar.n}: ${show(bar.label)} ${bar.outcome}`, onclick: () => open(bar.n),
  style: `left:${100 * bar.from / span}%;width:${100 * (bar.to - bar.from) / span}%` })));

// ---- table
const columns = [["n", "cycle", true], ["t", "at", false], ["label", "part", false], ["outcome", "outcome", false],
  ["looks", "looks", true], ["s", "s", true], ["mm", "predicted mm", true], ["true_mm", "true mm", true], ["why", "why", false]];
let order = "n", ascending = true, wanted = "all", opened = null;
const rows = new Map();
by("table").tHead.append(el("tr", {}, ...columns.map(([key, name]) => el("th", {
  class: ["t", "true_mm"].includes(key) ? "hide" : null,
  onclick: () => { ascending = order === key ? !ascending : true; order = key; fill(); } }, name))));
for (const cycle of data.cycles) {
  const cells = columns.map(([key, , number]) => el("td", {
    class: [number ? "num" : "", key === "why" ? "why" : "", key === "outcome" ? `o ${cycle.outcome}` : "",
      ["t", "true_mm"].includes(key) ? "hide" : ""].join(" ") }, key === "t" ? clock(cycle.t) : show(cycle[key])));
  rows.set(cycle.n, el("tr", { tabindex: 0, "data-cycle": cycle.n, onclick: () => open(cycle.n),
    onkeydown: (e) => { if (e.key === "Enter") open(cycle.n); } }, ...cells));
}
const text = new Map(data.cycles.map((c) => [c.n, [c.n, c.label, c.outcome, c.why, ...c.causes.map((k) => k.e + k.stage),
  ...c.decisions.map((d) => `${d.text} ${d.why}`)].join(" ").toLowerCase()]));
function fill() {
  const words = by("search").value.toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = data.cycles.filter((c) => (wanted === "all" || c.outcome === wanted) && words.every((w) => text.get(c.n).includes(w)));
  const value = (c) => (c[order] === null || c[order] === undefined ? (typeof c.n === typeof c[order] ? Infinity : "") : c[order]);
  chosen.sort((a, b) => { const x = value(a), y = value(b); return (x < y ? -1 : x > y ? 1 : 0) * (ascending ? 1 : -1); });
  by("table").tBodies[0].replaceChildren(...chosen.map((c) => rows.get(c.n)));
  by("count").textContent = `${chosen.length} of ${data.cycles.length}`;
}
by("search").addEventListener("input", fill);
const outcomes = ["all", ...new Set(data.cycles.map((c) => c.outcome))];
by("filters").append(...outcomes.map((name) => el("button", { type: "button", "data-outcome": name, "aria-pressed": name === "all",
  onclick: (e) => { wanted = name; for (const b of by("filters").children) b.setAttribute("aria-pressed", b === e.currentTarget); fill(); } },
  name === "all" ? "all" : `${name} ${stats.outcomes[name] ?? ""}`)));
fill();

// ---- one cycle
function open(number) {
  const cycle = data.cycles.find((c) => c.n === number);
  if (!cycle) return;
  if (opened !== null && rows.get(opened)) rows.get(opened).classList.remove("open");
  opened = number;
  rows.get(number).classList.add("open");
  const place = by("cycle"), body = el("div", { id: "stop" });
  const buttons = cycle.stops.map((stop, k) => el("button", { type: "button", class: "stop-button", "data-stop": k,
    onclick: () => choose(k) }, `${stop.estimate ? `stop ${stop.n}` : stop.purpose}`));
  let at = 0;
  const choose = (k) => {
    if (k < 0 || k >= cycle.stops.length) return;
    at = k;
    buttons.forEach((b, i) => b.setAttribute("aria-pressed", i === k));
    body.replaceChildren(lookView(cycle.stops[k]));
  };
  const step = (by) => () => choose(at + by);
  place.hidden = false;
  place.replaceChildren(...[
    el("h2", {}, `Cycle ${cycle.n}: ${show(cycle.label)} `, el("span", { class: `o ${cycle.outcome}` }, cycle.outcome)),
    el("p", { class: "dim" }, `${clock(cycle.t)}, ${cycle.s} s, ${cycle.looks} looks at the part. ${show(cycle.why)}`),
    cycle.causes.length ? el("h3", {}, "Why, likeliest first") : null,
    ...cycle.causes.map((c) => el("div", { class: "cause" }, el("b", {}, `${c.stage}: `), c.e, el("br"), el("small", {}, c.r))),
    el("ul", {}, ...cycle.decisions.map((d) => el("li", {}, el("b", {}, d.text), ` — ${show(d.why)}`))),
    el("div", { class: "stops" }, el("button", { type: "button", id: "previous", onclick: step(-1) }, "‹"), ...buttons,
      el("button", { type: "button", id: "next", onclick: step(1) }, "next ›")), body].filter(Boolean));
  if (cycle.stops.length) choose(Math.max(0, cycle.stops.findIndex((s) => s.estimate)));
  place.scrollIntoView({ behavior: "auto", block: "start" });
}
document.addEventListener("keydown", (e) => {
  if (e.target.tagName === "INPUT" || opened === null) return;
  if (e.key === "ArrowRight") by("next").click();
  if (e.key === "ArrowLeft") by("previous").click();
});

function lookView(stop) {
  const info = el("dl");
  const add = (name, value) => { if (value !== null && value !== undefined && value !== "") info.append(el("dt", {}, name), el("dd", {}, value)); };
  if (stop.estimate) {
    add("estimate", `${stop.estimate.label} at ${stop.estimate.at.join(", ")} mm, ±${stop.estimate.mm} mm ±${stop.estimate.deg}° at the grasp`);
    add("agreement", `chi-square ${stop.estimate.chi2} with the looks before (22.5 is the most)`);
  }
  for (const p of stop.parts) {
    add(p.label, `confidence ${show(p.conf)}, match ratio ${show(p.ratio)}, activation ${show(p.act)}, runner-up ${show(p.runner)}, residual ${show(p.res, " mm")}. ${show(p.why)}`);
  }
  for (const g of stop.guesses) {
    add("nearest", `${g.label}: ${Math.round(100 * g.share)} % of its edges show (drawn through), the others do not (dashed)`);
  }
  add("time", Object.entries(stop.seconds).map(([k, v]) => `${k} ${Math.round(1000 * v)} ms`).join(", "));
  add("health", Object.entries(stop.health).map(([k, v]) => `${k.replaceAll("_", " ")} ${typeof v === "number" ? Math.round(1000 * v) / 1000 : JSON.stringify(v)}`).join(", "));
  return el("div", {}, el("div", { class: "eyes" }, eyeView(stop, "left", "l"), eyeView(stop, "right", "r")), info,
    stop.notes.length ? el("details", {}, el("summary", {}, `${stop.notes.length} notes`), el("ul", {}, ...stop.notes.map((n) => el("li", {}, n)))) : null,
    stop.rejected.length ? el("details", {}, el("summary", {}, `${stop.rejected.length} outlines refused`),
      el("ul", {}, ...stop.rejected.map((r) => el("li", {}, `${r.eye}: ${r.why}`)))) : null,
    stop.moves.length ? el("div", {}, el("h3", {}, "What followed"), el("ul", {}, ...stop.moves.map((m) => el("li", { class: m.kind === "refusal" ? "warn" : null }, m.text)))) : null);
}
function eyeView(stop, eye, key) {
  pictures = pictures || JSON.parse(by("pictures").textContent);
  const source = pictures[`${stop.seq}-${eye}`];
  const box = el("div", { class: "eye" });
  if (!source) { box.append(el("div", { class: "none" }, `${eye}: the picture is not in this page`)); return box; }
  const image = el("img", { src: source, alt: `${eye} eye`, loading: "lazy" });
  const layer = svg("svg");
  image.addEventListener("load", () => layer.setAttribute("viewBox", `-0.5 -0.5 ${image.naturalWidth} ${image.naturalHeight}`));
  const outline = (points, name) => layer.append(svg("polygon", { points: points.map((p) => p.join(",")).join(" "), class: name }));
  const middle = (points) => [points.reduce((s, p) => s + p[0], 0) / points.length, points.reduce((s, p) => s + p[1], 0) / points.length];
  for (const r of stop.rejected) if (r.eye === eye) outline(r.px, "refused");
  for (const p of stop.parts) {
    const all = [];
    for (const f of p.facets) {
      if (!f[key].length) continue;
      outline(f[key], p.label === "unknown" ? "unknown" : "facet");
      const [x, y] = middle(f[key]);
      layer.append(svg("text", { x, y, class: "type", "text-anchor": "middle" }, f.type.replaceAll("_", " ")));
      all.push(...f[key]);
    }
    if (all.length) layer.append(svg("text", { x: Math.min(...all.map((q) => q[0])), y: Math.min(...all.map((q) => q[1])) - 6 }, p.label));
  }
  for (const g of stop.guesses) {
    for (const edge of g[key]) {
      const [[x1, y1], [x2, y2]] = edge.px;
      layer.append(svg("line", { x1, y1, x2, y2, class: edge.shows ? "shows" : "shows-not" }));
    }
    const low = g[key].flatMap((edge) => edge.px).sort((a, b) => b[1] - a[1])[0];
    if (low) layer.append(svg("text", { x: low[0], y: low[1] + 16, "text-anchor": "middle" }, `${g.label}?`));
  }
  box.append(image, layer);
  return box;
}

// ---- events, other looks
by("event-list").append(data.events.length ? el("ul", {}, ...data.events.map((e) => el("li", { class: ["fault", "refusal", "gap"].includes(e.kind) ? "warn" : null },
  `${clock(e.t)} `, e.cycle === null ? null : el("a", { href: "#cycle", onclick: () => open(e.cycle) }, `cycle ${e.cycle} `), e.text,
  e.after && ["fault", "refusal"].includes(e.kind) ? el("span", { class: "dim" }, ` — after: ${e.after}`) : null))) : el("p", { class: "dim" }, "none"));
by("other-list").append(...data.outside.map((stop) => {
  const box = el("details", {}, el("summary", {}, `${clock(stop.t)} ${stop.purpose}: ${stop.parts.map((p) => p.label).join(", ") || "nothing named"}`));
  box.addEventListener("toggle", () => { if (box.open && box.children.length === 1) box.append(lookView(stop)); });
  return box;
}));
if (!data.outside.length) by("other-list").append(el("p", { class: "dim" }, "none"));

// ---- plots: their program is megabytes, so it runs only once a plot comes into view
const drawn = [];
const plotlySource = by("plotly").textContent.trim();
function loadPlotly() {
  if (typeof Plotly === "undefined") document.head.append(el("script", {}, plotlySource));
  return typeof Plotly !== "undefined";
}
const layout = (title, x, y) => ({ title: { text: title, font: { size: 14 } }, margin: { l: 52, r: 12, t: 36, b: 42 }, height: 300,
  paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
  xaxis: { title: { text: x } }, yaxis: { title: { text: y }, rangemode: "tozero" } });
function plot(traces, title, x, y, extra = {}) {
  const box = el("div", { class: "plot" });
  by("plot-list").append(box);
  drawn.push([box, traces, { ...layout(title, x, y), ...extra }]);
}
function plotAll() {
  const cycles = data.cycles.filter((c) => c.stops.some((s) => s.estimate));
  const few = cycles.length <= 40;
  const curves = cycles.map((c) => c.stops.filter((s) => s.estimate).map((s) => s.estimate.mm));
  if (few) {
    const lines = cycles.map((c, k) => ({ x: curves[k].map((_, i) => i + 1), y: curves[k], mode: "lines+markers", name: `cycle ${c.n} ${c.label}`, opacity: .75 }));
    const truths = cycles.filter((c) => c.true_mm !== null);
    lines.push({ x: truths.map((c) => c.looks), y: truths.map((c) => c.true_mm), mode: "markers", name: "true (simulation)", marker: { symbol: "x", size: 9 } });
    plot(lines, "Predicted error at the grasp, look by look (x: true)", "look", "mm");
  } else {
    const most = Math.max(...curves.map((c) => c.length));
    plot(Array.from({ length: most }, (_, i) => ({ type: "box", name: `look ${i + 1}`, y: curves.filter((c) => c.length > i).map((c) => c[i]) })),
      "Predicted error at the grasp, look by look", "", "mm");
  }
  const names = [...new Set(data.cycles.flatMap((c) => Object.keys(c.states)))];
  if (few) plot(names.map((s) => ({ type: "bar", name: s, x: data.cycles.map((c) => c.n), y: data.cycles.map((c) => c.states[s] || 0) })),
    "Where the time goes", "cycle", "s", { barmode: "stack", showlegend: true, legend: { orientation: "h", y: -0.3 }, height: 380 });
  else plot([{ type: "bar", x: names, y: names.map((s) => data.cycles.reduce((sum, c) => sum + (c.states[s] || 0), 0) / data.cycles.length) }],
    "Where the time goes, mean of all cycles", "", "s");
  const looks = data.looks, spot = { mode: few ? "lines+markers" : "markers", marker: { size: 4 }, type: few ? "scatter" : "scattergl" };
  plot([{ ...spot, x: looks.s, y: looks.ms }], "Time of a look", "s since the start", "ms");
  plot([{ ...spot, x: looks.s, y: looks.residual_mm }], "Corner residuals of the fitted parts", "s since the start", "mm rms");
  const drifts = ["pitch_deg", "roll_deg", "vergence_deg"].filter((n) => looks.health[n]);
  if (drifts.length) plot(drifts.map((n) => ({ ...spot, x: looks.s, y: looks.health[n], name: n.replace("_deg", "") })),
    "Calibration drift: the right eye against the left, look by look", "s since the start", "degrees", { showlegend: true, yaxis: { title: { text: "degrees" } } });
  const measures = new Map();                          // left and right of one measure go into one plot
  for (const name of Object.keys(looks.health)) {
    if (name.endsWith("_deg")) continue;
    const base = name.replace(/_(left|right)$/, "");
    measures.set(base, [...(measures.get(base) || []), name]);
  }
  for (const [base, names] of measures) {
    if (names.every((n) => looks.health[n].every((v) => !v))) continue;  // frozen, doubled, half: nothing to see while nothing was wrong
    plot(names.map((n) => ({ ...spot, x: looks.s, y: looks.health[n], name: n.slice(base.length + 1) || base })),
      `Camera health: ${base.replaceAll("_", " ")}`, "s since the start", base.endsWith("px") ? "px" : "", { showlegend: names.length > 1 });
  }
}
function colours() {
  const style = getComputedStyle(root), fg = style.getPropertyValue("--fg").trim(), line = style.getPropertyValue("--line").trim();
  return { font: { color: fg }, axis: { gridcolor: line, zerolinecolor: line, linecolor: line } };
}
function restylePlots() {
  if (typeof Plotly === "undefined") return;
  const c = colours();
  for (const [box, , l] of drawn) if (box.data) Plotly.relayout(box, { ...l, font: c.font, xaxis: { ...l.xaxis, ...c.axis }, yaxis: { ...l.yaxis, ...c.axis } });
}
plotAll();
const watcher = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting || !loadPlotly()) continue;
    watcher.unobserve(entry.target);
    const [box, traces, l] = drawn.find(([b]) => b === entry.target), c = colours();
    Plotly.newPlot(box, traces, { ...l, font: c.font, xaxis: { ...l.xaxis, ...c.axis }, yaxis: { ...l.yaxis, ...c.axis } }, { displayModeBar: false, responsive: true });
  }
}, { rootMargin: "200px" });
if (plotlySource) drawn.forEach(([box]) => watcher.observe(box));
else by("plot-list").replaceChildren(el("p", { class: "dim" }, "none: this page was made without the extra facetd[review]"));
root.dataset.theme = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
root.dataset.ready = "yes";
})();
