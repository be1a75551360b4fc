// What the marks of a film's picture mean, and the colours that depend on the film.
// Every word from a scenario goes in as text, with its direction of writing kept to itself.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const apart = (word) => (/^[ -~]*$/.test(word) ? word : `\u2068${word}\u2069`);

function colours() {
  const top = film.charge ? film.charge[2] : 0, last = CIVIDIS.length - 1;
  const parts = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  ramp = Array.from({ length: 256 }, (_, level) => {
    const spot = Math.min(1, top ? level / top : 1) * last, low = Math.min(Math.floor(spot), last - 1), part = spot - low;
    const [a, b] = [parts(CIVIDIS[low]), parts(CIVIDIS[low + 1])];
    return `rgb(${a.map((each, i) => Math.round(each + part * (b[i] - each))).join(",")})`;
  });
}

// The commonest kinds of frames have a style each; all others share one.
function styles() {
  const counts = new Map();
  for (const name of ["link_what", "cast_what"]) {
    (film.col[name] || []).forEach((word) => counts.set(word, (counts.get(word) || 0) + 1));
  }
  film.style = {};
  [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a)).forEach((word, i) => { film.style[word] = Math.min(i, OTHER); });
}

function entry(words, paint) {
  const item = document.createElement("li"), swatch = document.createElement("canvas"), zoom = devicePixelRatio || 1;
  swatch.width = 34 * zoom; swatch.height = 22 * zoom;
  swatch.style.width = "34px"; swatch.style.height = "22px";
  const pen = swatch.getContext("2d"), dot = view.dot;
  pen.scale(zoom, zoom);
  view.dot = Math.max(Math.min(dot, 4), 3);
  paint(pen);
  view.dot = dot;
  item.append(swatch, document.createTextNode(words));
  byId("legend").append(item);
}

function line(colour, dash = [], width = 2) {
  return (pen) => { pen.beginPath(); pen.moveTo(2, 11); pen.lineTo(32, 11); stroke(pen, colour, width, dash); };
}

function legend() {
  byId("legend").replaceChildren();
  legendOfTargets();
  if (film.nodes) legendOfNodes();
  legendOfFrames();
}

function legendOfTargets() {
  const { col } = film, trail = Math.min(film.trail, film.frames - 1), before = film.stride > 1 ? "drawn steps" : "steps";
  if (col.truth_x) {
    entry("truth", (pen) => truthMark(pen, 17, 11));
    entry("true way", line(view.way, [], 1.2));
    entry(`true way, last ${trail} ${before}`, line(view.ink));
  }
  if (col.guess_x) {
    entry("estimate", (pen) => guessMark(pen, 17, 11, false));
    entry("estimate beyond the picture", (pen) => guessMark(pen, 17, 11, true));
    entry(`estimates, last ${trail} ${before}`, line(view.guess, [], 1.5));
  }
  if (col.cloud_x && col.cloud_x.length) {
    entry("particles", (pen) => { pen.fillStyle = view.particle; [6, 13, 18, 26].forEach((x, i) => pen.fillRect(x, 7 + 3 * (i % 3), 2.2, 2.2)); });
  }
  if (film.targets.length > 1) entry("the number beside a mark is its target's", () => {});
}

function legendOfNodes() {
  const { col } = film, full = film.charge ? film.charge[2] : 0, percent = (share) => `${+(100 * share).toFixed(1)}\u00a0%`;
  const as = (mode, mark) => (pen) => { node(pen, 17, 11, 3.5, mode, full); if (mark) mark(pen, 17, 11); };
  const modes = new Set([...(col.state || []), ...(col.turn_state || [])]);
  entry(modes.has(REST) ? "node awake" : "node", as(AWAKE));
  if (modes.has(REST)) {
    entry("at rest: asleep, dormant, or on its schedule", view.dot < 1.5 ? (pen) => node(pen, 17, 11, 1.4, REST, full) : as(REST));
  }
  if (modes.has(DEAD)) entry("dead", as(DEAD));
  if (film.charge) {
    entry(`charge left, ${percent(film.charge[0])} (dark) to ${percent(film.charge[1])}`, (pen) => {
      for (let x = 0; x < 34; x++) { pen.fillStyle = ramp[Math.round((x / 33) * full)]; pen.fillRect(x, 6, 1.2, 10); }
    });
  }
  if (col.head && col.head.some((at) => at >= 0)) entry("head", as(AWAKE, headMark));
  if (col.join_node && col.join_node.length) legendOfMembers(as);
  if (col.sense_node && col.sense_node.length) entry("node that senses", as(AWAKE, senseMark));
}

function legendOfMembers(as) {
  const several = film.targets.length > 1;
  film.targets.slice(0, RINGS.length).forEach((number, target) => {
    entry(several ? `member of the cluster of target ${number}` : "member of the cluster", as(AWAKE, (pen, x, y) => memberMark(pen, x, y, target)));
  });
  if (film.targets.length > RINGS.length) entry("further targets' rings repeat these", () => {});
}

function legendOfFrames() {
  const { col } = film, name = (word) => apart(film.words[word] || "message");
  const words = [...new Set([...(col.link_what || []), ...(col.cast_what || [])])].sort((a, b) => film.style[a] - film.style[b]);
  for (const word of words.slice(0, OTHER)) entry(`frame: ${name(word)}`, line(view.kinds[film.style[word]], DASHES[film.style[word]]));
  if (words.length > OTHER) entry(`other frames: ${words.slice(OTHER).map(name).join(", ")}`, line(view.kinds[OTHER], DASHES[OTHER]));
  if (col.cast_node && col.cast_node.length) {
    entry("broadcast, in the colour of its frame", (pen) => { marker(pen, "dot", 17, 11, 9); stroke(pen, view.soft, 1.6, [4, 3]); });
  }
  if (col.link_lost && col.link_lost.some((each) => each)) {
    entry("frame that was lost", (pen) => { line(view.lost, [3, 3])(pen); marker(pen, "cross", 17, 11, 3.5); stroke(pen, view.lost, 1.6); });
  }
}
