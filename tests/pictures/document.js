// A document for Node: elements that hold what the page sets, and a WebGL context that stores uploaded arrays.
const elements = {};
function makeElement(id) {
  return {
    id, style: {}, dataset: {}, children: [], value: "", textContent: id === "data" ? pageData : "",
    clientWidth: 800, clientHeight: 600, width: 800, height: 600,
    append(...children) { this.children.push(...children); }, addEventListener() {}, setPointerCapture() {},
    getContext(kind) { return kind === "2d" ? { putImageData() {} } : context; },
    querySelectorAll() { return this.children.flatMap((label) => label.children).filter((c) => c.type === "checkbox"); },
  };
}
const uploads = [];
const context = new Proxy({ uploads, bufferData(target, content) { uploads.push(content); } }, {
  get(own, name) {
    if (name in own) { return own[name]; }
    return typeof name === "string" && /^[A-Z_0-9]+$/.test(name) ? 1 : () => ({});
  },
});
const document = {
  getElementById(id) { return (elements[id] = elements[id] || makeElement(id)); },
  createElement: (tag) => makeElement(tag), body: makeElement("body"),
};
const window = { addEventListener() {}, devicePixelRatio: 1 };
class Option { constructor(text, value) { this.text = text; this.value = value; } }
class ImageData {}
const requestAnimationFrame = (call) => call();
