// The drawing of a replay on a canvas: axes, nodes, transmissions, particles and targets.
// Colours come from style.css. Residual energy uses cividis, which colour-blind readers can distinguish.
const CLOSE_UP_NODES = 150, DASHES = [[], [6, 3], [2, 2], [8, 2, 2, 2], [12, 3], [3, 5]], OTHER_STYLE = 5;
const RING_DASHES = [[], [3, 2], [1, 2]];
const COLOUR_NAMES = ["ink", "soft", "faint", "line", "paper", "trajectory", "estimate", "gold", "head", "lost", "particle", "sense"];
const canvas = byId("drawing"), pen = canvas.getContext("2d");
const shown = { traffic: true, sensing: true, members: true, particles: true, trails: true, close: false };
let view = null, ramp = [];

const px = (x) => view.left + ((x / (MISSING - 1) - view.x0) / view.part) * view.width;
const py = (y) => view.top + (1 - (y / (MISSING - 1) - view.y0) / view.part) * view.height;
const within = (x, y) => x > view.left - 5 && x < view.left + view.width + 5 && y > view.top - 5 && y < view.top + view.height + 5;
const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();

function measure() {
  const [x0, y0, x1, y1] = replay.box, wide = canvas.clientWidth, border = { left: 46, right: 10, top: 10, bottom: 34 };
  const room = wide - border.left - border.right;
  const ratio = replay.flat ? 0.55 : (y1 - y0) / (x1 - x0);
  let width = room, height = room * ratio;
  const most = Math.max(160, Math.min(0.7 * innerHeight, innerHeight - 130) - border.top - border.bottom), least = 120;
  if (height > most) { height = most; if (!replay.flat) width = most / ratio; }
  if (height < least) height = least;
  const tall = Math.round(height + border.top + border.bottom), zoom = devicePixelRatio || 1;
  canvas.style.height = `${tall}px`;
  canvas.width = Math.round(wide * zoom);
  canvas.height = Math.round(tall * zoom);
  const span = replay.flat ? height : Math.min(height, width * ratio);
  view = { wide, high: innerHeight, left: border.left + (room - width) / 2, top: border.top + (height - span) / 2, width, height: span, zoom };
  Object.assign(view, { x0: 0, y0: 0, part: 1 });
  if (shown.close) view.part = Math.min(0.5, Math.max(0.01, Math.sqrt(CLOSE_UP_NODES / Math.max(replay.nodes, 1))));
  view.dot = Math.min(4.5, Math.max(0.8, 0.16 * Math.sqrt((width * span) / Math.max(replay.nodes * view.part * view.part, 1))));
  for (const name of COLOUR_NAMES) view[name] = css(`--${name}`);
  view.kinds = DASHES.map((_, i) => css(`--kind-${i}`));
  view.base = null;
}

function follow() {
  const at = replay.targets.map((_, target) => target * replay.frames + frame);
  const near = (name) => at.map((each) => [replay.col[`${name}_x`]?.[each], replay.col[`${name}_y`]?.[each]]).find(([x]) => x !== undefined && x !== MISSING);
  const spot = near("truth") ?? near("estimate");
  if (!spot) return;
  [view.x0, view.y0] = spot.map((each) => Math.min(1 - view.part, Math.max(0, each / (MISSING - 1) - view.part / 2)));
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

// Awake nodes are large with a thick outline, others small with a thin one. The fill shows the residual energy.
function node(pen, x, y, r, mode, level) {
  if (mode === DEAD) { marker(pen, "cross", x, y, Math.max(r, 2)); stroke(pen, view.soft, 1.4); return; }
  const asleep = mode === ASLEEP, tiny = r < 1.5;
  if (asleep && tiny) pen.fillStyle = view.faint;
  else if (replay.charge) pen.fillStyle = ramp[level];
  else pen.fillStyle = asleep ? view.paper : view.soft;
  marker(pen, "dot", x, y, asleep ? 0.7 * r : r);
  pen.fill();
  if (!tiny) stroke(pen, asleep ? view.soft : view.ink, asleep ? 0.7 : 1.5);
}

function drawNodes(pen, busy) {
  const { node_x: xs, node_y: ys } = replay.col;
  for (const i of replay.nodeGroups[busy]) {
    const x = px(xs[i]), y = py(ys[i]);
    if (within(x, y)) node(pen, x, y, view.dot + busy * (view.dot < 1.5 ? 1 : 0), replay.mode[i], replay.level[i]);
  }
}

function drawBackground() {
  const base = document.createElement("canvas");
  base.width = canvas.width; base.height = canvas.height;
  const pen = base.getContext("2d");
  pen.scale(view.zoom, view.zoom);
  axes(pen);
  drawNodes(pen, 0);
  return base;
}

function ticks(low, high, most = 7) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw * 0.999);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(+(i * step).toPrecision(6));
  return found;
}

