// The curves beside the drawing: the position error of each target, and the energy spent, over the simulated time.
// They grow with each portion. A vertical line marks the drawn step, and the values there stand in words.
const CURVE_EDGE = { left: 44, right: 12, title: 18, gap: 16, bottom: 32 }, CURVE_HEIGHTS = [120, 84], LABEL_HEIGHT = 13, CURVE_TICKS = 5;
const LOG_FROM = 30, MOST_DECADES = 4;  // a logarithmic axis from this ratio of the largest error to the median on, and what it spans at most
const curves = { canvas: byId("time-curves"), of: [], panels: [], area: null, base: null };

const simulated = (number) => stepOf(number) * (replay.dt ?? 1);
const lengthUnit = () => (replay.axes[1].match(/\[(.*)\]$/) || ["", "m"])[1];

// [[time, value], ...] of a target's position error in the frames that are known; null where there is no estimate.
function errorCurve(target) {
  const { error } = replay.col, from = target * replay.frames;
  return Array.from({ length: replay.known }, (_, i) => [simulated(i), error && Number.isFinite(error[from + i]) ? error[from + i] : null]);
}

// The energy spent until a time, on the drawn line: between two looks at the run, it is interpolated.
function energyAt(time) {
  const { spent } = replay, next = spent.findIndex(([then]) => then >= time);
  if (next < 0) return spent[spent.length - 1][1];
  const [end, most] = spent[next], [begin, least] = next ? spent[next - 1] : [0, 0];
  return end > begin ? least + ((most - least) * (time - begin)) / (end - begin) : most;
}

// The time axis ends at the end of the run, or at a half, a quarter and so on of it that holds all that is known.
function curveEnd() {
  let end = simulated(replay.frames - 1);
  const now = Math.max(simulated(replay.known - 1), replay.spent.length ? replay.spent[replay.spent.length - 1][0] : 0);
  while (now > 0 && end / 2 >= now) end /= 2;
  return end || 1;
}

const energyScale = (most) => (most >= 1 || most === 0 ? [1, "J"] : most >= 1e-3 ? [1e3, "mJ"] : [1e6, "µJ"]);

// { share, marks, note }: the height of a value as a share of the panel, the values at its lines, and a note for its title.
// Without a logarithmic axis, the error at track initiation or after a loss would flatten all others.
function valueAxis(lines, mayBeLog) {
  const values = lines.flatMap((line) => line.map(([, value]) => value).filter((value) => value !== null)).sort((a, b) => a - b);
  const most = values[values.length - 1] || 1, median = values[values.length >> 1];
  if (!mayBeLog || !(most > LOG_FROM * median)) return { share: (value) => value / (1.06 * most), marks: ticks(0, 1.06 * most, CURVE_TICKS), note: "" };
  const least = Math.max(values.find((value) => value > 0), most / 10 ** MOST_DECADES), low = Math.log10(least), span = Math.log10(most) - low;
  const powers = Array.from({ length: Math.ceil(span) + 2 }, (_, i) => 10 ** (Math.floor(low) + i));
  const marks = powers.flatMap((power) => (span > 2 ? [power] : [power, 2 * power, 5 * power])).map((mark) => +mark.toPrecision(3));
  return { share: (value) => Math.max(0, (Math.log10(Math.max(value, least)) - low) / (1.06 * span)), marks: marks.filter((mark) => mark >= least && mark <= most), note: ", log scale" };
}

// One panel per quantity that the run has: { title, unit, lines, share, marks, at }; `at` gives the values of a frame.
function curvePanels() {
  const found = [], errors = replay.targets.map((_, target) => errorCurve(target));
  if (errors.some((line) => line.some(([, value]) => value !== null))) {
    found.push({ title: "position error", isError: true, unit: lengthUnit(), lines: errors, at: (number) => errors.map((line) => line[number]?.[1] ?? null) });
  }
  if (replay.spent.length) {
    const [scale, unit] = energyScale(replay.spent[replay.spent.length - 1][1]);
    const line = [[0, 0], ...replay.spent.map(([time, joules]) => [time, joules * scale])];
    found.push({ title: "energy spent", unit, lines: [line], at: (number) => [energyAt(simulated(number)) * scale] });
  }
  let top = 0;
  return found.map((panel, i) => {
    const placed = { ...panel, ...valueAxis(panel.lines, panel.isError), top: top + CURVE_EDGE.title, height: CURVE_HEIGHTS[i] };
    top = placed.top + placed.height + CURVE_EDGE.gap;
    return placed;
  });
}

const lineColour = (panel, i) => (!panel.isError ? view.sense : panel.lines.length === 1 ? view.estimate : view.kinds[i % view.kinds.length]);
const heightOf = (panel, value) => panel.top + panel.height * (1 - panel.share(value));
const lineDashes = (i) => DASHES[i % DASHES.length];

