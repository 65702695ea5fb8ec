// The page: what the session tells is drawn, what the hand does is asked of the session.

import { add, COLOURS, label, rangeOf, View } from "./drawing.js";

const by = id => document.getElementById(id);
const socket = new WebSocket(`ws://${location.host}/socket`);
const own = { mechanism: null, state: null, folds: null, diagram: null, dragging: false, falling: 0 };
const asked = new Map(); // when what was asked
const waiting = {}; // what passes is asked one at a time, and of many the last
let count = 0;
const STEP = 0.02; // of a key, as part of an input's range
const FALL = 900; // ms
window.explorer = { own, latencies: [], errors: [] }; // for those who measure

function ask(kind, content = {}) {
  if (socket.readyState !== WebSocket.OPEN) return;
  const id = ++count;
  asked.set(id, { kind, begin: performance.now() });
  socket.send(JSON.stringify({ kind, id, ...content }));
}
function pass(kind, content) { // one that the next of its kind may overtake
  if (own.falling) return;
  if (waiting.busy) waiting.next = [kind, content];
  else { waiting.busy = true; ask(kind, content); }
}
function tell(text, wrong = false) {
  by("notice").textContent = text;
  by("notice").classList.toggle("wrong", wrong);
}

socket.onmessage = event => {
  const content = JSON.parse(event.data), from = asked.get(content.answers);
  asked.delete(content.answers);
  if (from && ["drive", "drag", "load"].includes(from.kind)) {
    window.explorer.latencies.push({ kind: from.kind, ms: performance.now() - from.begin });
    waiting.busy = false;
    if (waiting.next) { const next = waiting.next; waiting.next = null; pass(...next); }
  }
  take[content.kind](content);
};
socket.onclose = () => tell("The explorer has gone away: start it again and load this page anew.", true);
socket.onopen = () => tell("Ready.");

const take = {
  mechanism(content) {
    Object.assign(own, { mechanism: content.mechanism, folds: null, diagram: null, dragging: false });
    fill(by("names"), content.names, content.names.includes(own.mechanism.name) ? own.mechanism.name : "");
    makeSliders();
    makeChoices();
    own.state = content.state;
    drawFolds();
    take.state(content.state);
    drawDiagram();
    if (own.mechanism.dof === 2) ask("folds");
  },
  state(content) {
    const load = own.state && own.state.load;
    own.state = content;
    if (content.fall) { animate(content.fall); tell(`${content.message} ${content.fall.message}`); }
    else if (content.message) tell(content.message);
    else tell(`${content.equilibria.length} equilibria, ${content.equilibria.filter(each => each.is_stable).length} stable.`);
    if (load && load.some((value, n) => value !== content.load[n]) && own.folds && !own.folds.stale) {
      own.folds.stale = true;
      drawFolds();
    }
    draw();
  },
  folds(content) { if (content.name === own.mechanism.name) { own.folds = content; drawFolds(); draw(); } },
  diagram(content) { own.diagram = content; drawDiagram(); tell(`${content.branches.length} branches, ${content.points.length} special points.`); },
  refused(content) {
    if (content.answers === null) waiting.busy = false;
    tell(content.reason, true); window.explorer.errors.push(content.reason);
  },
  file(content) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([content.text]));
    link.download = content.name;
    link.click();
    URL.revokeObjectURL(link.href);
  },
};

function fill(select, names, chosen) {
  select.replaceChildren(...names.map(name => new Option(name, name, false, name === chosen)));
  if (!chosen) select.selectedIndex = -1;
}
function chosen() { return own.state.equilibria[own.state.number]; }

