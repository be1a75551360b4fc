// The legend of the drawing, of at most ten entries with an explanation each, and the colours that depend on the replay.
// Words from a scenario are inserted as text, with their writing direction isolated.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const MOST_ENTRIES = 10;
const EXPLANATIONS = {
  truth: "the simulated trajectory, against which errors are measured; in bold: the last steps",
  track: "what a tracker believes of one target, with its number; thin: tentative",
  detection: "what a node measured, of no named target; a range is drawn in the direction of its target, a bearing in its distance; crossed: false, what it does not say is spread evenly",
  swap: "another track follows the target than before",
  estimate: "mean of the position that a tracker reports for a step; hollow: outside the drawing",
  particles: "samples of the state; the belief of the tracker",
  node: "one sensor node: sensor, processor, radio, battery; small: asleep, dormant or on its schedule; crossed: dead",
  energy: "what is left in a battery, drawable or not: initial and harvested less spent and lost; as a share of the initial energy",
  head: "the node that runs the tracker and collects from the members",
  gateway: "the participant whose estimate is recorded and reported",
  participant: "a node that runs the tracker, where there is no cluster head",
  member: "a node that joined a cluster, the head included",
  sensing: "a node that takes a measurement of the target in this step",
  message: "a line is a message from its sender to a receiver, a dashed ring a broadcast",
  lost: "a message that its receiver did not receive",
};
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

// The messages in use, the most frequent ones first, each with the way it is sent: { word, sent, broadcast }.
function messageKinds() {
  const kinds = new Map();
  for (const [name, way] of [["link_message", "sent"], ["broadcast_message", "broadcast"]]) {
    (replay.col[name] || []).forEach((word) => {
      const kind = kinds.get(word) || { word, count: 0, sent: false, broadcast: false };
      kind.count += 1; kind[way] = true;
      kinds.set(word, kind);
    });
  }
  return [...kinds.values()].sort((a, b) => b.count - a.count);
}

// The most frequent messages have a style each, as many as the legend has room for; all others share one.
function styles() {
  const kinds = messageKinds(), room = Math.min(OTHER_STYLE, MOST_ENTRIES - markEntries().length - (anyLost() ? 1 : 0));
  const own = kinds.length <= room ? kinds.length : room - 1;
  replay.style = {};
  kinds.forEach((kind, i) => { replay.style[kind.word] = i < own ? i : OTHER_STYLE; });
}

function entry([text, paint, explanation]) {
  const item = document.createElement("li"), swatch = document.createElement("canvas"), zoom = devicePixelRatio || 1;
  swatch.width = 34 * zoom; swatch.height = 22 * zoom;
  swatch.style.width = "34px"; swatch.style.height = "22px";
  const pen = swatch.getContext("2d"), dot = view.dot;
  pen.scale(zoom, zoom);
  view.dot = Math.max(Math.min(dot, 4), 3);
  paint(pen);
  view.dot = dot;
  item.append(swatch, term(text, explanation));
  byId("legend").append(item);
}

function line(colour, dash = [], width = 2) {
  return (pen) => { pen.beginPath(); pen.moveTo(2, 11); pen.lineTo(32, 11); stroke(pen, colour, width, dash); };
}

function legend() {
  byId("legend").replaceChildren();
  [...markEntries(), ...messageEntries()].forEach(entry);
}

// [text, the function that paints its mark, explanation] of targets and nodes.
function markEntries() {
  const { col } = replay, several = replay.targets.length > 1, entries = [];
  if (col.truth_x) {
    entries.push([several ? "ground truth, with the target's number" : "ground truth", (pen) => { line(view.ink)(pen); truthMark(pen, 17, 11); }, EXPLANATIONS.truth]);
  }
  if (col.estimate_x) entries.push(["estimate", (pen) => { line(view.estimate, [], 1.5)(pen); estimateMark(pen, 17, 11, false); }, EXPLANATIONS.estimate]);
  if (col.track_x && col.track_x.length) entries.push(["track, with its number", (pen) => trackMark(pen, 17, 11, 1, true), EXPLANATIONS.track]);
  if (col.detection_x && col.detection_x.length) {
    entries.push(["detection, clutter", (pen) => { detectionMark(pen, 11, 11, false); detectionMark(pen, 24, 11, true); }, EXPLANATIONS.detection]);
  }
  if (col.switch_x && col.switch_x.length) entries.push(["identity switch", (pen) => switchMark(pen, 17, 11), EXPLANATIONS.swap]);
  if (col.particle_x && col.particle_x.length) {
    entries.push(["particles", (pen) => { pen.fillStyle = view.particle; [6, 13, 18, 26].forEach((x, i) => pen.fillRect(x, 7 + 3 * (i % 3), 2.2, 2.2)); }, EXPLANATIONS.particles]);
  }
  return replay.nodes ? [...entries, ...nodeEntries()] : entries;
}