function curveFrame(pen, panel, area, isLast) {
  const { left, width, end } = area, { top, height } = panel, across = width / CURVE_TICKS > 45 ? CURVE_TICKS : 3;
  pen.font = "11px system-ui, sans-serif"; pen.fillStyle = view.soft;
  pen.textAlign = "left"; pen.fillText(`${panel.title} [${panel.unit}]${panel.note}`, left, top - 6);
  pen.beginPath(); pen.rect(left, top, width, height);
  for (const value of panel.marks) {
    const at = heightOf(panel, value);
    pen.moveTo(left, at); pen.lineTo(left + width, at);
    pen.textAlign = "right"; pen.fillText(value, left - 5, at + 4);
  }
  for (const time of ticks(0, end, across)) {
    const at = left + (width * time) / end;
    pen.moveTo(at, top); pen.lineTo(at, top + height);
    if (isLast) { pen.textAlign = "center"; pen.fillText(time, at, top + height + 13); }
  }
  stroke(pen, view.line, 0.6);
  if (isLast) { pen.textAlign = "center"; pen.fillText(replay.dt === null ? "step" : "time [s]", left + width / 2, top + height + 28); }
}

// Gaps stay open; a value between two gaps is a dot.
function curveLine(pen, panel, area, i) {
  const line = panel.lines[i], { left, width, end } = area, colour = lineColour(panel, i), alone = [];
  const place = ([time, value]) => [left + (width * time) / end, heightOf(panel, value)];
  pen.beginPath();
  line.forEach((point, k) => {
    if (point[1] === null) return;
    const before = k > 0 && line[k - 1][1] !== null, after = k + 1 < line.length && line[k + 1][1] !== null;
    if (before) pen.lineTo(...place(point)); else pen.moveTo(...place(point));
    if (!before && !after) alone.push(place(point));
  });
  stroke(pen, colour, 1.4, lineDashes(i));
  pen.fillStyle = colour;
  alone.forEach(([x, y]) => pen.fillRect(x - 1.2, y - 1.2, 2.4, 2.4));
}

// The values at the drawn step: one stands beside the title; of several targets, numbers stand beside the lines.
function curveValues(pen, panel, area) {
  const x = area.left + (area.width * simulated(frame)) / area.end, several = panel.lines.length > 1;
  pen.beginPath(); pen.moveTo(x, panel.top); pen.lineTo(x, panel.top + panel.height); stroke(pen, view.soft, 1);
  const values = panel.at(frame), marks = [];
  values.forEach((value, i) => {
    if (value === null) return;
    const y = heightOf(panel, value);
    marker(pen, "dot", x, y, 3); pen.fillStyle = lineColour(panel, i); pen.fill();
    marks.push({ y, i });
  });
  pen.font = "bold 11px system-ui, sans-serif";
  if (!several) {
    pen.textAlign = "right"; pen.fillStyle = view.ink;
    pen.fillText(values[0] === null ? "no estimate" : `${digits(values[0])}\u00a0${panel.unit}`, area.left + area.width, panel.top - 6);
    return;
  }
  const right = x < area.left + area.width - 24;
  pen.textAlign = right ? "left" : "right"; pen.lineWidth = 3; pen.strokeStyle = view.paper;
  let below = Infinity;
  marks.sort((a, b) => b.y - a.y).forEach(({ y, i }) => {
    below = Math.min(y + 4, below - LABEL_HEIGHT);
    const at = x + (right ? 6 : -6), number = replay.targets[i];
    pen.strokeText(number, at, below); pen.fillStyle = lineColour(panel, i); pen.fillText(number, at, below);
  });
}

// The axes and the lines, which change only with the data and with the size and the colours of the page.
function makeCurves() {
  const { canvas } = curves, panels = curvePanels();
  canvas.hidden = !panels.length;
  Object.assign(curves, { of: [replay, replay.portions, view], panels });
  if (!panels.length) return;
  const wide = canvas.clientWidth, last = panels[panels.length - 1], tall = last.top + last.height + CURVE_EDGE.bottom;
  const area = { left: CURVE_EDGE.left, width: Math.max(40, wide - CURVE_EDGE.left - CURVE_EDGE.right), end: curveEnd() };
  canvas.style.height = `${tall}px`;
  canvas.width = Math.round(wide * view.zoom);
  canvas.height = Math.round(tall * view.zoom);
  const base = document.createElement("canvas"), pen = base.getContext("2d");
  base.width = canvas.width; base.height = canvas.height;
  pen.scale(view.zoom, view.zoom);
  for (const panel of panels) {
    curveFrame(pen, panel, area, panel === last);
    panel.lines.forEach((_, i) => curveLine(pen, panel, area, i));
  }
  canvas.dataset.end = area.end;
  Object.assign(curves, { area, base });
}

function drawCurves() {
  if ([replay, replay.portions, view].some((each, i) => each !== curves.of[i])) makeCurves();
  if (!curves.panels.length) return;
  const pen = curves.canvas.getContext("2d");
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, curves.canvas.width, curves.canvas.height);
  pen.drawImage(curves.base, 0, 0);
  pen.setTransform(view.zoom, 0, 0, view.zoom, 0, 0);
  curves.panels.forEach((panel) => curveValues(pen, panel, curves.area));
  curves.canvas.setAttribute("aria-label", curves.panels.map(curveWords).join("; "));
}

// What the curves show at the drawn step, for who cannot see them.
function curveWords(panel) {
  const words = panel.at(frame).map((value) => (value === null ? "no estimate" : `${digits(value)}\u00a0${panel.unit}`));
  return `${panel.title}: ${words.join(", ")}`;
}

function showCurves() { canvas.addEventListener("drawn", drawCurves); }
