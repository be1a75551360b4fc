// The legend of the drawing, and the colours that depend on the replay.
// Words from a scenario are inserted as text, with their writing direction isolated.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const isolated = (word) => (/^[ -~]*$/.test(word) ? word : `\u2068${word}\u2069`);

function colours() {
  const top = replay.charge ? replay.charge[2] : 0, last = CIVIDIS.length - 1;
  const parts = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  ramp = Array.from({ length: 256 }, (_, level) => {
    const spot = Math.min(1, top ? level / top : 1) * last, low = Math.min(Math.floor(spot), last - 1), part = spot - low;
    const [a, b] = [parts(CIVIDIS[low]), parts(CIVIDIS[low + 1])];
    return `rgb(${a.map((each, i) => Math.round(each + part * (b[i] - each))).join(",")})`;
  });
}

// The most frequent messages have a style each; all others share one.
function styles() {
  const counts = new Map();
  for (const name of ["link_message", "broadcast_message"]) {
    (replay.col[name] || []).forEach((word) => counts.set(word, (counts.get(word) || 0) + 1));
  }
  replay.style = {};
  [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a)).forEach((word, i) => { replay.style[word] = Math.min(i, OTHER_STYLE); });
}

function entry(text, paint) {
  const item = document.createElement("li"), swatch = document.createElement("canvas"), zoom = devicePixelRatio || 1;
  swatch.width = 34 * zoom; swatch.height = 22 * zoom;
  swatch.style.width = "34px"; swatch.style.height = "22px";
  const pen = swatch.getContext("2d"), dot = view.dot;
  pen.scale(zoom, zoom);
  view.dot = Math.max(Math.min(dot, 4), 3);
  paint(pen);
  view.dot = dot;
  item.append(swatch, document.createTextNode(text));
  byId("legend").append(item);
}

function line(colour, dash = [], width = 2) {
  return (pen) => { pen.beginPath(); pen.moveTo(2, 11); pen.lineTo(32, 11); stroke(pen, colour, width, dash); };
}

function legend() {
  byId("legend").replaceChildren();
  targetLegend();
  if (replay.nodes) nodeLegend();
  trafficLegend();
}

function targetLegend() {
  const { col } = replay, trail = Math.min(replay.trail, replay.frames - 1), steps = replay.stride > 1 ? "drawn steps" : "steps";
  if (col.truth_x) {
    entry("ground truth", (pen) => truthMark(pen, 17, 11));
    entry("ground-truth trajectory", line(view.trajectory, [], 1.2));
    entry(`ground-truth trajectory, last ${trail} ${steps}`, line(view.ink));
  }
  if (col.estimate_x) {
    entry("estimate", (pen) => estimateMark(pen, 17, 11, false));
    entry("estimate outside the drawing", (pen) => estimateMark(pen, 17, 11, true));
    entry(`estimates, last ${trail} ${steps}`, line(view.estimate, [], 1.5));
  }
  if (col.particle_x && col.particle_x.length) {
    entry("particles", (pen) => { pen.fillStyle = view.particle; [6, 13, 18, 26].forEach((x, i) => pen.fillRect(x, 7 + 3 * (i % 3), 2.2, 2.2)); });
  }
  if (replay.targets.length > 1) entry("numbers beside marks are targets", () => {});
}

function nodeLegend() {
  const { col } = replay, full = replay.charge ? replay.charge[2] : 0, percent = (share) => `${+(100 * share).toFixed(1)}\u00a0%`;
  const as = (mode, mark) => (pen) => { node(pen, 17, 11, 3.5, mode, full); if (mark) mark(pen, 17, 11); };
  const modes = new Set([...(col.state || []), ...(col.state_change_state || [])]);
  entry(modes.has(ASLEEP) ? "node awake" : "node", as(AWAKE));
  if (modes.has(ASLEEP)) {
    entry("node asleep, dormant or on its schedule", view.dot < 1.5 ? (pen) => node(pen, 17, 11, 1.4, ASLEEP, full) : as(ASLEEP));
  }
  if (modes.has(DEAD)) entry("dead node", as(DEAD));
  if (replay.charge) {
    entry(`residual energy, ${percent(replay.charge[0])} (dark) to ${percent(replay.charge[1])}`, (pen) => {
      for (let x = 0; x < 34; x++) { pen.fillStyle = ramp[Math.round((x / 33) * full)]; pen.fillRect(x, 6, 1.2, 10); }
    });
  }
  if (col.head && col.head.some((at) => at >= 0)) entry("cluster head", as(AWAKE, headMark));
  if (col.membership_node && col.membership_node.length) memberLegend(as);
  if (col.sense_node && col.sense_node.length) entry("sensing node", as(AWAKE, senseMark));
}

function memberLegend(as) {
  const several = replay.targets.length > 1;
  replay.targets.slice(0, RING_DASHES.length).forEach((number, target) => {
    entry(several ? `cluster member, target ${number}` : "cluster member", as(AWAKE, (pen, x, y) => memberMark(pen, x, y, target)));
  });
  if (replay.targets.length > RING_DASHES.length) entry("rings repeat for further targets", () => {});
}

function trafficLegend() {
  const { col } = replay, name = (word) => isolated(replay.messages[word] || "message");
  const words = [...new Set([...(col.link_message || []), ...(col.broadcast_message || [])])].sort((a, b) => replay.style[a] - replay.style[b]);
  for (const word of words.slice(0, OTHER_STYLE)) entry(`message: ${name(word)}`, line(view.kinds[replay.style[word]], DASHES[replay.style[word]]));
  if (words.length > OTHER_STYLE) entry(`other messages: ${words.slice(OTHER_STYLE).map(name).join(", ")}`, line(view.kinds[OTHER_STYLE], DASHES[OTHER_STYLE]));
  if (col.broadcast_node && col.broadcast_node.length) {
    entry("broadcast, in the colour of its message", (pen) => { marker(pen, "dot", 17, 11, 9); stroke(pen, view.soft, 1.6, [4, 3]); });
  }
  if (col.link_lost && col.link_lost.some((each) => each)) {
    entry("lost transmission", (pen) => { line(view.lost, [3, 3])(pen); marker(pen, "cross", 17, 11, 3.5); stroke(pen, view.lost, 1.6); });
  }
}
