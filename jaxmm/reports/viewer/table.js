// The table of all elements that have a verdict, filtered by verdict and by words.

const MOST_ROWS = 300; // shown at once; a button shows all
const COLUMNS = [
  ["verdict", "", (one) => verdictBadge(one.verdict)],
  ["name", "name", null],
  ["class", "", (one) => one.ifc_class],
  ["storey", "", (one) => one.storey],
  ["off [mm, 95 %]", "number", (one) => offCell(offOfKey.get(one.key))],
  ["P(removed)", "number", (one) => chance(one.probability)],
  ...Object.keys(EVIDENCE).map((name) => [name, "number", (one) => count(one.evidence[name])]),
  ["file", "", (one) => one.file],
  ["GlobalId", "", (one) => make("code", {}, one.guid)],
];

/** Off its place with what is open: of two walls that face each other it may be which of them stands off. */
function offCell(off) {
  if (!off) return "";
  return `${fixed(1000 * shownOff(off), 1)} ± ${fixed(1000 * off.half, 1)}${off.at_ends ? " at its ends" : ""}`;
}

/** What asks most for attention comes first. */
function orderedElements() {
  const rank = Object.keys(VERDICTS);
  const off = (one) => {
    const told = one.verdict === "displaced" && offOfKey.get(one.key);
    return told ? surelyOff(told) : 0;
  };
  const order = (a, b) =>
    rank.indexOf(a.verdict) - rank.indexOf(b.verdict) || off(b) - off(a) || b.probability - a.probability;
  return [...report.elements].sort(order);
}

/** Fill the table and its filters; the returned function marks the chosen row. */
function tableOf(actions) {
  if (!report.elements.length) {
    byId("elements").hidden = true;
    return () => {};
  }
  const ordered = orderedElements();
  const filter = { verdict: null, words: "", all: false };
  let chosen = null;
  const body = make("tbody");
  const heads = COLUMNS.map(([title, look]) => make("th", { class: look, scope: "col" }, title));
  byId("table").append(make("thead", {}, make("tr", {}, ...heads)), body);
  const refill = () => {
    const rows = ordered.filter((one) => passes(one, filter));
    const shown = filter.all ? rows : rows.slice(0, MOST_ROWS);
    body.replaceChildren(...shown.map((one) => rowOf(one, actions)));
    const more = make("button", { click: () => { filter.all = true; refill(); } }, `Show all ${count(rows.length)}`);
    byId("more").replaceChildren(...(shown.length < rows.length ? [more] : []));
    mark(chosen);
  };
  const mark = (key) => {
    chosen = key;
    for (const row of body.rows) row.classList.toggle("chosen", row.dataset.key === key);
  };
  filterButtons(filter, refill);
  refill();
  return mark;
}

function passes(one, { verdict, words }) {
  const text = `${one.name} ${one.ifc_class} ${one.storey} ${one.file} ${one.guid}`.toLowerCase();
  return (verdict === null || one.verdict === verdict) && text.includes(words);
}

function rowOf(one, actions) {
  const click = () => { actions.choose(one.key); actions.look(); };
  const cells = COLUMNS.map(([title, look, content]) =>
    make("td", { class: look }, content ? content(one) : make("button", {}, one.name || "(no name)")));
  return make("tr", { "data-key": one.key, "data-guid": one.guid, click }, ...cells);
}

function filterButtons(filter, refill) {
  const names = [null, ...Object.keys(VERDICTS)];
  const buttons = names.map((name) => {
    const total = report.elements.filter((one) => name === null || one.verdict === name).length;
    const click = () => {
      filter.verdict = name;
      buttons.forEach((button, index) => button.setAttribute("aria-pressed", String(names[index] === name)));
      refill();
    };
    const label = name === null ? "all" : verdictBadge(name);
    const pressed = String(name === null);
    return make("button", { "aria-pressed": pressed, "data-verdict": name ?? "all", click }, label, ` ${count(total)}`);
  });
  const words = make("input", { type: "search", placeholder: "Name, class, storey, GlobalId", "aria-label": "Search" });
  words.addEventListener("input", () => { filter.words = words.value.toLowerCase(); refill(); });
  byId("filters").append(...buttons, words);
}
