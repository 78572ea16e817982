"use strict";
const token = new URLSearchParams(location.search).get("token") || "";
const $ = id => document.getElementById(id);
const VELOCITIES = [["u", "surge u [m/s]"], ["v", "sway v [m/s]"], ["r", "yaw rate r [rad/s]"]];
const MOST = 120;  // of a longer part of a run, so many seconds are predicted [s]
const LONG = 60;  // of a longer run, the first so many seconds are shown at first
const COMMANDS = ["#56b4e9", "#e69f00", "#009e73", "#cc79a7"];
const config = {responsive: true, displayModeBar: false, showTips: false};
let S = null, draft = {}, dragging = false, view = {run: "", from: 0, to: 0}, other = "", drawnOf = "", triedOf = "";
let known = {};  // what is drawn: measured, curves, missing
let slidersOf = "", ranges = {}, bars = {}, begun = 0, entry = null, order = 0, shown = [0, 1], newest = -1;
let fetching = null, again = false, busy = false, pending = 0, busyAll = false, pendingAll = false;
window.timing = {drag: [], net: [], all: [], first: 0, undo: [], add: []};

/* The server */
async function api(name, content = {}) {
  const answer = await fetch(name, {method: "POST", headers: {"Content-Type": "application/json", "X-Token": token},
    body: JSON.stringify(content)}).catch(() => null);
  if (!answer) throw new Error("The workbench does not answer. Start it again: nothing is lost.");
  const found = await answer.json();
  if (found.refused) throw new Error(found.refused);
  return found;
}
function say(text, bad = false) { $("said").textContent = text; $("said").classList.toggle("bad", bad); }
function act(name, content) {
  say("");  // what was done before is past
  return api(name, content).then(refresh).catch(error => say(error.message, true));
}
function refresh() {
  if (fetching) { again = true; return fetching; }
  fetching = (async () => {
    do { again = false; const before = S; S = await api("state"); show(before); } while (again);
  })().catch(error => say(error.message, true)).finally(() => { fetching = null; });
  return fetching;
}
const later = (wait, work) => { let timer; return (...given) => { clearTimeout(timer); timer = setTimeout(() => work(...given), wait); }; };

/* Words and parts */
const two = value => value === null || value === undefined ? "not finite" : value >= 99.5 ? value.toFixed(0) : String(+value.toPrecision(2));
const off = error => error ? `${two(error.position_mm)} mm, ${two(error.heading_deg)} deg` : "unknown";
const node = id => S.nodes.find(one => one.id === Number(id));
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const listed = names => names.join(", ").replace(/, (?=[^,]*$)/, " and ");
function make(kind, values = {}, ...inside) {
  const made = Object.assign(document.createElement(kind), values);
  made.append(...inside.filter(part => part !== null && part !== undefined));
  return made;
}

