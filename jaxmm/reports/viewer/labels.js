// Names that stand over the picture, at the places of boxes, sensors and axes, and the scale.

const MOST_OFFSETS = 40; // labels of displaced elements, the worst first

/** The labels of a page: {node, place, shown, mismatch} each; place() [m] is null while there is none. */
function makeLabels(state, actions, { grid, bounds }) {
  const add = (node, place, shown, mismatch = null) => {
    byId("labels").append(node);
    return { node, place, shown, mismatch };
  };
  const axes = grid.axes.map(([name, place]) => add(make("span", { class: "axis" }, name), () => place, () => true));
  const sensors = report.scans.map((one, scan) => {
    const words = report.scans.length > 1 ? `scan ${scan + 1}` : "sensor";
    const eye = offsetOf(one.pose);
    return add(make("span", {}, words), () => eye, () => state.layers.frustum && !state.hidden.has(scan));
  });
  const proposed = () => {
    const pose = verdictOfKey.get(state.key)?.next_view;
    return pose ? offsetOf(pose) : null;
  };
  const proposal = add(make("span", {}, "proposed view"), proposed, () => state.layers.frustum);
  const boxes = report.mismatches.map((one, index) => {
    const click = () => { actions.chooseMismatch(index); actions.look(); };
    const [x, y] = offsetOf(one.center);
    const node = make("button", { class: one.mismatch_type, tabindex: "-1", click }, mismatchName(index));
    const top = () => heights(one, state.layers.ceiling ? Infinity : state.cut)[1];
    return add(node, () => [x, y, top()], () => state.layers.boxes, index);
  });
  const offsets = displacedElements.slice(0, MOST_OFFSETS).flatMap((one) => {
    const [, tip] = arrowOf(one.key, bounds)[0] ?? [];
    const click = () => { actions.choose(one.key); actions.look(); };
    const node = make("button", { class: "displaced", tabindex: "-1", click }, millimetres(offOfKey.get(one.key)));
    return tip ? [add(node, () => tip, () => state.layers.arrows)] : [];
  });
  return [...axes, ...sensors, proposal, ...offsets, ...boxes];
}

/** Move the labels to where their places are on a screen of this size [CSS pixel]; those out of view are hidden. */
function placeLabels(labels, matrix, [width, height], chosen) {
  const taken = [];
  for (const label of labels) {
    const place = label.shown() ? label.place() : null;
    const [x, y, w] = place ? projected(matrix, place) : [0, 0, 0];
    label.node.hidden = !(w > 0.01 && Math.abs(x) < w && Math.abs(y) < w);
    label.node.classList.toggle("chosen", label.mismatch === chosen);
    if (label.node.hidden) continue;
    label.size ??= [label.node.offsetWidth, label.node.offsetHeight];
    const left = ((x / w + 1) / 2) * width - label.size[0] / 2;
    const corner = [left, freeTop(taken, label.size, left, ((1 - y / w) / 2) * height - 1.3 * label.size[1])];
    taken.push([...corner, ...label.size]);
    label.node.style.transform = `translate(${corner.map((value) => `${Math.round(value)}px`).join(", ")})`;
  }
}

/** The first height, upwards from `top`, at which a label covers no other [CSS pixel]. */
function freeTop(taken, [wide, tall], left, top) {
  const covered = taken.find((other) =>
    left < other[0] + other[2] && other[0] < left + wide && top < other[1] + other[3] && other[1] < top + tall);
  return covered && top > 0 ? freeTop(taken, [wide, tall], left, covered[1] - tall - 2) : top;
}

/** A bar of a round length at the middle of the view; `pixel` [m] is what one CSS pixel spans there. */
function showScale(pixel, step) {
  const length = niceLength(110 * pixel);
  const words = length >= 1 ? `${length} m` : `${Math.round(100 * length)} cm`;
  byId("scale-bar").style.width = `${length / pixel}px`;
  byId("scale-text").textContent = `${words} at the middle; grid ${step} m`;
}
