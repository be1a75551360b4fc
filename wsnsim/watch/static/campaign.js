// The page of a campaign: it asks its server for the progress, and for the curves when there are new ones.
const PAUSE = 1000, PATIENCE = 5, BETWEEN = 10000, root = document.documentElement, byId = (id) => document.getElementById(id);
const seen = { version: -1, failures: 0, done: null, at: -Infinity };
const number = (value) => +value.toPrecision(3);

function duration(seconds) {
  if (seconds === null) return "unknown";
  if (seconds < 120) return `about ${Math.ceil(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 120 ? `about ${minutes} min` : `about ${number(minutes / 60)} h`;
}

function items(list, texts) {
  list.replaceChildren(...texts.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; }));
}

function fillTable(points) {
  byId("rows").replaceChildren(...points.map(([settings, done, failed, wanted, seconds]) => {
    const row = document.createElement("tr"), name = document.createElement("th");
    name.scope = "row";
    name.textContent = settings;
    row.append(name, ...[done, failed, wanted, seconds === null ? "" : number(seconds)].map((value) => {
      const cell = document.createElement("td");
      cell.textContent = value;
      return cell;
    }));
    return row;
  }));
}

// A figure is replaced only when its image has arrived, so that nothing flickers.
function showCurves(state) {
  const list = byId("curves"), names = state.curves.map(([name]) => name);
  [...list.children].filter((figure) => !names.includes(figure.dataset.name)).forEach((figure) => figure.remove());
  state.curves.forEach(([name, title], place) => {
    let figure = list.querySelector(`[data-name="${name}"]`);
    if (!figure) {
      figure = document.createElement("figure");
      figure.dataset.name = name;
      figure.append(document.createElement("img"));
      list.insertBefore(figure, list.children[place] || null);
    }
    const image = figure.firstChild;
    image.alt = title;
    image.src = `${name}.svg?version=${state.version}`;
    image.onload = () => { root.dataset.curves = state.version; };
  });
  items(byId("left-out"), state.left_out.map(([name, why]) => `without ${name}: ${why}`));
}

function tell(state) {
  const share = state.total ? (state.done + state.failed) / state.total : 1;
  byId("share").value = share;
  byId("done").textContent = `${state.done.toLocaleString("en")} of ${state.total.toLocaleString("en")}`;
  byId("failed").textContent = state.failed;
  byId("running").textContent = state.running;
  byId("left").textContent = state.complete ? "nothing" : duration(state.left);
  byId("seconds").textContent = state.seconds === null ? "unknown" : `${number(state.seconds)}\u00a0s`;
  byId("why").textContent = state.why;
  byId("why").hidden = !state.why;
  fillTable(state.points);
  items(byId("failures"), state.failures.map(([task, why]) => `${task}: ${why}`));
  if (seen.done !== null && state.done !== seen.done) seen.at = performance.now();  // between two tasks, none is running
  seen.done = state.done;
  const waiting = state.running || state.computes || performance.now() - seen.at < BETWEEN ? "The campaign runs." : "No task is running: resume the campaign with wsnsim sweep.";
  byId("state").textContent = state.complete ? "The campaign is complete." : waiting;
  if (state.version !== seen.version) { seen.version = state.version; showCurves(state); }
  root.dataset.done = state.done;
  root.dataset.ready = "yes";
}

async function watch() {
  for (;;) {
    try {
      const answer = await fetch("state", { cache: "no-store" });
      if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
      tell(await answer.json());
      seen.failures = 0;
    } catch (error) { seen.failures++; root.dataset.failure = error.message; }
    if (seen.failures >= PATIENCE) {
      byId("state").textContent += " wsnsim no longer answers: its server has been closed. What is shown here stays.";
      root.dataset.ready = root.dataset.ready || "failed";
      return;
    }
    await new Promise((done) => { setTimeout(done, PAUSE); });
  }
}

watch();
