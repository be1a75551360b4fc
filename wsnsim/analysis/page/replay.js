// The player: pages through a film by button, slider, key and clock, and says in words what the picture shows.
// Every word from a scenario goes in as text; nothing is fetched.
const films = [...document.querySelectorAll(".film")], unpacked = [];
const slider = byId("slider"), speed = byId("speed"), chosen = byId("run"), message = byId("message");
const still = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
const RATES = [1, 2, 5, 10, 25, 50, 100, 250, 1000], STILL_RATE = 2;
const LAYERS = { frames: "frames in flight", sensing: "who senses", members: "members", particles: "particles", trails: "ways", close: "close-up" };
let playing = false, due = 0, before = 0;

const digits = (value) => (Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));

function tell() {
  const step = Math.min(frame * film.stride, film.last);
  const time = film.dt === null ? "" : ` · ${+(step * film.dt).toPrecision(7)} s`;
  const lines = [`step ${step} of ${film.last}${time}`];
  film.targets.forEach((number, target) => lines.push(tellTarget(number, target * film.frames + frame)));
  const count = (name) => { const [from, to] = rows(name); return to - from; };
  const members = film.joiners.reduce((sum, i) => sum + (film.owner[i] > 0), 0);
  if (film.col.join_node?.length) lines.push(`${members} members, ${count("sense")} nodes sense`);
  else if (film.col.sense_node?.length) lines.push(`${count("sense")} nodes sense`);
  if (film.col.link_count) lines.push(`${count("link")} links in use, ${count("cast")} broadcasts`);
  if (film.col.cloud_count) lines.push(`${count("cloud")} particles`);
  byId("status").textContent = lines.join("\n");
  slider.value = frame;
  slider.setAttribute("aria-valuetext", lines[0]);
  root.dataset.frame = frame;
}

function tellTarget(number, at) {
  const name = film.targets.length > 1 ? `target ${number}: ` : "", unit = film.axes[1].match(/\[(.*)\]$/)?.[1] ?? "";
  const error = film.col.error ? film.col.error[at] : NaN;
  const led = film.col.head && film.col.head[at] >= 0 ? `, head ${film.col.node[film.col.head[at]]}` : "";
  return `${name}${Number.isFinite(error) ? `error ${digits(error)} ${unit}`.trim() : "no estimate"}${led}`;
}

function entry(words, paint) {
  const item = document.createElement("li"), swatch = document.createElement("canvas"), zoom = devicePixelRatio || 1;
  swatch.width = 34 * zoom; swatch.height = 20 * zoom;
  swatch.style.width = "34px"; swatch.style.height = "20px";
  const pen = swatch.getContext("2d");
  pen.scale(zoom, zoom);
  const dot = view.dot;
  view.dot = Math.max(dot, 3);
  paint(pen);
  view.dot = dot;
  item.append(swatch, document.createTextNode(words));
  byId("legend").append(item);
}

function line(colour, dash) {
  return (pen) => { pen.beginPath(); pen.moveTo(2, 10); pen.lineTo(32, 10); stroke(pen, colour, 2, dash); };
}