/* The state */
function show(before) {
  const now = {...node(S.current), ...S.now}, names = S.runs.map(run => run.name);
  if (!names.includes(view.run)) choose((S.runs.find(run => run.role === "fit") || S.runs[0]).name);
  if (!before || before.current !== S.current || JSON.stringify(node(S.current).error) !== JSON.stringify(before.nodes.find(n => n.id === S.current)?.error)) draft = {};
  showRuns(); showParameters(now); showBars(now); showHistory(); showSearch(before); showTried(); showNext(); showJobs(before);
  $("story").textContent = `${S.runs.filter(run => run.role === "fit").length} runs fitted, ${S.runs.filter(run => run.role === "held out").length} held out; model ${now.id}${S.effects.length ? " with " + S.effects.join(", ") : ""}`;
  number(now.error, now.by);
  if (before && before.current !== S.current) told(now, S.nodes.length > before.nodes.length);
  if (!before && Object.keys(S.formula).length) fill({expression: S.formula.expression || S.formula});
  const key = JSON.stringify([S.current, now.as_is, view, other, css("--page"), S.runs.map(run => run.cuts), S.judge]);
  if (key !== drawnOf && !dragging) { drawnOf = key; draw(); }
}
function told(now, isNew) {
  if (!isNew) return say(`Now at model ${now.id}: ${now.what}.`);
  const was = now.before || node(now.parent)?.error;
  if (now.kind === "add") window.timing.add.push(performance.now() - begun);
  if (now.kind === "add") say(`${now.what.replace("add", "Added")}: ${off(was)} before, ${off(now.error)} with it. ${now.helps ? "It helps" : "Not shown to help"}: ${now.reason}.`, !now.helps);
  if (now.kind === "fit") say(`Fitted: ${off(was)} before, ${off(now.error)} now, each run predicted by a fit to the others.`);
}
function number(error, by) {
  const now = {...node(S.current), ...S.now};
  $("number").replaceChildren(`Prediction after ${now.seconds} s: `, make("b", {textContent: off(error)}),
    make("span", {className: "less", textContent: ` ${by}; ${error.mocap || now.mocap}: ${off(now.floor)}`}));
}
function showRuns() {
  $("runs").replaceChildren(...S.runs.map(run => {
    const role = make("select", {ariaLabel: "role of " + run.name, onchange: () => act("role", {run: run.name, role: role.value})},
      ...["fit", "held out", "off"].map(name => make("option", {value: name, textContent: name, selected: name === run.role})));
    const cuts = run.cuts.length ? make("button", {textContent: "use the whole run again", onclick: () => act("cut", {run: run.name, span: null})}) : null;
    return make("div", {className: "run" + (run.name === view.run ? " shown" : "")}, role,
      make("b", {textContent: run.name, tabIndex: 0, role: "button", onclick: () => { choose(run.name); show(S); },
        onkeydown: event => { if (event.key === "Enter") { choose(run.name); show(S); } }}),
      make("p", {textContent: run.quality}), ...run.odd.map(text => make("p", {className: "odd", textContent: text})),
      run.cuts.length ? make("p", {textContent: "left out: " + run.cuts.map(c => `${c[0].toFixed(1)} to ${c[1].toFixed(1)} s `).join(", ")}) : null, cuts);
  }));
  $("run").replaceChildren(...S.runs.map(run => make("option", {textContent: run.name, selected: run.name === view.run})));
  $("other").replaceChildren(make("option", {value: "", textContent: "no other model"}), ...S.nodes.filter(n => n.id !== S.current)
    .map(n => make("option", {value: n.id, textContent: `${n.id}: ${n.what}`, selected: String(n.id) === String(other)})));
}
function choose(name) {
  const run = S.runs.find(one => one.name === name);
  view = {run: name, from: 0, to: run.end > LONG ? LONG : 0};
  if (!$("brushed").hidden) $("brush").click();
}

/* Parameters: the curves follow the slider */
function showParameters(now) {
  $("model").textContent = now.what;
  const key = S.current + S.parameters.map(p => p.name).join();
  if (key === slidersOf) {
    if (!dragging) for (const p of S.parameters) setSlider(p, p.value);
    return;
  }
  slidersOf = key;
  $("parameters").replaceChildren(...S.parameters.map(p => {
    const found = now.parameters?.[p.name], id = "p_" + p.name, range = ranges[p.name] = rangeOf(p);
    const slider = make("input", {type: "range", id, min: 0, max: 1000, step: 1, title: p.doc});
    const box = make("input", {type: "number", step: "any", id: id + "_n", ariaLabel: `${p.name} in ${p.unit}`});
    slider.oninput = () => { dragging = true; const value = atSlider(range, slider.value / 1000); box.value = +value.toPrecision(4); drag(p.name, value); };
    slider.onchange = () => commit();
    box.onchange = () => { const value = Number(box.value); if (box.value === "" || !isFinite(value)) return; drag(p.name, value); commit(); };
    return make("div", {className: "parameter"}, make("label", {htmlFor: id}, ...p.name.split(/(?=[._])/).flatMap(part => [make("wbr"), part]), make("small", {textContent: p.unit === "-" ? "" : ` [${p.unit}]`})), box, slider,
      found ? make("div", {className: "ci", textContent: found.words}) : null);
  }));
  for (const p of S.parameters) setSlider(p, p.value);
}
function rangeOf(p) {
  const value = p.value;
  if (value > 0 && !p.name.includes(".")) return {log: true, low: value / 4, high: value * 4};
  const reach = value ? 3 * Math.abs(value) : p.name.includes("tau") || p.unit === "s" ? 0.2 : 0.05;
  return {log: false, low: Math.max(value - reach, p.lower ?? -Infinity), high: Math.min(value + reach, p.upper ?? Infinity)};
}
const atSlider = (range, share) => range.log ? range.low * (range.high / range.low) ** share : range.low + share * (range.high - range.low);
function setSlider(p, value) {
  const range = ranges[p.name], slider = $("p_" + p.name);
  slider.value = 1000 * (range.log ? Math.log(value / range.low) / Math.log(range.high / range.low) : (value - range.low) / (range.high - range.low));
  $("p_" + p.name + "_n").value = +value.toPrecision(4);
}
async function drag(name, value) {
  draft[name] = value;
  pending = pending || performance.now();
  if (!busyAll) dragAll(); else pendingAll = true;
  if (busy) return;
  busy = true;
  try {
    while (pending) {
      const begun = pending; pending = 0;
      const found = await api("curves", {...at(), values: draft});
      known.curves = found.predicted; window.timing.net.push(performance.now() - begun);
      await Plotly.restyle($("motion"), predictedOf(found.predicted), known.places);
      window.timing.drag.push(performance.now() - begun);
    }
  } catch (error) { say(error.message, true); }
  busy = false;
}
async function dragAll() {
  busyAll = true;
  try {
    do { pendingAll = false; const begun = performance.now(); const error = await api("error", {node: S.current, values: draft});
      number(error, "as it is"); liveBar(error); window.timing.all.push(performance.now() - begun); } while (pendingAll);
  } catch (error) { say(error.message, true); }
  busyAll = false;
}
async function commit() {
  dragging = false;
  if (Object.keys(draft).length) await act("set", {node: S.current, values: draft});
}

