// Joins it all: the state, the camera, the painter, the panels, and the hook window.jaxmm.

const state = {
  layers: { surface: true, prior: true, robot: true, boxes: true, things: true, arrows: true, frustum: true, ceiling: false },
  mode: "probability",
  cut: data.frame.cut, // [m] above it nothing is drawn, unless the ceiling is
  hidden: new Set(), // scans
  key: null, // chosen element
  mismatch: -1, // chosen mismatch
};
const canvas = byId("canvas");
const painter = startPainter();
const reach = reachOf(painter?.bounds ?? []);
let camera = overview(state.cut, aspect());
let flight = null; // {from, to, start} while the camera moves by itself
let waiting = false; // for the next frame
let detail = 0; // row of DETAILS that is drawn while the camera moves: what the machine can draw in time
let coarse = false; // whether the last picture was drawn so
let settling = null; // timer of the whole picture that follows when the camera stands still
let planned = null; // level [m] at which the painter cut floor plan and boxes
let lastClick = null; // {x, y, camera, met, turn}: clicking again goes on to what lies behind

/** The painter, or null and a message in its place where the browser cannot draw in 3D. */
function startPainter() {
  const fail = (words) => {
    Object.assign(byId("failure"), { hidden: false, textContent: words });
    return null;
  };
  const gl = contextOf(canvas);
  if (!gl) return fail("This browser offers no WebGL 2, so there is no 3D view here; lists and tables say the same.");
  canvas.addEventListener("webglcontextlost", () => fail("The 3D view was lost: load the page again."));
  try {
    return painterOf(gl);
  } catch (error) {
    window.jaxmm.errors.push(String(error));
    return fail(`The 3D view cannot be drawn: ${error.message}`);
  }
}

function aspect() {
  return Math.max(1, canvas.clientWidth) / Math.max(1, canvas.clientHeight);
}

const drawnHeights = () => (state.layers.ceiling ? EVERYWHERE : [data.frame.under, state.cut]);

function move(to) {
  flight = null;
  camera = to;
  settle();
  redraw();
}

const [SLOW, QUICK] = [70, 15]; // [ms] of a picture: slower ones are drawn coarser while the camera moves, or finer
const MOST_BUTTONS = 8; // of scans: more of them are one list
const REST = 250; // [ms] after which the camera stands still

/** All of it is drawn once the camera stands still. */
function settle() {
  window.clearTimeout(settling);
  settling = window.setTimeout(() => { settling = null; if (coarse) redraw(); }, REST);
}

/** How long a picture of the moving camera took [ms] decides how much of the next one is drawn. */
function adapt(took) {
  if (took > SLOW) detail = Math.min(DETAILS.length - 1, detail + (took > 3 * SLOW ? 2 : 1));
  else if (took < QUICK) detail = Math.max(0, detail - 1);
}

function fly(to) {
  if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) return move(to);
  flight = { from: camera, to, start: performance.now() };
  settle();
  return redraw();
}

/** Draw at the next frame, however often it is asked for until then. */
function redraw() {
  if (waiting || !painter) return;
  waiting = true;
  window.requestAnimationFrame((now) => {
    waiting = false;
    if (flight) {
      const part = Math.min(1, Math.max(0, (now - flight.start) / 450));
      camera = part === 1 ? flight.to : between(flight.from, flight.to, part * part * (3 - 2 * part));
      if (part === 1) flight = null;
      settle();
    }
    paint();
    if (flight) redraw();
  });
}

function paint() {
  const moving = settling !== null;
  const shown = moving ? detail : 0;
  coarse = shown > 0;
  const ratio = fitted(canvas, DETAILS[shown].share);
  const between = drawnHeights();
  if (planned !== between[1]) painter.cutAt((planned = between[1]));
  const matrix = matrixOf(camera, aspect(), reach);
  painter.draw(state, { matrix: new Float32Array(matrix), eye: axesOf(camera).eye, ratio, between, detail: shown });
  if (moving) timed(painter.gl, adapt);
  placeLabels(labels, matrix, [canvas.clientWidth, canvas.clientHeight], state.mismatch);
  showScale((2 * camera.distance * Math.tan(FIELD / 2)) / canvas.clientHeight, painter.grid.step);
}

const actions = {
  /** Choose an element by its key, and the mismatch that it is; says whether it exists. */
  choose(key) {
    const known = indexOfKey.has(key) || verdictOfKey.has(key);
    if (known) choose(key, mismatchOfKey.get(key) ?? -1);
    return known;
  },
  chooseMismatch(index) {
    const known = index in report.mismatches;
    if (known) choose(data.mismatch_key[index], index);
    return known;
  },
  clear: () => choose(null, -1),
  /** Let the camera fly to what is chosen. */
  look() {
    const place = painter && placeOf(state.key, state.mismatch, painter.bounds);
    if (!place) return;
    if (!state.layers.ceiling) place.high[2] = Math.max(place.low[2], Math.min(place.high[2], state.cut));
    fly(closeUp(camera, place, aspect()));
  },
};

