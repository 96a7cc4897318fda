const data = JSON.parse(document.getElementById("data").textContent);
const SVG = "http://www.w3.org/2000/svg";
const MOST_ROWS = 300;
const at = (name) => document.getElementById(name);
const elements = data.elements, weeks = data.weeks;
const counted = data.counted.map((row) => elements[row]);
const slug = (state) => state.replace(" ", "-");
const stateOf = (one, week) => data.states[one.states[week]];
let now = weeks.length - 1, storey = 0, picked = null, timer = null, view = null;

function make(name, attributes = {}, text = null) {
  const svg = ["path", "svg", "g", "line", "circle", "text", "polyline", "polygon", "rect", "defs", "pattern"];
  const node = svg.includes(name) ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== null) node.textContent = text;
  return node;
}

const nameOf = (one) => one.name || one.guid;
const several = new Set(data.elements.map((one) => one.file)).size > 1;
// Names repeat: what tells elements apart is their GlobalId, and the file where a model has several.
const whichOf = (one) => `GlobalId ${one.guid}${several && one.file ? ` of ${one.file}` : ""}`;
const percent = (value) => `${Math.round(100 * value)}\u00a0%`;

function spanOf(least, most) {
  if (least === null) return "";
  return percent(least) === percent(most) ? percent(least) : `${Math.round(100 * least)} to ${percent(most)}`;
}
const told = (one, week) => one.told[week] === "1";
const inModel = (one, week) => one.model[week] === "1";

function lastTold(one, week) {
  for (let n = week; n >= 0; n -= 1) if (told(one, n)) return n;
  return null;
}

function changedIn(one, week) {
  const before = week ? stateOf(one, week - 1) : "not seen", after = stateOf(one, week);
  return inModel(one, week) && before !== after ? [before, after] : null;
}

// The plan: y points north, so all is drawn upside down.
const [low, high] = data.bounds || [[0, 0], [1, 1]];
const whole = [low[0] - 1, -high[1] - 1, high[0] - low[0] + 2, high[1] - low[1] + 2];
const pathOf = (rings) => rings.map((ring) => "M" + ring.map(([x, y]) => `${x} ${-y}`).join("L")).join("");
let shapes = new Map();

function drawStorey() {
  const plan = at("plan");
  plan.replaceChildren();
  shapes = new Map();
  if (!data.storeys.length) return;
  const defs = make("defs"), size = Math.max(whole[2], whole[3]) / 110;
  const cross = make("pattern", {id: "cross", width: size, height: size, patternUnits: "userSpaceOnUse"});
  cross.append(make("rect", {width: size, height: size, class: "hatch-ground"}));
  cross.append(make("path", {d: `M0 0L${size} ${size}M0 ${size}L${size} 0`, class: "hatch"}));
  defs.append(cross);
  plan.append(defs);
  const one = data.storeys[storey];
  if (one.others.length) plan.append(make("path", {d: pathOf(one.others), class: "other"}));
  for (const [row, rings] of one.elements) {
    const path = make("path", {d: pathOf(rings), tabindex: -1});
    path.append(make("title"));
    path.addEventListener("click", () => choose(row));
    shapes.set(row, path);
    plan.append(path);
  }
  plan.append(make("g", {id: "added"}));
  showView();
}

function showView() {
  const shown = view || whole;
  at("plan").setAttribute("viewBox", shown.join(" "));
  at("plan").classList.toggle("near", view !== null);
}

function zoom(factor) {
  const [x, y, w, h] = view || whole;
  const next = [x + w * (1 - factor) / 2, y + h * (1 - factor) / 2, w * factor, h * factor];
  view = next[2] >= whole[2] ? null : next;
  showView();
}