function makeSliders() {
  const { legs, loads, dof } = own.mechanism, sliders = by("sliders");
  sliders.replaceChildren();
  legs.forEach((leg, n) => sliders.append(slider(`Input ${n + 1}, ${leg.is_angle ? "rad" : "m"}`, ...leg.limits,
    value => { const inputs = [...own.state.inputs]; inputs[n] = value; pass("drive", { inputs }); }, "inputs", n)));
  ["Fx, N", "Fy, N", "M, N m"].slice(0, dof).forEach((name, n) => sliders.append(slider(`Load ${name}`, -20 * loads[n], 20 * loads[n],
    value => { const load = [...own.state.load]; load[n] = value; pass("load", { load }); }, "load", n)));
}
function slider(name, low, high, move, group, n) {
  const box = document.createElement("label"), range = document.createElement("input"), number = document.createElement("input");
  Object.assign(range, { type: "range", min: low, max: high, step: (high - low) / 1000 });
  Object.assign(number, { type: "number", step: "any" });
  number.setAttribute("aria-label", name);
  for (const input of [range, number]) {
    Object.assign(input.dataset, { group, n });
    const event = input === range ? "input" : "change";
    input.addEventListener(event, () => { if (Number.isFinite(input.valueAsNumber)) move(input.valueAsNumber); });
  }
  box.append(name, range, number);
  return box;
}
function makeChoices() {
  const { legs, dof } = own.mechanism;
  const lines = [...legs.map((_, n) => [`input ${n + 1}`, `input ${n}`]), ...["Fx", "Fy", "M"].slice(0, dof).map((name, n) => [`load ${name}`, `load ${n}`])];
  by("along").replaceChildren(...lines.map(([text, value]) => new Option(text, value)));
  by("ordinate").replaceChildren(...["energy", "x", "y", "phi"].slice(0, dof + 1).map(name => new Option(name, name)));
}

function draw() {
  drawScene();
  markFolds();
  markDiagram();
  drawTable();
  const there = chosen(), margin = there.singularity_margin ?? 0;
  by("bar").style.width = `${100 * Math.min(1, Math.sqrt(margin))}%`;
  by("bar").classList.toggle("near", margin < 0.1);
  by("margin").textContent = there.is_stable ? label(margin) : "unstable";
  by("release").disabled = there.is_stable;
  for (const input of document.querySelectorAll("#sliders input")) {
    if (document.activeElement !== input) input.value = own.state[input.dataset.group][input.dataset.n];
    if (input.type === "number" && document.activeElement !== input) input.value = Number(Number(input.value).toPrecision(5));
  }
}

const scene = by("scene");
function drawScene() {
  const view = own.view = new View(scene, own.mechanism.bounds, { equal: true });
  scene.replaceChildren();
  for (const leg of own.mechanism.legs) {
    if (leg.rail) view.line(scene, leg.rail, COLOURS.metal, 5, { "stroke-linecap": "round" });
    else view.dot(scene, leg.base, 11, "#dfe4ea", COLOURS.metal);
  }
  if (own.limits) scene.append(own.limits);
  own.state.equilibria.forEach((each, n) => { if (n !== own.state.number) drawOne(view, each, n); });
  if (!own.falling) drawOne(view, chosen(), own.state.number, true);
}
function drawOne(view, each, n, isChosen = false) {
  const colour = isChosen ? COLOURS.chosen : each.is_stable ? COLOURS.stable : COLOURS.unstable;
  const group = add(scene, "g", { opacity: isChosen ? 1 : 0.55, "data-number": n, class: "equilibrium" });
  if (!isChosen) group.addEventListener("click", () => ask("pick", { number: n }));
  if (each.platform) add(group, "polygon", { points: view.points(each.platform), fill: colour, "fill-opacity": 0.15, stroke: colour });
  for (const rod of each.rods) {
    if (!isChosen) view.line(group, rod, "transparent", 14);
    view.line(group, rod, colour, isChosen ? 5 : 2, each.is_stable ? {} : { "stroke-dasharray": "9 6" });
  }
  if (isChosen) own.handle = view.dot(group, each.pose, 12, COLOURS.chosen);
  else view.dot(group, each.pose, 5, colour);
}

scene.addEventListener("pointerdown", event => {
  const [x, y] = own.view.place(event), [hx, hy] = chosen().pose;
  if (Math.hypot(x - own.view.x(hx), y - own.view.y(hy)) > 26) return;
  own.dragging = true;
  scene.setPointerCapture(event.pointerId);
});
scene.addEventListener("pointermove", event => { if (own.dragging) pass("drag", { place: own.view.world(event) }); });
for (const kind of ["pointerup", "pointercancel"]) scene.addEventListener(kind, () => { own.dragging = false; });

