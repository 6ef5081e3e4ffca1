// What all our pages share: elements, numbers and times as people say them, a look drawn into both cameras. Texts go in as
// text, never as markup; nothing is fetched.
"use strict";
const by = (id) => document.getElementById(id);
const el = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false && value !== undefined) node.setAttribute(name, value === true ? "" : value);
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
const known = (value) => value !== null && value !== undefined;

// ---- types of facets in the words of geometry
const POLYGONS = { 3: "triangle", 4: "quadrilateral", 5: "pentagon", 6: "hexagon", 7: "heptagon", 8: "octagon", 9: "nonagon", 10: "decagon", 12: "dodecagon" };
const facetName = (type) => { const sides = /^polygon(\d+)$/.exec(type || ""); return sides ? POLYGONS[sides[1]] || `${sides[1]}-sided polygon` : (type || "").replace(/^arc(\d+)$/, "$1-degree arc").replaceAll("_", " "); };

// ---- numbers: as many digits as mean something
const number = (value) => {
  if (!known(value)) return "–";
  const size = Math.abs(value);
  if (size > 0 && size < 0.005) return "< 0.01";
  return String(Number(size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : size >= 1 ? value.toPrecision(2) : value.toFixed(2)));
};
const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
const duration = (s) => {
  if (!known(s)) return "–";
  if (s < 60) return `${number(s)} s`;
  const whole = Math.round(s), minutes = Math.floor(whole / 60), hours = Math.floor(minutes / 60), days = Math.floor(hours / 24);
  if (minutes < 60) return `${minutes} min${whole % 60 && minutes < 10 ? ` ${whole % 60} s` : ""}`;
  if (hours < 48) return `${hours} h${minutes % 60 ? ` ${minutes % 60} min` : ""}`;
  return `${days} days${hours % 24 ? ` ${hours % 24} h` : ""}`;
};
const share = ([part, of]) => (of ? `${Math.round(100 * part / of)} %` : "–");

// ---- picks that do not count as tried, and a pace at which times are no times of the cell
const notTried = (p) => [[p.released, "released without confirmation"], [p.aborted, "ended by a person"], [p.interrupted, "interrupted"]].filter(([n]) => n).map(([n, what]) => `, ${n} ${what}`).join("");
const atPace = (pace) => (pace === 1 ? "real time" : `${number(pace)} times real time`);
const paceOf = (p) => (p.paces.some((pace) => pace !== 1) ? (known(p.median_s) ? "runs in real time only" : `simulated at ${p.paces.map(atPace).join(", ")}: no cycle times`) : null);

// ---- what stopped it, how often, and what to do about it
const stoppedBy = (stops) => (stops.length ? `. Causes of stops: ${stops.slice(0, 4).map(([name, n]) => (n > 1 ? `${n} × ${name}` : name)).join(", ")}${stops.length > 4 ? `, and ${stops.length - 4} more` : ""}` : "");
const stoppedList = (stops, remedies) => el("div", { class: "tile list reasons" }, el("span", {}, "causes of stops"), ...(stops.length ? stops.map(([name, n]) => el("div", {}, el("i", { class: "bad" }, n), ` ${name} `, el("small", {}, remedies[name]))) : [el("b", {}, "none")]));

// ---- buttons of which one is pressed: all, or one of some names; text(name) is on it
const filters = (box, names, text, choose) => box.append(...["all", ...names].map((name) => el("button", { type: "button", "data-outcome": name, "aria-pressed": name === "all",
  onclick: (e) => { for (const b of box.children) b.setAttribute("aria-pressed", b === e.currentTarget); choose(name); } }, name === "all" ? "all" : text(name))));