function colourPlan() {
  const byFirst = at("mode").value === "first";
  for (const [row, path] of shapes) {
    const one = elements[row], state = stateOf(one, now);
    const names = ["element", slug(state)];
    if (!told(one, now)) names.push("kept");
    if (changedIn(one, now)) names.push("changed");
    if (row === picked) names.push("picked");
    path.setAttribute("class", names.join(" "));
    const stands = state === "built" || state === "displaced";
    path.style.fill = byFirst && stands ? data.colours[one.first] : "";
    path.style.fillOpacity = byFirst ? "1" : "";
    path.style.display = inModel(one, now) ? "" : "none";
    path.firstChild.textContent = `${nameOf(one)}: ${wordsOf(one, now)}`;
  }
  const added = at("added");
  if (added) {
    added.replaceChildren();
    const floor = data.storeys[storey].floor, above = data.storeys[storey + 1];
    for (const box of weeks[now].added) {
      if (box.middle >= floor - 0.5 && (!above || box.middle < above.floor)) {
        added.append(make("path", {d: pathOf([box.corners]) + "Z", class: "added"}));
      }
    }
  }
  showLegend(byFirst);
}

function showLegend(byFirst) {
  const legend = at("legend"), entries = [];
  const swatch = (names, colour = "") => {
    const node = make("span", {class: `swatch ${names}`});
    if (colour) node.style.background = colour;
    return node;
  };
  const counts = {};
  for (const one of counted) if (inModel(one, now)) counts[stateOf(one, now)] = (counts[stateOf(one, now)] || 0) + 1;
  for (const state of data.states) {
    if (byFirst && state === "built") {
      for (let n = 0; n <= now; n += 1) entries.push([swatch("built", data.colours[n]), `first seen ${weeks[n].label}`]);
    } else if (counts[state]) entries.push([swatch(slug(state)), `${state}: ${counts[state]}`]);
  }
  entries.push([swatch("changed"), "changed this week"]);
  if (!byFirst) entries.push([swatch("built kept"), "pale: not seen this week, as it was before"]);
  if (weeks[now].added.length) entries.push([swatch("added"), `not in the model: ${weeks[now].added.length}`]);
  legend.replaceChildren(...entries.map(([mark, text]) => {
    const item = make("li");
    item.append(mark, text);
    return item;
  }));
}

function wordsOf(one, week) {
  if (!inModel(one, week)) return "not in the model of this week";
  const state = stateOf(one, week), since = lastTold(one, week);
  if (since === null) return state;
  return since === week ? state : `${state} as of ${weeks[since].label}, not seen since`;
}

const offText = (off) => off === null ? "" : `${off.toFixed(0)} mm`;

function choose(row, jump = false) {
  picked = row;
  const box = at("chosen");
  box.hidden = row === null;
  if (row !== null) {
    const one = elements[row], place = data.storeys.findIndex((level) => level.elements.some(([other]) => other === row));
    if (jump && place >= 0 && place !== storey) {
      storey = place;
      showStoreys();
      drawStorey();
    }
    const list = make("dl");
    const say = (term, value) => {
      if (value === null || value === "") return;
      list.append(make("dt", {}, term), make("dd", {}, value));
    };
    const date = (week) => week === null ? null : weeks[week].label;
    say("on " + weeks[now].label, wordsOf(one, now));
    say("class", one.class);
    say("storey", one.storey);
    say("GlobalId", one.guid);
    if (several) say("file", one.file);
    say("first seen", date(one.first));
    say("its place seen empty", date(one.not_before));
    say("last seen", date(one.last));
    say("gone since", date(one.removed));
    say("displaced since", date(one.displaced));
    if (one.moved) say("moved", `by ${(1000 * one.moved[0]).toFixed(0)} mm from ${date(one.moved[1])} to ${date(one.moved[2])}`);
    say("tasks", one.tasks.map((number) => data.tasks[number]).join("; "));
    say("planned to be done", one.finish);
    if (one.behind) say("schedule", one.behind === "late" ? `${one.days} days late` : `due ${one.days} days ago, not seen`);
    for (let n = 0; n < weeks.length; n += 1) {
      const off = one.off[n] === null ? "" : `, ${offText(one.off[n])} off its place`;
      say(weeks[n].label, inModel(one, n) ? (told(one, n) ? stateOf(one, n) : `not seen (${stateOf(one, n)})`) + off : "not in the model");
    }
    const close = make("button", {type: "button"}, "close");
    close.addEventListener("click", () => choose(null));
    box.replaceChildren(make("h2", {}, nameOf(one)), list, close);
    if (jump) at("plans").scrollIntoView({block: "nearest"});
  }
  colourPlan();
}

