// The player: pages through a film by button, slider, key and clock, and says in words what the picture shows.
// Nothing is fetched.
const films = [...document.querySelectorAll(".film")], unpacked = [];
const slider = byId("slider"), speed = byId("speed"), chosen = byId("run"), message = byId("message"), player = byId("player");
const still = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
const RATES = [1, 2, 5, 10, 25, 50, 100, 250, 1000], STILL_RATE = 2, MUCH = 120;
const LAYERS = { frames: "frames in flight", sensing: "who senses", members: "members", particles: "particles", trails: "ways", close: "close-up" };
let playing = false, due = 0, before = 0, opened = 0;

const digits = (value) => (Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));
const counted = (number, noun) => `${number.toLocaleString("en")} ${noun}${number === 1 ? "" : "s"}`;

// How many there are, of which fewer may be drawn.
function tellCount(name, noun) {
  const [from, to] = rows(name), all = film.col[`${name}_all`] ? film.col[`${name}_all`][frame] : to - from;
  return counted(all, noun) + (all > to - from ? ` (${(to - from).toLocaleString("en")} drawn)` : "");
}

function tellTarget(number, target) {
  const { col } = film, at = target * film.frames + frame, head = col.head ? col.head[at] : -1;
  const unit = (film.axes[1].match(/\[(.*)\]$/) || ["", ""])[1], error = col.error ? col.error[at] : NaN;
  const told = [Number.isFinite(error) ? `error ${digits(error)} ${apart(unit)}` : "no estimate"];
  if (head >= 0) told.push(`head ${col.node[head]}${film.mode[head] === DEAD ? ", which has died" : ""}`);
  if (col.join_node && col.join_node.length) told.push(counted(film.clusters[target].size, "member"));
  return (film.targets.length > 1 ? `target ${number}: ` : "") + told.join(", ");
}

function tell() {
  const step = stepOf(frame), sensing = rows("sense")[1] - rows("sense")[0];
  const lines = [`step ${step} of ${film.last}${film.dt === null ? "" : ` · ${+(step * film.dt).toPrecision(7)} s`}`];
  film.targets.forEach((number, target) => lines.push(tellTarget(number, target)));
  if (film.col.sense_node && film.col.sense_node.length) lines.push(sensing === 1 ? "1 node senses" : `${counted(sensing, "node")} sense`);
  if (film.col.link_count) lines.push(`${tellCount("link", "link")} in use, ${tellCount("cast", "broadcast")}`);
  if (film.col.cloud_count) lines.push(tellCount("cloud", "particle"));
  byId("status").textContent = lines.join("\n");
  if (!playing && opened && document.activeElement !== slider) byId("spoken").textContent = lines.join(". ");
  slider.value = frame;
  slider.setAttribute("aria-valuetext", lines[0]);
  root.dataset.frame = step;
}

function layers() {
  const { col } = film, way = col.truth_x || col.guess_x;
  const has = { frames: col.link_what, sensing: col.sense_node, members: col.join_node, particles: col.cloud_x, trails: way };
  has.close = film.flat ? null : way;
  byId("shown").replaceChildren();
  for (const [name, words] of Object.entries(LAYERS)) {
    if (!has[name] || !has[name].length) continue;
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = shown[name];
    box.addEventListener("change", () => { shown[name] = box.checked; anew(); });
    label.append(box, document.createTextNode(` ${words}`));
    byId("shown").append(label);
  }
}

// With reduced motion none is offered that is faster than it will be.
function rates() {
  const usual = film.dt ? film.stride * film.dt : 0, real = usual ? 1 / usual : 25;
  const offered = still.matches ? RATES.filter((rate) => rate <= STILL_RATE) : RATES;
  const near = offered.reduce((best, rate) => (Math.abs(Math.log(rate / real)) < Math.abs(Math.log(best / real)) ? rate : best));
  const start = Math.min(Math.max(near, 10), 25, offered[offered.length - 1] === STILL_RATE ? STILL_RATE : 25);
  speed.replaceChildren(...offered.map((rate) => {
    const times = usual ? ` (${+(rate * usual).toPrecision(2)}× real time)` : "";
    return new Option(`${rate}/s${times}`, rate, rate === start, rate === start);
  }));
}

function show(number) {
  frame = Math.min(Math.max(number, 0), film.frames - 1);
  draw();
  tell();
}

function play(wanted) {
  playing = wanted && film.frames > 1;
  if (playing && frame >= film.frames - 1) show(0);
  byId("play").textContent = playing ? "Pause" : "Play";
  if (playing) { due = 0; before = performance.now(); requestAnimationFrame(tick); } else { tell(); remember(); }
}

