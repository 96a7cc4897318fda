// How far off their places elements stand: what to colour, to count and to point at. Nothing here knows the document.

const OFF_RAMP = ["#8c510a", "#e2e4e6", "#01665e"]; // away from the scanner, in place, toward it: ColorBrewer's BrBG
const ARROW_TIMES = [50, 20, 10, 5]; // as long as the offsets arrows may be drawn
const LONGEST_ARROW = 1.5; // [m]
const OFF_STEPS = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5]; // [m] that a scale may end at

/** How far off its place an element is at least [m], and whether that is beyond a tolerance [m]. */
const surelyOff = (one) => Math.max(0, one.most - one.half);
const isBeyond = (one, tolerance) => surelyOff(one) > tolerance;

/** Of measured elements (others are null): how many are surely beyond a tolerance [m], and of how many that is open. */
function offCounts(rows, tolerance) {
  const measured = rows.filter((one) => one !== null);
  const beyond = measured.filter((one) => isBeyond(one, tolerance)).length;
  const reach = measured.filter((one) => one.most + one.half > tolerance).length;
  return { measured: measured.length, beyond, open: reach - beyond };
}

/** The signed distance [m] that an element is coloured by: of what is turned or leans that of its ends. */
const shownOff = (one) => (one.at_ends ? (one.distance < 0 ? -one.most : one.most) : one.distance);

/** The end [m] of a scale that holds all distances, or nearly: one of OFF_STEPS. */
function offScale(rows) {
  const most = Math.max(0, ...rows.map((one) => (one === null ? 0 : Math.abs(shownOff(one)))));
  return OFF_STEPS.find((step) => most <= step) ?? OFF_STEPS[OFF_STEPS.length - 1];
}

/** The colour of a signed distance [m] on a scale that ends at `scale`, "#rrggbb". */
function offTint(distance, scale) {
  const part = Math.max(-1, Math.min(1, distance / scale));
  const [from, to] = [OFF_RAMP[1], OFF_RAMP[part < 0 ? 0 : 2]];
  const mixed = [1, 3, 5].map((at) => {
    const [a, b] = [from, to].map((hex) => parseInt(hex.slice(at, at + 2), 16));
    return Math.round(a + (b - a) * Math.abs(part)).toString(16).padStart(2, "0");
  });
  return `#${mixed.join("")}`;
}

/** How an element is drawn when elements are coloured by their distance; null of one that was not measured. */
function offLook(one, tolerance, scale) {
  if (one === null) return null;
  return { tint: offTint(shownOff(one), scale), fill: isBeyond(one, tolerance) ? 0.6 : 0.22 };
}

/** How many times as long as these offsets their arrows are: the most that keeps them bearable. */
function arrowTimes(rows) {
  const offsets = rows.flatMap((one) => one.arrows?.map(([, offset]) => offset) ?? [one.offset]);
  const longest = Math.max(0, ...offsets.map((offset) => Math.hypot(...offset)));
  return ARROW_TIMES.find((times) => times * longest <= LONGEST_ARROW) ?? ARROW_TIMES[ARROW_TIMES.length - 1];
}

/** Pairs of ends of an arrow from a place along an offset [m], so many times as long; none where it is no offset. */
function arrowStrokes(place, offset, times) {
  const long = times * Math.hypot(...offset);
  if (!(long > 0)) return [];
  const along = offset.map((value) => (times * value) / long);
  const side = Math.abs(along[2]) < 0.9 ? [-along[1], along[0], 0] : [1, 0, 0];
  const at = (back, aside) => place.map((value, axis) =>
    value + (long - back) * along[axis] + aside * side[axis]);
  const head = Math.min(0.25, 0.4 * long);
  const tip = at(0, 0);
  return [[place, tip], [tip, at(head, 0.5 * head)], [tip, at(head, -0.5 * head)]];
}
