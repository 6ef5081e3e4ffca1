// Draws the arm, the parts, the tool's way, the table and the keep-out boxes in 3-D, in mm of the world. Needs Plotly and shared.js.
"use strict";
const space3d = (() => {
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const line = (name, points, style, more = {}) => ({ type: "scatter3d", mode: "lines", name, x: points.map((p) => p && p[0]), y: points.map((p) => p && p[1]), z: points.map((p) => p && p[2]),
  line: style, hoverinfo: "name", connectgaps: false, ...more });
const joined = (polygons) => polygons.flatMap((p) => [...p, null]);

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
function traces({ parts, radius, ends, way, table_z, keep_out }) {
  const shown = partTraces(parts);
  if (ends) shown.push({ type: "mesh3d", name: "arm", ...tubes(ends, radius), color: colour("dim"), opacity: 0.45, hoverinfo: "name", showlegend: true });
  if (way.length) shown.push(line("path of the tool", way, { color: colour("c0"), width: 5 }));
  if (known(table_z) && way.length) {
    const seen = [...way, ...parts.flatMap((p) => p.facets.flat())], [x, y] = [0, 1].map((a) => [Math.min(...seen.map((p) => p[a])) - 60, Math.max(...seen.map((p) => p[a])) + 60]);
    shown.push({ type: "mesh3d", name: "table", x: [x[0], x[1], x[1], x[0]], y: [y[0], y[0], y[1], y[1]], z: Array(4).fill(table_z), i: [0, 0], j: [1, 2], k: [2, 3], color: colour("line"), opacity: 0.7, hoverinfo: "name", showlegend: true });
  }
  for (const [name, low, high] of keep_out) shown.push(line(name, joined(boxEdges(low, high)), { color: colour("bad"), width: 3 }));
  return shown;
}
const plain = () => ({ paper_bgcolor: colour("card"), plot_bgcolor: colour("card"), font: { color: colour("fg") }, hovermode: "closest", uirevision: "kept", legend: { orientation: "h", y: 1.02, yanchor: "bottom" } });
const axis = (title, more = {}) => ({ title: { text: title }, gridcolor: colour("line"), zeroline: false, ...more });
const options = { displaylogo: false, responsive: true, displayModeBar: window.innerWidth > 700 };
// parts: [{label, facets}]; the arm's capsules: radius, ends (null: no arm); way: points of the tool
function draw(id, view) {
  return Plotly.react(id, traces(view), { ...plain(), margin: { l: 0, r: 0, t: 60, b: 0 },
    scene: { aspectmode: "data", xaxis: axis("x mm"), yaxis: axis("y mm"), zaxis: axis("z mm"), camera: { eye: innerWidth < 700 ? { x: 1.9, y: -2.2, z: 1.15 } : { x: 1.15, y: -1.35, z: 0.7 }, center: { x: 0, y: 0, z: -0.15 } } } }, options);
}
return { draw, colour, plain, axis, options };
})();
