// The data of a replay: unpacked from text, and advanced to a frame. replay_encoding.py describes the format.
const ASLEEP = 0, AWAKE = 1, DEAD = 2, MISSING = 65535, FEW_NODES = 4000;
const STARTS = 1, LEAVES = 2, ENDS = 3;
const NUMBERS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i4: Int32Array, f4: Float32Array };
const root = document.documentElement, byId = (id) => document.getElementById(id);
let replay = null, frame = 0;

// The header and the columns of a text: a whole replay, or what a live view gets of it at a time.
async function parse(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const data = { ...head, col: {} };
  for (const [name, [kind, offset, count]] of Object.entries(head.columns)) {
    data.col[name] = new NUMBERS[kind](buffer, 4 + size + offset, count);
  }
  return data;
}

async function unpack(text) {
  const data = { ...await parse(text), from: {} };
  for (const name of Object.keys(data.col).filter((name) => name.endsWith("_count"))) {
    const from = new Uint32Array(data.frames + 1);
    data.col[name].forEach((count, i) => { from[i + 1] = from[i] + count; });
    data.from[name.slice(0, -6)] = from;
  }
  data.nodeGroups = nodeGroups(data);
  return rewind(data);
}

function rewind(data) {
  data.at = -1;
  data.level = data.col.charge ? data.col.charge.slice() : new Uint8Array(data.nodes);
  data.mode = data.col.state ? data.col.state.slice() : new Uint8Array(data.nodes).fill(AWAKE);
  data.clusters = Array.from({ length: data.groups ?? data.targets.length }, () => new Set());
  return data;
}

// [nodes that never change, drawn once; nodes that change, drawn at each frame]
function nodeGroups(data) {
  const busy = new Uint8Array(data.nodes).fill(data.nodes <= FEW_NODES ? 1 : 0);
  for (const name of ["state_change_node", "charge_change_node"]) (data.col[name] || []).forEach((node) => { busy[node] = 1; });
  return busyGroups(busy);
}

function busyGroups(busy) {
  const every = Uint32Array.from({ length: busy.length }, (_, i) => i);
  return [every.filter((i) => !busy[i]), every.filter((i) => busy[i])];
}

function advance(to) {
  if (to < replay.at) rewind(replay);
  for (const [name, value, state] of [["charge_change", "level", replay.level], ["state_change", "state", replay.mode]]) {
    const from = replay.from[name];
    if (!from) continue;
    const nodes = replay.col[`${name}_node`], values = replay.col[`${name}_${value}`];
    for (let i = from[replay.at + 1]; i < from[to + 1]; i++) state[nodes[i]] = values[i];
  }
  if (replay.from.membership) changeClusters(replay.from.membership[replay.at + 1], replay.from.membership[to + 1]);
  replay.at = to;
}

// In the order of the event log: a node that is elected and dies within a frame is no member afterwards.
function changeClusters(first, end) {
  const { membership_node: nodes, membership_target: targets, membership_change: change } = replay.col;
  for (let i = first; i < end; i++) {
    if (change[i] === LEAVES) { replay.clusters.forEach((each) => each.delete(nodes[i])); continue; }
    const cluster = replay.clusters[targets[i]];
    if (change[i] === STARTS || change[i] === ENDS) cluster.clear();
    if (change[i] !== ENDS) cluster.add(nodes[i]);
  }
}

// The last frame that can be shown; a live view does not know all frames yet.
const lastFrame = () => (replay.known ?? replay.frames) - 1;
const rows = (name) => (replay.from[name] ? [replay.from[name][frame], replay.from[name][frame + 1]] : [0, 0]);
const stepOf = (number) => Math.min(number * replay.stride, replay.last);
const frameOf = (step) => Math.min(Math.ceil(step / replay.stride), lastFrame());