function tick(now) {
  if (!playing) return;
  due += Math.max(0, now - before) * speed.value / 1000;
  before = now;
  const whole = Math.floor(due);
  due -= whole;
  if (whole) show(frame + whole);
  if (frame >= film.frames - 1) play(false); else requestAnimationFrame(tick);
}

function turn(number) { playing = false; show(number); play(false); }

function remember() {
  const run = films.length > 1 ? `run=${chosen.value}&` : "";
  try { history.replaceState(null, "", `#${run}frame=${stepOf(frame)}`); } catch { /* a browser that does not let files do it */ }
}

function asked(name) {
  const found = location.hash.match(new RegExp(`[#&]${name}=(\\d+)(?=&|$)`));
  return found ? +found[1] : null;
}

async function open(run, step) {
  const mine = ++opened;
  playing = false;
  chosen.value = run;
  try {
    if (!unpacked[run]) unpacked[run] = await unpack(films[run].textContent.trim());
  } catch {
    const which = films.length > 1 ? ` of ${apart(films[run].dataset.title)}` : "";
    if (mine === opened) failed(`The replay${which} cannot be shown: its data are damaged.`);
    return;
  }
  if (mine !== opened) return;
  film = unpacked[run];
  view = null;
  message.hidden = true;
  player.hidden = false;
  shown.close = film.nodes > FEW && !film.flat && film.targets.length > 0;
  colours(); styles(); rates();
  slider.max = film.frames - 1;
  byId("play").textContent = "Play";
  show(frameOf(step));
  legend(); layers();
  if (!root.dataset.drawn) root.dataset.drawn = Math.round(performance.now());
  root.dataset.ready = "yes";
}

// Keys are obeyed only where the focus is within the player: elsewhere they are the page's.
function key(event) {
  const held = document.activeElement;
  if (!film || !player.contains(held) || event.ctrlKey || event.metaKey || event.altKey || held.tagName === "SELECT") return;
  if (event.key === " " && ["BUTTON", "INPUT"].includes(held.tagName) && held !== slider) return;
  const stride = event.shiftKey ? 10 : 1;
  const goal = { ArrowLeft: frame - stride, ArrowRight: frame + stride, Home: 0, End: film.frames - 1 }[event.key];
  if (event.key === " ") play(!playing); else if (goal === undefined) return; else turn(goal);
  event.preventDefault();
}

function anew() {
  if (!film || player.hidden) return;
  view = null;
  show(frame);
  legend();
}

function listen() {
  byId("play").addEventListener("click", () => play(!playing));
  byId("back").addEventListener("click", () => turn(frame - 1));
  byId("ahead").addEventListener("click", () => turn(frame + 1));
  slider.addEventListener("input", () => turn(+slider.value));
  chosen.addEventListener("change", () => open(+chosen.value, 0).then(() => { if (film) remember(); }));
  addEventListener("keydown", key);
  addEventListener("hashchange", goTo);
  new ResizeObserver(() => { if (view && canvas.clientWidth !== view.wide) anew(); }).observe(canvas);
  addEventListener("resize", () => { if (view && Math.abs(innerHeight - view.high) > MUCH) anew(); });
  addEventListener("beforeprint", () => { root.dataset.print = "yes"; anew(); });
  addEventListener("afterprint", () => { delete root.dataset.print; anew(); });
  dark.addEventListener("change", anew);
  still.addEventListener("change", () => { if (film) rates(); });
}

// What the address asks for; one that names neither a run nor a step asks for nothing.
async function goTo() {
  const step = asked("frame"), run = asked("run");
  if (film && step === null && run === null) return;
  const wanted = run === null ? +chosen.value : Math.min(run, films.length - 1);
  if (film && unpacked[wanted] === film) { if (step !== null) turn(frameOf(step)); return; }
  await open(wanted, step || 0);
  if (film && step !== null && step !== stepOf(frame)) remember();
}

function failed(words) {
  film = null;
  player.hidden = true;
  message.textContent = words;
  message.hidden = false;
  root.dataset.ready = "failed";
}

async function begin() {
  if (!films.length) { message.hidden = true; root.dataset.ready = "empty"; return; }
  if (!("DecompressionStream" in window)) {
    failed("The replay cannot be shown: this browser cannot unpack it (no DecompressionStream); newer ones can.");
    return;
  }
  films.forEach((each, i) => chosen.append(new Option(apart(each.dataset.title), i)));
  byId("which").hidden = films.length < 2;
  listen();
  await goTo();
}

begin().catch((error) => failed(`The replay cannot be shown: ${error.message}`));
