// Shows one cycle in space and over time, from the data in the page. Nothing is fetched.
"use strict";
(() => {
const data = JSON.parse(by("data").textContent), { moments, motion } = data;
theme();
by("verdict").textContent = `Cycle ${data.n}: ${data.label || "no part"}, ${data.outcome}`;
by("verdict").className = data.outcome === "picked" ? "good" : "";
by("summary").append(`run ${data.run}, `, time(data.t, data.utc_offset_s), `, ${duration(data.seconds)}. ${data.why || ""}`);
if (data.trouble) by("warnings").append(el("p", { class: "warn" }, data.trouble));

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const line = (name, points, style, more = {}) => ({ type: "scatter3d", mode: "lines", name, x: points.map((p) => p && p[0]), y: points.map((p) => p && p[1]), z: points.map((p) => p && p[2]),
  line: style, hoverinfo: "name", connectgaps: false, ...more });
const joined = (polygons) => polygons.flatMap((p) => [...p, null]);

// ---- what is in space: the parts of the last look, the arm, the tool's way, the table, the boxes
function partTraces(parts) {
  const labels = [...new Set(parts.map((p) => p.label))];
  return labels.flatMap((label, k) => {
    const facets = parts.filter((p) => p.label === label).flatMap((p) => p.facets), x = [], y = [], z = [], i = [], j = [], l = [];
    for (const facet of facets) {                     // facets are drawn as fans: of those that are not convex the outline counts
      const first = x.length;
      for (const p of facet) { x.push(p[0]); y.push(p[1]); z.push(p[2]); }
      for (let n = 1; n + 1 < facet.length; n++) { i.push(first); j.push(first + n); l.push(first + n + 1); }
    }
    const shade = label === "unknown" ? colour("dim") : colour(`c${(k + 1) % COLOURS}`);
    return [{ type: "mesh3d", name: label, x, y, z, i, j, k: l, color: shade, opacity: 0.6, flatshading: true, hoverinfo: "name", showlegend: true },
      line(label, joined(facets.map((f) => [...f, f[0]])), { color: shade, width: 4 }, { showlegend: false })];
  });
}
// A capsule is drawn as a tube between its ends; one without length as a ball.
function tubes(ends, radii) {
  const x = [], y = [], z = [], i = [], j = [], k = [], around = 10;
  const push = (p) => { x.push(p[0]); y.push(p[1]); z.push(p[2]); return x.length - 1; };
  const triangle = (a, b, c) => { i.push(a); j.push(b); k.push(c); };
  ends.forEach(([from, to], n) => {
    const along = to.map((v, a) => v - from[a]), length = Math.hypot(...along), axis = length > 1e-6 ? along.map((v) => v / length) : [0, 0, 1];
    const least = axis.map(Math.abs).indexOf(Math.min(...axis.map(Math.abs))), other = [0, 1, 2].map((a) => (a === least ? 1 : 0));
    const u = unit(cross(axis, other)), v = cross(axis, u), r = radii[n];
    const rings = [[from, -0.87, 0.5], [from, 0, 1], [to, 0, 1], [to, 0.87, 0.5]].map(([end, out, wide]) => Array.from({ length: around }, (_, m) => {
      const turn = 2 * Math.PI * m / around, c = Math.cos(turn) * r * wide, s = Math.sin(turn) * r * wide;
      return push(end.map((e, a) => e + out * r * axis[a] + c * u[a] + s * v[a]));
    }));
    const caps = [[from, -1], [to, 1]].map(([end, way]) => push(end.map((e, a) => e + way * r * axis[a])));
    for (let m = 0; m < around; m++) {
      const next = (m + 1) % around;
      for (let ring = 0; ring < 3; ring++) {
        triangle(rings[ring][m], rings[ring][next], rings[ring + 1][m]);
        triangle(rings[ring][next], rings[ring + 1][next], rings[ring + 1][m]);
      }
      triangle(caps[0], rings[0][next], rings[0][m]);
      triangle(caps[1], rings[3][m], rings[3][next]);
    }
  });
  return { x, y, z, i, j, k };
}
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const size = Math.hypot(...a) || 1; return a.map((v) => v / size); };
function boxEdges(low, high) {
  const corner = (n) => [n & 1 ? high[0] : low[0], n & 2 ? high[1] : low[1], n & 4 ? high[2] : low[2]], edges = [];
  for (let a = 0; a < 8; a++) for (const bit of [1, 2, 4]) if (!(a & bit)) edges.push([corner(a), corner(a | bit)]);
  return edges;
}
function traces(at) {
  const { parts } = moments[at], shown = partTraces(parts);
  if (data.arm) shown.push({ type: "mesh3d", name: "arm", ...tubes(data.arm.ends[at], data.arm.radius), color: colour("dim"), opacity: 0.45, hoverinfo: "name", showlegend: true });
  if (data.way.length) shown.push(line("way of the tool", data.way, { color: colour("c0"), width: 5 }));
  if (known(data.table_z) && data.way.length) {
    const seen = [...data.way, ...parts.flatMap((p) => p.facets.flat())], [x, y] = [0, 1].map((a) => [Math.min(...seen.map((p) => p[a])) - 60, Math.max(...seen.map((p) => p[a])) + 60]);
    shown.push({ type: "mesh3d", name: "table", x: [x[0], x[1], x[1], x[0]], y: [y[0], y[0], y[1], y[1]], z: Array(4).fill(data.table_z), i: [0, 0], j: [1, 2], k: [2, 3], color: colour("line"), opacity: 0.7, hoverinfo: "name", showlegend: true });
  }
  for (const [name, low, high] of data.keep_out) shown.push(line(name, joined(boxEdges(low, high)), { color: colour("bad"), width: 3 }));
  return shown;
}

// ---- the two figures, and the moment that both show
let at = Math.max(0, moments.findIndex((m) => m.kind === "look"));
const marks = () => moments.map((m, k) => ({ type: "line", xref: "x", yref: "paper", x0: m.s, x1: m.s, y0: 0, y1: 1,
  line: { width: k === at ? 3 : 1, dash: m.kind === "look" ? "solid" : "dot", color: k === at ? colour("fg") : colour(m.kind === "look" ? "accent" : ["refusal", "fault"].includes(m.kind) ? "bad" : "line") } }));
const plain = () => ({ paper_bgcolor: colour("card"), plot_bgcolor: colour("card"), font: { color: colour("fg") }, hovermode: "closest", uirevision: "kept", legend: { orientation: "h", y: 1.02, yanchor: "bottom" } });
const axis = (title, more = {}) => ({ title: { text: title }, gridcolor: colour("line"), zeroline: false, ...more });
const options = { displaylogo: false, responsive: true, displayModeBar: window.innerWidth > 700 };
function drawSpace() {
  return Plotly.react("space", traces(at), { ...plain(), margin: { l: 0, r: 0, t: 60, b: 0 },
    scene: { aspectmode: "data", xaxis: axis("x mm"), yaxis: axis("y mm"), zaxis: axis("z mm"), camera: { eye: { x: 1.15, y: -1.35, z: 0.7 }, center: { x: 0, y: 0, z: -0.15 } } } }, options);
}
const overTime = (name, y, axis_, k, more = {}) => ({ type: "scatter", mode: "lines", name, x: motion.s, y, yaxis: axis_, line: { color: colour(`c${k}`) }, ...more });
function drawMotion() {
  const lines = motion.s.length ? [
    ...[0, 1, 2].map((a) => overTime(`tool ${"xyz"[a]}`, motion.tool.map((p) => p[a]), "y", a)),
    ...[0, 1, 2, 3, 4, 5].map((a) => overTime(`joint ${a + 1}`, motion.joints.map((p) => p[a]), "y2", a)),
    overTime("speed", motion.speed, "y3", 0, { fill: "tozeroy" })] : [];
  const chosen = { type: "scatter", mode: "markers", name: "moments", x: moments.map((m) => m.s), y: moments.map(() => 0), yaxis: "y3", text: moments.map((m) => m.text), hoverinfo: "text+x",
    marker: { size: 9, color: moments.map((m) => colour(m.kind === "look" ? "accent" : ["refusal", "fault"].includes(m.kind) ? "bad" : "dim")) } };
  return Plotly.react("motion", [...lines, chosen], { ...plain(), margin: { l: 60, r: 10, t: 60, b: 40 }, shapes: marks(), xaxis: axis("s from the cycle's start", { anchor: "y3" }),
    yaxis: axis("tool, mm", { domain: [0.64, 1] }), yaxis2: axis("joints, degrees", { domain: [0.26, 0.6] }), yaxis3: axis("speed, %", { domain: [0, 0.22], rangemode: "tozero" }) }, options);
}
function choose(k) {
  if (k < 0 || k >= moments.length) return;
  at = k;
  [...by("moments").children].forEach((b, n) => b.setAttribute("aria-pressed", n === k));
  by("moment").textContent = `${number(moments[k].s)} s: ${moments[k].text}`;
  drawSpace();
  Plotly.relayout("motion", { shapes: marks() });
}
by("moments").append(...moments.map((m, k) => el("button", { type: "button", title: m.text, "aria-pressed": false, onclick: () => choose(k) }, m.name)));
document.addEventListener("keydown", (e) => { if (e.key === "ArrowRight") choose(at + 1); if (e.key === "ArrowLeft") choose(at - 1); });
by("theme").addEventListener("click", () => { drawSpace(); drawMotion(); });
Promise.all([drawSpace(), drawMotion()]).then(() => {
  by("motion").on("plotly_click", (e) => {            // the moment nearest to the point that was clicked
    const gaps = moments.map((m) => Math.abs(m.s - e.points[0].x));
    choose(gaps.indexOf(Math.min(...gaps)));
  });
  choose(at);
  document.documentElement.dataset.ready = "yes";
});
})();
