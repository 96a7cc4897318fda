// What is drawn on top of clouds and surfaces: boxes of mismatches, sensors, proposed views, and the grid on the floor.

const LINE = 8; // numbers of a line: start, end, colour, dash
const LINES_A_ROW = 1024; // of the texture that holds them; the shader says the same
const DASH = 0.24; // [m] of dash and gap

/** Append a line between two places; `ink` as `packed` gives it, `dash` [m], 0 for a solid one. */
function addLine(lines, start, end, ink, dash = 0) {
  lines.push(start[0], start[1], start[2], end[0], end[1], end[2], ink, dash);
}

/** Lines as the bytes that the graphics card reads. */
function lineBytes(lines) {
  const numbers = new Float32Array(lines);
  const bytes = new Uint32Array(numbers.buffer);
  for (let i = 6; i < lines.length; i += LINE) bytes[i] = lines[i];
  return bytes;
}

/** Corners of a mismatch's footprint, counter-clockwise: 4 of a rectangle, 32 of a round one; [x, y] offsets. */
function footprint(mismatch) {
  const center = offsetOf(mismatch.center);
  const [a, b] = [mismatch.dimensions[0] / 2, mismatch.dimensions[1] / 2];
  const turn = (mismatch.rotation * Math.PI) / 180;
  const ring = [...Array(32).keys()].map((k) => (2 * Math.PI * k) / 32).map((t) => [a * Math.cos(t), b * Math.sin(t)]);
  const corners = mismatch.shape === "round" ? ring : [[-a, -b], [a, -b], [a, b], [-a, b]];
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return corners.map(([x, y]) => [center[0] + c * x - s * y, center[1] + s * x + c * y]);
}

/** Bottom and top of a mismatch, no higher than `cut` [m]. */
function heights(mismatch, cut = Infinity) {
  const middle = offsetOf(mismatch.center)[2];
  const bottom = middle - mismatch.dimensions[2] / 2;
  return [bottom, Math.max(bottom, Math.min(middle + mismatch.dimensions[2] / 2, cut))];
}

/** Outline of a mismatch: solid for added, dashed for removed. */
function boxLines(mismatch, cut) {
  const lines = [];
  const corners = footprint(mismatch);
  const [bottom, top] = heights(mismatch, cut);
  const removed = mismatch.mismatch_type === "removed";
  const look = [packed(removed ? REMOVED : ADDED), removed ? DASH : 0];
  const upright = corners.length / 4;
  corners.forEach((one, k) => {
    const next = corners[(k + 1) % corners.length];
    for (const z of [bottom, top]) addLine(lines, [...one, z], [...next, z], ...look);
    if (k % upright === 0) addLine(lines, [...one, bottom], [...one, top], ...look);
  });
  return lines;
}

/** Triangles of the sides and the top of a mismatch, three numbers a corner. */
function boxTriangles(mismatch, cut) {
  const corners = footprint(mismatch);
  const [bottom, top] = heights(mismatch, cut);
  const middle = offsetOf(mismatch.center);
  return corners.flatMap((one, k) => {
    const next = corners[(k + 1) % corners.length];
    const side = [...one, bottom, ...next, bottom, ...next, top, ...one, bottom, ...next, top, ...one, top];
    return [...side, ...one, top, ...next, top, middle[0], middle[1], top];
  });
}

/** Outlines of what is not in the model, and neither a wall nor a column. */
function thingLines(cut) {
  const lines = [];
  for (const one of report.unexplained) {
    const corners = footprint(one);
    const [bottom, top] = heights(one, cut);
    if (bottom >= cut) continue;
    corners.forEach((corner, k) => {
      const next = corners[(k + 1) % corners.length];
      for (const z of [bottom, top]) addLine(lines, [...corner, z], [...next, z], packed(UNEXPLAINED), DASH / 3);
      addLine(lines, [...corner, bottom], [...corner, top], packed(UNEXPLAINED), DASH / 3);
    });
  }
  return lines;
}

