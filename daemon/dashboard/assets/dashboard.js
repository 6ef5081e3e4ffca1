// Shows what the server sends. It requests nothing but pictures.
"use strict";
(() => {
theme();
let shown = null;
const source = new EventSource("/events");
source.onmessage = (event) => { draw(JSON.parse(event.data)); document.documentElement.dataset.ready = "yes"; };
source.onerror = () => { by("state").textContent = "Connection to the dashboard lost; reconnecting"; by("state").className = "bad"; };

const knows = (model) => (!model || !model.labels.length ? "no model" : `model ${known(model.version) ? `version ${model.version}` : "as configured"}`);
function draw(now) {
  const daemon = now.daemon, start = now.start || {}, offset = start.utc_offset_s;
  by("state").className = !daemon || daemon.fault ? "bad" : daemon.doing ? "good" : "";
  by("state").textContent = !daemon ? "No daemon answers; reconnecting"
    : daemon.fault ? (daemon.fault.startsWith("stopped ") ? `STOPPED ${daemon.fault.slice(8)}` : `FAULT: ${daemon.fault}`)
      : `${daemon.doing || "idle"}${daemon.target ? `: ${daemon.target}, look ${daemon.stop}` : daemon.doing ? ` (${daemon.state})` : ""}${daemon.paused ? ", paused" : ""}`;
  by("summary").replaceChildren(...[
    start.cell === "simulated" ? el("b", { class: "tag" }, "simulated") : null, start.name ? el("b", {}, `${start.name} `) : null,
    daemon ? `${daemon.picked} of ${known(daemon.tried) ? daemon.tried : daemon.picked} picked, ${daemon.fault ? "nothing moves until `resume`" : daemon.enabled ? "arm enabled" : "arm disabled"}, ${knows(daemon.model)}` : "last known state below",
    daemon && daemon.pending ? el("b", {}, `, waits for confirmation: ${daemon.pending}`) : null, el("br"), `run ${now.run || "–"}${start.version ? `, facetd ${start.version}` : ""}`].filter(Boolean));
  by("warnings").replaceChildren(...Object.values((daemon && daemon.troubles) || {}).map((text) => el("p", { class: "warn" }, text)));
  const seq = now.look ? `${now.run}-${now.look.seq}` : null;
  if (seq !== shown) {
    shown = seq;
    by("look-name").replaceChildren("Last look", ...(now.look ? [`: ${now.look.purpose}, `, time(now.look.t, offset)] : []));
    by("look").replaceChildren(...(now.look ? [stereoView(now.look, (camera) => (now.cameras.includes(camera) ? `/picture/${now.look.seq}/${camera}?run=${encodeURIComponent(now.run)}` : null))] : [el("p", { class: "dim" }, "none yet")]));
  }
  const places = (daemon && daemon.each_place) || [];
  by("places").hidden = !places.length;
  by("places-body").replaceChildren(...[placesDrawing(places)].filter(Boolean));
  const limit = (start.limits || {}).grasp_mm, points = now.approach.map((e) => [e.look, e.mm]);
  by("approach").replaceChildren(...[now.approach.length ? chart(`${now.approach[0].label}: predicted error at the grasp`, [{ name: "", points }],
    { x: "look at the part", y: "mm", limit, xs: points.map((p) => p[0]) }) : el("p", { class: "dim" }, "no part is being approached")].filter(Boolean));
  by("table").tBodies[0].replaceChildren(...now.picks.slice().reverse().map((p) => el("tr", {}, el("td", {}, time(p.t, offset)), el("td", {}, p.label || "–"),
    el("td", { class: `o ${p.outcome}` }, p.outcome), el("td", { class: "num" }, duration(p.s)), el("td", { class: "k-cause" }, p.outcome === "picked" && !p.stopped ? "" : p.why || ""))));
  by("lines").textContent = now.lines.slice().reverse().join("\n");
}
})();