/* Bars and history */
function bar(label, error, most, floor, kind = "", more = null) {
  const width = error ? Math.max(0.5, 100 * Math.min(1, error.position_mm / most)) : 0;
  const track = make("div", {className: "track"}, make("div", {className: "fill"}), make("div", {className: "floor", title: "noise floor"}));
  track.children[0].style.width = width + "%"; track.children[1].style.left = Math.min(100, 100 * floor / most) + "%";
  return make("div", {className: "bar " + kind}, make("span", {textContent: label}), track, more || make("span", {className: "n", textContent: off(error)}));
}
function showBars(now) {
  const before = S.now.error ? null : now.before || node(now.parent)?.error, label = now.kind !== "add" ? "before" : Array.isArray(now.effect) ? "without them, refitted" : "without it, refitted";
  const beside = other && node(other);
  const all = [now.error, before, beside?.error, now.holdout, node(1).error].filter(Boolean).map(error => error.position_mm ?? 0);
  const most = Math.max(...all) * 1.02, floor = now.floor.position_mm ?? 0, rows = [];
  bars = {most, floor};
  if (before) rows.push(bar(label, before, most, floor));
  rows.push(bar(S.now.error ? "on the runs ticked now" : `now, ${now.by}`, now.error, most, floor, "now"));
  if (beside) rows.push(bar(`model ${beside.id}: ${beside.what}`, beside.error, most, floor));
  if (S.runs.some(run => run.role === "held out")) {
    const open = make("button", {id: "open", textContent: S.opened ? `Open (seen ${S.opened === 1 ? "once" : S.opened + " times"})` : "Open (not seen yet)", onclick: () => act("open")});
    if (now.holdout) rows.push(bar(`held out, seen ${S.opened === 1 ? "once" : S.opened + " times"}`, now.holdout, most, floor, "out"));
    else rows.push(bar("held out, sealed", null, most, floor, "out", open));
  }
  if (now.kind === "add") rows.push(make("p", {className: "less"}, make("span", {className: now.helps ? "yes" : "no", textContent: now.helps ? "It helps: " : "Not shown to help: "}), now.reason));
  const old = [...$("bars").querySelectorAll(".now .fill")].map(fill => fill.style.width)[0];
  $("bars").replaceChildren(...rows);
  const fill = $("bars").querySelector(".now .fill"), width = fill.style.width;
  if (old && old !== width) { fill.style.width = old; void fill.offsetWidth; fill.style.width = width; }
}
function liveBar(error) {
  const row = $("bars").querySelector(".now"); if (!row) return;
  row.querySelector(".fill").style.width = Math.min(100, 100 * error.position_mm / bars.most) + "%";
  row.querySelector(".n").textContent = off(error);
}
function showHistory() {
  const most = Math.max(...S.nodes.map(n => n.error.position_mm ?? 0));
  const rows = [], walk = (parent, depth) => S.nodes.filter(n => n.parent === parent).forEach(n => {
    const line = make("i"); line.style.width = Math.max(1, 100 * (n.error.position_mm ?? most) / most) + "%";
    const row = make("button", {className: "node", role: "treeitem", ariaLevel: depth + 1, title: n.reason || "",
      onclick: () => act("select", {node: n.id})}, make("em", {textContent: off(n.error)}), `${n.id} ${n.what}${n.helps === false ? " (not shown to help)" : ""}`, line);
    row.style.marginLeft = 0.7 * Math.min(depth, 8) + "rem"; row.style.width = "auto"; row.setAttribute("aria-current", n.id === S.current);
    row.dataset.node = n.id; rows.push(row); walk(n.id, depth + 1);
  });
  walk(0, 0);
  $("history").replaceChildren(...rows.map(row => { row.style.display = "block"; row.style.width = `calc(100% - ${row.style.marginLeft})`; return row; }));
}

