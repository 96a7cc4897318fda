// The prior's surface: triangles in the order of their elements, the edges worth drawing, and where a level cuts it.

const triangleCount = arrays.faces.length / 3;
const corner = (triangle, k) => 3 * arrays.faces[3 * triangle + k]; // where its coordinates begin in `vertices`

/** Corners of all triangles one after the other: what the graphics card draws. */
function cornersOf() {
  const place = new Float32Array(9 * triangleCount);
  for (let i = 0; i < 3 * triangleCount; i++) {
    const from = 3 * arrays.faces[i];
    for (let axis = 0; axis < 3; axis++) place[3 * i + axis] = arrays.vertices[from + axis];
  }
  return place;
}

/** The colour of each of those corners `place`, in the light that falls on its triangle. */
function tintsOf(place) {
  const tint = new Uint32Array(3 * triangleCount);
  data.key.forEach((key, element) => {
    const look = lookOf(key);
    tint.fill(packed(look.tint, look.fill), 3 * arrays.first[element], 3 * arrays.first[element + 1]);
  });
  return lit(tint, place);
}

const SUN = [0.4161, 0.26, 0.8715]; // unit vector to the light

/** Colours of corners `place`, three a triangle, darkened by how its triangle lies to the light, in place. */
function lit(tint, place) {
  const v = place;
  for (let i = 0, at = 0; i < tint.length; i += 3, at += 9) {
    const [ux, uy, uz] = [v[at + 3] - v[at], v[at + 4] - v[at + 1], v[at + 5] - v[at + 2]];
    const [wx, wy, wz] = [v[at + 6] - v[at], v[at + 7] - v[at + 1], v[at + 8] - v[at + 2]];
    const [x, y, z] = [uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx];
    const size = Math.sqrt(x * x + y * y + z * z) || 1;
    const light = 0.72 + (0.28 * Math.abs(x * SUN[0] + y * SUN[1] + z * SUN[2])) / size;
    const ink = tint[i];
    const [red, green, blue] = [ink & 255, (ink >> 8) & 255, (ink >> 16) & 255].map((one) => Math.round(light * one));
    tint.fill(((ink & 0xff000000) | (blue << 16) | (green << 8) | red) >>> 0, i, i + 3);
  }
  return tint;
}

/** Lowest and highest corner of every element, six numbers each. */
function boundsOf() {
  const bounds = new Float32Array(6 * elementCount);
  for (let element = 0; element < elementCount; element++) {
    const row = bounds.subarray(6 * element, 6 * element + 6);
    row.fill(Infinity, 0, 3).fill(-Infinity, 3, 6);
    for (let i = 3 * arrays.first[element]; i < 3 * arrays.first[element + 1]; i++) {
      for (let axis = 0; axis < 3; axis++) {
        const value = arrays.vertices[3 * arrays.faces[i] + axis];
        if (value < row[axis]) row[axis] = value;
        if (value > row[3 + axis]) row[3 + axis] = value;
      }
    }
  }
  return bounds;
}

/** Vertex to the first vertex at the same place, for files that repeat them. */
function weldedVertices() {
  const first = new Map();
  const same = new Int32Array(arrays.vertices.length / 3);
  for (let vertex = 0; vertex < same.length; vertex++) {
    const [x, y, z] = [0, 1, 2].map((axis) => Math.round(1e4 * arrays.vertices[3 * vertex + axis]));
    const key = `${x},${y},${z}`;
    if (!first.has(key)) first.set(key, vertex);
    same[vertex] = first.get(key);
  }
  return same;
}

function normalOf(triangle) {
  const v = arrays.vertices;
  const [a, b, c] = [corner(triangle, 0), corner(triangle, 1), corner(triangle, 2)];
  const [ux, uy, uz] = [v[b] - v[a], v[b + 1] - v[a + 1], v[b + 2] - v[a + 2]];
  const [wx, wy, wz] = [v[c] - v[a], v[c + 1] - v[a + 1], v[c + 2] - v[a + 2]];
  const normal = [uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx];
  const length = Math.hypot(...normal) || 1;
  return normal.map((value) => value / length);
}

/** Pairs of vertices where an element ends or bends by more than 20 degrees; none where that is all over it. */
function edgesOf(element, same) {
  const open = new Map(); // edge to the one triangle that was met on it so far
  const sharp = new Set();
  const [from, to] = [arrays.first[element], arrays.first[element + 1]];
  for (let triangle = from; triangle < to; triangle++) {
    for (let k = 0; k < 3; k++) {
      const [a, b] = [same[arrays.faces[3 * triangle + k]], same[arrays.faces[3 * triangle + ((k + 1) % 3)]]];
      const edge = Math.min(a, b) * same.length + Math.max(a, b);
      const other = open.get(edge);
      if (other === undefined) open.set(edge, triangle);
      else if (Math.abs(dot(normalOf(triangle), normalOf(other))) < 0.94) sharp.add(edge);
      else open.set(edge, -1);
    }
  }
  for (const [edge, triangle] of open) if (triangle >= 0) sharp.add(edge);
  const rough = to - from > 3000 && sharp.size > 0.5 * (to - from); // a scanned mesh would be nothing but lines
  return rough ? [] : [...sharp].map((edge) => [Math.floor(edge / same.length), edge % same.length]);
}

/** Edges of all elements as lines, and the first line of each element. */
function edgeLines() {
  const same = weldedVertices();
  const lines = [];
  const starts = [0];
  const place = (vertex) => arrays.vertices.subarray(3 * vertex, 3 * vertex + 3);
  for (let element = 0; element < elementCount; element++) {
    for (const [a, b] of edgesOf(element, same)) addLine(lines, place(a), place(b), 0);
    starts.push(lines.length / LINE);
  }
  return inked({ lines, starts });
}

/** The same edges in the colours that their elements have now. */
function inked(edges) {
  data.key.forEach((key, element) => {
    const ink = packed(lookOf(key).tint, verdictOfKey.has(key) ? 0.75 : 0.35);
    for (let line = edges.starts[element]; line < edges.starts[element + 1]; line++) edges.lines[LINE * line + 6] = ink;
  });
  return edges;
}

/** Lines along which the level z [m] cuts the elements: the floor plan that stays when the view is cut. */
function planLines(bounds, z) {
  const lines = [];
  const v = arrays.vertices;
  for (let element = 0; element < elementCount; element++) {
    if (!(bounds[6 * element + 2] < z && bounds[6 * element + 5] > z)) continue;
    const ink = packed(lookOf(data.key[element]).tint);
    for (let triangle = arrays.first[element]; triangle < arrays.first[element + 1]; triangle++) {
      const ends = [];
      for (let k = 0; k < 3; k++) {
        const [a, b] = [corner(triangle, k), corner(triangle, (k + 1) % 3)];
        if (v[a + 2] < z === v[b + 2] < z) continue;
        const part = (z - v[a + 2]) / (v[b + 2] - v[a + 2]);
        ends.push([v[a] + part * (v[b] - v[a]), v[a + 1] + part * (v[b + 1] - v[a + 1]), z]);
      }
      if (ends.length === 2) addLine(lines, ends[0], ends[1], ink);
    }
  }
  return lines;
}
