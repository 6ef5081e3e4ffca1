// Shows what a replay of many runs came to from the data in the page. Nothing is fetched.
"use strict";
(() => {
const data = JSON.parse(by("data").textContent), pictures = JSON.parse(by("pictures").textContent), total = data.total, all = total.all;
theme();
const percent = (part, of) => (of ? `${(100 * part / of).toFixed(1)} %` : "–");
const words = (label) => (label || "nothing").replaceAll("_", " ");
const better = all.proved ? all.right[1] - all.right[0] : all.named[1] - all.named[0];
by("verdict").textContent = total.identical === total.looks ? `All ${total.looks} looks came out the same` : all.proved
  ? `${all.right[1]} of ${all.proved} proved parts named right, ${all.right[0]} then` : `${all.named[1]} of ${all.parts} parts named, ${all.named[0]} then`;
by("verdict").className = better < 0 || all.wrong[1] > all.wrong[0] ? "bad" : better > 0 ? "good" : "";
by("summary").append(`${total.looks} looks of ${plural(total.runs, "run")}, replayed with `, el("b", {}, data.with.join(", ")));
const tile = (name, value, under, kind) => el("div", { class: `tile ${kind || ""}` }, el("span", {}, name), el("b", {}, value), under ? el("small", {}, under) : null);
const kinds = Object.entries(data.kinds);
by("tiles").append(tile("right, as the pick proved", percent(all.right[1], all.proved), `${percent(all.right[0], all.proved)} then, of ${all.proved}`),
  tile("wrong, as the pick proved", all.wrong[1], `${all.wrong[0]} then`, all.wrong[1] > all.wrong[0] ? "bad" : ""), tile("with a name", percent(all.named[1], all.parts), `${percent(all.named[0], all.parts)} then`),
  tile("poses apart, median", known(all.mm) ? `${number(all.mm)} mm` : "–", known(all.p95_mm) ? `95 %: ${number(all.p95_mm)} mm` : ""), tile("a look, median", known(all.ms[1]) ? `${number(all.ms[1])} ms` : "–", known(all.ms[0]) ? `${number(all.ms[0])} ms then` : ""),
  tile("the same to the last digit", percent(total.identical, total.looks), `${total.identical} looks`), tile("worse", total.worse, "names lost or changed, poses moved", total.worse ? "bad" : ""),
  el("div", { class: "tile list" }, el("span", {}, "names that changed"), ...(kinds.length ? kinds.slice(0, 6).map(([name, n]) => el("div", {}, el("i", {}, n), ` ${name.replaceAll("_", " ")}`)) : [el("b", {}, "none")])));

// ---- differences, each with its pictures: as it was, as it is now
function show(one, number_) {
  const source = (camera) => pictures[`${number_}-${camera}`], box = by("shown");
  box.replaceChildren(el("h2", {}, `${one.cell}, run ${one.run}, look ${one.seq}`), ...one.changes.map((c) => el("div", { class: `cause ${c.regression ? "" : "less"}` }, `${words(c.part)}: ${c.what}`)),
    ...(one.looks ? [["then", one.looks[0]], ["now", one.looks[1]]].flatMap(([name, look]) => [el("h3", {}, name), stereoView(look, source)]) : [el("p", { class: "dim" }, "Its pictures are not in this page; they are in the run.")]));
  box.hidden = false;
  box.scrollIntoView({ block: "start", behavior: "smooth" });
}
by("summary").textContent = data.differences.length ? `Proved names that were lost first. A row opens its pictures.${data.more ? ` ${data.more} more are counted and not shown.` : ""}` : "Nothing.";
const columns = ["cell", "run", "look", "purpose", "light", "proved", "what"];
if (data.differences.length) by("table").tHead.append(el("tr", {}, ...columns.map((name) => el("th", {}, name))));
by("table").tBodies[0].append(...data.differences.map((one, k) => el("tr", { class: one.looks ? "with" : "", onclick: () => show(one, k) },
  ...[one.cell, one.run, one.seq, one.purpose, one.light, [...new Set(one.parts.map((p) => p.proved).filter(Boolean))].map(words).join(", ") || "–"].map((text) => el("td", {}, text)),
  el("td", { class: "k-cause" }, el("b", {}, one.changes.some((c) => c.regression) ? "worse: " : "other: "), one.changes.map((c) => `${words(c.part)} ${c.what}`).join("; ")))));

// ---- per cell, part and light
const thenNow = ([before, now], of) => el("td", {}, `${percent(before, of)} `, el("span", { class: now > before ? "up" : now < before ? "down" : "dim" }, now === before ? "same" : percent(now, of)));
for (const [kind, groups] of Object.entries(total.by)) {
  const rows = Object.entries(groups);
  by("by").append(el("h2", {}, `By ${kind}`), el("div", { class: "wide" }, el("table", { class: "plain" },
    el("thead", {}, el("tr", {}, ...[kind, "parts", "named then, now", "proved", "right then, now", "wrong then, now", "apart mm", "95 % mm", "ms then", "ms now"].map((name) => el("th", {}, name)))),
    el("tbody", {}, ...rows.map(([name, g]) => el("tr", {}, el("td", {}, words(name)), el("td", {}, g.parts), thenNow(g.named, g.parts), el("td", {}, g.proved), thenNow(g.right, g.proved),
      el("td", {}, `${g.wrong[0]} `, el("span", { class: g.wrong[1] > g.wrong[0] ? "down" : g.wrong[1] < g.wrong[0] ? "up" : "dim" }, g.wrong[1])), el("td", {}, number(g.mm)), el("td", {}, number(g.p95_mm)), el("td", {}, number(g.ms[0])), el("td", {}, number(g.ms[1]))))))));
}
if (total.skipped.length) { by("skipped").hidden = false; by("skipped").querySelector("ul").append(...total.skipped.map((line) => el("li", {}, line))); }
document.documentElement.dataset.ready = "yes";
})();
