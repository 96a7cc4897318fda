// Everything that is on the graphics card, and how one picture is drawn from it.

const POINT_WIDTH = 0.04; // [m]
/**
 * How much is drawn, from all to least: of each CSS pixel's side the share, every how many-th point, and whether the
 * edges of elements, which are most of what thousands of them take. WebGL allows no stride over 255 bytes, which 22
 * points of 12 bytes would be.
 */
const DETAILS = [
  { share: 1, step: 1, edges: true }, { share: 0.7, step: 2, edges: true }, { share: 0.5, step: 4, edges: true },
  { share: 0.5, step: 8, edges: false }, { share: 0.35, step: 16, edges: false },
  { share: 0.25, step: 21, edges: false },
];

/**
 * The painter of a context: fixed buffers now, `draw` for every picture; `cutAt`, `proposed`, `tinted` and `pointedAt`
 * where levels, colours or what is chosen change.
 */
function painterOf(gl) {
  const programs = {
    surface: linked(gl, SURFACE_SHADERS),
    lines: linked(gl, LINE_SHADERS),
    points: linked(gl, POINT_SHADERS),
  };
  const bounds = boundsOf();
  const edges = edgeLines();
  const grid = gridMarks();
  const long = Math.min(2.5, Math.max(1, 0.2 * Math.hypot(...sum(data.frame.high, data.frame.low, -1))));
  const sensorsOf = (old) => report.scans.map((scan, index) => {
    const one = sensorMarks(scan.pose, data.fields_of_view[index] ?? [], scanTint(index), long);
    const lines = lineItem(gl, one.lines, old[index]?.lines);
    const solid = solidItem(gl, programs, one.triangles, scanTint(index), 1, old[index]?.solid);
    return { eye: one.eye, lines, solid };
  });
  const painter = {
    gl, programs, bounds, grid, edgeStarts: edges.starts,
    nothing: gl.createVertexArray(), // lines have no attributes
    surface: surfaceItem(gl, programs),
    edges: lineItem(gl, edges.lines),
    arrows: lineItem(gl, []),
    plan: lineItem(gl, []),
    grid_: lineItem(gl, grid.lines),
    boxes: [],
    sensors: sensorsOf([]),
    proposal: null,
    robot: pointItem(gl, programs, arrays.robot, arrays.robot_probability, arrays.robot_evidence, arrays.robot_distance),
    prior: pointItem(gl, programs, arrays.prior, arrays.prior_probability, arrays.prior_evidence),
  };
  painter.cutAt = (z) => {
    painter.plan = lineItem(gl, planLines(bounds, z), painter.plan);
    painter.things = lineItem(gl, thingLines(z), painter.things);
    painter.boxes = report.mismatches.map((one, index) => boxItem(gl, programs, one, z, painter.boxes[index]));
  };
  painter.proposed = (pose) => {
    const marks = pose && sensorMarks(pose, [], ink(), 0.8);
    painter.proposal = marks && {
      eye: marks.eye,
      lines: lineItem(gl, marks.lines, painter.proposal?.lines),
      solid: solidItem(gl, programs, marks.triangles, "#e69f00", 1, painter.proposal?.solid),
    };
  };
  painter.tinted = () => {
    painter.sensors = sensorsOf(painter.sensors);
    gl.bindBuffer(gl.ARRAY_BUFFER, painter.surface.buffers[1]);
    gl.bufferData(gl.ARRAY_BUFFER, tintsOf(cornersOf()), gl.STATIC_DRAW);
    painter.edges = lineItem(gl, inked(edges).lines, painter.edges);
  };
  painter.pointedAt = (keys) => {
    painter.arrows = lineItem(gl, offsetArrows(keys, bounds), painter.arrows);
  };
  painter.draw = (state, view) => draw(painter, state, view);
  return painter;
}

/** Free what `old` held, so that what moves can be made anew at every move. */
function replaced(gl, old) {
  if (!old) return;
  old.buffers?.forEach((buffer) => gl.deleteBuffer(buffer));
  if (old.reader) gl.deleteVertexArray(old.reader);
  if (old.texture) gl.deleteTexture(old.texture);
}

function lineItem(gl, lines, old = null) {
  replaced(gl, old);
  return { texture: lineTexture(gl, lineBytes(lines)), count: lines.length / LINE };
}

