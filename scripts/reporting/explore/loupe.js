"use strict";
// A part of the capture, of its twin and of their difference, each pixel as a square of eight: for overshoot, fringes, noise.
explorer.parts.loupe = (element) => {
  const { make } = explorer, TIMES = 8, LEAST = 8, MOST = 32; // half a side, pixels of the capture
  const names = ["capture", "twin", "difference × 4"];
  const canvases = names.map((name) => make("canvas", { role: "img", "aria-label": name, width: 1, height: 1 }));
  element.append(...canvases.map((canvas, k) => make("figure", { class: k === 2 ? "amplified" : null }, canvas, make("figcaption", {}, names[k]))));
  const images = new Map();
  let now = null, again = null;

  function image(url) {
    if (!images.has(url)) {
      if (images.size > 40) images.delete(images.keys().next().value);
      const loading = new Image();
      loading.src = url;
      images.set(url, loading.decode().then(() => loading, () => null));
    }
    return images.get(url);
  }

  // at: {x, y} in pixels of the capture; corners: [[x, y, ...] measured, predicted], either may be null
  async function show(real, twin, width, at, corners) {
    const mine = (now = {});
    again = (dx, dy) => show(real, twin, width, { x: at.x + dx, y: at.y + dy }, corners);
    const half = Math.min(Math.max(Math.floor(canvases[0].clientWidth / TIMES / 2), LEAST), MOST);
    const loaded = await Promise.all([image(real), twin ? image(twin) : null]);
    if (now !== mine) return;
    const size = 2 * half * TIMES, left = Math.round(at.x) - half, top = Math.round(at.y) - half;
    canvases.forEach((canvas, k) => {
      canvas.width = canvas.height = size;
      const pen = canvas.getContext("2d");
      pen.imageSmoothingEnabled = false;
      const draw = (picture) => {
        const s = picture.naturalWidth / width; // 1, but of reduced images
        pen.drawImage(picture, left * s, top * s, 2 * half * s, 2 * half * s, 0, 0, size, size);
      };
      if (k !== 1 && loaded[0]) draw(loaded[0]);
      if (k === 2) pen.globalCompositeOperation = "difference";
      if (k !== 0 && loaded[1]) draw(loaded[1]);
      pen.globalCompositeOperation = "source-over";
      if (k < 2) ["#00b7ff", "#ff8c00"].forEach((colour, n) => corners[n] && cross(pen, corners[n], left, top, colour));
    });
    element.dataset.at = `${at.x.toFixed(1)},${at.y.toFixed(1)}`;
    element.dataset.size = size;
    element.dataset.twin = twin || "";
  }

  for (const canvas of canvases) {
    let last = null;
    canvas.addEventListener("pointerdown", (event) => { last = event; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (!last || !again) return;
      const by = [last.clientX - event.clientX, last.clientY - event.clientY].map((d) => Math.trunc((d * canvas.width) / canvas.clientWidth / TIMES));
      if (by[0] || by[1]) { last = event; again(...by); }
    });
  }

  // Measured corners are crosses, predicted ones too, turned by 45 degrees: told apart without colour.
  function cross(pen, corners, left, top, colour) {
    const arm = 7, turned = colour === "#ff8c00";
    pen.lineWidth = 2;
    pen.strokeStyle = colour;
    for (let k = 0; k < 8; k += 2) {
      const x = (corners[k] + 0.5 - left) * TIMES, y = (corners[k + 1] + 0.5 - top) * TIMES;
      pen.beginPath();
      for (const [a, b] of turned ? [[0.7, 0.7], [0.7, -0.7]] : [[1, 0], [0, 1]]) {
        pen.moveTo(x - arm * a, y - arm * b);
        pen.lineTo(x + arm * a, y + arm * b);
      }
      pen.stroke();
    }
  }
  return { show };
};
