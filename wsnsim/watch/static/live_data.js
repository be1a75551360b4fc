// The data of a run that computes: a head, to which portions of frames are added. replay_portions.py makes both.
const DENSE = /^particle_[xy]_(low|width)$/, OF_ESTIMATES = { estimate_x: MISSING, estimate_y: MISSING, error: NaN, head: -1 };

function beginLive(head) {
  const data = { ...head, from: {}, known: 0, portions: 0, spent: [], room: {}, busy: new Uint8Array(head.nodes).fill(head.nodes <= FEW_NODES ? 1 : 0), words: new Set(), style: {} };
  data.nodeGroups = nodeGroups(data);
  return rewind(data);
}

// Columns have room for more rows than they hold, so that most portions need no copy of what came before.
function appendRows(data, name, values) {
  const held = data.col[name], size = held ? held.length : 0, wanted = size + values.length;
  if (!data.room[name] || data.room[name].length < wanted) {
    const larger = new values.constructor(2 * wanted);
    if (held) larger.set(held);
    data.room[name] = larger;
  }
  data.room[name].set(values, size);
  data.col[name] = data.room[name].subarray(0, wanted);
}

function placeEstimates(data, part) {
  const size = data.targets.length * data.frames, places = part.col.place;
  for (const [name, missing] of Object.entries(OF_ESTIMATES)) data.col[name] ??= new part.col[name].constructor(size).fill(missing);
  for (const name of Object.keys(OF_ESTIMATES)) {
    places.forEach((place, i) => { if (Number.isFinite(part.col.error[i]) || !Number.isFinite(data.col.error[place])) data.col[name][place] = part.col[name][i]; });
  }
}

function rescale(data, charge) {
  const old = data.charge;
  data.charge = charge;
  if (!old || !charge || old[0] === charge[0]) return false;
  const top = charge[2], ratio = (1 - old[0]) / (1 - charge[0]);
  for (const levels of [data.col.charge, data.col.charge_change_level]) if (levels) levels.forEach((level, i) => { levels[i] = Math.round(top - (top - level) * ratio); });
  return true;
}

// The number of rows before each frame. A table of which a portion has no rows has none in its frames.
function countRows(data, part) {
  const tables = new Set([...Object.keys(data.from), ...Object.keys(part.col).filter((name) => name.endsWith("_count")).map((name) => name.slice(0, -6))]);
  for (const name of tables) {
    const from = data.from[name] ??= new Uint32Array(data.frames + 1), counts = part.col[`${name}_count`];
    for (let i = 0; i < part.frames; i++) from[part.first + i + 1] = from[part.first + i] + (counts ? counts[i] : 0);
  }
}

function extendLive(data, part) {
  countRows(data, part);
  if (part.col.place) placeEstimates(data, part);
  for (const [name, values] of Object.entries(part.col)) {
    if (name in OF_ESTIMATES || name === "place" || name.endsWith("_count")) continue;
    if (name === "state") data.col.state = values.slice();
    else if (DENSE.test(name)) (data.col[name] ??= new values.constructor(data.frames)).set(values, part.first);
    else appendRows(data, name, values);
  }
  const changed = rescale(data, part.charge) || part.col.state;
  data.messages = part.messages;
  data.spent.push(...part.spent);
  data.portions++;
  data.known = Math.max(data.known, part.first + part.frames);
  for (const name of ["link_message", "broadcast_message"]) (part.col[name] || []).forEach((word) => data.words.add(word));
  let news = 0;
  for (const name of ["state_change_node", "charge_change_node"]) (part.col[name] || []).forEach((node) => { news += !data.busy[node]; data.busy[node] = 1; });
  if (news) data.nodeGroups = busyGroups(data.busy);
  if (changed) rewind(data);
}
