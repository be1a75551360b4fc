// The player: moves through a replay by button, slider, key and clock, and describes the drawing in words.
// Nothing is fetched.
const replays = [...document.querySelectorAll(".replay-data")], unpacked = [];
const slider = byId("slider"), speed = byId("speed"), chosen = byId("run"), message = byId("message"), player = byId("player");
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
const RATES = [1, 2, 5, 10, 25, 50, 100, 250, 1000], REDUCED_RATE = 2, MIN_RESIZE = 120;
const LAYERS = { traffic: "transmissions", sensing: "sensing nodes", members: "cluster members", particles: "particles", trails: "trajectories", close: "close-up" };
let playing = false, due = 0, before = 0, opened = 0;

const digits = (value) => (Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));
const counted = (number, noun) => `${number.toLocaleString("en")} ${noun}${number === 1 ? "" : "s"}`;

// The number of rows in the frame, and how many of them are drawn if not all are.
function countOf(name, noun) {
  const [from, to] = rows(name), all = replay.col[`${name}_total`] ? replay.col[`${name}_total`][frame] : to - from;
  return counted(all, noun) + (all > to - from ? ` (${(to - from).toLocaleString("en")} drawn)` : "");
}

function describeTarget(number, target) {
  const { col } = replay, at = target * replay.frames + frame, head = col.head ? col.head[at] : -1;
  const unit = (replay.axes[1].match(/\[(.*)\]$/) || ["", ""])[1], error = col.error ? col.error[at] : NaN;
  const parts = [Number.isFinite(error) ? `error ${digits(error)} ${isolated(unit)}` : "no estimate"];
  if (head >= 0) parts.push(`${replay.headless ? "gateway" : "cluster head"} ${col.node[head]}${replay.mode[head] === DEAD ? ", dead" : ""}`);
  if (replay.groups == null && col.membership_node && col.membership_node.length) parts.push(counted(replay.clusters[target].size, replay.headless ? "participant" : "member"));
  return (replay.targets.length > 1 ? `target ${number}: ` : "") + parts.join(", ");
}

function describe() {
  const step = stepOf(frame), sensing = rows("sense")[1] - rows("sense")[0];
  const lines = [`step ${step} of ${replay.last}${replay.dt === null ? "" : ` · ${+(step * replay.dt).toPrecision(7)} s`}`];
  if (replay.groups == null || replay.from.track) replay.targets.forEach((number, target) => lines.push(describeTarget(number, target)));
  if (replay.col.sense_node && replay.col.sense_node.length) lines.push(counted(sensing, "sensing node"));
  if (replay.from.link) lines.push(`${countOf("link", "link")} in use, ${countOf("broadcast", "broadcast")}`);
  if (replay.from.track) lines.push(`${counted(tracksNow(), "confirmed track")}, ${countOf("detection", "detection")}`);
  for (const what of ["merge", "split"]) if (rows(what)[1] > rows(what)[0]) lines.push(`${countOf(what, what)} of groups of tracks`);
  if (replay.from.particle) lines.push(countOf("particle", "particle"));
  byId("status").textContent = lines.join("\n");
  if (!playing && opened && document.activeElement !== slider) byId("spoken").textContent = lines.join(". ");
  slider.value = frame;
  slider.setAttribute("aria-valuetext", lines[0]);
  root.dataset.frame = step;
}

function layers() {
  const { col } = replay, track = col.truth_x || col.estimate_x;
  const has = { traffic: col.link_message, sensing: col.sense_node, members: col.membership_node, particles: col.particle_x, trails: track };
  has.close = replay.flat ? null : track;
  byId("shown").replaceChildren();
  for (const [name, words] of Object.entries(LAYERS)) {
    if (!has[name] || !has[name].length) continue;
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = shown[name];
    box.addEventListener("change", () => { shown[name] = box.checked; redraw(); });
    label.append(box, document.createTextNode(` ${replay.headless && name === "members" ? "participants" : words}`));
    byId("shown").append(label);
  }
}

// With reduced motion, only slow rates are offered.
function rates() {
  const usual = replay.dt ? replay.stride * replay.dt : 0, real = usual ? 1 / usual : 25;
  const offered = reducedMotion.matches ? RATES.filter((rate) => rate <= REDUCED_RATE) : RATES;
  const near = offered.reduce((best, rate) => (Math.abs(Math.log(rate / real)) < Math.abs(Math.log(best / real)) ? rate : best));
  const start = Math.min(Math.max(near, 10), 25, offered[offered.length - 1] === REDUCED_RATE ? REDUCED_RATE : 25);
  speed.replaceChildren(...offered.map((rate) => {
    const times = usual ? ` (${+(rate * usual).toPrecision(2)}× real time)` : "";
    return new Option(`${rate}/s${times}`, rate, rate === start, rate === start);
  }));
}

function show(number) {
  frame = Math.min(Math.max(number, 0), lastFrame());
  draw();
  describe();
}

function play(wanted) {
  playing = wanted && lastFrame() > 0;
  if (playing && frame >= lastFrame()) show(0);
  byId("play").textContent = playing ? "Pause" : "Play";
  if (playing) { due = 0; before = performance.now(); requestAnimationFrame(tick); } else { describe(); updateAddress(); }
}

