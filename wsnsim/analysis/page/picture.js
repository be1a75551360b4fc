// A replay's film, and its picture on a canvas. What is read here is described in film.py; replay.js turns the pages.
// The colours of frames and marks are those of Okabe and Ito, those of charge are cividis: the colour-blind tell them apart.
const REST = 0, DEAD = 2, NOWHERE = 65535, TRAIL = 60, WAY = 1000, FEW = 4000, NEAR = 150;
const BLUE = "#0072B2", ORANGE = "#E69F00", VERMILLION = "#D55E00", SKY = "#56B4E9";
const WORDS = ["#56B4E9", "#CC79A7", "#009E73", "#0072B2", "#B8A800", "#8C8C8C"];
const DASHES = [[], [6, 3], [2, 2], [8, 2, 2, 2], [12, 3], [3, 5]];
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const KINDS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i4: Int32Array, f4: Float32Array };
const root = document.documentElement, byId = (id) => document.getElementById(id);
const canvas = byId("stage"), pen = canvas.getContext("2d");
const shown = { frames: true, sensing: true, members: true, particles: true, trails: true, close: false };
let film = null, frame = 0, view = null, ramp = [];

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const made = { ...head, col: {}, from: {} };
  for (const [name, [kind, offset, count]] of Object.entries(head.columns)) {
    made.col[name] = new KINDS[kind](buffer, 4 + size + offset, count);
  }
  for (const name of Object.keys(made.col).filter((name) => name.endsWith("_count"))) {
    const from = new Uint32Array(made.frames + 1);
    made.col[name].forEach((count, i) => { from[i + 1] = from[i] + count; });
    made.from[name.slice(0, -6)] = from;
  }
  return rewound(made);
}

function rewound(made) {
  made.at = -1;
  made.level = made.col.charge ? made.col.charge.slice() : new Uint8Array(made.nodes);
  made.mode = made.col.state ? made.col.state.slice() : new Uint8Array(made.nodes).fill(1);
  made.owner = new Uint8Array(made.nodes);
  made.sorted ??= sorted(made);
  made.joiners ??= Uint32Array.from(new Set(made.col.join_node ?? []));
  return made;
}

// The nodes that are drawn once, and those that are drawn at each frame.
function sorted(made) {
  const busy = new Uint8Array(made.nodes).fill(made.nodes <= FEW ? 1 : 0);
  for (const name of ["turn_node", "drain_node"]) (made.col[name] ?? []).forEach((node) => { busy[node] = 1; });
  const every = Uint32Array.from({ length: made.nodes }, (_, i) => i);
  return [every.filter((i) => !busy[i]), every.filter((i) => busy[i])];
}

function advance(to) {
  if (to < film.at) rewound(film);
  for (const [name, value, state] of [["drain", "level", film.level], ["turn", "state", film.mode]]) {
    const from = film.from[name];
    if (!from) continue;
    const nodes = film.col[`${name}_node`], values = film.col[`${name}_${value}`];
    for (let i = from[film.at + 1]; i < from[to + 1]; i++) state[nodes[i]] = values[i];
  }
  if (film.from.join) changeMembers(film.at + 1, to);
  film.at = to;
}

function changeMembers(first, to) {
  const { join_node: nodes, join_target: targets, turn_node: turned, turn_state: states } = film.col, { join, turn } = film.from;
  for (let at = first; at <= to; at++) {
    for (let i = turn[at]; i < turn[at + 1]; i++) if (states[i] !== 1) film.owner[turned[i]] = 0;
    for (let i = join[at]; i < join[at + 1]; i++) {
      const mark = (targets[i] & 127) + 1;
      if (targets[i] > 127) for (const other of film.joiners) if (film.owner[other] === mark) film.owner[other] = 0;
      film.owner[nodes[i]] = mark;
    }
  }
}

