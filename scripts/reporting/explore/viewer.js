"use strict";
// One capture over its twin, for wiping, blinking and taking the difference; zoom and touch are OpenSeadragon's.
explorer.parts.viewer = (element, { onPick, onMove }) => {
  const { make } = explorer;
  const BLINK_MS = 600, SMOOTH_BELOW = 1.5;
  const world = { real: null, rungs: [], width: 1, height: 1, token: 0 };
  let mode = "wipe", step = 0, share = 0.5, showsTwin = true, timer = null, outlines = true, shapes = [];

  const osd = OpenSeadragon({
    element: element.querySelector(".stage"), drawer: "canvas", crossOriginPolicy: false, showNavigationControl: false,
    imageSmoothingEnabled: true, visibilityRatio: 0.5, minZoomImageRatio: 0.7, maxZoomPixelRatio: 48, animationTime: 0.25,
    clickTimeThreshold: 1000, // a slow finger clicks too
    immediateRender: true, gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true },
    gestureSettingsTouch: { clickToZoom: false, dblClickToZoom: true, pinchRotate: false },
  });
  const divider = element.querySelector(".divider"), svg = element.querySelector("svg.outlines");
  const sides = { left: element.querySelector(".side.left"), right: element.querySelector(".side.right") };

  osd.addHandler("canvas-key", (event) => { event.preventDefaultAction = true; }); // the page has keys of its own
  osd.addHandler("canvas-click", (event) => {
    if (!event.quick || !world.real) return;
    const at = osd.viewport.pointFromPixel(event.position);
    onPick(at.x * world.width - 0.5, at.y * world.width - 0.5);
  });
  for (const name of ["update-viewport", "resize"]) osd.addHandler(name, place);
  osd.addHandler("animation", clip);

  function show(capture) {
    const token = ++world.token, keep = world.real && world.width === capture.width && world.height === capture.height;
    const bounds = keep ? osd.viewport.getBounds() : null;
    Object.assign(world, { width: capture.width, height: capture.height, real: null, rungs: [] });
    osd.world.removeAll();
    const ready = [capture.real, ...capture.rungs].map((url, k) => new Promise((resolve) => {
      osd.addTiledImage({
        tileSource: { type: "image", url, buildPyramid: false, crossOriginPolicy: false }, x: 0, y: 0, width: 1, index: k,
        opacity: k === 0 ? 1 : 0, preload: true,
        success: ({ item }) => {
          if (token !== world.token) { osd.world.removeItem(item); return resolve(false); }
          if (k === 0) world.real = item; else world.rungs[k - 1] = item;
          resolve(true);
        },
        error: () => resolve(false),
      });
    }));
    return Promise.all(ready).then((loaded) => {
      if (token !== world.token) return false;
      if (bounds) osd.viewport.fitBounds(bounds, true); else osd.viewport.goHome(true);
      arrange();
      return loaded.every(Boolean);
    });
  }

  // What lies over what: in all modes the capture is below, and of the twins one is seen at most.
  function arrange() {
    const twinSeen = mode !== "blink" || showsTwin;
    world.rungs.forEach((item, k) => {
      if (!item) return;
      item.setCompositeOperation(mode === "difference" ? "difference" : null);
      item.setOpacity(k === step && twinSeen ? 1 : 0);
    });
    element.dataset.mode = mode;
    element.dataset.shown = mode === "blink" ? (showsTwin ? "twin" : "capture") : mode;
    const some = world.rungs.length > 0;
    divider.hidden = mode !== "wipe" || !some;
    sides.left.textContent = mode === "blink" ? (showsTwin ? "twin" : "capture") : mode === "difference" ? "difference × 4" : "capture";
    sides.right.textContent = "twin";
    sides.right.hidden = mode !== "wipe" || !some;
    clip();
  }

  function clip() {
    const item = world.rungs[step];
    if (!item) return;
    if (mode !== "wipe") return item.setClip(null);
    const size = item.getContentSize(), edge = osd.viewport.pointFromPixel(new OpenSeadragon.Point(share * element.clientWidth, 0), true);
    const x = Math.min(Math.max(edge.x * size.x, 0), size.x);
    item.setClip(new OpenSeadragon.Rect(x, 0, Math.max(size.x - x, 0.001), size.y));
  }

  function place() {
    clip();
    const a = osd.viewport.pixelFromPoint(new OpenSeadragon.Point(0, 0), true);
    const b = osd.viewport.pixelFromPoint(new OpenSeadragon.Point(1, 0), true);
    const scale = (b.x - a.x) / world.width; // screen pixels a pixel of the capture
    svg.firstElementChild.setAttribute("transform", `translate(${a.x + scale / 2} ${a.y + scale / 2}) scale(${scale})`);
    if (osd.drawer.setImageSmoothingEnabled) osd.drawer.setImageSmoothingEnabled(scale < SMOOTH_BELOW);
    divider.style.left = `${100 * share}%`;
    divider.setAttribute("aria-valuenow", Math.round(100 * share));
    onMove(scale);
  }

  function wipeTo(value) {
    share = Math.min(Math.max(value, 0), 1);
    place();
    osd.forceRedraw();
  }
  divider.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    divider.focus({ preventScroll: true });
    divider.setPointerCapture(event.pointerId);
    const box = element.getBoundingClientRect();
    const move = (e) => wipeTo((e.clientX - box.left) / box.width);
    divider.addEventListener("pointermove", move);
    divider.addEventListener("lostpointercapture", () => divider.removeEventListener("pointermove", move), { once: true });
  });
  divider.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -0.02, ArrowRight: 0.02, PageUp: -0.2, PageDown: 0.2 }[event.key];
    if (by) wipeTo(share + by);
    else if (event.key === "Home" || event.key === "End") wipeTo(event.key === "Home" ? 0 : 1);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  function blink(on) {
    clearInterval(timer);
    timer = on ? setInterval(() => { showsTwin = !showsTwin; arrange(); }, BLINK_MS) : null;
  }

  return {
    show,
    setMode(name) {
      mode = name;
      showsTwin = true;
      blink(mode === "blink" && !matchMedia("(prefers-reduced-motion: reduce)").matches);
      arrange();
    },
    setStep(k) { step = k; arrange(); },
    swap() { blink(false); showsTwin = !showsTwin; arrange(); },
    // shapes: [{corners: [x, y, ...], kind, marker}], pixels of the capture
    outline(some) {
      shapes = some;
      const points = (c) => [0, 2, 4, 6].map((k) => `${c[k]},${c[k + 1]}`).join(" ");
      // The frame hides a seam: at the border both images cover a pixel in part, which a difference shows bright.
      const frame = make("rect", { class: "frame", x: -0.5, y: -0.5, width: world.width, height: world.height });
      svg.firstElementChild.replaceChildren(frame, ...(outlines ? shapes : []).map((s) =>
        make("polygon", { points: points(s.corners), class: s.kind, "data-marker": s.marker })));
    },
    setOutlines(on) { outlines = on; this.outline(shapes); },
    zoom(factor) { osd.viewport.zoomBy(factor); osd.viewport.applyConstraints(); },
    home() { osd.viewport.goHome(); },
    goTo(x, y, scale) {
      osd.viewport.panTo(new OpenSeadragon.Point((x + 0.5) / world.width, (y + 0.5) / world.width));
      if (scale) osd.viewport.zoomTo((scale * world.width) / element.clientWidth);
    },
    state: () => ({ mode, step, share, showsTwin, loaded: world.rungs.filter(Boolean).length, drawn: osd.world.getItemCount() }),
  };
};