function triangleItem(gl, programs, place, tint, old = null) {
  replaced(gl, old);
  const buffers = [filled(gl, place), filled(gl, tint)];
  const reader = readBy(gl, programs.surface, [
    { name: "place", buffer: buffers[0], size: 3, kind: gl.FLOAT },
    { name: "tint", buffer: buffers[1], size: 4, kind: gl.UNSIGNED_BYTE, normalized: true },
  ]);
  return { reader, buffers, count: place.length / 3 };
}

function surfaceItem(gl, programs) {
  const place = cornersOf();
  return triangleItem(gl, programs, place, tintsOf(place));
}

function solidItem(gl, programs, numbers, hex, opacity, old = null) {
  const tint = new Uint32Array(numbers.length / 3).fill(packed(hex, opacity));
  return triangleItem(gl, programs, new Float32Array(numbers), lit(tint, numbers), old);
}

function boxItem(gl, programs, mismatch, cut, old) {
  const removed = mismatch.mismatch_type === "removed";
  const lines = lineItem(gl, boxLines(mismatch, cut), old?.lines);
  const sides = solidItem(gl, programs, boxTriangles(mismatch, cut), removed ? REMOVED : ADDED, 0.3, old?.sides);
  return { removed, lines, sides };
}

/** Points, with a reader of all of them, of every second one, and so on, by the steps of DETAILS. */
function pointItem(gl, programs, place, probability, evidence, distance = []) {
  const off = distance.length ? distance : new Int16Array(place.length / 3);
  const buffers = [place, probability, evidence, off].map((values) => filled(gl, values));
  const readers = DETAILS.map(({ step }) => readBy(gl, programs.points, [
    { name: "place", buffer: buffers[0], size: 3, kind: gl.FLOAT, stride: 12 * step },
    { name: "probability", buffer: buffers[1], size: 1, kind: gl.UNSIGNED_BYTE, normalized: true, stride: step },
    { name: "evidence", buffer: buffers[2], size: 1, kind: gl.UNSIGNED_BYTE, stride: step },
    { name: "off", buffer: buffers[3], size: 1, kind: gl.SHORT, stride: 2 * step },
  ]));
  return { readers, count: place.length / 3 };
}

/**
 * One picture: points first, for they hide what lies behind; then, through each other, floor, surfaces, boxes, sensors.
 *
 * state: of the viewer; view: {matrix, eye, ratio, between, detail} with the pixels of a CSS pixel, the heights drawn [m]
 * and the row of DETAILS.
 */
function draw(painter, state, view) {
  const { gl } = painter;
  gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
  gl.clearColor(...rgb(ofStyle("--back")), 1);
  gl.depthMask(true);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);
  gl.disable(gl.BLEND);
  drawPoints(painter, state, view);
  gl.depthMask(false);
  gl.enable(gl.BLEND);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  drawLines(painter, painter.grid_, view, 1);
  if (state.layers.surface) {
    drawTriangles(painter, painter.surface, view);
    if (DETAILS[view.detail].edges) drawLines(painter, painter.edges, view, 1.1);
    drawLines(painter, painter.plan, { ...view, between: EVERYWHERE }, 1.8);
  }
  const element = indexOfKey.get(state.key);
  if (element !== undefined) drawChosen(painter, element, view);
  const whole = { ...view, between: EVERYWHERE }; // boxes are cut already, and sensors may stand above it
  if (state.layers.boxes) painter.boxes.forEach((box, index) => drawBox(painter, box, index === state.mismatch, whole));
  if (state.layers.things) drawLines(painter, painter.things, whole, 1.6);
  if (state.layers.arrows) {
    gl.disable(gl.DEPTH_TEST); // they begin inside of what moved
    drawLines(painter, painter.arrows, whole, 3);
    gl.enable(gl.DEPTH_TEST);
  }
  if (state.layers.frustum) {
    const shown = painter.sensors.filter((_, scan) => !state.hidden.has(scan));
    for (const sensor of painter.proposal ? [...shown, painter.proposal] : shown) {
      if (Math.hypot(...sum(sensor.eye, view.eye, -1)) < 0.5) continue; // who looks from a sensor does not see it
      drawTriangles(painter, sensor.solid, whole);
      drawLines(painter, sensor.lines, whole, 1.6);
    }
  }
}

const EVERYWHERE = [-1e9, 1e9];