// ---- how the time was used: OEE with its factors, and what each stop cost, the costliest first
const percent = (value) => (known(value) ? share([value, 1]) : "–");
const oeeOf = (times) => (known(times.oee) ? `availability ${percent(times.availability)} × performance ${percent(times.performance)} × quality ${percent(times.quality)}` : "too few picks in real time");
const OEE = "Availability: time picking, of the time in which parts were wanted (a pick, an auto, a job, with its stops). Performance: against the fastest tenth of the good picks. Quality: picked of tried. Waiting for parts does not count.";
const downtime = ({ stops, picking_s, down_s, waiting_s }) => {
  if (!(picking_s + down_s + waiting_s)) return null;
  let sum = 0;
  const bar = (s) => `background: linear-gradient(to right, color-mix(in srgb, var(--c0) 35%, transparent) ${100 * s / stops[0].s}%, transparent 0)`;
  const rows = stops.map(({ cause, count, s }) => { sum += s; return el("tr", {}, el("td", { style: bar(s) }, cause), ...[duration(s), count, percent(sum / down_s)].map((text) => el("td", { class: "num" }, text))); });
  return el("figure", { class: "chart" }, el("figcaption", {}, `Downtime ${duration(down_s)}, picking ${duration(picking_s)}, waiting for parts ${duration(waiting_s)}`),
    stops.length ? el("div", { class: "wide" }, el("table", {}, el("thead", {}, el("tr", {}, ...["stopped by", "downtime", "stops", "cumulative"].map((name, k) => el("th", { class: k ? "num" : null }, name)))), el("tbody", {}, ...rows))) : null);
};

// ---- times: the cell's own, UTC under the pointer
const cellTime = (t, offset) => new Date(Date.parse(t) + 1000 * (offset || 0)).toISOString();
const clock = (t, offset) => (t ? cellTime(t, offset).slice(11, 19) : "–");
const time = (t, offset) => el("time", { datetime: t, title: t ? `${t.slice(0, 19).replace("T", " ")} UTC` : null }, clock(t, offset));
const dayAndTime = (t, offset) => (t ? cellTime(t, offset).slice(0, 16).replace("T", " ") : "–");

