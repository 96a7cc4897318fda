// Colours that are told apart with every kind of colour blindness (M. Okabe and K. Ito, 2008), and signs beside them.

/** A colour of the page's style, as it is now: a page turns dark with the system. */
const ofStyle = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ink = () => ofStyle("--ink");
const ADDED = "#0072b2";
const REMOVED = "#d55e00";
/** By verdict: its colour, how strongly its surfaces are filled, and a sign for where colour is not seen. */
const VERDICTS = {
  removed: { tint: REMOVED, fill: 0.26, sign: "×" },
  displaced: { tint: "#e69f00", fill: 0.3, sign: "↔" },
  occluded: { tint: "#cc79a7", fill: 0.2, sign: "◐" },
  unscanned: { tint: "#767d85", fill: 0.08, sign: "?" },
  present: { tint: "#009e73", fill: 0.11, sign: "✓" },
};
const UNEXPLAINED = "#2b8cbe"; // what is not in the model: lines
const ARROW = "#a35c00"; // of offsets: that of displaced elements, darker, for lines are thin
const NO_VERDICT = { tint: "#98a1aa", fill: 0.05, sign: "–" };
/** By what most rays did; each in the colour of the verdict that it speaks for. */
const EVIDENCE = { through: REMOVED, support: "#009e73", blocked: "#cc79a7", unseen: "#767d85" };
/** Points from probability 0 to 1. */
const ROBOT_RAMP = ["#7d8894", ADDED];
const PRIOR_RAMP = ["#b9b2a3", REMOVED];
const SCANS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#a89c00", "#8a5a44"];

/** What points may be coloured by; by distances where the model has a surface, by scans where there are several. */
const MODES = ["probability", "evidence", "distance", "scan"];
const usualModes = () => MODES.filter((name) =>
  name === "distance" ? arrays.robot_distance.length > 0 : name !== "scan" || report.scans.length > 1);
/** Points by how far off the model they are: as elements, but for those in place, which would be lost on the paper. */
const DISTANCE_RAMP = [OFF_RAMP[0], "#a3aab1", OFF_RAMP[2]];
const FAR = "#cc79a7"; // of points that are farther off than the scale goes

const scanTint = (scan) => (report.scans.length > 1 ? SCANS[scan % SCANS.length] : ink());
/** What elements may be coloured by: their verdict, or how far off its place each stands. */
const TINTINGS = ["verdict", "deviation"];
/** What they are coloured by now; the controls change it. The tolerance [m] matters to deviations only. */
const tinting = { by: "verdict", tolerance: data.tolerance };
const OFF_SCALE = offScale(data.deviations); // [m]

function lookOf(key) {
  const off = offOfKey.get(key) ?? null;
  if (tinting.by === "deviation") return offLook(off, tinting.tolerance, OFF_SCALE) ?? NO_VERDICT;
  return VERDICTS[verdictOfKey.get(key)?.verdict] ?? NO_VERDICT;
}

/** "#rrggbb" to [r, g, b] in 0..1. */
function rgb(hex) {
  return [1, 3, 5].map((from) => parseInt(hex.slice(from, from + 2), 16) / 255);
}

/** "#rrggbb" and an opacity to one number of four bytes, red in the lowest. */
function packed(hex, opacity = 1) {
  const [red, green, blue] = rgb(hex).map((value) => Math.round(255 * value));
  return (red | (green << 8) | (blue << 16) | (Math.round(255 * opacity) << 24)) >>> 0;
}