function legend() {
  byId("legend").replaceChildren();
  const { col } = film, percent = (share) => `${+(100 * share).toFixed(1)} %`;
  if (col.truth_x) entry("truth", (pen) => truthMark(pen, 17, 10));
  if (col.guess_x) entry("estimate (hollow: beyond the picture)", (pen) => guessMark(pen, 17, 10, false));
  if (col.head?.some((at) => at >= 0)) entry("head", (pen) => { node(pen, 17, 10, 3.5, 1, 255); headMark(pen, 17, 10); });
  if (col.sense_node?.length) entry("node that senses", (pen) => { node(pen, 17, 10, 3.5, 1, 255); senseMark(pen, 17, 10); });
  if (col.join_node?.length) entry("member of the cluster", (pen) => { node(pen, 17, 10, 3.5, 1, 255); memberMark(pen, 17, 10); });
  if (film.nodes) legendOfNodes(percent);
  if (col.cloud_x?.length) entry("particles", (pen) => { pen.fillStyle = SKY; [6, 13, 18, 26].forEach((x, i) => pen.fillRect(x, 6 + 3 * (i % 3), 3, 3)); });
  const words = [...new Set([...(col.link_what ?? []), ...(col.cast_what ?? [])])].sort((a, b) => film.style[a] - film.style[b]);
  words.slice(0, 10).forEach((word) => entry(`frame: ${film.words[word] || "message"}`, line(WORDS[film.style[word]], DASHES[film.style[word]])));
  if (words.length > 10) entry(`and ${words.length - 10} further kinds of frames`, () => {});
  if (col.cast_node?.length) entry("broadcast", (pen) => { marker(pen, "dot", 17, 10, 8); stroke(pen, view.soft, 1.4, [4, 3]); });
  if (col.link_lost?.some((each) => each)) entry("frame that was lost", (pen) => { line(VERMILLION, [3, 3])(pen); marker(pen, "cross", 17, 10, 3.5); stroke(pen, VERMILLION, 1.6); });
}

function legendOfNodes(percent) {
  const full = film.charge ? film.charge[2] : 0;
  if (film.charge) {
    entry(`charge left, ${percent(film.charge[0])} (small, dark) to ${percent(film.charge[1])}`, (pen) => {
      for (let x = 0; x < 34; x++) { pen.fillStyle = ramp[Math.round((x / 33) * full)]; pen.fillRect(x, 5, 1.2, 10); }
    });
  } else entry("node", (pen) => node(pen, 17, 10, 3.5, 1, 0));
  const modes = new Set([...(film.col.state ?? []), ...(film.col.turn_state ?? [])]);
  if (modes.has(REST)) entry("at rest: asleep, dormant, or on its schedule", (pen) => node(pen, 17, 10, 3.5, REST, full));
  if (modes.has(DEAD)) entry("dead", (pen) => node(pen, 17, 10, 3.5, DEAD, 0));
}

function layers() {
  const { col } = film, way = col.truth_x ?? col.guess_x;
  const has = { frames: col.link_what, sensing: col.sense_node, members: col.join_node, particles: col.cloud_x, trails: way, close: film.flat ? null : way };
  byId("shown").replaceChildren();
  for (const [name, words] of Object.entries(LAYERS)) {
    if (!has[name]?.length) continue;
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = shown[name];
    box.addEventListener("change", () => { shown[name] = box.checked; view = null; show(frame); });
    label.append(box, document.createTextNode(` ${words}`));
    byId("shown").append(label);
  }
}

function colours() {
  const top = film.charge ? film.charge[2] : 0, last = CIVIDIS.length - 1;
  const parts = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  ramp = Array.from({ length: 256 }, (_, level) => {
    const spot = Math.min(1, top ? level / top : 1) * last, low = Math.min(Math.floor(spot), last - 1), part = spot - low;
    const [a, b] = [parts(CIVIDIS[low]), parts(CIVIDIS[low + 1])];
    return `rgb(${a.map((each, i) => Math.round(each + part * (b[i] - each))).join(",")})`;
  });
}

function styles() {
  const counts = new Map();
  for (const name of ["link_what", "cast_what"]) (film.col[name] ?? []).forEach((word) => counts.set(word, (counts.get(word) ?? 0) + 1));
  film.style = {};
  [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a)).forEach((word, i) => { film.style[word] = i % WORDS.length; });
}

function rates() {
  const usual = film.dt ? film.stride * film.dt : 0, real = usual ? 1 / usual : 25;
  const near = RATES.reduce((best, rate) => (Math.abs(Math.log(rate / real)) < Math.abs(Math.log(best / real)) ? rate : best));
  const start = Math.min(Math.max(near, 10), 25);
  speed.replaceChildren(...RATES.map((rate) => {
    const times = usual ? ` (${+(rate * usual).toPrecision(2)}× real time)` : "";
    return new Option(`${rate}/s${times}`, rate, rate === start, rate === start);
  }));
}

