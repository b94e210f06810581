"use strict";
// Data comes as scripts that hand values over: a page opened from a folder may run scripts but fetch nothing.
window.explorer = (() => {
  const MOST_KEPT = 24; // files of markers' numbers
  const promises = new Map(), handOver = new Map();

  function take(name, value) {
    const give = handOver.get(name);
    if (give) give(value);
  }

  function load(name, url) {
    if (promises.has(name)) {
      const promise = promises.get(name);
      promises.delete(name);
      promises.set(name, promise); // the one used last goes last
      return promise;
    }
    const promise = new Promise((resolve, reject) => {
      const script = document.createElement("script");
      handOver.set(name, resolve);
      script.src = url;
      script.onload = () => { handOver.delete(name); script.remove(); reject(new Error(`${url} holds no ${name}`)); };
      script.onerror = () => { handOver.delete(name); promises.delete(name); script.remove(); reject(new Error(`${url} is missing`)); };
      document.head.append(script);
    });
    promises.set(name, promise);
    const cells = [...promises.keys()].filter((key) => key.startsWith("cells/"));
    if (cells.length > MOST_KEPT) promises.delete(cells[0]);
    return promise;
  }

  return { take, load, parts: {} };
})();

// What all parts share: elements are made with text, never with markup, as names are foreign.
explorer.make = (tag, attributes = {}, ...children) => {
  const svg = ["svg", "g", "polygon", "polyline", "circle", "line", "path", "text", "title", "rect"].includes(tag);
  const element = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "onclick") element.addEventListener("click", value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
};
explorer.number = (value, digits, unit = "") =>
  value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits).replace("-", "−") + unit;
explorer.words = (name) => name.replaceAll("_", " ");
