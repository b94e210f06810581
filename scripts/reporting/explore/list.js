"use strict";
// The captures, of which only the rows in sight are made: ten thousand are as quick as ten.
explorer.parts.list = (element, { row, kept, current, onCapture }) => {
  const { make, number } = explorer, HEIGHT = 36, MORE = 4;
  const inner = make("div", { class: "rows" });
  element.append(inner);
  element.addEventListener("scroll", draw, { passive: true });
  new ResizeObserver(draw).observe(element);

  function draw() {
    const first = Math.max(0, Math.floor(element.scrollTop / HEIGHT) - MORE), count = Math.ceil(element.clientHeight / HEIGHT) + 2 * MORE;
    inner.replaceChildren(...kept().slice(first, first + count).map((k, n) => {
      const r = row(k), bar = (v, kind) => make("span", { class: kind, style: `width:${Number.isFinite(v) ? Math.max(1, (100 * v) / r.top) : 0}%` });
      return make("button", { type: "button", class: k === current() ? "chosen" : null, style: `top:${(first + n) * HEIGHT}px;height:${HEIGHT}px`, "data-capture": k, onclick: () => onCapture(k) },
        make("span", { class: "name" }, r.name, r.drawn ? make("small", { title: "shown with all twins of the ladder" }, " ◆") : null),
        Number.isFinite(r.before) ? make("span", { class: "bars", title: `corners off: ${number(r.before, 2)} px before, ${number(r.after, 2)} px after` }, bar(r.before, "before"), bar(r.after, "after")) : null);
    }));
  }

  return {
    lay() { inner.style.height = `${kept().length * HEIGHT}px`; draw(); },
    mark() {
      const at = kept().indexOf(current()) * HEIGHT;
      if (at >= 0 && (at < element.scrollTop || at + HEIGHT > element.scrollTop + element.clientHeight)) element.scrollTop = at - element.clientHeight / 2;
      draw();
    },
  };
};
