// Mouse, touch and keys turn into moves of the camera; the layers' boxes, the colouring and the cut into the state.

/** Turn, move and zoom by hand; `moved(camera)` is told of every step, `clicked(x, y)` of a click at CSS pixels. */
function steer(canvas, camera, moved, clicked) {
  const fingers = new Map(); // pointers that are down, with their place
  let walked = 0; // [CSS pixel] since the first one came down: a click does not move
  const tall = () => (2 * camera().distance * Math.tan(FIELD / 2)) / canvas.clientHeight; // [m] a pixel
  const shift = (dx, dy) => {
    const { right, up } = axesOf(camera());
    const target = sum(sum(camera().target, right, -dx * tall()), up, dy * tall());
    moved({ ...camera(), target });
  };
  const turn = (dx, dy) => {
    const elevation = Math.min(STEEPEST, Math.max(-STEEPEST, camera().elevation + dy * 0.007));
    moved({ ...camera(), azimuth: camera().azimuth - dx * 0.007, elevation });
  };
  const zoom = (factor) => moved({ ...camera(), distance: Math.min(5e4, Math.max(0.2, camera().distance * factor)) });
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (!fingers.size) walked = 0;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
    canvas.classList.add("dragging");
  });
  canvas.addEventListener("pointermove", (event) => {
    const from = fingers.get(event.pointerId);
    if (!from) return;
    const before = fingers.size === 2 ? spread() : null;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
    walked += Math.abs(dx) + Math.abs(dy);
    if (before) {
      const after = spread();
      shift(after.x - before.x, after.y - before.y);
      zoom(before.apart / after.apart);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) shift(dx, dy);
    else turn(dx, dy);
  });
  const lifted = (event) => {
    const last = fingers.delete(event.pointerId) && !fingers.size;
    if (last) canvas.classList.remove("dragging");
    if (last && event.type === "pointerup" && event.button === 0 && walked < 5) {
      canvas.focus({ preventScroll: true }); // from now on one finger turns; before, it scrolls the page
      clicked(event.offsetX, event.offsetY);
    } else if (fingers.size) walked = 1e3; // what remains of a pinch is no click
  };
  canvas.addEventListener("pointerup", lifted);
  canvas.addEventListener("pointercancel", lifted);
  document.addEventListener("pointerdown", (event) => { if (event.target !== canvas) canvas.blur(); });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(Math.max(-120, Math.min(120, event.deltaY * (event.deltaMode ? 30 : 1))) * 0.0015));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const way = ways[event.key];
    if (way) (event.shiftKey ? shift : turn)(-25 * way[0], -25 * way[1]);
    else if (event.key === "+" || event.key === "=") zoom(0.85);
    else if (event.key === "-") zoom(1 / 0.85);
    else return;
    event.preventDefault();
  });
}

/** Check boxes of layers and scans, the choice of colours and the slider of the cut; `changed` follows every change. */
function showControls(state, changed) {
  const has = {
    surface: data.has_surface && triangleCount > 0, prior: arrays.prior.length > 0, robot: arrays.robot.length > 0,
    boxes: report.mismatches.length > 0, things: report.unexplained.length > 0, arrows: data.deviations.some((one) => one !== null),
    frustum: report.scans.length > 0, ceiling: true,
  };
  const boxes = Object.fromEntries(Object.keys(state.layers).map((layer) => {
    const box = make("input", { type: "checkbox", id: `layer-${layer}`, disabled: !has[layer] });
    box.addEventListener("change", () => { state.layers[layer] = box.checked; changed(); });
    byId("layer-list").append(make("label", { class: has[layer] ? "" : "off" }, box, layerWords(layer)));
    return [layer, box];
  }));
  const scans = report.scans.map((_, scan) => scanBox(state, scan, changed));
  if (scans.length > 1) byId("scan-list").append(...scans);
  const mode = byId("mode");
  mode.append(...usualModes().map((name) => make("option", { value: name }, name)));
  mode.addEventListener("change", () => { state.mode = mode.value; changed(); });
  const slider = byId("cut-height");
  const { floor, ceiling } = data.frame;
  Object.assign(slider, { min: String(floor), max: String(Math.max(ceiling, state.cut) + 0.05), step: "0.05" });
  slider.addEventListener("input", () => { state.cut = Number(slider.value); changed(); });
  return () => {
    for (const [layer, box] of Object.entries(boxes)) box.checked = state.layers[layer];
    mode.value = state.mode;
    slider.value = String(state.cut);
    slider.disabled = state.layers.ceiling;
    byId("cut-text").textContent = `${(state.cut - floor).toFixed(2)} m above the floor`;
  };
}

/** What elements are coloured by, the tolerance of offsets and what is beyond it; `changed` follows every change. */
function showTinting(changed) {
  const [by, slider] = [byId("tinting"), byId("tolerance")];
  by.append(...TINTINGS.map((name) => make("option", { value: name }, name)));
  by.addEventListener("change", () => { tinting.by = by.value; changed(); });
  const steps = 1000 * Math.max(0.1, OFF_SCALE, tinting.tolerance);
  Object.assign(slider, { min: "0", max: String(Math.ceil(steps)), step: "1" });
  slider.addEventListener("input", () => { tinting.tolerance = Number(slider.value) / 1000; changed(); });
  byId("tinting-label").hidden = !data.deviations.some((one) => one !== null);
  return () => {
    by.value = tinting.by;
    slider.value = String(Math.round(1000 * tinting.tolerance));
    byId("off").hidden = tinting.by !== "deviation";
    byId("tolerance-text").textContent = `${slider.value} mm`;
    const { measured, beyond, open } = offCounts(data.deviations, tinting.tolerance);
    byId("off-counts").textContent =
      `${count(beyond)} of ${plural(measured, "measured element")} surely beyond it, ${count(open)} perhaps`;
  };
}

function layerWords(layer) {
  const [robot, prior] = [arrays.robot, arrays.prior].map((points) => count(points.length / 3));
  return {
    surface: data.has_surface ? "model surface" : "model surface (the model is a point cloud)",
    prior: `model points (${prior})`,
    robot: `robot points (${robot})`,
    boxes: `boxes of mismatches (${count(report.mismatches.length)})`,
    things: `outlines of what else is not in the model (${count(report.unexplained.length)})`,
    arrows: `arrows of displaced elements (${count(displacedElements.length)}), ${arrowsLong} times as long`,
    frustum: "sensors and their fields of view",
    ceiling: "ceiling and other storeys",
  }[layer];
}

function scanBox(state, scan, changed) {
  const box = make("input", { type: "checkbox", id: `scan-${scan}`, checked: true });
  box.addEventListener("change", () => {
    if (box.checked) state.hidden.delete(scan);
    else state.hidden.add(scan);
    changed();
  });
  return make("label", {}, box, swatch(scanTint(scan), "dot"), `scan ${scan + 1}: ${report.scans[scan].file}`);
}