const rows = (name) => (film.from[name] ? [film.from[name][frame], film.from[name][frame + 1]] : [0, 0]);
const px = (x) => view.left + ((x / (NOWHERE - 1) - view.x0) / view.part) * view.width;
const py = (y) => view.top + (1 - (y / (NOWHERE - 1) - view.y0) / view.part) * view.height;
const within = (x, y) => x > view.left - 5 && x < view.left + view.width + 5 && y > view.top - 5 && y < view.top + view.height + 5;
const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();

function measure() {
  const [x0, y0, x1, y1] = film.box, wide = canvas.clientWidth, border = { left: 46, right: 10, top: 10, bottom: 34 };
  const room = wide - border.left - border.right;
  const ratio = film.flat ? 0.55 : (y1 - y0) / (x1 - x0);
  let width = room, height = room * ratio;
  const most = Math.max(260, 0.78 * innerHeight), least = 120;
  if (height > most) { height = most; if (!film.flat) width = most / ratio; }
  if (height < least) height = least;
  const tall = Math.round(height + border.top + border.bottom), zoom = devicePixelRatio || 1;
  canvas.style.height = `${tall}px`;
  canvas.width = Math.round(wide * zoom);
  canvas.height = Math.round(tall * zoom);
  const span = film.flat ? height : Math.min(height, width * ratio);
  view = { wide, left: border.left + (room - width) / 2, top: border.top + (height - span) / 2, width, height: span, zoom };
  Object.assign(view, { x0: 0, y0: 0, part: 1 });
  if (shown.close) view.part = Math.min(0.5, Math.max(0.01, Math.sqrt(NEAR / Math.max(film.nodes, 1))));
  view.dot = Math.min(4.5, Math.max(0.8, 0.16 * Math.sqrt((width * span) / Math.max(film.nodes * view.part * view.part, 1))));
  view.ink = css("--ink"); view.soft = css("--soft"); view.line = css("--line"); view.paper = css("--paper");
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

function node(pen, x, y, r, mode, level) {
  if (mode === DEAD) { marker(pen, "cross", x, y, r); stroke(pen, view.soft, 1.2); return; }
  const charged = film.charge ? 0.6 + 0.4 * (level / film.charge[2]) : 1;
  const tiny = r < 1.5;
  pen.globalAlpha = mode === REST ? (tiny ? 0.6 : 0.38) : 1;
  pen.fillStyle = film.charge && !(tiny && mode === REST) ? ramp[level] : view.soft;
  marker(pen, "dot", x, y, r * charged * (mode === REST ? 0.85 : 1));
  pen.fill();
  if (r > 2) stroke(pen, view.ink, mode === REST ? 0.5 : 0.9);
  pen.globalAlpha = 1;
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
  pen.globalAlpha = many ? 0.35 : 0.9;
  for (let i = begin; i < end; i++) {
    const x = px(xs[goals[i]]), y = py(ys[goals[i]]), x0 = px(xs[origins[i]]), y0 = py(ys[origins[i]]);
    const style = film.style[words[i]] ?? 0;
    pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x, y);
    stroke(pen, lost[i] ? VERMILLION : WORDS[style], many ? 0.7 : 1.6, lost[i] ? [3, 3] : DASHES[style]);
    if (lost[i]) { marker(pen, "cross", x + (x0 - x) * 0.15, y + (y0 - y) * 0.15, 3.5); stroke(pen, VERMILLION, 1.6); }
    else if (!many) { marker(pen, "dot", x0 + (x - x0) * 0.7, y0 + (y - y0) * 0.7, 2.4); pen.fillStyle = WORDS[style]; pen.fill(); }
  }
  const [first, until] = rows("cast");
  for (let i = first; i < until; i++) {
    const at = film.col.cast_node[i];
    marker(pen, "dot", px(xs[at]), py(ys[at]), view.dot + 8); stroke(pen, WORDS[film.style[film.col.cast_what[i]] ?? 0], 1.4, [4, 3]);
  }
  pen.globalAlpha = 1;
}

