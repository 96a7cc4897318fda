// Numbers and values in words, and nodes of the document. Text only ever becomes text: nothing here parses HTML.

/** A node with attributes and children; strings become text nodes. `click` is what it does. */
function make(tag, { click = null, ...attributes } = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  if (click) node.addEventListener("click", click);
  node.append(...children.filter((child) => child !== null));
  return node;
}

const byId = (id) => document.getElementById(id);
const count = (value) => value.toLocaleString("en-US");
/** A number with fixed digits, and no sign before zero. */
const fixed = (value, digits) => (Number(value.toFixed(digits)) === 0 ? 0 : value).toFixed(digits);
/** An angle about the vertical, counter-clockwise positive: "77.0° clockwise". */
const turnWords = (angle, digits) => `${fixed(Math.abs(angle), digits)}°${
  Number(angle.toFixed(digits)) === 0 ? "" : angle > 0 ? " counter-clockwise" : " clockwise"}`;
const plural = (value, word) => `${count(value)} ${word}${value === 1 ? "" : "s"}`;
/** The dimensions of a mismatch, those that are assumed behind a tilde. */
const sizes = (one) =>
  `${one.dimensions.map((size, axis) => `${one.measured[axis] ? "" : data.words.tilde}${size.toFixed(2)}`).join(" × ")} m`;
/** Both types and their probabilities, where what is seen of a mismatch leaves open which it is; else a gap. */
function typeWords(one) {
  if (one.type_probability === null || one.type_probability >= data.words.sure_of_type) return null;
  const other = one.object_type === "wall" ? "pillar" : "wall";
  return `${one.object_type} ${chance(one.type_probability)}, ${other} ${chance(1 - one.type_probability)}`;
}
/** A place: "x 1.20, y -0.35, z 0.00 m". */
const metres = (values) => `${values.map((value, axis) => `${"xyz"[axis]} ${fixed(value, 2)}`).join(", ")} m`;
/** A measured offset, without sign: "23 mm", or that of the ends of what is turned or leans. */
function millimetres(one) {
  if (one.at_ends) return `${(1000 * one.most).toFixed(one.half < 0.0005 ? 1 : 0)} mm at its ends`;
  const fine = one.half < 0.0005 || Math.abs(one.distance) < 0.001;
  return `${(1000 * Math.abs(one.distance)).toFixed(fine ? 1 : 0)} mm`;
}
const capital = (word) => word.charAt(0).toUpperCase() + word.slice(1);

/** A probability, as report.md has it: what is nearly sure is not rounded to sure. */
function chance(value) {
  if (value === null) return "unknown";
  if (value > 0.99 && value < 1) return "> 99 %";
  if (value > 0 && value < 0.01) return "< 1 %";
  return `${(100 * value).toFixed(0)} %`;
}

function poseWords([x, y, z, yaw, pitch]) {
  return `${metres([x, y, z])}, yaw ${fixed(yaw, 1)}°, pitch ${fixed(pitch, 1)}°`;
}

/** A mismatch in one line: "Removed wall at x 1.41, y 2.50, z 0.00 m; 1.72 × 0.19 × 3.00 m". */
const mismatchWords = (one) =>
  `${capital(one.mismatch_type)} ${one.object_type} at ${metres(one.center)}; ${sizes(one)}`;

const mismatchName = (index) => {
  const { mismatch_type: change, object_type: kind } = report.mismatches[index];
  return `${index + 1}  ${change === "added" ? "+" : "−"} ${kind} ${change}`;
};

/** A verdict with its sign in its colour. */
function verdictBadge(verdict) {
  const look = VERDICTS[verdict] ?? NO_VERDICT;
  const node = make("span", { class: "badge", "data-sign": look.sign }, verdict ?? "no verdict");
  node.style.setProperty("--tint", look.tint);
  return node;
}

function swatch(tint, kind = "") {
  const node = make("span", { class: `swatch ${kind}` });
  if (tint) node.style.background = tint;
  return node;
}

/** Colours from none to all of something. */
function ramp(colours) {
  return swatch(`linear-gradient(to right, ${colours.join(", ")})`, "ramp");
}

/** Pairs of a word and what it stands for; gaps are left out. */
function pairs(rows) {
  const list = make("dl", { class: "pairs" });
  for (const [word, value] of rows) {
    if (value !== null && value !== undefined) list.append(make("dt", {}, word), make("dd", {}, value));
  }
  return list;
}

const UNITS = { shift: " m", turn: "°", residual: " m" };

/** Any value of the report: objects as pairs, lists joined, gaps as a dash. */
function valueNode(value) {
  if (value === null || value === undefined) return "–";
  if (Array.isArray(value)) {
    if (value.some((one) => typeof one === "object" && one !== null)) {
      return make("ul", {}, ...value.map((one) => make("li", {}, valueNode(one))));
    }
    return value.length ? value.join(", ") : "–";
  }
  if (typeof value !== "object") return String(value);
  const words = (name, one) => (typeof one === "number" ? `${one}${UNITS[name] ?? ""}` : valueNode(one));
  return pairs(Object.entries(value).map(([name, one]) => [name.replaceAll("_", " "), words(name, one)]));
}
