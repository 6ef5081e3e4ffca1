// Shows where the arm and the parts are now. It requests them whenever the server reports a change.
"use strict";
(() => {
theme();
const warn = (texts) => by("warnings").replaceChildren(...texts.filter(Boolean).map((text) => el("p", { class: "warn" }, text)));
if (typeof Plotly === "undefined") { by("state").textContent = "3-D view"; warn([missing]); return; }
let asking = false, again = false, last = null;
async function show() {
  if (asking) { again = true; return; }              // one request at a time; changes meanwhile make one more
  asking = true;
  do {
    again = false;
    try {
      last = await (await fetch("/space.json")).json();
      await draw();
    } catch { /* the event source below says that the server is away */ }
  } while (again);
  asking = false;
}
async function draw() {
  const { moment, arm, trouble } = last;
  warn([trouble]);
  by("moment").textContent = moment ? moment.text : "Nothing was recorded yet.";
  await space3d.draw("space", { ...last, parts: moment ? moment.parts : [], radius: arm && arm.radius, ends: arm && arm.ends[0] });
  document.documentElement.dataset.ready = "yes";
}
by("theme").addEventListener("click", () => last && draw());
const source = new EventSource("/events");
source.onmessage = (event) => {
  const { daemon } = JSON.parse(event.data);
  by("state").className = !daemon || daemon.fault ? "bad" : daemon.doing ? "good" : "";
  by("state").textContent = !daemon ? "No daemon answers; reconnecting" : daemon.fault ? "Nothing moves until `resume`" : daemon.doing || "idle";
  show();
};
source.onerror = () => { by("state").textContent = "Connection to the dashboard lost; reconnecting"; by("state").className = "bad"; };
})();