function choose(key, mismatch) {
  Object.assign(state, { key, mismatch });
  if (painter) {
    painter.proposed(verdictOfKey.get(key)?.next_view ?? null);
    painter.pointedAt(pointedAt());
  }
  refresh();
  // On a small screen what is chosen is told below the view.
  const isSmall = window.matchMedia("(max-width: 900px)").matches;
  if (isSmall && (key !== null || mismatch >= 0)) byId("stage").scrollIntoView?.({ block: "start" });
}

/** What has an arrow: displaced elements, and the chosen one if it was measured. */
function pointedAt() {
  const keys = new Set(displacedElements.map((one) => one.key));
  return state.key === null ? keys : keys.add(state.key);
}

/** Elements are coloured anew, by what `tinting` says now. */
function retint() {
  if (painter) painter.tinted();
  planned = null;
  refresh();
}

/** A click at CSS pixels of the canvas; again at the same place, what lies behind. */
function clicked(x, y) {
  if (!painter) return;
  const again = lastClick && Math.hypot(x - lastClick.x, y - lastClick.y) < 5 && lastClick.camera === camera;
  if (again) lastClick.turn++;
  else {
    const ray = rayThrough(camera, aspect(), (2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight);
    lastClick = { x, y, camera, met: metBy(ray, state, painter.bounds, drawnHeights()), turn: 0 };
  }
  const one = lastClick.met[lastClick.turn % Math.max(1, lastClick.met.length)];
  if (one) choose(one.key, one.mismatch);
  else actions.clear();
}

function refresh() {
  showChosen(state, actions);
  showMismatches(state, actions);
  showDisplaced(state, actions);
  showUnexplained();
  showLegend(state);
  markRow(state.key);
  syncControls();
  syncTinting();
  redraw();
}

/** A list of [name, () => camera]; choosing one flies there. Left again, it is ready for the same one. */
function choiceOf(title, views) {
  const list = make("select", { "aria-label": title }, make("option", { value: "" }, title));
  list.append(...views.map(([name], index) => make("option", { value: index }, name)));
  list.addEventListener("change", () => {
    if (list.value !== "") fly(views[list.value][1]());
  });
  list.addEventListener("blur", () => { list.value = ""; }); // not before: keys go on from what is chosen
  return list;
}

function showCameras() {
  const views = [["Overview", () => overview(state.cut, aspect())], ["Plan", () => plan(state.cut, aspect())]];
  const several = report.scans.length > 1;
  const named = (scan) => (several ? `From scan ${scan + 1}` : "From the sensor");
  const sensors = report.scans.map((one, scan) => [named(scan), () => fromSensor(one.pose)]);
  if (sensors.length <= MOST_BUTTONS) views.push(...sensors);
  byId("cameras").append(...views.map(([name, to]) => make("button", { click: () => fly(to()) }, name)));
  if (sensors.length > MOST_BUTTONS) byId("cameras").append(choiceOf("From scan …", sensors));
  canvas.addEventListener("keydown", (event) => {
    if (event.key === "Home") fly(overview(state.cut, aspect()));
    else if (event.key === "Escape") actions.clear();
    else return;
    event.preventDefault();
  });
}

/** What tests and the console may use; it stays as it is. Positions are of the world [m]. */
function openHook() {
  const layers = {};
  for (const layer of Object.keys(state.layers)) {
    const set = (on) => { state.layers[layer] = Boolean(on); refresh(); };
    Object.defineProperty(layers, layer, { enumerable: true, get: () => state.layers[layer], set });
  }
  const hook = {
    layers,
    webgl: painter !== null,
    select: (key) => (key === null ? actions.clear() : actions.choose(key)),
    selectMismatch: actions.chooseMismatch,
    tinting,
    /** Where a world position is in the window [CSS pixel]; null behind the eye. */
    project(place) {
      const [x, y, w] = projected(matrixOf(camera, aspect(), reach), offsetOf(place));
      const area = canvas.getBoundingClientRect();
      return w > 0 ? [area.left + ((x / w + 1) / 2) * area.width, area.top + ((1 - y / w) / 2) * area.height] : null;
    },
  };
  const told = {
    selected: () => state.key, selectedMismatch: () => (state.mismatch < 0 ? null : state.mismatch),
    still: () => !flight && !waiting && settling === null,
  };
  for (const [name, get] of Object.entries(told)) Object.defineProperty(hook, name, { enumerable: true, get });
  Object.defineProperties(window.jaxmm, Object.getOwnPropertyDescriptors(hook));
}

const labels = painter ? makeLabels(state, actions, painter) : [];
const markRow = tableOf(actions);
const syncControls = showControls(state, refresh);
const syncTinting = showTinting(retint);
steer(canvas, () => camera, move, clicked);
showCameras();
showDetails();
openHook();
if (painter) painter.pointedAt(pointedAt());
new ResizeObserver(redraw).observe(canvas);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener?.("change", retint);
refresh();
window.jaxmm.ready = true;
