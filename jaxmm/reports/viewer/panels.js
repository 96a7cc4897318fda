// The words around the 3D view: what is chosen, the mismatches, the legend, what words mean, and the details.

const MOST_THINGS = 30; // that are not in the model, listed; unexplained.csv has all
const MOST_DISPLACED = 100; // listed beside the view; the table has all

/** The panel of the chosen element or mismatch; empty when nothing is chosen. */
function showChosen(state, actions) {
  const panel = byId("chosen");
  panel.replaceChildren();
  if (state.key === null && state.mismatch < 0) return;
  const title = state.mismatch >= 0 ? `Mismatch ${mismatchName(state.mismatch)}` : elementName(state.key);
  const close = make("button", { click: () => actions.clear(), "aria-label": "Close" }, "×");
  panel.append(make("div", { class: "head" }, make("h2", {}, title), close));
  if (state.mismatch >= 0) panel.append(mismatchPairs(state.mismatch, actions));
  if (state.key !== null) panel.append(...elementNodes(state.key, state.mismatch >= 0));
  panel.append(make("button", { click: () => actions.look() }, "Look at it"));
}

function elementName(key) {
  const one = verdictOfKey.get(key);
  return one?.name || one?.ifc_class || "Element";
}

function mismatchPairs(index, actions) {
  const one = report.mismatches[index];
  const source = one.moved_from;
  const origin = () => make("button", { click: () => actions.chooseMismatch(source) }, mismatchName(source));
  return pairs([
    ["probability", `${chance(one.probability)} that it is real`],
    ["type", typeWords(one)],
    ["centre", metres(one.center)],
    ["size", sizes(one)],
    ["", one.measured.every(Boolean) ? null : data.words.assumed],
    ["turned", one.rotation ? turnWords(one.rotation, 1) : null],
    ["footprint", one.object_type === "pillar" ? one.shape : null],
    ["observable", one.observable_fraction === null ? null : `${Math.round(100 * one.observable_fraction)} %`],
    ["moved from", source === null ? null : origin()],
  ]);
}

/** Other elements by GlobalId and file; null without any. */
const others = (keys) => (keys.length ? keys.map((other) => `${other.guid} of ${other.file}`).join(", ") : null);

function elementNodes(key, named) {
  const one = verdictOfKey.get(key);
  const id = make("code", {}, one ? one.guid : key);
  const element = indexOfKey.get(key);
  const drawn = element !== undefined && arrays.first[element + 1] > arrays.first[element];
  const surface = drawn ? null : "not in this view";
  if (!one) return [pairs([["GlobalId", id], ["verdict", "none was asked for"], ["surface", surface]])];
  const rows = pairs([
    ["element", named ? one.name || null : null],
    ["GlobalId", id],
    ["file", one.file || null],
    ["same as", others(one.same_as)],
    ["part of", others(one.part_of)],
    ["parts that are gone", others(one.parts_gone)],
    ["class", one.ifc_class || null],
    ["storey", one.storey || null],
    ["surface", surface],
    ["verdict", verdictBadge(one.verdict)],
    ["why", whyOfKey.get(key)],
    ["P(removed)", chance(one.probability)],
    ["next view", one.next_view ? poseWords(one.next_view) : null],
  ]);
  const meaning = make("p", { class: "quiet" }, data.words.verdicts[one.verdict] ?? "");
  return [rows, meaning, ...offsetNodes(one), ...evidenceNodes(one.evidence)];
}

/** How far off its place an element stands; of one that stands and was not measured, why, if others were. */
function offsetNodes(one) {
  const [told, off] = [one.deviation, offOfKey.get(one.key)];
  if (!told || !off) {
    const asks = one.verdict === "present" && data.deviations.some((other) => other !== null);
    return asks ? [pairs([["off its place", `not measured: ${data.words.unmeasured}`]])] : [];
  }
  const inMillimetres = (value) => fixed(1000 * value, off.half < 0.0005 ? 1 : 0);
  const axes = ["x", "y", "z"].map((name, axis) => {
    const span = told.interval[axis];
    if (span === null) return [name, "nothing that was seen fixes it"];
    return [name, `${inMillimetres(told.offset[axis])} mm (${span.map(inMillimetres).join(" to ")})`];
  });
  return [
    pairs([
      ["off its place", off.words], ...axes,
      ["turned", told.turn === null ? null : turnWords(told.turn, 2)],
      ["leans", told.lean === null ? null : `${told.lean.toFixed(2)}°`],
      ["flatness", told.flatness === null ? null : `${(1000 * told.flatness).toFixed(1)} mm`],
      ["classes", `${told.classes.loa}, DIN 18202: ${told.classes.din18202}`],
      ["told by", plural(told.rays, "ray")],
    ]),
    make("p", { class: "quiet" }, `${data.words.interval} ${data.words.north}`),
  ];
}