// Between the two shapes of a fall the picture goes evenly: where it begins and ends is computed, the way is drawn.
function animate(fall) {
  const first = fall.from, last = chosen(), begin = performance.now();
  own.falling++;
  own.dragging = false;
  function frame(now) {
    const part = Math.min(1, (now - begin) / FALL), eased = part * part * (3 - 2 * part);
    const blend = (a, b) => a.map((p, k) => [p[0] + eased * (b[k][0] - p[0]), p[1] + eased * (b[k][1] - p[1])]);
    drawScene();
    const between = { ...last, is_stable: true, rods: first.rods.map((rod, k) => blend(rod, last.rods[k])),
      pose: blend([first.pose], [last.pose])[0], platform: last.platform && blend(first.platform, last.platform) };
    drawOne(own.view, between, -1, true);
    if (part < 1) requestAnimationFrame(frame);
    else { own.falling--; draw(); }
  }
  requestAnimationFrame(frame);
}

function drawFolds() {
  const svg = by("folds"), { legs } = own.mechanism;
  svg.replaceChildren();
  const view = new View(svg, [...legs[0].limits, ...legs[1].limits], { width: 420, height: 420, margin: [26, 14, 44, 56] });
  view.axes(["input 1", "input 2"]);
  const clip = "inputs-window", [x0, x1] = legs[0].limits, [y0, y1] = legs[1].limits;
  add(add(svg, "clipPath", { id: clip }), "rect", { x: view.x(x0), y: view.y(y1), width: view.x(x1) - view.x(x0), height: view.y(y0) - view.y(y1) });
  const group = add(svg, "g", { "clip-path": `url(#${clip})` });
  if (own.folds && !own.folds.stale) for (const curve of own.folds.curves) {
    const periods = legs.slice(0, 2).map(leg => leg.is_angle && leg.limits[1] - leg.limits[0] > 6.28 ? 2 * Math.PI : 0);
    for (const shift of shifts(periods))
      view.line(group, curve.inputs.map(([x, y]) => [x + shift[0], y + shift[1]]), curve.is_limit ? COLOURS.limit : COLOURS.other, curve.is_limit ? 2.5 : 1);
  } else add(svg, "text", { x: view.x((x0 + x1) / 2), y: view.y((y0 + y1) / 2), "text-anchor": "middle", fill: COLOURS.text },
    own.folds ? "The load has changed: draw the map." : own.mechanism.dof === 2 ? "Searching for folds …" : "Draw the map: it takes a while.");
  own.map = { view, dot: view.dot(svg, own.state.inputs, 7, COLOURS.chosen) };
  own.limits = null; // of stability, where they bring the end-effector: drawn once, they stay
  if (own.folds && !own.folds.stale) {
    const plane = new View(scene, own.mechanism.bounds, { equal: true });
    own.limits = add(scene, "g", { opacity: 0.35 });
    for (const curve of own.folds.curves) if (curve.is_limit) plane.line(own.limits, curve.poses, COLOURS.limit, 1);
  }
}
function markFolds() {
  const [x, y] = own.state.inputs, { view, dot } = own.map;
  dot.setAttribute("cx", view.x(x));
  dot.setAttribute("cy", view.y(y));
}
function shifts(periods) {
  const along = period => (period ? [-period, 0, period] : [0]);
  return along(periods[0]).flatMap(x => along(periods[1]).map(y => [x, y]));
}