/* What is missing */
function showSearch(before) {
  const search = S.search, job = S.running.find(one => one.kind === "search");
  $("search").disabled = Boolean(job); $("stop").hidden = !job;
  $("stop").onclick = () => act("stop", {job: job.id});
  const where = search.judge ? ` on ${search.judge[0]}, ${search.judge[1].toFixed(1)} to ${search.judge[2].toFixed(1)} s` : "";
  const states = {none: "Tries every effect of the library, singly and together.", stopped: `Stopped. Single effects, relative to model ${search.node}.`, failed: "Failed.", done: `Done, for model ${search.node}${where}.`};
  $("searching").textContent = job ? `${job.told}${job.of > 1 ? `, ${job.done} of ${job.of}` : ""}${where} …` : states[search.state] || "";
  if (!job && search.rows.length && search.node !== S.current) $("searching").append(" Search again for this model. ");
  if (S.judge && !job) $("searching").append(` Candidates are judged on ${S.judge[0]}, ${S.judge[1].toFixed(1)} to ${S.judge[2].toFixed(1)} s. `,
    make("button", {textContent: "judge on all", onclick: () => act("judge", {run: S.judge[0], span: null})}));
  if (S.last.search?.failed && !before?.last.search?.failed) say(S.last.search.failed, true);
  const adding = S.running.some(one => one.kind === "add" || one.kind === "fit"), focus = document.activeElement?.dataset?.effect;
  const isWeak = row => row.certain.startsWith("not significant"), rows = search.rows || [], weak = rows.filter(isWeak);
  const named = rows.filter(row => row.found).map(row => row.effect), found = named.filter(name => !S.effects.includes(name));
  $("answer").replaceChildren(...(search.answer || []).map(([head, text]) => head !== "Missing" || !named.length ? [head, text] : found.length ? [head, listed(found) + "."] : ["Added", text]).map(([head, text]) => make("p", {}, make("b", {textContent: head ? head + ": " : ""}), text)));
  if (found.length > 1) $("answer").append(make("button", {id: "addfound", className: "main", textContent: found.length > 2 ? `Add all ${found.length}` : "Add both",
    disabled: adding, ariaLabel: "Add " + listed(found), onclick: () => begin("add", found)}));
  const shownAs = row => {
    const has = S.effects.includes(row.effect);
    const add = make("button", {textContent: has ? "added" : "Add", disabled: has || adding, ariaLabel: "Add " + row.effect, onclick: () => begin("add", row.effect)});
    add.dataset.effect = row.effect;
    const parts = [row.certain + (row.found?.length ? ", together with " + listed(row.found) : "")];
    if (row.prediction) parts.push(`error with it, fitted by likelihood: ${off(row.prediction)}`);
    if (row.group?.length) parts.push("is indistinguishable from " + row.group.join(", "));
    if (row.seen === false) parts.push("these runs cannot show it");
    return make("li", {}, add, make("b", {textContent: row.effect, className: row.selected ? "chosen" : ""}),
      row.meaning ? " " + row.meaning : "", make("div", {className: "less", textContent: row.size}), make("div", {className: "less", textContent: parts.join("; ")}));
  };
  $("effects").replaceChildren(...rows.filter(row => !isWeak(row)).map(shownAs));
  $("weak").replaceChildren(...weak.map(shownAs));
  $("others").hidden = !weak.length;
  $("count").textContent = `${weak.length} effect${weak.length > 1 ? "s are" : " is"} not significant`;
  if (focus) document.querySelector(`[data-effect="${CSS.escape(focus)}"]`)?.focus();
  if (search.proposal && !formula().any && triedOf === "") fill(search.proposal);
}
function showJobs(before) {
  const job = S.running.find(one => one.kind === "fit" || one.kind === "add");
  $("fit").disabled = Boolean(job);
  if (job) say(`${job.kind === "fit" ? "Fitting" : "Adding"}: ${job.told}${job.of > 1 ? `, ${job.done} of ${job.of}` : ""} …`);
  else if (S.running.some(one => one.kind === "page")) say("Saving …");
  else if (before && S.last.page && (before.running.some(one => one.kind === "page") || !before.last.page)) say(S.last.page.failed || `Saved in ${S.last.page.folder}: ${S.last.page.files.join(", ")}`, Boolean(S.last.page.failed));
  const ended = before?.running.find(one => one.kind === "fit" || one.kind === "add");
  if (!job && ended && S.last[ended.kind]?.failed) say(S.last[ended.kind].failed, true);
}
const begin = (kind, effect = null) => { begun = performance.now(); return act("begin", {kind, effect}); };

