// Shows one cycle in space and over time, from the data in the page. Nothing is fetched.
"use strict";
(() => {
const data = JSON.parse(by("data").textContent), { moments, motion } = data;
theme();
by("verdict").textContent = `Cycle ${data.n}: ${data.label || "no part"}, ${data.outcome}`;
by("verdict").className = data.outcome === "picked" ? "good" : "";
by("summary").append(`run ${data.run}, `, time(data.t, data.utc_offset_s), `, ${duration(data.seconds)}. ${data.why || ""}`);
if (data.trouble) by("warnings").append(el("p", { class: "warn" }, data.trouble));

const { colour, plain, axis, options } = space3d;
// ---- the two figures, and the moment that both show
let at = Math.max(0, moments.findIndex((m) => m.kind === "look"));
const marks = () => moments.map((m, k) => ({ type: "line", xref: "x", yref: "paper", x0: m.s, x1: m.s, y0: 0, y1: 1,
  line: { width: k === at ? 3 : 1, dash: m.kind === "look" ? "solid" : "dot", color: k === at ? colour("fg") : colour(m.kind === "look" ? "accent" : ["refusal", "fault"].includes(m.kind) ? "bad" : "line") } }));
const drawSpace = () => space3d.draw("space", { ...data, parts: moments[at].parts, radius: data.arm && data.arm.radius, ends: data.arm && data.arm.ends[at] });
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