function linkTo(row) {
  const button = make("button", {type: "button", title: whichOf(elements[row])}, nameOf(elements[row]));
  button.addEventListener("click", () => choose(row, true));
  return button;
}

function showChanges() {
  const items = [];
  elements.forEach((one, row) => {
    const found = changedIn(one, now);
    if (!found) return;
    const item = make("li");
    item.append(linkTo(row), ` ${one.class.replace(/^Ifc/, "")}${one.storey ? `, ${one.storey}` : ""}: ${one.became[now]}${found[0] === "not seen" ? "" : `, was ${found[0]}`}`);
    items.push(item);
  });
  const most = 200, more = items.length - most;
  if (more > 0) items.splice(most, more, make("li", {}, `and ${more} more: see the sheet Changes in progress.xlsx`));
  at("changes").replaceChildren(...(items.length ? items : [make("li", {}, "nothing")]));
}

function showBars() {
  const kind = at("by").value;
  const rows = data.shares.filter((one) => one.kind === kind).map((one) => {
    const [count, done, least, most] = one.weeks[now];
    const group = make("div", {class: "group"}), label = make("div", {class: "label"}), track = make("div", {class: "track"});
    label.append(make("span", {}, one.name), make("span", {}, count ? `${done} of ${count}, ${spanOf(least, most)}` : "none"));
    for (const [name, value] of [["most", most], ["least", least]]) {
      const bar = make("i", {class: name});
      bar.style.width = `${100 * (value || 0)}%`;
      track.append(bar);
    }
    group.append(label, track);
    return group;
  });
  at("bars").replaceChildren(...rows);
}

function showCurve() {
  const all = data.shares.find((one) => one.kind === "all").weeks;
  const times = weeks.map((one) => Date.parse(one.date)), first = times[0], span = times[times.length - 1] - first || 1;
  const x = (n) => 40 + 270 * (weeks.length > 1 ? (times[n] - first) / span : 0.5), y = (value) => 112 - 100 * (value || 0);
  const curve = at("curve"), parts = [];
  curve.setAttribute("viewBox", "0 0 330 136");
  for (const value of [0, 0.5, 1]) {
    parts.push(make("line", {x1: 40, x2: 316, y1: y(value), y2: y(value), class: "grid"}));
    parts.push(make("text", {x: 35, y: y(value) + 4, "text-anchor": "end"}, `${100 * value}%`));
  }
  const upper = all.map((one, n) => `${x(n)},${y(one[3])}`), lower = all.map((one, n) => `${x(n)},${y(one[2])}`);
  parts.push(make("polygon", {points: [...upper, ...lower.slice().reverse()].join(" "), class: "span"}));
  parts.push(make("polyline", {points: lower.join(" "), class: "least"}));
  all.forEach((one, n) => parts.push(make("circle", {cx: x(n), cy: y(one[2]), r: n === now ? 4.5 : 2.5})));
  parts.push(make("line", {x1: x(now), x2: x(now), y1: 8, y2: 112, class: "now"}));
  parts.push(make("text", {x: x(0), y: 130, "text-anchor": weeks.length > 1 ? "start" : "middle"}, weeks[0].label));
  if (weeks.length > 1) parts.push(make("text", {x: 316, y: 130, "text-anchor": "end"}, weeks[weeks.length - 1].label));
  curve.replaceChildren(...parts);
  const [count, done, least, most] = all[now];
  at("total").textContent = `${done} of ${count} elements stand: ${spanOf(least, most)}`;
}