/* The formula */
const formula = () => { const found = {X: $("fX").value, Y: $("fY").value, N: $("fN").value}; return {...found, any: Boolean(found.X + found.Y + found.N)}; };
const check = later(250, async () => {
  const given = formula();
  entry = null; $("addformula").disabled = true;
  if (!given.any) { $("parsed").textContent = ""; return; }
  try {
    const proposed = S.search.proposal, same = proposed && ["X", "Y", "N"].every(c => (proposed.expression[c] || "") === given[c]);
    const found = await api("check", {formula: same ? proposed : {X: given.X, Y: given.Y, N: given.N}});
    entry = found.entry; triedOf = JSON.stringify(entry); $("addformula").disabled = false;
    $("parsed").dataset.units = Object.entries(found.units).map(([name, unit]) => `${name} in ${unit === "?" ? "an unknown unit" : unit}`).join(", ");
    $("parsed").textContent = `${$("parsed").dataset.units}; trying …`;
    await begin("try", entry);
  } catch (error) { $("parsed").replaceChildren(make("span", {className: "no", textContent: error.message})); }
});
function showTried() {
  const found = S.last.try;
  if (!entry || !found || S.running.some(one => one.kind === "try")) return;
  const units = $("parsed").dataset.units;
  if (found.failed) $("parsed").textContent = `${units}; ${found.failed}`;
  else $("parsed").replaceChildren(`${units}; error ${off(found.before)} → ${off(found.after)}: `, make("span", {className: found.helps ? "yes" : "no", textContent: found.helps ? "it helps" : "not shown to help"}));
}
function fill(proposal) { for (const c of "XYN") $("f" + c).value = (proposal.expression || {})[c] || ""; triedOf = "offered"; $("own").open = true; check(); }

