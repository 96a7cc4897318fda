// A camera that turns about a target: {target [m], azimuth, elevation [rad], distance [m]}; z is up.

const FIELD = (45 * Math.PI) / 180; // vertical field of view
const STEEPEST = 1.5533; // [rad] looking straight down would leave no direction that is up

const sum = (a, b, factor = 1) => [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Eye and unit axes of a camera: right, up, and back from the target to the eye. */
function axesOf(camera) {
  const [ca, sa, ce, se] = [
    Math.cos(camera.azimuth), Math.sin(camera.azimuth), Math.cos(camera.elevation), Math.sin(camera.elevation),
  ];
  const back = [ce * ca, ce * sa, se];
  return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], back, eye: sum(camera.target, back, camera.distance) };
}

/** Offsets [m] to clip space, (16) column by column; what lies more than `reach` [m] from the target is cut off. */
function matrixOf(camera, aspect, reach) {
  const { right, up, back, eye } = axesOf(camera);
  const near = Math.max(0.02, camera.distance / 200);
  const far = camera.distance + reach;
  const tall = 1 / Math.tan(FIELD / 2);
  const [a, b] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const shift = [right, up, back].map((axis) => -dot(axis, eye));
  const matrix = [];
  for (let axis = 0; axis < 3; axis++) {
    matrix.push((tall / aspect) * right[axis], tall * up[axis], a * back[axis], -back[axis]);
  }
  matrix.push((tall / aspect) * shift[0], tall * shift[1], a * shift[2] + b, -shift[2]);
  return matrix;
}

/** Offset to clip space: [x, y, w]; seen where w > 0 and x, y lie within -w to w. */
function projected(matrix, place) {
  const row = (i) => matrix[i] * place[0] + matrix[4 + i] * place[1] + matrix[8 + i] * place[2] + matrix[12 + i];
  return [row(0), row(1), row(3)];
}

/** The ray from the eye through x, y in -1..1. */
function rayThrough(camera, aspect, x, y) {
  const { right, up, back, eye } = axesOf(camera);
  const tall = Math.tan(FIELD / 2);
  return { from: eye, along: sum(sum(sum([0, 0, 0], back, -1), right, x * tall * aspect), up, y * tall) };
}

/** The camera in the same direction from which the box from low to high fills the view and stands in its middle. */
function framing(camera, low, high, aspect) {
  const { right, up, back } = axesOf(camera);
  const tall = 0.92 * Math.tan(FIELD / 2);
  const corners = [...Array(8).keys()].map((k) => [0, 1, 2].map((axis) => (k & (1 << axis) ? high : low)[axis]));
  let target = sum(low, sum(high, low, -1), 0.5);
  let distance = 1;
  // What is near looks larger, so the middle of the box is not the middle of its picture: some rounds find that.
  for (let round = 0; round < 6; round++) {
    const places = corners.map((corner) => sum(corner, target, -1));
    const needs = places.map((place) => {
      const wide = Math.abs(dot(place, right)) / (tall * aspect);
      return Math.max(wide, Math.abs(dot(place, up)) / tall) + dot(place, back);
    });
    distance = Math.max(1, ...needs);
    const middle = (axis) => {
      const seen = places.map((place) => dot(place, axis) / (distance - dot(place, back)));
      return 0.5 * (Math.min(...seen) + Math.max(...seen)) * distance;
    };
    if (round < 5) target = sum(sum(target, right, middle(right)), up, middle(up));
  }
  return { ...camera, target, distance };
}

/** Between two cameras, the shorter way round. */
function between(from, to, part) {
  const turn = ((((to.azimuth - from.azimuth + Math.PI) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI)) - Math.PI;
  return {
    target: sum(from.target, sum(to.target, from.target, -1), part),
    azimuth: from.azimuth + part * turn,
    elevation: from.elevation + part * (to.elevation - from.elevation),
    distance: from.distance * (to.distance / from.distance) ** part,
  };
}