function tick(now) {
  if (!playing) return;
  due += Math.max(0, now - before) * speed.value / 1000;
  before = now;
  const whole = Math.floor(due);
  due -= whole;
  if (whole) show(frame + whole);
  if (frame >= lastFrame()) play(false); else requestAnimationFrame(tick);
}

function goTo(number) { playing = false; show(number); play(false); }

function updateAddress() {
  const run = replays.length > 1 ? `run=${chosen.value}&` : "";
  try { history.replaceState(null, "", `#${run}frame=${stepOf(frame)}`); } catch { /* some browsers do not allow it for files */ }
}

function requested(name) {
  const found = location.hash.match(new RegExp(`[#&]${name}=(\\d+)(?=&|$)`));
  return found ? +found[1] : null;
}

async function open(run, step) {
  const mine = ++opened;
  playing = false;
  chosen.value = run;
  try {
    if (!unpacked[run]) unpacked[run] = await unpack(replays[run].textContent.trim());
  } catch {
    const which = replays.length > 1 ? ` of ${isolated(replays[run].dataset.title)}` : "";
    if (mine === opened) fail(`The replay${which} cannot be shown: its data are damaged.`);
    return;
  }
  if (mine !== opened) return;
  present(unpacked[run], step);
  if (!root.dataset.drawn) root.dataset.drawn = Math.round(performance.now());
  root.dataset.ready = "yes";
}

// The frame with the largest error after the start, else the middle of the run.
function tellingFrame() {
  const errors = replay.col.error || [], start = Math.ceil(replay.frames / 10);
  let found = Math.floor(lastFrame() / 2), largest = -1;
  errors.forEach((error, i) => {
    if (i % replay.frames >= start && error > largest && error < Infinity) { found = i % replay.frames; largest = error; }
  });
  return found;
}

function present(data, step) {
  replay = data;
  view = null;
  message.hidden = true;
  player.hidden = false;
  shown.close = replay.nodes > FEW_NODES && !replay.flat && replay.targets.length > 0;
  colours(); styles(); rates();
  slider.max = lastFrame();
  byId("play").textContent = "Play";
  show(step === null ? tellingFrame() : frameOf(step));
  legend(); layers();
}

// Keys are handled only if the focus is within the player; elsewhere they scroll the page.
function key(event) {
  const held = document.activeElement;
  if (!replay || !player.contains(held) || event.ctrlKey || event.metaKey || event.altKey || held.tagName === "SELECT") return;
  if (event.key === " " && ["BUTTON", "INPUT"].includes(held.tagName) && held !== slider) return;
  const stride = event.shiftKey ? 10 : 1;
  const goal = { ArrowLeft: frame - stride, ArrowRight: frame + stride, Home: 0, End: lastFrame() }[event.key];
  if (event.key === " ") play(!playing); else if (goal === undefined) return; else goTo(goal);
  event.preventDefault();
}

function redraw() {
  if (!replay || !canvas.clientWidth) return;
  view = null;
  show(frame);
  legend();
}

function listen() {
  byId("play").addEventListener("click", () => play(!playing));
  canvas.addEventListener("click", () => play(!playing));
  byId("back").addEventListener("click", () => goTo(frame - 1));
  byId("ahead").addEventListener("click", () => goTo(frame + 1));
  slider.addEventListener("input", () => goTo(+slider.value));
  chosen.addEventListener("change", () => open(+chosen.value, null).then(() => { if (replay) updateAddress(); }));
  addEventListener("keydown", key);
  addEventListener("hashchange", followAddress);
  new ResizeObserver(() => { if (view && canvas.clientWidth !== view.wide) redraw(); }).observe(canvas);
  addEventListener("resize", () => { if (view && Math.abs(innerHeight - view.high) > MIN_RESIZE) redraw(); });
  addEventListener("beforeprint", () => { root.dataset.print = "yes"; redraw(); });
  addEventListener("afterprint", () => { delete root.dataset.print; redraw(); });
  dark.addEventListener("change", redraw);
  reducedMotion.addEventListener("change", () => { if (replay) rates(); });
}

// Go to the run and the step in the address; without either, stay.
async function followAddress() {
  const step = requested("frame"), run = requested("run");
  if (replay && step === null && run === null) return;
  const wanted = run === null ? +chosen.value : Math.min(run, replays.length - 1);
  if (replay && unpacked[wanted] === replay) { if (step !== null) goTo(frameOf(step)); return; }
  await open(wanted, step);
  if (replay && step !== null && step !== stepOf(frame)) updateAddress();
}

function fail(text) {
  replay = null;
  player.hidden = true;
  message.textContent = text;
  message.hidden = false;
  root.dataset.ready = "failed";
}

async function begin() {
  if (!replays.length) { message.hidden = true; root.dataset.ready = "empty"; return; }
  if (!("DecompressionStream" in window)) {
    fail("The replay cannot be shown: this browser has no DecompressionStream; newer ones have.");
    return;
  }
  replays.forEach((each, i) => chosen.append(new Option(isolated(each.dataset.title), i)));
  byId("which").hidden = replays.length < 2;
  listen();
  await followAddress();
}