/* Figures */
const at = () => ({run: view.run, node: S.current, from: view.from, to: view.to});
function styled(layout) {
  const faint = css("--lines"), text = css("--text");
  for (const name of Object.keys(layout).filter(name => /^[xy]axis/.test(name)))
    layout[name] = {gridcolor: faint, zerolinecolor: css("--less"), linecolor: faint, tickfont: {size: 10}, ...layout[name]};
  return {paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: {color: text, size: 11}, showlegend: false, uirevision: "same", ...layout};
}
const predictedOf = p => ({x: [p.t, p.t, p.t, p.y], y: [p.u, p.v, p.r, p.x]});
const line = (x, y, name, color, more = {}) => ({x, y, name, type: "scatter", mode: "lines", line: {color, width: 1.6}, hoverinfo: "x+y+name", ...more});
async function draw() {
  const mine = ++order, run = S.runs.find(one => one.name === view.run);
  try {
    const [measured, curves, beside] = await Promise.all([api("measured", at()), api("curves", at()), other ? api("curves", {...at(), node: Number(other)}) : null]);
    if (mine !== order) return;
    known = {measured, curves: curves.predicted};
    const grey = css("--measured"), colour = css("--model"), second = css("--other"), traces = [];
    VELOCITIES.forEach(([name], i) => traces.push(line(measured.t, measured[name], "measured", grey, {line: {color: grey, width: 4}, opacity: .6, yaxis: ["y", "y2", "y3"][i]})));
    traces.push(line(measured.y, measured.x, "measured", grey, {line: {color: grey, width: 4}, opacity: .6, xaxis: "x2", yaxis: "y5"}));
    const add = (p, name, color, dash) => { VELOCITIES.forEach(([c], i) => traces.push(line(p.t, p[c], name, color, {line: {color, width: 1.6, dash}, yaxis: ["y", "y2", "y3"][i]})));
      traces.push(line(p.y, p.x, name, color, {line: {color, width: 1.6, dash}, xaxis: "x2", yaxis: "y5"})); };
    known.places = [4, 5, 6, 7];
    add(curves.predicted, "predicted", colour);
    if (beside) add(beside.predicted, "model " + other, second, "dot");
    measured.channels.forEach((c, i) => traces.push(line(measured.t, c.y, "command " + c.name, COMMANDS[i % 4], {yaxis: "y4", line: {shape: "hv", width: 1.2, color: COMMANDS[i % 4], dash: i > 3 ? "dot" : "solid"}})));
    const keys = [["measured", grey], ["predicted", colour], ...(beside ? [["model " + other, second]] : []), ...measured.channels.map((c, i) => [(i < 2 ? "command " : "") + c.name, COMMANDS[i % 4]])];
    $("legend").replaceChildren(...keys.map(([text, color]) => { const key = make("span", {textContent: text}); key.style.setProperty("--key", color); return key; }),
      view.to - view.from > MOST || (!view.to && run.end > MOST) ? `predictions and missing force only for the first ${MOST} s: zoom in for more` : "");
    const range = [measured.t[0] ?? 0, measured.t[measured.t.length - 1] ?? 1], band = (i, count) => [1 - (i + 1) / count + .02, 1 - i / count];
    const shapes = run.cuts.map(([a, b]) => ({type: "rect", xref: "x", yref: "paper", x0: a, x1: b, y0: 0, y1: 1, fillcolor: "#888", opacity: .3, line: {width: 0}}));
    if (S.judge && S.judge[0] === view.run) shapes.push({type: "rect", xref: "x", yref: "paper", x0: S.judge[1], x1: S.judge[2], y0: 0, y1: 1, line: {color: "#e69f00", dash: "dash"}});
    const axis = (title, i) => ({title: {text: title, font: {size: 10}, standoff: 2}, domain: band(i, 4), nticks: 4});
    await Plotly.react($("motion"), traces, styled({margin: {t: 6, b: 32, l: 52, r: 8}, dragmode: $("brush").getAttribute("aria-pressed") === "true" ? "select" : "zoom", selectdirection: "h", shapes, hovermode: "x",
      xaxis: {domain: [0, .66], range, title: {text: "time [s]", standoff: 2}, anchor: "y4"}, yaxis: axis("u [m/s]", 0), yaxis2: axis("v [m/s]", 1), yaxis3: axis("r [rad/s]", 2), yaxis4: axis("command", 3),
      xaxis2: {domain: [.75, 1], anchor: "y5", title: {text: "y [m]", standoff: 2}, autorange: true}, yaxis5: {anchor: "x2", scaleanchor: "x2", title: {text: "x [m]", standoff: 0}, autorange: true}}), config);
    if (!window.timing.first) window.timing.first = performance.now();
    $("motion").dataset.drawn = drawnOf;
    listen("motion", range);
    drawMissing(mine, range);
  } catch (error) { if (mine === order) say(error.message, true); }
}
async function drawMissing(mine, range) {
  const found = await api("missing", at()).catch(error => { say(error.message, true); return null; });
  if (!found || mine !== order) return;
  known.missing = found;
  const colour = css("--model"), traces = [], layout = {margin: {t: 4, b: 30, l: 52, r: 8}, hovermode: "x", xaxis: {range, title: {text: "time [s]", standoff: 2}, anchor: "y3", domain: [0, .66]}};
  found.channels.forEach((c, i) => {
    const y = ["y", "y2", "y3"][i];
    traces.push(line([...found.t, ...found.t.slice().reverse()], [...c.low, ...c.high.slice().reverse()], "", colour, {yaxis: y, fill: "toself", fillcolor: colour + "40", line: {width: 0}, hoverinfo: "skip"}));
    traces.push(line(found.t, c.y, "missing " + c.name, colour, {yaxis: y}));
    layout["yaxis" + (i ? i + 1 : "")] = {title: {text: `${c.name} [${c.unit}]`, font: {size: 10}, standoff: 2}, domain: [1 - (i + 1) / 3 + .07, 1 - i / 3], nticks: 4, zeroline: true};
  });
  const share = c => c.stands_out * c.rms / c.full, largest = found.channels.slice().sort((a, b) => share(b) - share(a) || b.rms / b.full - a.rms / a.full)[0];
  if (!$("channel").dataset.chosen) $("channel").value = largest.name;
  const c = found.channels.find(one => one.name === $("channel").value), most = c.y.map(Math.abs).sort((a, b) => a - b)[Math.floor(.98 * (c.y.length - 1))] || 1;
  traces.push({x: found.y, y: found.x, mode: "markers", type: "scatter", xaxis: "x2", yaxis: "y4", customdata: found.t, hovertemplate: "%{marker.color:.3g}<extra></extra>",
    marker: {size: 4, color: c.y, colorscale: "RdBu", cmin: -most, cmax: most, showscale: true, colorbar: {title: {text: c.unit, font: {size: 9}}, thickness: 8, x: .93, tickfont: {size: 9}}}});
  Object.assign(layout, {xaxis2: {domain: [.75, .92], anchor: "y4", title: {text: "y [m]", standoff: 2}}, yaxis4: {anchor: "x2", scaleanchor: "x2", title: {text: "x [m]", standoff: 0}}});
  await Plotly.react($("wrench"), traces, styled(layout), config);
  listen("wrench", range);
  const names = Object.keys(found.against), wide = 1 / names.length, clouds = [], spread = {margin: {t: 4, b: 32, l: 52, r: 8}, yaxis: {title: {text: `missing ${c.name}<br>[${c.unit}]`, font: {size: 10}}, nticks: 4, zeroline: true}};
  names.forEach((name, i) => {
    const x = "x" + (i ? i + 1 : "");
    clouds.push({x: found.against[name], y: c.y, mode: "markers", type: "scatter", xaxis: x, customdata: found.t, marker: {size: 3, color: colour, opacity: .5}, hoverinfo: "x+y"});
    spread["xaxis" + (i ? i + 1 : "")] = {domain: [i * wide + (i ? .015 : 0), (i + 1) * wide], title: {text: name, font: {size: 10}, standoff: 2}, nticks: 4};
  });
  await Plotly.react($("against"), clouds, styled(spread), config);
  listen("against", range);
  $("worst").textContent = !largest.stands_out ? "nothing exceeds the noise"
    : `most in ${largest.name}: ${two(largest.rms)} ${largest.unit} rms, ${two(100 * largest.rms / largest.full)}% of ${largest.name === "N" ? "the moment of " : ""}full thrust`;
  $("wrench").dataset.drawn = drawnOf;
}