function show(number) {
  frame = Math.min(Math.max(Math.round(number) || 0, 0), film.frames - 1);
  draw();
  tell();
}

function play(wanted) {
  playing = wanted && film.frames > 1;
  if (playing && frame >= film.frames - 1) show(0);
  byId("play").textContent = playing ? "Pause" : "Play";
  if (playing) { due = 0; before = performance.now(); requestAnimationFrame(tick); } else remember();
}

function tick(now) {
  if (!playing) return;
  const rate = still.matches ? Math.min(STILL_RATE, +speed.value) : +speed.value;
  due += Math.max(0, now - before) * rate / 1000;
  before = now;
  const whole = Math.floor(due);
  due -= whole;
  if (whole) show(frame + whole);
  if (frame >= film.frames - 1) play(false); else requestAnimationFrame(tick);
}

function turn(number) { playing = false; show(number); play(false); }

function remember() {
  const run = films.length > 1 ? `run=${chosen.value}&` : "";
  try { history.replaceState(null, "", `#${run}frame=${frame}`); } catch { /* a browser that does not let files do it */ }
}

const asked = (name) => location.hash.match(new RegExp(`[#&]${name}=(\\d+)`))?.[1];

async function open(run, number) {
  playing = false;
  unpacked[run] ??= await unpack(films[run].textContent.trim());
  film = unpacked[run];
  view = null;
  shown.close = film.nodes > FEW && !film.flat && film.targets.length > 0;
  colours(); styles(); rates();
  slider.max = film.frames - 1;
  chosen.value = run;
  byId("play").textContent = "Play";
  show(number);
  legend(); layers();
}

function key(event) {
  const held = document.activeElement, box = canvas.getBoundingClientRect();
  const free = held === document.body || byId("player").contains(held);
  if (!free || event.ctrlKey || event.metaKey || event.altKey || box.bottom < 0 || box.top > innerHeight) return;
  if (held.tagName === "SELECT" || (event.key === " " && ["BUTTON", "INPUT"].includes(held.tagName) && held !== slider)) return;
  const stride = event.shiftKey ? 10 : 1;
  const goal = { ArrowLeft: frame - stride, ArrowRight: frame + stride, Home: 0, End: film.frames - 1 }[event.key];
  if (event.key === " ") play(!playing); else if (goal === undefined) return; else turn(goal);
  event.preventDefault();
}

function listen() {
  byId("play").addEventListener("click", () => play(!playing));
  byId("back").addEventListener("click", () => turn(frame - 1));
  byId("ahead").addEventListener("click", () => turn(frame + 1));
  slider.addEventListener("input", () => turn(+slider.value));
  chosen.addEventListener("change", () => open(+chosen.value, 0).then(remember, failed));
  addEventListener("keydown", key);
  addEventListener("hashchange", () => goTo().catch(failed));
  const anew = () => { view = null; show(frame); legend(); };
  new ResizeObserver(() => { if (film && view && canvas.clientWidth !== view.wide) anew(); }).observe(canvas);
  dark.addEventListener("change", anew);
}

async function goTo() {
  const run = Math.min(+(asked("run") ?? chosen.value ?? 0), films.length - 1), number = +(asked("frame") ?? 0);
  if (film && unpacked[run] === film) turn(number); else await open(run, number);
}

function failed(error) {
  message.textContent = `The replay cannot be shown: ${error.message}`;
  message.hidden = false;
  root.dataset.ready = "failed";
}

async function begin() {
  if (!films.length) { message.hidden = true; root.dataset.ready = "empty"; return; }
  if (!("DecompressionStream" in window)) throw new Error("this browser cannot unpack it (no DecompressionStream); newer ones can");
  films.forEach((each, i) => chosen.append(new Option(each.dataset.title, i)));
  byId("which").hidden = films.length < 2;
  message.hidden = true;
  byId("player").hidden = false;
  await goTo();
  listen();
  root.dataset.drawn = Math.round(performance.now());
  root.dataset.ready = "yes";
}

begin().catch(failed);
