// The page of a run that computes: it asks its server for what is new, and shows the newest frame until the user goes to another one.
const PAUSE = 400, PATIENCE = 5;
const live = { run: 0, got: 0, follows: true, failures: 0, features: "", ended: false };
const number = (value, unit) => (value === null || value === undefined ? "none yet" : `${+value.toPrecision(3)}${unit ? `\u00a0${unit}` : ""}`);
const joules = (value) => (value >= 1 || value === 0 ? number(value, "J") : value >= 1e-3 ? number(1e3 * value, "mJ") : number(1e6 * value, "µJ"));

function keepNewest(wanted) {
  live.follows = wanted;
  byId("follow").checked = wanted;
}

// The legend and the styles of messages are made again when something is drawn that was not drawn before.
function showNewest() {
  slider.max = Math.max(lastFrame(), 0);
  if (view) view.base = null;
  const features = JSON.stringify([Object.keys(replay.col), [...replay.words], replay.charge, replay.col.membership_node?.length > 0, [...new Set(replay.col.state || [])], replay.mode.includes(DEAD)]), fresh = features !== live.features;
  if (fresh) styles();
  if (live.follows && !playing) show(lastFrame()); else { draw(); describe(); }
  if (fresh) { live.features = features; legend(); layers(); }
}

async function take(state) {
  if (!state.run) return;
  if (state.run !== live.run || state.from === 0) Object.assign(live, { run: state.run, got: 0, features: "" });
  for (const text of state.texts) {
    const part = await parse(text);
    if (live.got === 0) {
      live.data = beginLive(part);
      live.shown = false;
      keepNewest(true);
    } else extendLive(live.data, part);
    live.got++;
  }
  if (!state.texts.length || !live.data || !live.data.known) return;
  if (!live.shown) {
    live.shown = true;
    present(live.data, 0);
  }
  showNewest();
  root.dataset.ready = "yes";
  root.dataset.known = live.data.known;
}

function bars(causes) {
  const list = byId("energy"), most = Math.max(...Object.values(causes), 1e-30);
  list.replaceChildren(...Object.entries(causes).sort((a, b) => b[1] - a[1]).map(([cause, value]) => {
    const row = document.createElement("div"), name = document.createElement("span"), bar = document.createElement("meter"), size = document.createElement("span");
    name.textContent = cause.replaceAll("_", " ");
    size.textContent = joules(value);
    Object.assign(bar, { min: 0, max: most, value });
    bar.setAttribute("aria-label", `${cause}: ${joules(value)}`);
    row.append(name, bar, size);
    return row;
  }));
}

function tellProgress(state) {
  const { progress } = state, unit = (replay?.axes[1].match(/\[(.*)\]$/) || ["", "m"])[1];
  if (progress) {
    byId("share").value = progress.share;
    byId("time").textContent = `${+progress.time.toPrecision(4)} of ${+progress.duration.toPrecision(4)} s`;
    byId("speed-now").textContent = +progress.speed.toPrecision(3);
    byId("number").textContent = `${progress.number} of ${progress.runs}`;
    byId("left").textContent = progress.share > 0 ? `about ${Math.ceil(progress.wall / progress.share - progress.wall)} s` : "unknown";
  }
  if (state.rmse === null && replay && !Object.keys(state.joules || {}).length) return;  // another run has begun, of which no frame is complete
  byId("error").textContent = number(state.error, unit);
  byId("rmse").textContent = number(state.rmse, unit);
  const spent = Object.values(state.joules || {}).reduce((sum, each) => sum + each, 0);
  byId("spent").textContent = spent ? joules(spent) : "none";
  bars(state.joules || {});
}

function say(text) {
  byId("state").textContent = text;
  root.dataset.state = text;
}

async function ask() {
  const answer = await fetch(`state?run=${live.run}&from=${live.got}`, { cache: "no-store" });
  if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
  const state = await answer.json();
  live.failures = 0;
  await take(state);
  tellProgress(state);
  if (state.ended) { live.ended = true; location.reload(); return 0; }
  const done = state.progress && state.progress.share >= 1;
  say(done ? "The run has ended; the page of its result is being made." : state.run ? "The run computes." : "The run begins.");
  if (!state.run && state.progress && state.progress.runs > 1) say("Standalone runs are computed many at once: they have no steps to show (--no-batch computes them one by one).");
  if (state.note) say(state.note);
  return state.run && live.got < state.known ? 0 : PAUSE;
}

async function watch() {
  byId("follow").addEventListener("change", () => { keepNewest(byId("follow").checked); if (live.follows && replay) { playing = false; show(lastFrame()); play(false); } });
  for (const id of ["play", "back", "slider"]) byId(id).addEventListener(id === "slider" ? "input" : "click", () => keepNewest(false));
  canvas.addEventListener("keydown", (event) => { if (["ArrowLeft", "Home", " "].includes(event.key)) keepNewest(false); });
  while (!live.ended) {
    let pause = PAUSE;
    try { pause = await ask(); } catch (error) { live.failures++; root.dataset.failure = error.message; }
    if (live.failures >= PATIENCE) {
      say("wsnsim no longer answers: the run was interrupted, or its server has been closed. What is shown here stays.");
      root.dataset.ready = root.dataset.ready || "failed";
      return;
    }
    if (pause) await new Promise((done) => { setTimeout(done, pause); });
  }
}

listen();
showCurves();
watch();