function drawPoints({ gl, programs, robot, prior }, state, view) {
  const { program, at } = programs.points;
  gl.useProgram(program);
  gl.uniformMatrix4fv(at.matrix, false, view.matrix);
  gl.uniform2fv(at.between, view.between);
  gl.uniform1f(at.diameter, (POINT_WIDTH * gl.canvas.height) / (2 * Math.tan(FIELD / 2)));
  const { step } = DETAILS[view.detail];
  const wider = step ** 0.25; // fewer points cover a little more each
  gl.uniform2f(at.sizes, 1.8 * view.ratio * wider, 9 * view.ratio * wider);
  gl.uniform3fv(at.palette, Object.values(EVIDENCE).flatMap(rgb));
  gl.uniform3fv(at.offs, [...DISTANCE_RAMP, FAR].flatMap(rgb));
  gl.uniform1f(at.scale, OFF_SCALE / data.distance_step);
  const ranges = (item, mode, ramp, round, parts) => {
    gl.bindVertexArray(item.readers[view.detail]);
    gl.uniform1i(at.mode, mode);
    gl.uniform3fv(at.calm, rgb(ramp[0]));
    gl.uniform3fv(at.hot, rgb(ramp[1]));
    gl.uniform1i(at.round_, round);
    for (const [first, last, tint] of parts) {
      gl.uniform3fv(at.plain, rgb(tint));
      const [start, end] = [Math.ceil(first / step), Math.floor(last / step)];
      if (end > start) gl.drawArrays(gl.POINTS, start, end - start);
    }
  };
  const mode = MODES.indexOf(state.mode);
  // Of the model's own points nothing is off, and they would hide where those of the scan are.
  if (state.layers.prior && state.mode !== "distance") ranges(prior, mode, PRIOR_RAMP, 0, [[0, prior.count, PRIOR_RAMP[0]]]);
  if (state.layers.robot) {
    const starts = scanStarts();
    const parts = report.scans.map((_, scan) => [starts[scan], starts[scan + 1], scanTint(scan)]);
    ranges(robot, mode, ROBOT_RAMP, 1, parts.filter((_, scan) => !state.hidden.has(scan)));
  }
}

function drawTriangles({ gl, programs }, item, view, { instead = [0, 0, 0, 0], hatch = 0, part } = {}) {
  const { program, at } = programs.surface;
  gl.useProgram(program);
  gl.uniformMatrix4fv(at.matrix, false, view.matrix);
  gl.uniform2fv(at.between, view.between);
  gl.uniform4fv(at.instead, instead);
  gl.uniform1f(at.hatch, hatch * view.ratio);
  gl.bindVertexArray(item.reader);
  const [first, end] = part ?? [0, item.count];
  if (end > first) gl.drawArrays(gl.TRIANGLES, first, end - first);
}

function drawLines({ gl, programs, nothing }, item, view, width, { instead = [0, 0, 0, 0], fade = 1, part } = {}) {
  const { program, at } = programs.lines;
  gl.useProgram(program);
  gl.uniformMatrix4fv(at.matrix, false, view.matrix);
  gl.uniform2fv(at.between, view.between);
  gl.uniform2f(at.size, gl.canvas.width, gl.canvas.height);
  gl.uniform1f(at.width, width * view.ratio);
  gl.uniform4fv(at.instead, instead);
  gl.uniform1f(at.fade, fade);
  gl.bindTexture(gl.TEXTURE_2D, item.texture);
  gl.bindVertexArray(nothing);
  const [first, end] = part ?? [0, item.count];
  if (end > first) gl.drawArrays(gl.TRIANGLES, 6 * first, 6 * (end - first));
}

/** The chosen element: filled, and outlined in ink also where points stand before it. */
function drawChosen(painter, element, view) {
  const { gl } = painter;
  const part = [3 * arrays.first[element], 3 * arrays.first[element + 1]];
  drawTriangles(painter, painter.surface, view, { instead: [...rgb(lookOf(data.key[element]).tint), 0.42], part });
  const outline = [painter.edgeStarts[element], painter.edgeStarts[element + 1]];
  gl.disable(gl.DEPTH_TEST);
  drawLines(painter, painter.edges, view, 2.4, { instead: [...rgb(ink()), 1], part: outline });
  gl.enable(gl.DEPTH_TEST);
}

function drawBox(painter, box, chosen, view) {
  const { gl } = painter;
  drawTriangles(painter, box.sides, view, { hatch: box.removed ? 9 : 0 });
  const width = chosen ? 4 : 2.4;
  gl.disable(gl.DEPTH_TEST);
  drawLines(painter, box.lines, view, width, { fade: 0.4 });
  gl.enable(gl.DEPTH_TEST);
  drawLines(painter, box.lines, view, width);
}
