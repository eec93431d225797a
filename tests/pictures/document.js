// A document for Node: elements that hold what the page sets, with what listens to them, and a WebGL
// context that stores uploaded arrays and the numbers of each drawing.
const elements = {};
function makeElement(id) {
  return {
    id, style: {}, offsetLeft: 0, offsetTop: 0, dataset: {}, children: [], value: "", textContent: "",
    clientWidth: 800, clientHeight: 600, width: 800, height: 600,
    listeners: {}, append(...children) { this.children.push(...children); },
    addEventListener(kind, call) { this.listeners[kind] = call; }, setPointerCapture() {},
    send(kind, event) { this.listeners[kind]({ preventDefault() {}, target: this, ...event }); },
    getContext(kind) { return kind === "2d" ? { putImageData() {} } : context; },
    querySelectorAll() { return this.children.flatMap((label) => label.children).filter((c) => c.type === "checkbox"); },
  };
}
const uploads = [];
const numbers = {}, drawn = [];
const context = new Proxy({
  uploads, drawn, bufferData(target, content) { uploads.push(content); },
  getUniformLocation: (program, name) => name, uniform1i(name, value) { numbers[name] = value; },
  drawArrays() { drawn.push({ ...numbers }); },
}, {
  get(own, name) {
    if (name in own) { return own[name]; }
    return typeof name === "string" && /^[A-Z_0-9]+$/.test(name) ? 1 : () => ({});
  },
});
const document = {
  getElementById(id) { return (elements[id] = elements[id] || makeElement(id)); },
  querySelectorAll: () => pageData.map((textContent) => ({ textContent })), createElement: (tag) => makeElement(tag), body: makeElement("body"),
};
const window = { addEventListener() {}, devicePixelRatio: 1 };
class Option { constructor(text, value) { this.text = text; this.value = value; } }
class ImageData {}
const requestAnimationFrame = (call) => call();
