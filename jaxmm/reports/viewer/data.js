// What the page was given, and the place where tests and the console meet it.

window.jaxmm = { ready: false, errors: [] };
window.addEventListener("error", (event) => window.jaxmm.errors.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => window.jaxmm.errors.push(String(event.reason)));

const KINDS = { float32: Float32Array, int32: Int32Array, int16: Int16Array, uint8: Uint8Array };
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

// Files may share GlobalIds, so elements go by keys: the GlobalId, with the file where another file has it, too.
report.elements.forEach((one, index) => { one.key = data.element_key[index]; });
const elementCount = data.key.length;
const indexOfKey = new Map([...data.pieced, ...data.twins, ...data.key.map((key, index) => [key, index])]);
const verdictOfKey = new Map(report.elements.map((one) => [one.key, one]));
const whyOfKey = new Map(report.elements.map((one, index) => [one.key, data.why[index]])); // null but of occluded ones
const offOfKey = new Map(report.elements.map((one, index) => [one.key, data.deviations[index]]));
/** Elements that stand off their places, the worst first, without those that are drawn as others. */
const displacedElements = report.elements
  .filter((one) => ![...data.twins, ...data.pieced].some(([key]) => key === one.key))
  .filter((one) => one.verdict === "displaced" && offOfKey.get(one.key))
  .sort((a, b) => surelyOff(offOfKey.get(b.key)) - surelyOff(offOfKey.get(a.key)));
const arrowsLong = arrowTimes(displacedElements.map((one) => offOfKey.get(one.key))); // times the offsets
const mismatchOfKey = new Map();
report.mismatches.forEach((one, index) => {
  if (one.element === null) return;
  const key = data.mismatch_key[index];
  mismatchOfKey.set(key, index);
  for (const [twin, element] of data.twins) if (data.key[element] === key) mismatchOfKey.set(twin, index);
  const isOfIt = (whole) => whole.guid === one.element && whole.file === one.file;
  for (const part of report.elements) {
    if (part.verdict === "removed" && part.part_of.some(isOfIt)) mismatchOfKey.set(part.key, index);
  }
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
