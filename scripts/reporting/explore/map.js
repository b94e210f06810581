"use strict";
// The rig from above, each plate coloured by its gap over the captures that the filters leave, and where cameras stand.
explorer.parts.map = (element, { onMarker, onCapture }) => {
  const { make } = explorer, MOST_PLACES = 1500;
  const STOPS = [[247, 251, 255], [200, 220, 240], [115, 178, 216], [41, 121, 185], [8, 48, 107]]; // light to dark: also without colour
  let plates = [], flip = ([x, y]) => `${x},${-y}`;

  function colour(share) {
    const t = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1), k = Math.min(Math.floor(t), STOPS.length - 2);
    return `rgb(${STOPS[k].map((c, n) => Math.round(c + (t - k) * (STOPS[k + 1][n] - c))).join(",")})`;
  }

  function lay(index, stands) {
    const all = [...index.plates.flat(), ...(index.board ? index.board : []), ...stands.filter(Boolean)];
    if (!all.length) all.push([0, 0]);
    const [x0, x1, y0, y1] = all.reduce(([a, b, c, d], [x, y]) => [Math.min(a, x), Math.max(b, x), Math.min(c, y), Math.max(d, y)], [Infinity, -Infinity, Infinity, -Infinity]);
    const pad = 0.08 * Math.max(x1 - x0, y1 - y0, 0.1);
    const svg = make("svg", { viewBox: `${x0 - pad} ${-y1 - pad} ${x1 - x0 + 2 * pad} ${y1 - y0 + 2 * pad}`, role: "group", "aria-label": "The rig from above" });
    plates = index.plates.map((corners, k) => make("polygon",
      { points: corners.map(flip).join(" "), class: "plate", "data-marker": k, onclick: () => onMarker(k) }, make("title")));
    const board = index.board ? [make("polygon", { points: index.board.map(flip).join(" "), class: "board" })] : [];
    svg.append(make("polygon", { class: "ground", points: "" }), ...board, ...plates, make("g", { class: "places" }), make("path", { class: "camera", d: "" }));
    element.replaceChildren(svg);
    element.style.setProperty("--ratio", (x1 - x0 + 2 * pad) / (y1 - y0 + 2 * pad));
    element.dataset.unit = pad / 4;
  }

  // values: a number or null a plate; top: the value of the darkest colour
  function fill(values, top, say) {
    plates.forEach((plate, k) => {
      plate.style.fill = values[k] === null ? "" : colour(values[k] / top);
      plate.classList.toggle("unknown", values[k] === null);
      plate.dataset.value = values[k] === null ? "" : values[k];
      plate.firstElementChild.textContent = say(k, values[k]);
    });
  }

  function places(stands, kept) {
    const seen = new Map(), unit = Number(element.dataset.unit);
    kept.forEach((k) => { if (stands[k]) { const key = stands[k].slice(0, 2).map((v) => v.toFixed(3)).join(); if (!seen.has(key)) seen.set(key, k); } });
    const some = [...seen.values()].filter((_, n, all) => n % Math.ceil(all.length / MOST_PLACES) === 0);
    element.querySelector(".places").replaceChildren(...some.map((k) => make("circle",
      { cx: stands[k][0], cy: -stands[k][1], r: unit / 2, class: "place", onclick: () => onCapture(k) }, make("title", {}, "a camera stood here"))));
  }

  function current(place) {
    element.querySelector(".ground").setAttribute("points", place ? place.ground.map(flip).join(" ") : "");
    const camera = element.querySelector(".camera"), unit = 2 * Number(element.dataset.unit);
    const [x, y] = place ? place.at : [0, 0], length = place ? Math.hypot(...place.axis) : 0;
    const [dx, dy] = length > 1e-6 ? place.axis.map((v) => v / length) : [0, 1];
    const corner = (along, across) => `${x + unit * (along * dx - across * dy)} ${-(y + unit * (along * dy + across * dx))}`;
    camera.setAttribute("d", place ? `M${corner(1, 0)} L${corner(-0.7, 0.7)} L${corner(-0.7, -0.7)} Z` : "");
  }

  return { lay, fill, places, current, colour, select: (k) => plates.forEach((plate, n) => plate.classList.toggle("chosen", n === k)) };
};