function visibleRange() {
  const [left, bottom, right, top] = replay.box, across = right - left, up = top - bottom;
  return [left + view.x0 * across, left + (view.x0 + view.part) * across, bottom + view.y0 * up, bottom + (view.y0 + view.part) * up];
}

function axes(pen) {
  const { left, top, width, height } = view, [x0, x1, y0, y1] = visibleRange();
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
  pen.textAlign = "center"; pen.fillText(replay.axes[0], left + width / 2, top + height + 28);
  pen.save(); pen.translate(left - 36, top + height / 2); pen.rotate(-Math.PI / 2); pen.fillText(replay.axes[1], 0, 0); pen.restore();
}

function tracePath(name, target, first, until) {
  const xs = replay.col[`${name}_x`], ys = replay.col[`${name}_y`], from = target * replay.frames;
  let drawing = false;
  pen.beginPath();
  for (let i = from + Math.max(first, 0); i <= from + until; i++) {
    if (xs[i] === MISSING) { drawing = false; continue; }
    if (drawing) pen.lineTo(px(xs[i]), py(ys[i])); else pen.moveTo(px(xs[i]), py(ys[i]));
    drawing = true;
  }
}

function drawTraffic() {
  const { node_x: xs, node_y: ys, link_origin: origins, link_destination: destinations, link_message: messages, link_lost: lost } = replay.col;
  const [begin, end] = rows("link"), many = end - begin > 300;
  for (let i = begin; i < end; i++) {
    const x = px(xs[destinations[i]]), y = py(ys[destinations[i]]), x0 = px(xs[origins[i]]), y0 = py(ys[origins[i]]);
    const style = replay.style[messages[i]] || 0;
    pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x, y);
    stroke(pen, lost[i] ? view.lost : view.kinds[style], many ? 0.8 : 1.6, lost[i] ? [3, 3] : DASHES[style]);
    if (lost[i]) { marker(pen, "cross", x + (x0 - x) * 0.15, y + (y0 - y) * 0.15, 3.5); stroke(pen, view.lost, 1.6); }
    else if (!many) { marker(pen, "dot", x0 + (x - x0) * 0.7, y0 + (y - y0) * 0.7, 2.4); pen.fillStyle = view.kinds[style]; pen.fill(); }
  }
  const [first, until] = rows("broadcast");
  for (let i = first; i < until; i++) {
    const at = replay.col.broadcast_node[i];
    broadcastMark(pen, px(xs[at]), py(ys[at]), view.kinds[replay.style[replay.col.broadcast_message[i]] || 0]);
  }
}

function drawParticles() {
  const [begin, end] = rows("particle"), { particle_x: xs, particle_y: ys } = replay.col, full = MISSING - 1;
  if (begin === end) return;
  const [x0, dx, y0, dy] = ["x_low", "x_width", "y_low", "y_width"].map((name) => replay.col[`particle_${name}`][frame]);
  pen.fillStyle = view.particle;
  for (let i = begin; i < end; i++) {
    pen.fillRect(px((x0 + (xs[i] / 255) * dx) * full) - 1.1, py((y0 + (ys[i] / 255) * dy) * full) - 1.1, 2.2, 2.2);
  }
}