function showRows() {
  const words = at("find").value.toLowerCase().split(/\s+/).filter(Boolean), only = at("only").value, rows = [];
  let count = 0;
  elements.forEach((one, row) => {
    const state = inModel(one, now) ? stateOf(one, now) : "not in the model";
    const text = `${one.name} ${one.class} ${one.storey} ${one.guid} ${one.file}`.toLowerCase();
    const behind = only === "late" && one.behind;
    if ((only && state !== only && !behind) || !words.every((word) => text.includes(word))) return;
    count += 1;
    if (count > MOST_ROWS) return;
    const line = make("tr"), name = make("td", {class: "name"}), strip = make("span", {class: "strip"}), since = lastTold(one, now);
    name.append(linkTo(row), make("span", {class: "quiet"}, several && one.file ? `${one.guid} of ${one.file}` : one.guid));
    weeks.forEach((week, n) => {
      const known = inModel(one, n);
      strip.append(make("i", {class: known ? `${slug(stateOf(one, n))}${told(one, n) ? "" : " kept"}` : "absent",
        title: `${week.label}: ${wordsOf(one, n)}`}));
    });
    const cell = make("td");
    cell.append(strip);
    const off = one.off.slice(0, now + 1).filter((value) => value !== null).pop();
    const first = one.first === null || one.first > now ? "" : weeks[one.first].label;
    const rest = [one.class.replace(/^Ifc/, ""), one.storey, since === null ? "never" : weeks[since].label, first, offText(off ?? null)];
    line.append(name, make("td", {}, state), cell, ...rest.map((text) => make("td", {}, text)));
    rows.push(line);
  });
  at("rows").replaceChildren(...rows);
  at("more").textContent = count > MOST_ROWS ? `${MOST_ROWS} of ${count} are shown; progress.xlsx has all.` : `${count} elements.`;
}

function showStoreys() {
  at("storeys").replaceChildren(...data.storeys.map((one, n) => {
    const button = make("button", {type: "button", "aria-pressed": n === storey}, one.name);
    button.addEventListener("click", () => {
      storey = n;
      showStoreys();
      drawStorey();
      colourPlan();
    });
    return button;
  }));
}

function show() {
  const week = weeks[now];
  at("week").value = now;
  at("week").setAttribute("aria-valuetext", week.label);
  at("date").textContent = week.label;
  const count = counted.filter((one) => told(one, now)).length;
  at("told").textContent = `Week ${now + 1} of ${weeks.length}, from ${week.report}: its scans told of ${count} of ${counted.length} elements.`;
  choose(picked);
  showBars();
  showCurve();
  showChanges();
  showRows();
}

function go(week) {
  now = Math.min(Math.max(week, 0), weeks.length - 1);
  show();
}

function play() {
  if (timer !== null) {
    clearInterval(timer);
    timer = null;
  } else {
    if (now === weeks.length - 1) go(0);
    timer = setInterval(() => {
      go(now + 1);
      if (now === weeks.length - 1) play();
    }, 1100);
  }
  at("play").textContent = timer === null ? "play" : "stop";
}

function letDrag() {
  const plan = at("plan");
  let from = null;
  plan.addEventListener("pointerdown", (event) => { from = view && [event.clientX, event.clientY, ...view]; });
  plan.addEventListener("pointermove", (event) => {
    if (!from || !(event.buttons & 1)) return;
    const scale = Math.max(from[4] / plan.clientWidth, from[5] / plan.clientHeight);
    view = [from[2] - (event.clientX - from[0]) * scale, from[3] - (event.clientY - from[1]) * scale, from[4], from[5]];
    showView();
  });
  for (const end of ["pointerup", "pointerleave"]) plan.addEventListener(end, () => { from = null; });
}

at("week").max = weeks.length - 1;
at("week").addEventListener("input", () => go(Number(at("week").value)));
at("before").addEventListener("click", () => go(now - 1));
at("after").addEventListener("click", () => go(now + 1));
at("play").addEventListener("click", play);
at("mode").addEventListener("change", colourPlan);
at("in").addEventListener("click", () => zoom(0.7));
at("out").addEventListener("click", () => zoom(1 / 0.7));
at("fit").addEventListener("click", () => { view = null; showView(); });
at("find").addEventListener("input", showRows);
at("only").append(make("option", {value: ""}, "every state"), ...data.states.map((state) => make("option", {value: state}, state)));
if (data.tasks.length) at("only").append(make("option", {value: "late"}, "behind schedule"));
at("only").addEventListener("change", showRows);
const kinds = [...new Set(data.shares.map((one) => one.kind))].filter((kind) => kind !== "all");
at("by").append(...kinds.map((kind) => make("option", {value: kind}, kind)));
at("by").addEventListener("change", showBars);
at("plans").hidden = !data.storeys.length;
storey = Math.max(data.storeys.findIndex((one) => one.elements.length), 0);
showStoreys();
drawStorey();
letDrag();
show();
