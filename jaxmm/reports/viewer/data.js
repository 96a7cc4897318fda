// What the page was given, and the place where tests and the console meet it.

window.jaxmm = { ready: false, errors: [] };
window.addEventListener("error", (event) => window.jaxmm.errors.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => window.jaxmm.errors.push(String(event.reason)));

const KINDS = { float32: Float32Array, int32: Int32Array, uint8: Uint8Array };
const data = JSON.parse(document.getElementById("data").textContent);
const report = data.report;
const arrays = Object.fromEntries(Object.entries(data.arrays).map(([name, one]) => [name, decoded(one)]));

/** Base64 of little-endian numbers as a flat typed array; browsers that draw 3D run on little-endian machines. */
function decoded(array) {
  const text = atob(array.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new KINDS[array.dtype](bytes.buffer);
}

/** World position to the offset that everything is drawn in; differences in double precision. */
const offsetOf = (place) => [0, 1, 2].map((axis) => place[axis] - data.origin[axis]);

const elementCount = data.guid.length;
const indexOfGuid = new Map(data.guid.map((guid, index) => [guid, index]));
const verdictOfGuid = new Map(report.elements.map((one) => [one.guid, one]));
const offOfGuid = new Map(report.elements.map((one, index) => [one.guid, data.deviations[index]]));
/** Elements that stand off their places, the worst first. */
const displacedElements = report.elements
  .filter((one) => one.verdict === "displaced" && offOfGuid.get(one.guid))
  .sort((a, b) => surelyOff(offOfGuid.get(b.guid)) - surelyOff(offOfGuid.get(a.guid)));
const arrowsLong = arrowTimes(displacedElements.map((one) => offOfGuid.get(one.guid))); // times the offsets
const mismatchOfGuid = new Map();
report.mismatches.forEach((one, index) => {
  if (one.element !== null) mismatchOfGuid.set(one.element, index);
});

/** First point of each scan in the robot's cloud, which is in the order of the scans; one more than there are scans. */
function scanStarts() {
  const starts = [];
  let point = 0;
  for (let scan = 0; scan <= report.scans.length; scan++) {
    while (point < arrays.robot_scan.length && arrays.robot_scan[point] < scan) point++;
    starts.push(point);
  }
  return starts;
}