function truthMark(pen, x, y) { marker(pen, "plus", x, y, 8); stroke(pen, view.paper, 5); stroke(pen, view.ink, 2.4); }

function estimateMark(pen, x, y, outside) {
  marker(pen, "diamond", x, y, 6);
  pen.fillStyle = outside ? view.paper : view.gold; pen.fill(); stroke(pen, outside ? view.estimate : view.ink, outside ? 2 : 1.2);
}

// The radius of a mark around a node. From inside: cluster membership by target, sensing, broadcast.
const ring = (number) => view.dot + Math.max(1.3, Math.min(2.2, 0.55 * view.dot)) * number;

function headMark(pen, x, y) { marker(pen, "square", x, y, ring(2)); stroke(pen, view.head, 2.4); }

function broadcastMark(pen, x, y, colour) { marker(pen, "dot", x, y, ring(5)); stroke(pen, colour, 1.6, [4, 3]); }

// Each target has a ring of its own, because a node may belong to two clusters.
function memberMark(pen, x, y, target) {
  marker(pen, "dot", x, y, ring(1 + 0.8 * (target % RING_DASHES.length))); stroke(pen, view.ink, 1.2, RING_DASHES[target % RING_DASHES.length]);
}

// A disc, so that it differs from the rings of members by its form, too.
function senseMark(pen, x, y) {
  marker(pen, "dot", x, y, ring(1.6 + 0.8 * Math.min(replay.targets.length, RING_DASHES.length)));
  pen.globalAlpha = 0.38; pen.fillStyle = view.sense; pen.fill(); pen.globalAlpha = 1;
}

function drawTargetNumber(target, x, y, colour) {
  if (replay.targets.length > 1) numeral(replay.targets[target], x, y, colour);
}

function numeral(number, x, y, colour) {
  pen.font = "bold 12px system-ui, sans-serif"; pen.textAlign = "left"; pen.lineWidth = 3; pen.strokeStyle = view.paper;
  pen.strokeText(number, x, y); pen.fillStyle = colour; pen.fillText(number, x, y);
}

function drawTarget(target) {
  const at = target * replay.frames + frame, head = replay.col.head ? replay.col.head[at] : -1;
  if (shown.trails && replay.col.estimate_x) { tracePath("estimate", target, frame - replay.trail, frame); stroke(pen, view.estimate, 1.5); }
  if (head >= 0) {
    const x = px(replay.col.node_x[head]), y = py(replay.col.node_y[head]);
    headMark(pen, x, y); drawTargetNumber(target, x + ring(2) + 2, y + ring(2) + 8, view.head);
  }
  for (const name of ["truth", "estimate"]) {
    if (!replay.col[`${name}_x`]) continue;
    const x = replay.col[`${name}_x`][at], y = replay.col[`${name}_y`][at];
    if (x === MISSING) continue;
    const outside = [x, y].some((each) => each === 0 || each === MISSING - 1);
    if (name === "truth") { truthMark(pen, px(x), py(y)); drawTargetNumber(target, px(x) + 9, py(y) - 6, view.ink); }
    else { estimateMark(pen, px(x), py(y), outside); drawTargetNumber(target, px(x) - 16, py(y) - 6, view.estimate); }
  }
}

function trackMark(pen, x, y, number, confirmed) {
  const colour = view.kinds[number % OTHER_STYLE];
  marker(pen, "dot", x, y, 4); stroke(pen, colour, confirmed ? 2.4 : 0.8);
}

