// Cameras worth having: the whole scan from above, its plan, what a sensor saw, and one mismatch or element.

/** From above, over the shoulder of the first sensor; `cut` [m] is where the view ends upwards. */
function overview(cut, aspect) {
  const yaw = report.scans.length ? (report.scans[0].pose[3] * Math.PI) / 180 : 0;
  const whole = { target: [0, 0, 0], azimuth: yaw + Math.PI + 0.45, elevation: 0.9, distance: 1 };
  return framing(whole, data.frame.low, highest(cut), aspect);
}

function plan(cut, aspect) {
  const camera = { target: [0, 0, 0], azimuth: -Math.PI / 2, elevation: STEEPEST, distance: 1 };
  return framing(camera, data.frame.low, highest(cut), aspect);
}

const highest = (cut) => [data.frame.high[0], data.frame.high[1], Math.min(data.frame.high[2], cut)];

/** From where a sensor stood, in its direction. */
function fromSensor(pose) {
  const [yaw, pitch] = [pose[3], pose[4]].map((angle) => (angle * Math.PI) / 180);
  return { target: sum(offsetOf(pose), headingOf(pose)), azimuth: yaw + Math.PI, elevation: -pitch, distance: 1 };
}

/** A camera that keeps its direction, if it looks down steeply enough, and comes near to a box {low, high}. */
function closeUp(camera, { low, high }, aspect) {
  const steep = { ...camera, elevation: Math.min(1.1, Math.max(0.6, camera.elevation)) };
  const near = framing(steep, low, high, aspect);
  return { ...near, distance: Math.max(3, 1.7 * near.distance) };
}

/** Lowest and highest corner of a mismatch, or else of an element with the view proposed for it; null without place. */
function placeOf(key, mismatch, bounds) {
  const rows = [];
  const element = indexOfKey.get(key);
  if (mismatch >= 0) {
    const one = report.mismatches[mismatch];
    for (const z of heights(one)) rows.push(...footprint(one).map(([x, y]) => [x, y, z]));
  } else if (element !== undefined && Number.isFinite(bounds[6 * element])) {
    rows.push(bounds.subarray(6 * element, 6 * element + 3), bounds.subarray(6 * element + 3, 6 * element + 6));
    const proposed = verdictOfKey.get(key)?.next_view;
    if (proposed) rows.push(offsetOf(proposed));
  }
  const ends = (pick) => [0, 1, 2].map((axis) => pick(...rows.map((row) => row[axis])));
  return rows.length ? { low: ends(Math.min), high: ends(Math.max) } : null;
}

/** A length [m] that no part of the drawing exceeds. */
function reachOf(bounds) {
  let size = 4 * Math.hypot(...sum(data.frame.high, data.frame.low, -1)) + 10;
  for (const value of bounds) if (Number.isFinite(value)) size = Math.max(size, 4 * Math.abs(value));
  return size;
}
