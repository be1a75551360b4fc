// A film's picture on a canvas: axes, nodes, frames in flight, particles, targets; film.js says what is where.
// Colours come from style.css, those of charge are cividis: the colour-blind tell them apart, and forms differ, too.
const NEAR = 150, DASHES = [[], [6, 3], [2, 2], [8, 2, 2, 2], [12, 3], [3, 5]], OTHER = 5;
const RINGS = [[], [3, 2], [1, 2]];
const PAINTS = ["ink", "soft", "faint", "line", "paper", "way", "guess", "gold", "head", "lost", "particle", "sense"];
const canvas = byId("stage"), pen = canvas.getContext("2d");
const shown = { frames: true, sensing: true, members: true, particles: true, trails: true, close: false };
let view = null, ramp = [];

const px = (x) => view.left + ((x / (NOWHERE - 1) - view.x0) / view.part) * view.width;
const py = (y) => view.top + (1 - (y / (NOWHERE - 1) - view.y0) / view.part) * view.height;
const within = (x, y) => x > view.left - 5 && x < view.left + view.width + 5 && y > view.top - 5 && y < view.top + view.height + 5;
const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();

function measure() {
  const [x0, y0, x1, y1] = film.box, wide = canvas.clientWidth, border = { left: 46, right: 10, top: 10, bottom: 34 };
  const room = wide - border.left - border.right;
  const ratio = film.flat ? 0.55 : (y1 - y0) / (x1 - x0);
  let width = room, height = room * ratio;
  const most = Math.max(160, Math.min(0.78 * innerHeight, innerHeight - 130) - border.top - border.bottom), least = 120;
  if (height > most) { height = most; if (!film.flat) width = most / ratio; }
  if (height < least) height = least;
  const tall = Math.round(height + border.top + border.bottom), zoom = devicePixelRatio || 1;
  canvas.style.height = `${tall}px`;
  canvas.width = Math.round(wide * zoom);
  canvas.height = Math.round(tall * zoom);
  const span = film.flat ? height : Math.min(height, width * ratio);
  view = { wide, high: innerHeight, left: border.left + (room - width) / 2, top: border.top + (height - span) / 2, width, height: span, zoom };
  Object.assign(view, { x0: 0, y0: 0, part: 1 });
  if (shown.close) view.part = Math.min(0.5, Math.max(0.01, Math.sqrt(NEAR / Math.max(film.nodes, 1))));
  view.dot = Math.min(4.5, Math.max(0.8, 0.16 * Math.sqrt((width * span) / Math.max(film.nodes * view.part * view.part, 1))));
  for (const name of PAINTS) view[name] = css(`--${name}`);
  view.kinds = DASHES.map((_, i) => css(`--kind-${i}`));
  view.base = null;
}

function follow() {
  const at = film.targets.map((_, target) => target * film.frames + frame);
  const near = (name) => at.map((each) => [film.col[`${name}_x`]?.[each], film.col[`${name}_y`]?.[each]]).find(([x]) => x !== undefined && x !== NOWHERE);
  const spot = near("truth") ?? near("guess");
  if (!spot) return;
  [view.x0, view.y0] = spot.map((each) => Math.min(1 - view.part, Math.max(0, each / (NOWHERE - 1) - view.part / 2)));
}

function marker(pen, shape, x, y, r) {
  pen.beginPath();
  if (shape === "dot") pen.arc(x, y, r, 0, 7);
  if (shape === "square") pen.rect(x - r, y - r, 2 * r, 2 * r);
  if (shape === "diamond") { pen.moveTo(x, y - r); pen.lineTo(x + r, y); pen.lineTo(x, y + r); pen.lineTo(x - r, y); pen.closePath(); }
  if (shape === "plus") { pen.moveTo(x - r, y); pen.lineTo(x + r, y); pen.moveTo(x, y - r); pen.lineTo(x, y + r); }
  if (shape === "cross") { pen.moveTo(x - r, y - r); pen.lineTo(x + r, y + r); pen.moveTo(x - r, y + r); pen.lineTo(x + r, y - r); }
}

function stroke(pen, colour, width, dash = []) {
  pen.strokeStyle = colour; pen.lineWidth = width; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
}

// Awake: large, with a strong outline; at rest: small, with a thin one. The fill is the charge either way.
function node(pen, x, y, r, mode, level) {
  if (mode === DEAD) { marker(pen, "cross", x, y, Math.max(r, 2)); stroke(pen, view.soft, 1.4); return; }
  const rest = mode === REST, tiny = r < 1.5;
  if (rest && tiny) pen.fillStyle = view.faint;
  else if (film.charge) pen.fillStyle = ramp[level];
  else pen.fillStyle = rest ? view.paper : view.soft;
  marker(pen, "dot", x, y, rest ? 0.7 * r : r);
  pen.fill();
  if (!tiny) stroke(pen, rest ? view.soft : view.ink, rest ? 0.7 : 1.5);
}