/** A bar and the numbers of what the rays towards an element did. */
function evidenceNodes(evidence) {
  const names = Object.keys(EVIDENCE);
  const total = names.reduce((all, name) => all + evidence[name], 0);
  const bar = make("div", { class: "shares", role: "img", "aria-label": "shares of rays" });
  for (const name of names) {
    bar.append(sharePart(EVIDENCE[name], total ? evidence[name] / total : 0));
  }
  const rows = names.map((name) => [
    make("span", { class: "mark" }, swatch(EVIDENCE[name], "square"), name),
    `${plural(evidence[name], "ray")}${total ? `, ${Math.round((100 * evidence[name]) / total)} %` : ""}`,
  ]);
  return [bar, pairs([...rows, ["model points", count(evidence.points)]])];
}

function sharePart(tint, share) {
  const part = make("span");
  part.style.background = tint;
  part.style.width = `${100 * share}%`;
  return part;
}

function showMismatches(state, actions) {
  const rows = report.mismatches.map((one, index) => {
    const seen = one.observable_fraction === null ? "" : `, ${Math.round(100 * one.observable_fraction)} % observable`;
    const look = `${one.mismatch_type}${index === state.mismatch ? " chosen" : ""}`;
    const click = () => { actions.chooseMismatch(index); actions.look(); };
    const button = make("button", { class: look, click, "aria-pressed": String(index === state.mismatch) },
      `${index + 1}. ${mismatchWords(one)}`, make("small", {}, `probability ${chance(one.probability)}${seen}`));
    return make("li", {}, button);
  });
  byId("mismatches").replaceChildren(...(rows.length ? rows : [make("li", {}, "No mismatch was found.")]));
}

/** The displaced elements, the worst first. */
function showDisplaced(state, actions) {
  byId("displaced").hidden = !displacedElements.length;
  const rows = displacedElements.slice(0, MOST_DISPLACED).map((one) => {
    const chosen = one.key === state.key;
    const click = () => { actions.choose(one.key); actions.look(); };
    const look = { class: `displaced${chosen ? " chosen" : ""}`, click, "aria-pressed": String(chosen) };
    return make("li", {}, make("button", look, offOfKey.get(one.key).sentence));
  });
  byId("displaced-list").replaceChildren(...rows);
  const left = displacedElements.length - rows.length;
  const more = left > 0 ? `And ${count(left)} more, in the table. ` : "";
  byId("displaced-words").textContent = more + data.words.north;
}

/** What is not in the model, and neither a wall nor a column: where it is, how large, and by how many points. */
function showUnexplained() {
  byId("unexplained").hidden = !report.unexplained.length;
  byId("unexplained-words").textContent = data.words.unexplained;
  const rows = report.unexplained.slice(0, MOST_THINGS).map((one) => {
    const size = one.dimensions.map((edge) => edge.toFixed(2)).join(" × ");
    return make("li", {}, `${size} m at ${metres(one.center)}, ${count(one.points)} points`);
  });
  const left = report.unexplained.length - rows.length;
  byId("unexplained-list").replaceChildren(...rows, ...(left > 0 ? [make("li", {}, `and ${count(left)} more`)] : []));
}