/** Arrows of elements that stand off their places: from the middle of each along its offset, or from its ends. */
function offsetArrows(keys, bounds) {
  const lines = [];
  for (const key of keys) {
    for (const [start, end] of arrowOf(key, bounds)) addLine(lines, start, end, packed(ARROW));
  }
  return lines;
}

/** The strokes of an element's arrows, of each from tail to tip first; none where it was not measured or is not drawn. */
function arrowOf(key, bounds) {
  const [element, off] = [indexOfKey.get(key), offOfKey.get(key)];
  if (!off || element === undefined || !Number.isFinite(bounds[6 * element])) return [];
  const middle = [0, 1, 2].map((axis) => (bounds[6 * element + axis] + bounds[6 * element + 3 + axis]) / 2);
  const arrows = off.arrows ?? [[middle, off.offset]];
  return arrows.flatMap(([place, offset]) => arrowStrokes(place, offset, arrowsLong));
}

/** Unit vector of a pose: yaw counter-clockwise from x, pitch up [deg]. */
function headingOf(pose) {
  const [yaw, pitch] = [pose[3], pose[4]].map((angle) => (angle * Math.PI) / 180);
  return [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
}

/** A sensor: an octahedron, and how far its field of view opens; a scanner that sees all around gets a ring. */
function sensorMarks(pose, corners, tint, length) {
  const [lines, eye, ink] = [[], offsetOf(pose), packed(tint)];
  const heading = headingOf(pose);
  addLine(lines, eye, sum(eye, heading, length * 1.15), ink);
  const ends = corners.map((one) => sum(eye, one, length));
  ends.forEach((end, k) => {
    addLine(lines, eye, end, ink);
    addLine(lines, end, ends[(k + 1) % ends.length], ink);
  });
  if (!corners.length) {
    const ring = (k) => sum(eye, [Math.cos((Math.PI * k) / 20), Math.sin((Math.PI * k) / 20), 0], length / 2);
    for (let k = 0; k < 40; k++) addLine(lines, ring(k), ring(k + 1), ink);
  }
  const triangles = [];
  for (let corner = 0; corner < 8; corner++) {
    for (let axis = 0; axis < 3; axis++) {
      const tip = [0, 0, 0];
      tip[axis] = corner & (1 << axis) ? 0.11 : -0.11;
      triangles.push(...sum(eye, tip));
    }
  }
  return { eye, lines, triangles };
}

/** Distance of the lines of the floor's grid [m]: 1, 2, 5 or 10 times a power of ten, about 15 lines. */
function gridStep() {
  const wide = Math.max(data.frame.high[0] - data.frame.low[0], data.frame.high[1] - data.frame.low[1]);
  return Math.max(1, niceLength(wide / 12));
}

/** The greatest of 1, 2, 5 times a power of ten that is not above a length. */
function niceLength(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return power * [5, 2, 1].find((factor) => factor * power <= length * 1.000001);
}

/** Grid on the floor in whole world metres, and where the names of its axes stand. */
function gridMarks() {
  const [lines, step, z] = [[], gridStep(), data.frame.floor];
  const ink = packed("#6d7783", 0.3);
  const start = [0, 1].map((axis) => Math.floor((data.frame.low[axis] + data.origin[axis]) / step) * step - step);
  const end = [0, 1].map((axis) => Math.ceil((data.frame.high[axis] + data.origin[axis]) / step) * step + step);
  const place = (x, y) => [x - data.origin[0], y - data.origin[1], z];
  for (let x = start[0]; x <= end[0] + 1e-6; x += step) addLine(lines, place(x, start[1]), place(x, end[1]), ink);
  for (let y = start[1]; y <= end[1] + 1e-6; y += step) addLine(lines, place(start[0], y), place(end[0], y), ink);
  return { lines, step, axes: [["x", place(end[0], start[1])], ["y", place(start[0], end[1])]] };
}
