// A replay's film: unpacked from text, and turned to a frame. What is read here film.py and film_clusters.py describe.
const REST = 0, AWAKE = 1, DEAD = 2, NOWHERE = 65535, FEW = 4000;
const BEGINS = 1, LEAVES = 2, ENDS = 3;
const NUMBERS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i4: Int32Array, f4: Float32Array };
const root = document.documentElement, byId = (id) => document.getElementById(id);
let film = null, frame = 0;

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const made = { ...head, col: {}, from: {} };
  for (const [name, [kind, offset, count]] of Object.entries(head.columns)) {
    made.col[name] = new NUMBERS[kind](buffer, 4 + size + offset, count);
  }
  for (const name of Object.keys(made.col).filter((name) => name.endsWith("_count"))) {
    const from = new Uint32Array(made.frames + 1);
    made.col[name].forEach((count, i) => { from[i + 1] = from[i] + count; });
    made.from[name.slice(0, -6)] = from;
  }
  made.sorted = sorted(made);
  return rewound(made);
}

function rewound(made) {
  made.at = -1;
  made.level = made.col.charge ? made.col.charge.slice() : new Uint8Array(made.nodes);
  made.mode = made.col.state ? made.col.state.slice() : new Uint8Array(made.nodes).fill(AWAKE);
  made.clusters = made.targets.map(() => new Set());
  return made;
}

// The nodes that are drawn once, and those that are drawn at each frame.
function sorted(made) {
  const busy = new Uint8Array(made.nodes).fill(made.nodes <= FEW ? 1 : 0);
  for (const name of ["turn_node", "drain_node"]) (made.col[name] || []).forEach((node) => { busy[node] = 1; });
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
  if (film.from.join) changeClusters(film.from.join[film.at + 1], film.from.join[to + 1]);
  film.at = to;
}

// In the order of the log: a node that is elected and dies within a frame is no member after it.
function changeClusters(first, end) {
  const { join_node: nodes, join_target: targets, join_what: what } = film.col;
  for (let i = first; i < end; i++) {
    if (what[i] === LEAVES) { film.clusters.forEach((each) => each.delete(nodes[i])); continue; }
    const cluster = film.clusters[targets[i]];
    if (what[i] === BEGINS || what[i] === ENDS) cluster.clear();
    if (what[i] !== ENDS) cluster.add(nodes[i]);
  }
}

const rows = (name) => (film.from[name] ? [film.from[name][frame], film.from[name][frame + 1]] : [0, 0]);
const stepOf = (number) => Math.min(number * film.stride, film.last);
const frameOf = (step) => Math.min(Math.ceil(step / film.stride), film.frames - 1);