function drawNodes(pen, busy) {
  const { node_x: xs, node_y: ys } = film.col;
  for (const i of film.sorted[busy]) {
    const x = px(xs[i]), y = py(ys[i]);
    if (within(x, y)) node(pen, x, y, view.dot + busy * (view.dot < 1.5 ? 1 : 0), film.mode[i], film.level[i]);
  }
}

function resting() {
  const base = document.createElement("canvas");
  base.width = canvas.width; base.height = canvas.height;
  const pen = base.getContext("2d");
  pen.scale(view.zoom, view.zoom);
  axes(pen);
  drawNodes(pen, 0);
  return base;
}

function ticks(low, high) {
  const raw = (high - low) / 7, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw * 0.999);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(+(i * step).toPrecision(6));
  return found;
}

function seen() {
  const [left, bottom, right, top] = film.box, across = right - left, up = top - bottom;
  return [left + view.x0 * across, left + (view.x0 + view.part) * across, bottom + view.y0 * up, bottom + (view.y0 + view.part) * up];
}

function axes(pen) {
  const { left, top, width, height } = view, [x0, x1, y0, y1] = seen();
  pen.font = "11px system-ui, sans-serif"; pen.fillStyle = view.soft;
  pen.beginPath(); pen.rect(left, top, width, height);
  for (const x of ticks(x0, x1)) {
    const at = left + ((x - x0) / (x1 - x0)) * width;
    pen.moveTo(at, top); pen.lineTo(at, top + height);
    pen.textAlign = "center"; pen.fillText(x, at, top + height + 13);
  }
  for (const y of ticks(y0, y1)) {
    const at = top + (1 - (y - y0) / (y1 - y0)) * height;
    pen.moveTo(left, at); pen.lineTo(left + width, at);
    pen.textAlign = "right"; pen.fillText(y, left - 5, at + 4);
  }
  stroke(pen, view.line, 0.6);
  pen.textAlign = "center"; pen.fillText(film.axes[0], left + width / 2, top + height + 28);
  pen.save(); pen.translate(left - 36, top + height / 2); pen.rotate(-Math.PI / 2); pen.fillText(film.axes[1], 0, 0); pen.restore();
}

function way(name, target, first, until) {
  const xs = film.col[`${name}_x`], ys = film.col[`${name}_y`], from = target * film.frames;
  let drawing = false;
  pen.beginPath();
  for (let i = from + Math.max(first, 0); i <= from + until; i++) {
    if (xs[i] === NOWHERE) { drawing = false; continue; }
    if (drawing) pen.lineTo(px(xs[i]), py(ys[i])); else pen.moveTo(px(xs[i]), py(ys[i]));
    drawing = true;
  }
}

function drawLinks() {
  const { node_x: xs, node_y: ys, link_origin: origins, link_goal: goals, link_what: words, link_lost: lost } = film.col;
  const [begin, end] = rows("link"), many = end - begin > 300;
  for (let i = begin; i < end; i++) {
    const x = px(xs[goals[i]]), y = py(ys[goals[i]]), x0 = px(xs[origins[i]]), y0 = py(ys[origins[i]]);
    const style = film.style[words[i]] || 0;
    pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x, y);
    stroke(pen, lost[i] ? view.lost : view.kinds[style], many ? 0.8 : 1.6, lost[i] ? [3, 3] : DASHES[style]);
    if (lost[i]) { marker(pen, "cross", x + (x0 - x) * 0.15, y + (y0 - y) * 0.15, 3.5); stroke(pen, view.lost, 1.6); }
    else if (!many) { marker(pen, "dot", x0 + (x - x0) * 0.7, y0 + (y - y0) * 0.7, 2.4); pen.fillStyle = view.kinds[style]; pen.fill(); }
  }
  const [first, until] = rows("cast");
  for (let i = first; i < until; i++) {
    const at = film.col.cast_node[i];
    castMark(pen, px(xs[at]), py(ys[at]), view.kinds[film.style[film.col.cast_what[i]] || 0]);
  }
}

function drawCloud() {
  const [begin, end] = rows("cloud"), { cloud_x: xs, cloud_y: ys } = film.col, full = NOWHERE - 1;
  if (begin === end) return;
  const [x0, dx, y0, dy] = ["x_low", "x_width", "y_low", "y_width"].map((name) => film.col[`cloud_${name}`][frame]);
  pen.fillStyle = view.particle;
  for (let i = begin; i < end; i++) {
    pen.fillRect(px((x0 + (xs[i] / 255) * dx) * full) - 1.1, py((y0 + (ys[i] / 255) * dy) * full) - 1.1, 2.2, 2.2);
  }
}