function detectionMark(pen, x, y, clutter) {
  marker(pen, clutter ? "cross" : "dot", x, y, clutter ? 2.4 : 1.8);
  if (clutter) stroke(pen, view.faint, 1); else { pen.fillStyle = view.sense; pen.fill(); }
}

function switchMark(pen, x, y) { marker(pen, "cross", x, y, 9); stroke(pen, view.paper, 6); stroke(pen, view.lost, 3); }

const rowsOfTracks = (first, until) => Array.from({ length: replay.from.track[until + 1] - replay.from.track[first] }, (_, i) => replay.from.track[first] + i);
const tracksNow = () => rowsOfTracks(frame, frame).filter((i) => replay.col.track_confirmed[i]).length;

function drawDetections() {
  const { detection_x: xs, detection_y: ys, detection_clutter: clutter } = replay.col;
  for (let [i, end] = rows("detection"); i < end; i++) detectionMark(pen, px(xs[i]), py(ys[i]), clutter[i]);
}

// Each track has a colour, by its number, and a trail of the same frames as a target.
function drawTracks() {
  const { track_x: xs, track_y: ys, track_number: numbers, track_confirmed: confirmed, switch_x: sx, switch_y: sy } = replay.col;
  if (!replay.from.track) return;
  const trails = new Map();
  for (const i of rowsOfTracks(shown.trails ? Math.max(0, frame - replay.trail) : frame, frame)) {
    if (!trails.has(numbers[i])) trails.set(numbers[i], []);
    trails.get(numbers[i]).push(i);
  }
  trails.forEach((each, number) => {
    const last = each[each.length - 1], colour = view.kinds[number % OTHER_STYLE];
    pen.beginPath(); each.forEach((i, k) => (k ? pen.lineTo(px(xs[i]), py(ys[i])) : pen.moveTo(px(xs[i]), py(ys[i]))));
    stroke(pen, colour, confirmed[last] ? 1.5 : 0.5);
    if (last < replay.from.track[frame]) return;
    trackMark(pen, px(xs[last]), py(ys[last]), number, confirmed[last]);
    if (confirmed[last]) numeral(number, px(xs[last]) + 7, py(ys[last]) + 12, colour);
  });
  for (let [i, end] = rows("switch"); i < end; i++) switchMark(pen, px(sx[i]), py(sy[i]));
}

function drawTrajectories() {
  if (!shown.trails || !replay.col.truth_x) return;
  replay.targets.forEach((_, target) => {
    tracePath("truth", target, frame - replay.trajectory, Math.min(frame + replay.trajectory, replay.frames - 1)); stroke(pen, view.trajectory, 1.2);
    tracePath("truth", target, frame - replay.trail, frame); stroke(pen, view.ink, 2);
  });
}

function drawRings() {
  const { node_x: xs, node_y: ys, sense_node: senses } = replay.col;
  if (shown.sensing) for (let [i, end] = rows("sense"); i < end; i++) senseMark(pen, px(xs[senses[i]]), py(ys[senses[i]]));
  if (shown.members) replay.clusters.forEach((each, target) => each.forEach((i) => memberMark(pen, px(xs[i]), py(ys[i]), target)));
}

function draw() {
  if (!view) measure();
  advance(frame);
  if (shown.close) { follow(); view.base = null; }
  if (!view.base) view.base = drawBackground();
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.drawImage(view.base, 0, 0);
  pen.setTransform(view.zoom, 0, 0, view.zoom, 0, 0);
  pen.save();
  pen.beginPath(); pen.rect(view.left - 9, view.top - 9, view.width + 18, view.height + 18); pen.clip();
  drawTrajectories();
  if (shown.particles) drawParticles();
  if (shown.sensing) drawDetections();
  drawNodes(pen, 1);
  drawRings();
  if (shown.traffic) drawTraffic();
  replay.targets.forEach((_, target) => drawTarget(target));
  drawTracks();
  pen.restore();
  canvas.dispatchEvent(new Event("drawn"));
}