// ---- light or dark
const theme = () => {
  const root = document.documentElement;
  root.dataset.theme = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  by("theme").addEventListener("click", () => { root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark"; });
};

// ---- a look: both cameras with what was found drawn in. source(camera): where its picture is, or null
async function unpacked(text) {                         // JSON that was compressed by gzip, as base64
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return JSON.parse(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text());
}
function stereoView(look, source) {
  const box = el("div", { class: "stereo" }, cameraView(look, "left", "l", source("left")), cameraView(look, "right", "r", source("right")));
  box.addEventListener("click", () => large(look, source));
  return box;
}
function large(look, source) {
  const dialog = el("dialog", { class: "large", onclick: () => dialog.close(), onclose: () => dialog.remove() },
    el("div", { class: "stereo" }, cameraView(look, "left", "l", source("left")), cameraView(look, "right", "r", source("right"))));
  document.body.append(dialog);
  dialog.showModal();
}
function cameraView(look, camera, key, source) {
  const box = el("div", { class: "camera" });
  if (!source) { box.append(el("div", { class: "none" }, `${camera}: the image is not in this page`)); return box; }
  const image = el("img", { src: source, alt: `${camera} camera` });
  const layer = svg("svg");
  image.addEventListener("error", () => box.replaceChildren(el("div", { class: "none" }, `${camera}: the image is in the run's folder, and not beside this page`)));
  image.addEventListener("load", () => layer.setAttribute("viewBox", `-0.5 -0.5 ${image.naturalWidth} ${image.naturalHeight}`));
  const outline = (points, name) => layer.append(svg("polygon", { points: points.map((p) => p.join(",")).join(" "), class: name }));
  const middle = (points) => [points.reduce((s, p) => s + p[0], 0) / points.length, points.reduce((s, p) => s + p[1], 0) / points.length];
  for (const r of look.rejected) if (r.camera === camera) outline(r.px, "refused");
  for (const p of look.parts) {
    const all = [];
    for (const f of p.facets) {
      if (!f[key].length) continue;
      outline(f[key], p.label === "unknown" ? "unknown" : "facet");
      const [x, y] = middle(f[key]);
      layer.append(svg("text", { x, y, class: "type", "text-anchor": "middle" }, facetName(f.type)));
      all.push(...f[key]);
    }
    if (all.length) layer.append(svg("text", { x: Math.min(...all.map((q) => q[0])), y: Math.min(...all.map((q) => q[1])) - 6 }, p.label));
  }
  for (const g of look.guesses) {
    for (const edge of g[key]) {
      const [[x1, y1], [x2, y2]] = edge.px;
      layer.append(svg("line", { x1, y1, x2, y2, class: edge.shows ? "shows" : "shows-not" }));
    }
    const low = g[key].flatMap((edge) => edge.px).sort((a, b) => b[1] - a[1])[0];
    if (low) layer.append(svg("text", { x: low[0], y: low[1] + 16, "text-anchor": "middle" }, `${g.label}?`));
  }
  box.append(image, layer, el("span", { class: "which" }, camera));
  return box;
}

// ---- places from above: the outline of each part in its place, in the colour of its status, with a sign for it
const PLACE_SIGNS = { "seen right": "✓", off: "✗", missing: "✗", set: "?", claimed: "?", "to be looked at": "?" };
function placesDrawing(places) {
  const drawn = places.filter((p) => p.outline && p.outline.length);
  if (!drawn.length) return null;
  const all = drawn.flatMap((p) => p.outline), side = (k) => [Math.min(...all.map((q) => q[k])), Math.max(...all.map((q) => q[k]))];
  const [left, right] = side(0), [low, high] = side(1), room = 8 + 0.04 * Math.max(right - left, high - low);
  const layer = svg("svg", { viewBox: `${left - room} ${-high - room} ${right - left + 2 * room} ${high - low + 2 * room}`, role: "img", class: "places" });
  const wide = (points, k) => Math.max(...points.map((q) => q[k])) - Math.min(...points.map((q) => q[k]));
  const called = (p) => p.name.split(".").pop(), sign = (p) => Math.max(6, Math.min(wide(p.outline, 0), wide(p.outline, 1)) / 3);
  const letters = Math.min(...drawn.map((p) => Math.min(0.8 * sign(p), 2.3 * wide(p.outline, 0) / Math.max(called(p).length, 1))));
  for (const p of drawn) {
    const name = `place ${(PLACE_SIGNS[p.status] || "") === "✓" ? "right" : PLACE_SIGNS[p.status] === "✗" ? "wrong" : PLACE_SIGNS[p.status] ? "unsure" : "empty"}`;
    const group = svg("g", { class: name }), x = p.outline.reduce((s, q) => s + q[0], 0) / p.outline.length, y = p.outline.reduce((s, q) => s + q[1], 0) / p.outline.length;
    const size = sign(p);
    group.append(svg("title", {}, `${p.name}: ${p.part}, ${p.status}${known(p.off_mm) ? `, ${number(p.off_mm)} mm and ${number(p.off_deg)} degrees off` : ""}`),
      svg("polygon", { points: p.outline.map(([px, py]) => `${px},${-py}`).join(" ") }),
      svg("text", { x, y: -y, "text-anchor": "middle", "font-size": size }, PLACE_SIGNS[p.status] || ""),
      svg("text", { x, y: -y + size, "text-anchor": "middle", "font-size": letters }, called(p)));
    layer.append(group);
  }
  const count = {};
  for (const p of places) count[p.status] = (count[p.status] || 0) + 1;
  const counts = Object.entries(count).map(([status, n]) => `${n} ${status}${PLACE_SIGNS[status] ? ` ${PLACE_SIGNS[status]}` : ""}`).join(", ");
  return el("figure", { class: "drawing" }, el("figcaption", {}, "Places from above, x to the right, y up"), layer, el("p", { class: "dim" }, counts));
}
// How exactly parts came to lie at their places; a pattern before its places.
const placingTable = (rows) => el("div", { class: "wide" }, el("table", { class: "placing stacked" }, el("thead", {}, el("tr", {}, ...["part", "place", "seen right", "median mm", "95 % mm", "median °", "95 % °"].map((name, k) => el("th", { class: k > 2 ? "num" : null }, name)))),
  el("tbody", {}, ...rows.map((r) => el("tr", { class: r.place.includes(".") ? "one-of" : null }, el("td", {}, r.part), el("td", {}, r.place), el("td", { class: r.right < r.looked_at ? "o" : null }, `${r.right} of ${r.looked_at}`),
    ...[["median_mm", "median mm"], ["p95_mm", "95 % mm"], ["median_deg", "median °"], ["p95_deg", "95 % °"]].map(([key, name]) => el("td", { class: "num", "data-name": name }, number(r[key]))))))));

// ---- a line over time: points are [x, y or null], x and y in the chart's own units; where nothing is for longer
// than `gap` of the width, the line is broken
function curve(points, [x0, x1], [y0, y1], width, height, gap = Infinity) {
  const px = (x) => width * (x - x0) / Math.max(x1 - x0, 1e-9), py = (y) => height - height * (Math.min(Math.max(y, y0), y1) - y0) / Math.max(y1 - y0, 1e-9);
  const columns = new Map();                            // what falls on one column is drawn as its least and greatest
  for (const [x, y] of points) {
    if (!known(y)) continue;
    const at = Math.round(px(x) * 2) / 2, seen = columns.get(at);
    if (seen) { seen[0] = Math.min(seen[0], y); seen[1] = Math.max(seen[1], y); } else columns.set(at, [y, y]);
  }
  const sorted = [...columns].sort((a, b) => a[0] - b[0]);
  return { path: sorted.map(([x, [low, high]], k) => `${k && x - sorted[k - 1][0] < gap ? "L" : "M"}${x.toFixed(1)} ${py(high).toFixed(1)}${low < high ? `L${x.toFixed(1)} ${py(low).toFixed(1)}` : ""}`).join(""),
    dots: sorted.length <= 60 ? sorted.map(([x, [, high]]) => [x, py(high)]) : [], px, py };
}
// A chart with axes, units and its limit. series: [{name, points, colour, dotless}]; options: x, y titles, limit, on(point index)
const COLOURS = 6;
function chart(title, series, options) {
  const width = 460, height = 190, box = el("figure", { class: "chart" }, el("figcaption", {}, title));
  const every = series.flatMap((s) => s.points).filter((p) => known(p[1]));
  if (!every.length) return null;
  const xs = every.map((p) => p[0]), ys = every.map((p) => p[1]);
  const span = [Math.min(...xs), Math.max(...xs)], [low, top] = options.fit || [Math.min(0, ...ys), Math.max(...ys, options.limit || 0) * 1.1 || 1];
  if (span[0] === span[1]) { span[0] -= 0.5; span[1] += 0.5; }
  const layer = svg("svg", { viewBox: `-46 -24 ${width + 62} ${height + 60}`, role: "img" });
  const scale = curve([], span, [low, top], width, height);
  for (const y of ticks(low, top)) {
    layer.append(svg("line", { x1: 0, x2: width, y1: scale.py(y), y2: scale.py(y), class: "grid" }),
      svg("text", { x: -6, y: scale.py(y) + 4, "text-anchor": "end" }, String(y)));
  }
  let right = -Infinity;
  for (const x of options.xs || ticks(...span, options.whole)) {
    if (scale.px(x) - right < 34) continue;
    right = scale.px(x);
    layer.append(svg("text", { x: scale.px(x), y: height + 16, "text-anchor": "middle" }, options.xName ? options.xName(x) : String(x)));
  }
  layer.append(svg("text", { x: width / 2, y: height + 33, "text-anchor": "middle", class: "axis" }, options.x));
  layer.append(svg("text", { x: -40, y: -11, class: "axis" }, options.y));
  if (known(options.limit)) layer.append(svg("line", { x1: 0, x2: width, y1: scale.py(options.limit), y2: scale.py(options.limit), class: "limit" }),
    svg("text", { x: width, y: scale.py(options.limit) - 4, "text-anchor": "end", class: "limit" }, `limit ${number(options.limit)}`));
  series.forEach((s, k) => {
    const { path } = curve(s.points, span, [low, top], width, height), name = `line c${s.colour ?? k % COLOURS}`;
    if (!s.dotsOnly) layer.append(svg("path", { d: path, class: name }));
    const count = s.points.filter((p) => known(p[1])).length;
    if ((s.dotless && count > 1) || count > 200) return;
    s.points.forEach((p, i) => {
      if (!known(p[1])) return;
      const dot = svg("circle", { cx: scale.px(p[0]), cy: scale.py(p[1]), r: options.on ? 4 : 2.5, class: `dot c${s.colour ?? k % COLOURS}` });
      dot.append(svg("title", {}, `${s.name ? `${s.name}: ` : ""}${number(p[1])} ${options.y}${p[2] ? `, ${p[2]}` : ""}`));
      if (options.on) { dot.classList.add("leads"); dot.addEventListener("click", () => options.on(i)); }
      layer.append(dot);
    });
  });
  box.append(layer);
  const named = series.filter((s) => s.name && s.legend !== false);
  if (named.length > 1) box.append(el("div", { class: "legend" }, ...named.map((s) => el("span", { class: `c${s.colour ?? series.indexOf(s) % COLOURS}` }, s.name))));
  return box;
}
function ticks(low, high, whole = false) {
  const rough = (high - low) / 4, ten = 10 ** Math.floor(Math.log10(rough || 1)), step = Math.max([1, 2, 5, 10].find((m) => m * ten >= rough) * ten, whole ? 1 : 0);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9; at += step) found.push(Number(at.toPrecision(6)));
  return found;
}