/* A zoom in one view is a part of the run, and all views show that part. */
const heard = new Set();
function listen(id, range) {
  shown = range;
  const plot = $(id);
  if (heard.has(id)) return;
  heard.add(id);
  plot.on("plotly_relayout", change => {
    const box = name => change[name + ".range[0]"] === undefined ? null : [change[name + ".range[0]"], change[name + ".range[1]"]].sort((a, b) => a - b);
    const inside = (values, reach) => values.map(value => !reach || (value >= reach[0] && value <= reach[1]));
    const times = (...pairs) => { let keep = known.missing.t.map(() => true); for (const [values, reach] of pairs) { const one = inside(values, reach); keep = keep.map((k, i) => k && one[i]); }
      const found = known.missing.t.filter((_, i) => keep[i]); return found.length > 3 ? [found[0], found[found.length - 1]] : null; };
    let part = null;
    if (Object.keys(change).some(name => name.endsWith("autorange"))) return whole();
    if (id === "against") {
      Object.keys(known.missing.against).forEach((name, i) => { const reach = box("xaxis" + (i ? i + 1 : "")); if (reach) part = times([known.missing.against[name], reach]); });
    } else {
      part = box("xaxis");
      const map = [box("xaxis2"), box(id === "motion" ? "yaxis5" : "yaxis4")];
      if (!part && (map[0] || map[1]) && known.missing) part = times([known.missing.y, map[0]], [known.missing.x, map[1]]);
    }
    if (part && part[1] - part[0] > .2) zoom(part[0], part[1]);
  });
  if (id === "motion") plot.on("plotly_selected", event => { if (event?.range?.x) mark(event.range.x); });
}
function zoom(from, to) { view = {...view, from: Math.max(0, from), to}; show(S); }
function whole() { const run = S.runs.find(one => one.name === view.run); zoom(0, run.end > 20 * LONG ? LONG : run.end + 1e9); view.to = 0; }
function mark(range) { [$("from").value, $("to").value] = range.slice().sort((a, b) => a - b).map(value => value.toFixed(2)); }
const stretch = () => [Number($("from").value), Number($("to").value)];