function drawCloud() {
  const [begin, end] = rows("cloud"), { cloud_x: xs, cloud_y: ys } = film.col, full = NOWHERE - 1;
  const [x0, dx, y0, dy] = ["x_low", "x_width", "y_low", "y_width"].map((name) => film.col[`cloud_${name}`]?.[frame]);
  pen.fillStyle = SKY; pen.globalAlpha = 0.65;
  for (let i = begin; i < end; i++) {
    pen.fillRect(px((x0 + (xs[i] / 255) * dx) * full) - 1.1, py((y0 + (ys[i] / 255) * dy) * full) - 1.1, 2.2, 2.2);
  }
  pen.globalAlpha = 1;
}

function truthMark(pen, x, y) { marker(pen, "plus", x, y, 8); stroke(pen, view.paper, 5); stroke(pen, view.ink, 2.4); }

function guessMark(pen, x, y, beyond) {
  marker(pen, "diamond", x, y, 6);
  pen.fillStyle = beyond ? view.paper : ORANGE; pen.fill(); stroke(pen, beyond ? ORANGE : view.ink, beyond ? 2 : 1);
}

function headMark(pen, x, y) { marker(pen, "square", x, y, view.dot + 4); stroke(pen, VERMILLION, 2.2); }

function memberMark(pen, x, y) { marker(pen, "dot", x, y, view.dot + 2.5); stroke(pen, SKY, 1.2); }

function senseMark(pen, x, y) { marker(pen, "dot", x, y, view.dot + 2.5); stroke(pen, BLUE, 1.6); }

function drawTarget(target) {
  const at = target * film.frames + frame, several = film.targets.length > 1;
  if (shown.trails && film.col.guess_x) { way("guess", target, frame - TRAIL, frame); stroke(pen, ORANGE, 1.3); }
  const leader = film.col.head ? film.col.head[at] : -1;
  if (leader >= 0) headMark(pen, px(film.col.node_x[leader]), py(film.col.node_y[leader]));
  for (const name of ["truth", "guess"]) {
    const x = film.col[`${name}_x`]?.[at], y = film.col[`${name}_y`]?.[at];
    if (x === undefined || x === NOWHERE) continue;
    const beyond = [x, y].some((each) => each === 0 || each === NOWHERE - 1);
    if (name === "truth") truthMark(pen, px(x), py(y)); else guessMark(pen, px(x), py(y), beyond);
    if (several && name === "truth") { pen.fillStyle = view.ink; pen.font = "bold 12px system-ui, sans-serif"; pen.textAlign = "left"; pen.fillText(film.targets[target], px(x) + 9, py(y) - 6); }
  }
}

function draw() {
  if (!view) measure();
  advance(frame);
  if (shown.close) { follow(); view.base = null; }
  view.base ??= resting();
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.drawImage(view.base, 0, 0);
  pen.setTransform(view.zoom, 0, 0, view.zoom, 0, 0);
  pen.save();
  pen.beginPath(); pen.rect(view.left - 9, view.top - 9, view.width + 18, view.height + 18); pen.clip();
  film.targets.forEach((_, target) => {
    if (!film.col.truth_x) return;
    if (shown.trails) { way("truth", target, frame - WAY, Math.min(frame + WAY, film.frames - 1)); stroke(pen, view.line, 1.4); way("truth", target, frame - TRAIL, frame); stroke(pen, view.ink, 1.6); }
  });
  if (shown.particles) drawCloud();
  drawNodes(pen, 1);
  if (shown.members) for (const i of film.joiners) if (film.owner[i]) memberMark(pen, px(film.col.node_x[i]), py(film.col.node_y[i]));
  if (shown.sensing) for (let [i, end] = rows("sense"); i < end; i++) senseMark(pen, px(film.col.node_x[film.col.sense_node[i]]), py(film.col.node_y[film.col.sense_node[i]]));
  if (shown.frames) drawLinks();
  film.targets.forEach((_, target) => drawTarget(target));
  pen.restore();
}
