// A stand-in for a browser: as much of a document, and of WebGL, as report.html asks for. Reads a script and its data,
// runs it, then prints what the lines on standard input give, as JSON.
//   node page_document.js SCRIPT DATA [blind]

const fs = require("fs");
const [script, dataText] = process.argv.slice(2, 4).map((path) => fs.readFileSync(path, "utf8"));
const blind = process.argv[4] === "blind";

class Node {
  constructor(tag) {
    Object.assign(this, { tag, children: [], attributes: {}, listeners: {}, style: { setProperty() {} }, dataset: {} });
    Object.assign(this, { clientWidth: 800, clientHeight: 600, offsetWidth: 60, offsetHeight: 16, value: "", rows: [] });
    const classes = new Set();
    this.classList = {
      add: (name) => classes.add(name), remove: (name) => classes.delete(name),
      toggle: (name, on) => (on ? classes.add(name) : classes.delete(name)), has: (name) => classes.has(name),
    };
  }
  append(...nodes) { this.children.push(...nodes.flat()); this.rows = this.children; }
  replaceChildren(...nodes) { this.children = []; this.append(...nodes); }
  setAttribute(name, value) {
    this.attributes[name] = String(value);
    if (name.startsWith("data-")) this.dataset[name.slice(5)] = String(value);
  }
  addEventListener(kind, act) { (this.listeners[kind] ??= []).push(act); }
  emit(kind, event = {}) {
    for (const act of this.listeners[kind] ?? []) act({ type: kind, preventDefault() {}, target: this, ...event });
  }
  click() { this.emit("click"); }
  focus() { focused = this; }
  blur() { if (focused === this) focused = null; }
  setPointerCapture() {}
  getBoundingClientRect() { return { left: 0, top: 0, width: 800, height: 600 }; }
  getContext() { return blind ? null : gl; }
  get text() { return this.own ?? this.children.map((one) => (one instanceof Node ? one.text : String(one))).join(" "); }
  set textContent(value) { this.own = String(value); }
  get textContent() { return this.text; }
}

let focused = null;
const uploads = []; // what went to the graphics card, by the order
const gl = new Proxy({ canvas: null, uploads }, {
  get(target, name) {
    if (name in target) return target[name];
    if (name === "getProgramParameter") return (_, what) => (what === "ACTIVE_UNIFORMS" ? 0 : true);
    if (name === "bufferData") return (_, values) => uploads.push(values);
    if (name === "texImage2D") return (...all) => uploads.push(new Float32Array(all.at(-1).buffer));
    if (name === "getSyncParameter") return () => "SIGNALED";
    if (name === "isContextLost") return () => false;
    return typeof name === "string" && name === name.toUpperCase() ? name : () => ({});
  },
});
const nodes = new Map();
const byId = (id) => nodes.get(id) ?? nodes.set(id, new Node(id)).get(id);
gl.canvas = byId("canvas");
byId("data").textContent = dataText;
const frames = [];
const top = new Node("document");
globalThis.document = Object.assign(top, {
  getElementById: byId, createElement: (tag) => new Node(tag), querySelectorAll: () => [],
});
const own = new Node("window");
globalThis.window = Object.assign(own, {
  devicePixelRatio: 1, matchMedia: () => ({ matches: true }), requestAnimationFrame: (act) => frames.push(act),
  setTimeout: (act) => frames.push(act), clearTimeout: (one) => { frames[one - 1] &&= () => {}; },
});
globalThis.getComputedStyle = () => ({ getPropertyValue: () => "#1d2329" });
globalThis.ResizeObserver = class { observe() {} };
const settle = () => { while (frames.length) frames.shift()(0); };
const errors = [];
try {
  new Function(script)();
  settle();
  const act = new Function("byId", "settle", "uploads", "focused", "hook", fs.readFileSync(0, "utf8"));
  const told = act(byId, settle, uploads, () => focused?.tag ?? null, window.jaxmm);
  settle();
  console.log(JSON.stringify({ told, ready: window.jaxmm.ready, errors: window.jaxmm.errors }));
} catch (error) {
  console.log(JSON.stringify({ failure: String(error.stack) }));
}