/** What the colours of the view mean, for the colouring that is chosen. */
function showLegend(state) {
  const group = (title, rows) => {
    const items = rows.map(([mark, words]) => make("li", {}, mark, make("span", {}, words)));
    return make("div", {}, make("h3", {}, title), make("ul", {}, ...items));
  };
  const groups = [];
  const boxes = [
    [swatch(null, "added"), "added: solid outline, filled"],
    [swatch(null, "removed"), "removed: dashed outline, hatched"],
  ];
  groups.push(group("Boxes", boxes));
  if (state.mode === "probability") {
    groups.push(group("Points, by probability from 0 % (left) to 100 %", [
      [ramp(ROBOT_RAMP), "robot: part of something added"],
      [ramp(PRIOR_RAMP), "model: gone"],
      [null, "Points that nobody could tell of are at the left end."],
    ]));
  } else if (state.mode === "distance") {
    const end = Math.round(1000 * OFF_SCALE);
    groups.push(group("Robot points, by how far off the model", [
      [ramp(DISTANCE_RAMP), `from −${end} mm, behind its surface, over 0 to +${end} mm, before it`],
      [swatch(FAR, "dot"), "farther"],
    ]));
  } else if (state.mode === "evidence") {
    for (const [title, words, shape] of [["Model points", "prior", "square"], ["Robot points", "robot", "dot"]]) {
      const rows = Object.entries(EVIDENCE).map(([name, tint]) => [
        swatch(tint, shape), `${name}: ${data.words[words][name]}`,
      ]);
      groups.push(group(title, rows));
    }
  } else {
    const rows = report.scans.map((one, scan) => [swatch(scanTint(scan), "dot"), `scan ${scan + 1}: ${one.file}`]);
    groups.push(group("Points", [...rows, [swatch(PRIOR_RAMP[0], "square"), "model"]]));
  }
  if (data.has_surface && tinting.by === "deviation") {
    const end = Math.round(1000 * OFF_SCALE);
    groups.push(group("Elements, by how far off their places", [
      [ramp(OFF_RAMP), `from −${end} mm, away from the scanner, over 0 to +${end} mm, toward it`],
      [null, "Filled strongly: surely beyond the tolerance. Hardly filled: within it, or open."],
      [swatch(NO_VERDICT.tint), "not measured"],
    ]));
  } else if (data.has_surface) {
    const rows = Object.entries(VERDICTS).map(([name, look]) => [verdictBadge(name), ""]);
    groups.push(group("Elements", [...rows, [verdictBadge(undefined), ""]]));
  }
  byId("legend").replaceChildren(...groups);
}

/** What does not change: scans, meanings, notes, settings, timing. */
function showDetails() {
  const points = report.scans.map((one) => `${one.file} (${plural(one.points, "point")})`);
  const scans = points.length ? `${plural(points.length, "scan")}: ${points.join(", ")}` : "No scan";
  byId("scans").textContent = `${scans}. Lengths in metres.`;
  for (const [verdict, words] of Object.entries(data.words.verdicts)) {
    byId("verdict-words").append(make("dt", {}, verdictBadge(verdict)), make("dd", {}, words));
  }
  byId("probability-words").textContent = data.words.probability;
  byId("observable-words").textContent = data.words.observable;
  const ofScans = report.scans.flatMap((one, scan) => one.notes.map((note) => `Scan ${scan + 1}: ${note}`));
  const notes = [...report.notes, ...ofScans, ...data.thinned];
  byId("notes").append(notes.length ? make("ul", {}, ...notes.map((note) => make("li", {}, note))) : "None.");
  byId("notes").open = data.thinned.length > 0 || report.scans.some((one) => one.doubted);
  const rows = report.scans.map((one, scan) => {
    const { told: changed, shows, alone, ...rest } = one;
    const told = {
      ...rest, "verdicts that it changed": changed, "mismatches that it shows": shows,
      "of those, shown too little by all others": alone, pose: poseWords(one.pose),
    };
    if (one.deviation) told.deviation = poseWords(one.deviation);
    return [`scan ${scan + 1}`, valueNode(told)];
  });
  byId("scan-details").append(pairs(rows), pairs([["all scans", valueNode(report.registration)]]));
  byId("settings").append(valueNode(report.settings));
  const seconds = Object.entries(report.timing).map(([stage, value]) => [stage, `${value?.toFixed(2) ?? "–"} s`]);
  byId("timing").append(pairs(seconds));
  window.addEventListener("beforeprint", () => {
    for (const one of document.querySelectorAll("details")) one.open = true;
  });
}