function nodeEntries() {
  const { col } = replay, full = replay.charge ? replay.charge[2] : 0, percent = (share) => `${+(100 * share).toFixed(1)}\u00a0%`;
  const modes = new Set([...(col.state || []), ...(col.state_change_state || [])]);
  const marked = (mark) => (pen) => { node(pen, 17, 11, 3.5, AWAKE, full); mark(pen, 17, 11); };
  const shownModes = [AWAKE, ASLEEP, DEAD].filter((mode) => mode === AWAKE || modes.has(mode)), word = { [AWAKE]: "awake", [ASLEEP]: "asleep", [DEAD]: "dead" };
  const names = shownModes.length > 1 ? `node: ${shownModes.map((mode) => word[mode]).join(", ")}` : "node";
  const dots = (pen) => shownModes.forEach((mode, i) => node(pen, 17 + 11 * (i - (shownModes.length - 1) / 2), 11, mode === ASLEEP && view.dot < 1.5 ? 1.4 : 3.5, mode, full));
  const entries = [[names, dots, EXPLANATIONS.node]];
  if (replay.charge) {
    entries.push([`residual energy, ${percent(replay.charge[0])} (dark) to ${percent(replay.charge[1])}`, (pen) => {
      for (let x = 0; x < 34; x++) { pen.fillStyle = ramp[Math.round((x / 33) * full)]; pen.fillRect(x, 6, 1.2, 10); }
    }, EXPLANATIONS.energy]);
  }
  if (col.head && col.head.some((at) => at >= 0)) {
    entries.push([replay.headless ? "gateway" : "cluster head", marked(headMark), EXPLANATIONS[replay.headless ? "gateway" : "head"]]);
  }
  if (col.membership_node && col.membership_node.length) entries.push(memberEntry(full));
  if (col.sense_node && col.sense_node.length) entries.push(["sensing node", marked(senseMark), EXPLANATIONS.sensing]);
  return entries;
}

// Members of several targets, or groups of tracks, differ in the dashes of their rings.
function memberEntry(full) {
  const every = replay.groups == null ? replay.targets : replay.clusters, shown = every.slice(0, RING_DASHES.length);
  const several = shown.length > 1, repeat = every.length > shown.length, word = replay.headless ? "participant" : "cluster member";
  const paint = (pen) => shown.forEach((_, target) => {
    const x = 17 + 11 * (target - (shown.length - 1) / 2);
    node(pen, x, 11, several ? 2 : 3.5, AWAKE, full);
    memberMark(pen, x, 11, target);
  });
  const whose = replay.groups == null ? `target ${shown.join(", ")}${repeat ? " …" : ""}` : "each group of tracks";
  return [several ? `${word} of ${whose}` : word, paint, EXPLANATIONS[replay.headless ? "participant" : "member"] + (repeat ? "; rings repeat for further targets" : "")];
}

function messageEntries() {
  const kinds = messageKinds(), name = ({ word }) => isolated((replay.messages[word] || "message").replaceAll("_", " "));
  const own = kinds.filter(({ word }) => replay.style[word] < OTHER_STYLE), others = kinds.filter(({ word }) => replay.style[word] === OTHER_STYLE);
  const entries = own.map((kind) => [`message: ${name(kind)}`, messageMark(kind, replay.style[kind.word]), EXPLANATIONS.message]);
  if (others.length) {
    const both = { sent: others.some(({ sent }) => sent), broadcast: others.some(({ broadcast }) => broadcast) };
    entries.push([own.length ? "other messages" : "messages", messageMark(both, OTHER_STYLE), `${others.map(name).join(", ")}: ${EXPLANATIONS.message}`]);
  }
  if (anyLost()) entries.push(["lost transmission", (pen) => { line(view.lost, [3, 3])(pen); marker(pen, "cross", 17, 11, 3.5); stroke(pen, view.lost, 1.6); }, EXPLANATIONS.lost]);
  return entries;
}

function messageMark({ sent, broadcast }, style) {
  return (pen) => {
    if (sent) line(view.kinds[style], DASHES[style])(pen);
    if (broadcast) { marker(pen, "dot", sent ? 10 : 17, 11, 8); stroke(pen, view.kinds[style], 1.6, [4, 3]); }
  };
}

function anyLost() { return Boolean(replay.col.link_lost && replay.col.link_lost.some((each) => each)); }