function showNext() {
  const next = S.search.next;
  if (!next) { $("next").hidden = true; if (S.search.state === "done") $("nexttext").textContent = "Nothing needed: these runs distinguish the effects."; return; }
  $("nexttext").replaceChildren(`${next.input}: it distinguishes ${listed(next.separates.filter(Boolean))}. The plot ends where the craft would leave the room; returns keep it inside. `, make("code", {textContent: next.launch}));
  if ($("next").dataset.of === next.launch) return;
  $("next").hidden = false; $("next").dataset.of = next.launch;
  const room = S.room || [[-2, -2], [2, -2], [2, 2], [-2, 2]], closed = [...room, room[0]];
  Plotly.react($("next"), [line(closed.map(p => p[1]), closed.map(p => p[0]), "room", css("--less")), line(next.path.y, next.path.x, "open loop", css("--model"))],
    styled({margin: {t: 5, b: 30, l: 40, r: 5}, xaxis: {title: {text: "y [m]"}}, yaxis: {title: {text: "x [m]"}, scaleanchor: "x"}}), config);
}

/* Buttons and keys */
$("fit").onclick = () => begin("fit");
$("undo").onclick = () => { const pressed = performance.now(); act("undo").then(() => window.timing.undo.push(performance.now() - pressed)); };
$("save").onclick = () => act("save");
$("search").onclick = () => begin("search");
$("addformula").onclick = () => entry && begin("add", entry);
$("run").onchange = () => { choose($("run").value); show(S); };
$("other").onchange = () => { other = $("other").value; show(S); };
$("channel").onchange = () => { $("channel").dataset.chosen = "yes"; drawMissing(order, shown); };
$("whole").onclick = whole;
$("brush").onclick = () => {
  const on = $("brush").getAttribute("aria-pressed") !== "true";
  $("brush").setAttribute("aria-pressed", on); $("brushed").hidden = !on;
  say(on ? "Drag over a stretch of the curves, or type its times." : "");
  if (on) mark(view.to ? [view.from, view.to] : shown);
  Plotly.relayout($("motion"), {dragmode: on ? "select" : "zoom"});
};
$("zoom").onclick = () => zoom(...stretch());
$("judge").onclick = () => act("judge", {run: view.run, span: stretch()});
$("cut").onclick = () => act("cut", {run: view.run, span: stretch()});
for (const c of "XYN") $("f" + c).oninput = check;
document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName)) return;
  const button = {f: "fit", u: "undo", s: "save"}[event.key];
  if (button) $(button).click();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => show(S));
const events = new EventSource("events?token=" + encodeURIComponent(token));
const changed = later(10, async () => { await fetching; if (!S || S.version !== newest) refresh(); });
events.onmessage = event => { newest = Number(event.data); changed(); };
events.onerror = () => say("The workbench does not answer. If it has ended, start it again: nothing is lost.", true);
events.onopen = () => { if ($("said").textContent.startsWith("The workbench does not")) say(""); };
refresh();
