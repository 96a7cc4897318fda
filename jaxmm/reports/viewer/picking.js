// What a ray from the eye meets: boxes of mismatches and elements of the prior.

/** Distances [ray lengths] at which a ray enters and leaves an upright box, or null. */
function throughBox(from, along, low, high) {
  let [enter, leave] = [0, Infinity];
  for (let axis = 0; axis < 3; axis++) {
    const ends = [(low[axis] - from[axis]) / along[axis], (high[axis] - from[axis]) / along[axis]];
    if (along[axis] === 0) {
      if (from[axis] < low[axis] || from[axis] > high[axis]) return null;
      continue;
    }
    enter = Math.max(enter, Math.min(...ends));
    leave = Math.min(leave, Math.max(...ends));
  }
  return enter <= leave ? [enter, leave] : null;
}

/** Distance at which a ray meets a triangle, from either side; Infinity where it does not. */
function throughTriangle(from, along, triangle) {
  const v = arrays.vertices;
  const a = corner(triangle, 0);
  const apex = [v[a], v[a + 1], v[a + 2]];
  const [b, c] = [corner(triangle, 1), corner(triangle, 2)];
  const one = [v[b] - apex[0], v[b + 1] - apex[1], v[b + 2] - apex[2]];
  const two = [v[c] - apex[0], v[c + 1] - apex[1], v[c + 2] - apex[2]];
  const p = cross(along, two);
  const volume = dot(one, p);
  if (Math.abs(volume) < 1e-12) return Infinity;
  const off = sum(from, apex, -1);
  const u = dot(off, p) / volume;
  const q = cross(off, one);
  const w = dot(along, q) / volume;
  const far = dot(two, q) / volume;
  return u >= 0 && w >= 0 && u + w <= 1 && far > 0 ? far : Infinity;
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** The first place where a ray meets an element at a height that is drawn. */
function throughElement({ from, along }, element, bounds, between) {
  const row = bounds.subarray(6 * element, 6 * element + 6);
  if (!throughBox(from, along, row.subarray(0, 3), row.subarray(3, 6))) return Infinity;
  let nearest = Infinity;
  for (let triangle = arrays.first[element]; triangle < arrays.first[element + 1]; triangle++) {
    const far = throughTriangle(from, along, triangle);
    const z = from[2] + far * along[2];
    if (far < nearest && z >= between[0] && z <= between[1]) nearest = far;
  }
  return nearest;
}

function throughMismatch({ from, along }, mismatch, cut) {
  const center = offsetOf(mismatch.center);
  const turn = (-mismatch.rotation * Math.PI) / 180;
  const turned = ([x, y, z]) => [
    Math.cos(turn) * x - Math.sin(turn) * y, Math.sin(turn) * x + Math.cos(turn) * y, z,
  ];
  const half = mismatch.dimensions.map((size) => size / 2);
  const high = [half[0], half[1], heights(mismatch, cut)[1] - center[2]];
  const met = throughBox(turned(sum(from, center, -1)), turned(along), half.map((size) => -size), high);
  return met ? met[0] : Infinity;
}

/** All that a ray meets, as {key, mismatch}: first the mismatches, for the page is about them, then by distance. */
function metBy(ray, state, bounds, between) {
  const met = [];
  if (state.layers.boxes) {
    report.mismatches.forEach((one, mismatch) => {
      met.push({ far: throughMismatch(ray, one, between[1]), rank: 0, key: data.mismatch_key[mismatch], mismatch });
    });
  }
  if (state.layers.surface) {
    data.key.forEach((key, element) => {
      const far = throughElement(ray, element, bounds, between);
      met.push({ far, rank: 1, key, mismatch: mismatchOfKey.get(key) ?? -1 });
    });
  }
  const seen = new Set();
  return met
    .filter((one) => Number.isFinite(one.far))
    .sort((a, b) => a.rank - b.rank || a.far - b.far)
    .filter(({ mismatch, key }) => {
      const same = mismatch >= 0 ? mismatch : key;
      return seen.has(same) ? false : seen.add(same);
    });
}