function ordinate() { return { energy: -1, x: 0, y: 1, phi: 2 }[by("ordinate").value]; }
function height(branch, k) { const n = ordinate(); return n < 0 ? branch.energy[k] : branch.pose[k][n]; }
function drawDiagram() {
  const svg = by("diagram"), diagram = own.diagram;
  svg.replaceChildren();
  own.plot = null;
  if (!diagram) {
    svg.setAttribute("viewBox", "0 0 600 340");
    add(svg, "text", { x: 300, y: 170, "text-anchor": "middle", fill: COLOURS.text }, "Choose a line and draw.");
    return;
  }
  const heights = diagram.branches.flatMap(branch => branch.abscissa.map((_, k) => height(branch, k)));
  const width = Math.min(Math.max(svg.clientWidth, 320), 800); // so that words are as large as elsewhere
  const view = own.plot = new View(svg, [...diagram.range, ...rangeOf(heights)],
    { width, height: Math.max(0.58 * width, 260), margin: [26, 14, 44, 60] });
  view.axes([`${diagram.along} ${diagram.axis + 1}`, by("ordinate").value]);
  for (const branch of diagram.branches) for (const [first, last, index] of branch.pieces) {
    const line = [];
    for (let k = first; k <= last; k++) line.push([branch.abscissa[k], height(branch, k)]);
    view.line(svg, line, index ? COLOURS.unstable : COLOURS.stable, index ? 1.3 : 2.5, index ? { "stroke-dasharray": "5 4" } : {});
  }
  for (const point of diagram.points) {
    const branch = diagram.branches[point.branch], colour = point.kind === "fold" ? COLOURS.limit : COLOURS.crossing;
    add(view.dot(svg, [branch.abscissa[point.vertex], height(branch, point.vertex)], 5, "#fff", colour), "title", {}, point.kind);
  }
  own.mark = view.dot(svg, [0, 0], 6, COLOURS.chosen);
  markDiagram();
}
function markDiagram() {
  if (!own.plot || !own.diagram) return;
  const { along, axis } = own.diagram, n = ordinate(), there = chosen();
  const at = own.state[along === "input" ? "inputs" : "load"][axis];
  own.mark.setAttribute("cx", own.plot.x(at));
  own.mark.setAttribute("cy", own.plot.y(n < 0 ? there.energy : there.pose[n]));
}
by("diagram").addEventListener("click", event => {
  if (!own.plot) return;
  const [x, y] = own.plot.place(event);
  let best = [Infinity];
  own.diagram.branches.forEach((branch, number) => branch.abscissa.forEach((at, k) => {
    const distance = Math.hypot(own.plot.x(at) - x, own.plot.y(height(branch, k)) - y);
    if (distance < best[0]) best = [distance, number, k];
  }));
  if (best[0] < 30) ask("go", { branch: best[1], vertex: best[2] });
});

function drawTable() {
  const { legs } = own.mechanism, rows = own.state.equilibria;
  const names = ["", "energy, J", "index", "margin to a fold", "modes", ...legs.map((_, n) => `stress ${n + 1}`),
    ...legs.map((leg, n) => (leg.is_angle ? `torque ${n + 1}, N m` : `force ${n + 1}, N`)), "largest rho"];
  by("columns").replaceChildren(...names.map(name => Object.assign(document.createElement("th"), { textContent: name })));
  by("rows").replaceChildren(...rows.map((each, n) => {
    const row = document.createElement("tr");
    row.className = n === own.state.number ? "chosen" : "";
    row.dataset.number = n;
    row.tabIndex = 0;
    const cells = [n, each.energy, each.is_stable ? "0, stable" : each.index, each.singularity_margin, each.modes.join(", "),
      ...each.stress.map(value => (value === null ? "–" : `${(100 * value).toFixed(0)} %`)), ...each.efforts, each.rho];
    row.append(...cells.map(value => Object.assign(document.createElement("td"), { textContent: label(value) })));
    row.addEventListener("click", () => ask("pick", { number: n }));
    row.addEventListener("keydown", event => { if (event.key === "Enter") ask("pick", { number: n }); });
    return row;
  }));
}

by("names").addEventListener("change", event => ask("choose", { name: event.target.value }));
by("file").addEventListener("change", async event => {
  const [file] = event.target.files;
  if (file) ask("read", { text: await file.text() });
  event.target.value = "";
});
for (const button of document.querySelectorAll("[data-form]")) button.addEventListener("click", () => ask("export", { form: button.dataset.form }));
by("release").addEventListener("click", () => ask("release"));
by("map").addEventListener("click", () => { own.folds = null; drawFolds(); ask("folds"); });
by("diagram-button").addEventListener("click", () => {
  const [along, axis] = by("along").value.split(" ");
  tell("Searching for all branches …");
  ask("diagram", { along, axis: Number(axis) });
});
by("ordinate").addEventListener("change", drawDiagram);
addEventListener("resize", () => { if (own.mechanism) drawDiagram(); });
addEventListener("keydown", event => {
  const keys = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1] };
  if (!keys[event.key] || /INPUT|SELECT/.test(event.target.tagName) || !own.state) return;
  event.preventDefault();
  const [n, sign] = keys[event.key], [low, high] = own.mechanism.legs[n].limits, inputs = [...own.state.inputs];
  inputs[n] += sign * STEP * (high - low);
  pass("drive", { inputs });
});