function truthMark(pen, x, y) { marker(pen, "plus", x, y, 8); stroke(pen, view.paper, 5); stroke(pen, view.ink, 2.4); }

function guessMark(pen, x, y, beyond) {
  marker(pen, "diamond", x, y, 6);
  pen.fillStyle = beyond ? view.paper : view.gold; pen.fill(); stroke(pen, beyond ? view.guess : view.ink, beyond ? 2 : 1.2);
}

// Rings around a node, from inside: membership of each target's cluster, sensing, broadcast; close where dots are small.
const ring = (number) => view.dot + Math.max(1.3, Math.min(2.2, 0.55 * view.dot)) * number;

function headMark(pen, x, y) { marker(pen, "square", x, y, ring(2)); stroke(pen, view.head, 2.4); }

function castMark(pen, x, y, colour) { marker(pen, "dot", x, y, ring(5)); stroke(pen, colour, 1.6, [4, 3]); }

// Each target's members have a ring of their own: a node may belong to two clusters.
function memberMark(pen, x, y, target) {
  marker(pen, "dot", x, y, ring(1 + 0.8 * (target % RINGS.length))); stroke(pen, view.ink, 1.2, RINGS[target % RINGS.length]);
}

function senseMark(pen, x, y) {
  marker(pen, "dot", x, y, ring(1.2 + 0.8 * Math.min(film.targets.length, RINGS.length))); stroke(pen, view.sense, 1.8);
}

function numbered(target, x, y, colour) {
  if (film.targets.length < 2) return;
  pen.font = "bold 12px system-ui, sans-serif"; pen.textAlign = "left"; pen.lineWidth = 3; pen.strokeStyle = view.paper;
  pen.strokeText(film.targets[target], x, y); pen.fillStyle = colour; pen.fillText(film.targets[target], x, y);
}

function drawTarget(target) {
  const at = target * film.frames + frame, leader = film.col.head ? film.col.head[at] : -1;
  if (shown.trails && film.col.guess_x) { way("guess", target, frame - film.trail, frame); stroke(pen, view.guess, 1.5); }
  if (leader >= 0) {
    const x = px(film.col.node_x[leader]), y = py(film.col.node_y[leader]);
    headMark(pen, x, y); numbered(target, x + ring(2) + 2, y + ring(2) + 8, view.head);
  }
  for (const name of ["truth", "guess"]) {
    if (!film.col[`${name}_x`]) continue;
    const x = film.col[`${name}_x`][at], y = film.col[`${name}_y`][at];
    if (x === NOWHERE) continue;
    const beyond = [x, y].some((each) => each === 0 || each === NOWHERE - 1);
    if (name === "truth") { truthMark(pen, px(x), py(y)); numbered(target, px(x) + 9, py(y) - 6, view.ink); }
    else { guessMark(pen, px(x), py(y), beyond); numbered(target, px(x) - 16, py(y) - 6, view.guess); }
  }
}

function drawWays() {
  if (!shown.trails || !film.col.truth_x) return;
  film.targets.forEach((_, target) => {
    way("truth", target, frame - film.way, Math.min(frame + film.way, film.frames - 1)); stroke(pen, view.way, 1.2);
    way("truth", target, frame - film.trail, frame); stroke(pen, view.ink, 2);
  });
}

function drawRings() {
  const { node_x: xs, node_y: ys, sense_node: senses } = film.col;
  if (shown.members) film.clusters.forEach((each, target) => each.forEach((i) => memberMark(pen, px(xs[i]), py(ys[i]), target)));
  if (shown.sensing) for (let [i, end] = rows("sense"); i < end; i++) senseMark(pen, px(xs[senses[i]]), py(ys[senses[i]]));
}

function draw() {
  if (!view) measure();
  advance(frame);
  if (shown.close) { follow(); view.base = null; }
  if (!view.base) view.base = resting();
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.drawImage(view.base, 0, 0);
  pen.setTransform(view.zoom, 0, 0, view.zoom, 0, 0);
  pen.save();
  pen.beginPath(); pen.rect(view.left - 9, view.top - 9, view.width + 18, view.height + 18); pen.clip();
  drawWays();
  if (shown.particles) drawCloud();
  drawNodes(pen, 1);
  drawRings();
  if (shown.frames) drawLinks();
  film.targets.forEach((_, target) => drawTarget(target));
  pen.restore();
}
