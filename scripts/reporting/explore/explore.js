"use strict";
// The page's state, and what follows from it: which capture, twin, marker; filters; keys; the address that tells all of it.
explorer.start = async () => {
  const { make, number, words, parts } = explorer;
  const $ = (id) => document.getElementById(id);
  const FOLDER = "explore";
  const MEASURES = {
    corners: { title: "corners off", unit: " px", digits: 3, by: "plates", of: (s) => Math.sqrt(s[1] / s[0]), count: 0 },
    white: { title: "white's level off", unit: " DN", digits: 1, by: "plates", of: (s) => s[2] / s[0], count: 0 },
    alone: { title: "found on one side only", unit: " %", digits: 0, by: "cells", of: (s) => (100 * s[1]) / s[0], count: 0 },
    distance: { title: "distance differs", unit: " cm", digits: 2, by: "cells", of: (s) => s[3] / s[2], count: 2 },
    rotation: { title: "rotation differs", unit: "°", digits: 2, by: "cells", of: (s) => s[4] / s[2], count: 2 },
  };
  const LADDER_WORDS = { corner_rmse_px: ["corners", 3, " px"], intensity_rmse_dn: ["grey levels", 2, " DN"], detection_disagreement_pct: ["detection disagrees", 1, " %"], gap: ["gap", 2, " floors"] };
  const index = await explorer.load("index", `${FOLDER}/index.js`);
  const S = { camera: null, capture: 0, step: 0, mode: "wipe", marker: null, tilts: new Set(), bins: new Set(), detector: index.detectors.indexOf(index.reference), measure: "corners", when: 0, sort: "name" };
  if (S.detector < 0) S.detector = 0;
  let camera = null, cells = null, kept = [];
  const viewer = parts.viewer($("viewer"), { onPick: pick, onMove: (scale) => { $("zoom").textContent = `${scale < 10 ? number(scale, 1) : number(scale, 0)} ×`; } });
  const loupe = parts.loupe($("loupe"));
  const map = parts.map($("map"), { onMarker: selectMarker, onCapture: selectCapture });

  // -- camera ---------------------------------------------------------------------------------------------------------

  async function selectCamera(name, capture) {
    camera = await explorer.load(`camera/${name}`, `${FOLDER}/${name}/camera.js`);
    S.camera = name;
    S.tilts = new Set(camera.tilts.keys());
    S.bins = new Set(camera.edges_m.slice(1).keys());
    press($("cameras"), name);
    map.lay(index, camera.stands);
    chips($("tilts"), camera.tilts, S.tilts);
    chips($("distances"), camera.edges_m.slice(1).map((end, k) => `${+camera.edges_m[k].toFixed(3)}–${+end.toFixed(3)} m`), S.bins);
    $("tilts").parentElement.hidden = camera.tilts.length < 2;
    $("distances").parentElement.hidden = !camera.in_bins.length;
    S.step = Math.min(S.step, camera.steps.length - 1);
    const named = camera.captures.name.indexOf(capture), first = camera.captures.drawn.indexOf(1);
    S.capture = named >= 0 ? named : Math.max(first, 0);
    $("verdict").textContent = camera.verdict;
    $("verdict").dataset.verdict = camera.verdict;
    ladder();
    filter();
    await selectCapture(S.capture);
  }

  const image = (k, what, drawn) => `${FOLDER}/${S.camera}/${String(k).padStart(5, "0")}_${what}.${drawn ? "png" : "jpg"}`;
  const drawn = () => camera.captures.drawn[S.capture] === 1;
  const rungsHere = () => (cells ? cells.steps.length : 0);
  const stepHere = () => Math.min(S.step, Math.max(rungsHere() - 1, 0));

  async function selectCapture(k) {
    S.capture = k;
    const file = Math.floor(k / camera.captures_a_file), from = S.camera;
    const told = await explorer.load(`cells/${from}/${file}`, `${FOLDER}/${from}/cells_${String(file).padStart(4, "0")}.js`);
    if (S.capture !== k || S.camera !== from) return;
    cells = told[k];
    const all = drawn();
    $("capture").textContent = camera.captures.name[k];
    $("how").textContent = all
      ? "Each twin is drawn in this capture's own pose, at full size, without loss."
      : rungsHere() && index.board ? "Reduced, beside its twin in its own pose, and in its own light where nobody declared it. What lies about the board is not modelled."
      : rungsHere() ? "Reduced, beside the twin as it stands at its station: a shift of some pixels is the station's tolerance." : "This capture has no twin: its pose is unknown.";
    $("ladder").classList.toggle("single", !all);
    viewer.setStep(stepHere());
    viewer.show({ width: camera.width, height: camera.height, real: image(k, "real", all), rungs: cells.steps.map((_, n) => image(k, n, all)) })
      .then((ok) => { $("viewer").dataset.ready = ok ? String(k) : "failed"; $("missing").hidden = ok || S.capture !== k; });
    map.current(cells.place || null);
    if (S.marker === null || !markerCorners(S.marker)) S.marker = worstMarker();
    list.mark();
    stations();
    showStep();
  }

  // -- ladder ---------------------------------------------------------------------------------------------------------

  function ladder() {
    const gaps = camera.steps.map((s) => s.errors.gap[0]), top = Math.max(1, ...gaps.filter(Number.isFinite));
    $("ladder").style.setProperty("--count", camera.steps.length);
    $("rungs").style.setProperty("--floor", `${100 / top}%`);
    $("rungs").replaceChildren(...camera.steps.map((s, k) => make("button", { type: "button", class: "rung", "data-step": k, onclick: () => setStep(k) },
      make("span", { class: "column" }, make("span", { class: "bar", style: `height:${Number.isFinite(gaps[k]) ? Math.max(2, (100 * gaps[k]) / top) : 0}%` })),
      make("strong", {}, number(gaps[k], 2)), make("span", {}, (k ? "+ " : "") + words(s.effect)))));
    $("step").max = camera.steps.length - 1;
    $("ladder").hidden = camera.steps.length < 2;
  }

  function setStep(k) {
    S.step = Math.min(Math.max(k, 0), camera.steps.length - 1);
    S.when = S.step === camera.steps.length - 1 ? 1 : S.step === 0 ? 0 : S.when;
    viewer.setStep(stepHere());
    showStep();
  }

  function showStep() {
    const step = camera.steps[S.step], here = cells.steps[stepHere()];
    $("step").value = S.step;
    $("step").setAttribute("aria-valuetext", words(step.effect));
    for (const rung of $("rungs").children) rung.classList.toggle("chosen", Number(rung.dataset.step) === S.step);
    $("rms").textContent = here ? number(here.rms_dn, 2) : "–";
    $("off").textContent = here ? number(here.off_px, 3) : "–";
    const values = Object.entries(step.parameters).map(([name, p]) => `${name} ${Number(p.value.toPrecision(4))}${p.se ? ` ± ${Number(p.se.toPrecision(2))}` : ""}`);
    $("parameters").textContent = S.step === 0 ? "the nominal rig through a pinhole, and nothing else" : values.length > 8 ? `${values.length} parameters` : values.join(", ");
    $("effect").textContent = words(step.effect);
    $("errors").replaceChildren(...Object.entries(LADDER_WORDS).filter(([key]) => Number.isFinite(step.errors[key][0])).map(([key, [title, digits, unit]]) =>
      make("div", {}, make("dt", {}, title), make("dd", { "data-error": key }, number(step.errors[key][0], digits, unit), make("small", {}, ` floor ${number(step.errors[key][1], digits)}`)))));
    colourMap();
    showMarker();
    remember();
  }

  // -- markers --------------------------------------------------------------------------------------------------------

  const detector = () => index.detectors[S.detector];
  const found = () => (cells && cells.found[detector()]) || { real: {}, before: {}, after: {} };
  const predicted = (m) => (cells.steps[stepHere()] || { corners: {} }).corners[m] || null;
  const inPicture = (c) => c && [0, 2, 4, 6].every((k) => c[k] > -0.5 && c[k + 1] > -0.5 && c[k] < camera.width - 0.5 && c[k + 1] < camera.height - 0.5);
  const inBins = (m) => { if (!cells.range_m) return true; const k = camera.edges_m.findIndex((e) => e > cells.range_m[m]) - 1; return S.bins.has(Math.min(Math.max(k < -1 ? camera.edges_m.length - 2 : k, 0), camera.edges_m.length - 2)); };
  const markerCorners = (m) => [cells.measured[m], predicted(m), found().real[m]].find(inPicture) || null;
  const markersHere = () => index.markers.map((_, m) => m).filter((m) => inBins(m) && markerCorners(m));
  const offPx = (m, k) => { const a = cells.measured[m], b = (cells.steps[k] || { corners: {} }).corners[m]; return a && b ? Math.sqrt(a.reduce((sum, v, n) => sum + (v - b[n]) ** 2, 0) / 4) : null; };
  const centre = (c) => ({ x: (c[0] + c[2] + c[4] + c[6]) / 4, y: (c[1] + c[3] + c[5] + c[7]) / 4 });

  function worstMarker() {
    const here = markersHere();
    return here.length ? here.reduce((a, b) => ((offPx(b, 0) || 0) > (offPx(a, 0) || 0) ? b : a)) : null;
  }

  function pick(x, y) {
    let best = null, least = Infinity;
    for (const m of markersHere()) {
      const c = markerCorners(m), at = centre(c), size = Math.hypot(c[0] - c[4], c[1] - c[5]), off = Math.hypot(x - at.x, y - at.y);
      if (off < size && off < least) [best, least] = [m, off];
    }
    if (best !== null) selectMarker(best);
    else loupe.show(image(S.capture, "real", drawn()), rungsHere() ? image(S.capture, stepHere(), drawn()) : null, camera.width, { x, y }, [null, null]);
  }

  function selectMarker(m) { S.marker = m; showMarker(); remember(); }

  function showMarker() {
    const m = S.marker, corners = m === null ? null : markerCorners(m);
    map.select(m);
    viewer.outline(markersHere().flatMap((k) => [
      predicted(k) && { corners: predicted(k), kind: k === m ? "predicted chosen" : "predicted", marker: k },
      (found().real[k] || cells.measured[k]) && { corners: found().real[k] || cells.measured[k], kind: k === m ? "measured chosen" : "measured", marker: k },
    ].filter(Boolean)));
    $("marker").hidden = !index.markers.length;
    if (m === null) return;
    $("marker-name").textContent = index.markers[m];
    $("marker-place").textContent = cells.range_m ? `${number(cells.range_m[m], 2)} m away${corners ? "" : "; not in this picture"}` : "";
    const at = corners && centre(corners);
    $("loupe").hidden = !at;
    if (at) loupe.show(image(S.capture, "real", drawn()), rungsHere() ? image(S.capture, stepHere(), drawn()) : null, camera.width, at, [cells.measured[m] || found().real[m] || null, predicted(m)]);
    const mark = (yes) => (yes === undefined ? "–" : yes ? "found" : "missed");
    $("found").replaceChildren(...index.detectors.map((name) => {
      const f = cells.found[name] || { before: {}, after: {} }, before = f.before[m] || [], after = f.after[m] || [];
      const row = make("tr", { class: name === detector() ? "chosen" : null }, make("th", { scope: "row" }, name));
      const values = [mark(before[0]), mark(before[1]), mark(after[1]), number(before[2] ?? after[2], 3), number(before[3], 3), number(after[3], 3), number(before[4], 2) + (before[5] ? " flip" : ""), number(after[4], 2) + (after[5] ? " flip" : "")];
      const heads = ["real", "before", "after", "distance-real", "distance-before", "distance-after", "rotation-before", "rotation-after"];
      row.append(...values.map((v, k) => make("td", { "data-value": heads[k], class: v === "missed" ? "missed" : null }, v)));
      return row;
    }));
    $("offs").replaceChildren(...cells.steps.map((_, k) => make("tr", { class: k === stepHere() ? "chosen" : null },
      make("th", { scope: "row" }, (k ? "+ " : "") + words(camera.steps[k].effect)), make("td", { "data-off": k }, number(offPx(m, k), 3)))));
    $("offs-table").hidden = !drawn();
  }

  // -- map, stations, list --------------------------------------------------------------------------------------------

  function sums(when) {
    const measure = MEASURES[S.measure], lead = measure.by === "plates" ? 4 : 5, values = index.markers.map(() => null);
    for (const row of camera[measure.by]) {
      const [tilt, bin, marker] = row.slice(lead - 3, lead);
      if (row[0] !== when || (lead === 5 && row[1] !== S.detector) || !(S.tilts.has(tilt) || tilt < 0) || !S.bins.has(bin)) continue;
      const sum = (values[marker] ||= new Array(row.length - lead).fill(0));
      row.slice(lead).forEach((v, k) => { sum[k] += v; });
    }
    return values.map((s) => (s && s[measure.count] > 0 ? measure.of(s) : null));
  }

  function colourMap() {
    const measure = MEASURES[S.measure], both = [sums(0), sums(1)], all = both.flat().filter((v) => v !== null).sort((a, b) => a - b);
    const top = all.length ? Math.max(all[Math.floor(0.95 * (all.length - 1))], 1e-6) : 1;
    const say = (v) => number(v, measure.digits, measure.unit);
    map.fill(both[S.when], top, (k, v) => `${index.markers[k]}: ${v === null ? "nothing compared" : say(v)}`);
    map.places(camera.stands, kept);
    $("top").textContent = `${say(top)} and more`;
    const mean = (v) => { const some = v.filter((x) => x !== null); return some.length ? some.reduce((a, b) => a + b, 0) / some.length : null; };
    $("mean").textContent = `${measure.title}, mean of the plates: ${say(mean(both[0]))} before, ${say(mean(both[1]))} after`;
    press($("when"), String(S.when));
  }

  function filter() {
    const { captures } = camera, mask = [...S.bins].reduce((bits, k) => bits | (1 << k), 0), all = S.bins.size === camera.edges_m.length - 1;
    kept = captures.name.map((_, k) => k).filter((k) => (captures.tilt[k] < 0 || S.tilts.has(captures.tilt[k])) && (all || !camera.in_bins.length || camera.in_bins[k] & mask));
    if (S.sort !== "name") kept.sort((a, b) => (captures[S.sort][b] ?? -1) - (captures[S.sort][a] ?? -1) || a - b);
    $("kept").textContent = `${kept.length} of ${captures.name.length}`;
    list.lay();
    if (cells) { stations(); colourMap(); showMarker(); }
  }

  const list = parts.list($("list"), {
    row: (k) => ({ name: camera.captures.name[k], drawn: camera.captures.drawn[k], before: camera.captures.before_px[k], after: camera.captures.after_px[k], top: Math.max(...camera.captures.before_px.filter(Number.isFinite), 1e-6) }),
    kept: () => kept, current: () => S.capture, onCapture: selectCapture,
  });

  function stations() {
    const { captures } = camera, rows = [...new Set(captures.height_m)].filter(Number.isFinite).sort((a, b) => b - a);
    const places = new Set(captures.station).size, byHand = camera.tilts.some((tilt) => tilt.includes(" to "));
    $("stations").hidden = byHand || rows.length > 12 || camera.tilts.length > 12 || places < 2 || captures.tilt.includes(-1);
    if ($("stations").hidden) return;
    const values = S.when ? captures.after_px : captures.before_px, top = Math.max(...captures.before_px.filter(Number.isFinite), 1e-6);
    const cell = (h, t) => {
      const here = captures.name.map((_, k) => k).filter((k) => captures.height_m[k] === h && captures.tilt[k] === t), some = here.map((k) => values[k]).filter(Number.isFinite);
      const mean = some.length ? some.reduce((a, b) => a + b, 0) / some.length : null, share = (mean ?? 0) / top;
      if (!here.length) return make("td");
      return make("td", {}, make("button", { type: "button", class: here.includes(S.capture) ? "chosen" : null, style: mean === null ? null : `background:${map.colour(share)};color:${share > 0.5 ? "#fff" : "inherit"}`, "aria-label": `height ${h} m, tilt ${camera.tilts[t]}: ${number(mean, 2)} px`, onclick: () => selectCapture(here[(here.indexOf(S.capture) + 1) % here.length]) }, number(mean, 2)));
    };
    $("station-table").replaceChildren(make("thead", {}, make("tr", {}, make("td"), ...camera.tilts.map((t) => make("th", { scope: "col" }, t)))),
      make("tbody", {}, ...rows.map((h) => make("tr", {}, make("th", { scope: "row" }, `${h} m`), ...camera.tilts.map((_, t) => cell(h, t))))));
  }

  // -- controls -------------------------------------------------------------------------------------------------------

  function press(group, value) { for (const b of group.querySelectorAll("button")) b.setAttribute("aria-pressed", b.value === value); }

  // Toggles, of which none is pressed while all are chosen; the last one taken away asks for all again.
  function chips(group, labels, chosen) {
    const all = () => chosen.size === labels.length;
    const shown = () => { for (const b of group.children) b.setAttribute("aria-pressed", b.value === "all" ? all() : !all() && chosen.has(Number(b.value))); };
    const choose = (k) => {
      if (all()) chosen.clear();
      if (chosen.has(k)) chosen.delete(k); else chosen.add(k);
      if (!chosen.size) labels.forEach((_, n) => chosen.add(n));
      shown();
      filter();
    };
    const everything = () => { labels.forEach((_, n) => chosen.add(n)); shown(); filter(); };
    group.replaceChildren(make("button", { type: "button", value: "all", onclick: everything }, "all"),
      ...labels.map((label, k) => make("button", { type: "button", value: k, onclick: () => choose(k) }, label)));
    shown();
  }

  function setMode(name) { S.mode = name; press($("modes"), name); viewer.setMode(name); remember(); }
  function turn(by) { if (kept.length) selectCapture(kept[(kept.indexOf(S.capture) + by + kept.length) % kept.length]); }
  function nextMarker(by) { const here = markersHere(); if (here.length) selectMarker(here[(here.indexOf(S.marker) + by + here.length) % here.length]); }
  function toMarker() { const c = S.marker !== null && markerCorners(S.marker); if (c) { const at = centre(c); viewer.goTo(at.x, at.y, 8); } }

  function remember() {
    const told = { camera: S.camera, capture: camera.captures.name[S.capture], step: S.step, mode: S.mode };
    if (S.marker !== null) told.marker = index.markers[S.marker];
    history.replaceState(null, "", `#${new URLSearchParams(told)}`);
  }

  const KEYS = {
    ArrowLeft: () => turn(-1), ArrowRight: () => turn(1), ArrowUp: () => setStep(S.step + 1), ArrowDown: () => setStep(S.step - 1),
    w: () => setMode("wipe"), b: () => setMode("blink"), d: () => setMode("difference"), " ": () => (S.mode === "blink" ? viewer.swap() : setMode("blink")),
    m: () => nextMarker(1), M: () => nextMarker(-1), z: toMarker, "+": () => viewer.zoom(1.5), "-": () => viewer.zoom(1 / 1.5), 0: () => viewer.home(), "?": () => { $("keys").open = !$("keys").open; },
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, summary")) return;
    if (event.key === " " && event.target.closest("button")) return;
    const act = KEYS[event.key];
    if (act && camera) { act(); event.preventDefault(); }
  });

  $("cameras").append(...index.cameras.map((name) => make("button", { type: "button", value: name, "aria-pressed": "false", onclick: () => selectCamera(name) }, name)));
  $("detector").append(...index.detectors.map((name, k) => make("option", { value: k }, name)));
  $("detector").value = S.detector;
  $("detector").addEventListener("change", (event) => { S.detector = Number(event.target.value); colourMap(); showMarker(); });
  $("measure").append(...Object.entries(MEASURES).map(([key, m]) => make("option", { value: key }, m.title)));
  $("measure").addEventListener("change", (event) => { S.measure = event.target.value; colourMap(); });
  $("when").addEventListener("click", (event) => { if (event.target.value) { S.when = Number(event.target.value); colourMap(); stations(); } });
  $("modes").addEventListener("click", (event) => { if (event.target.value) setMode(event.target.value); });
  $("step").addEventListener("input", (event) => setStep(Number(event.target.value)));
  $("sort").addEventListener("change", (event) => { S.sort = event.target.value; filter(); });
  $("outlines").addEventListener("change", (event) => viewer.setOutlines(event.target.checked));
  for (const [id, act] of Object.entries({ previous: () => turn(-1), next: () => turn(1), closer: () => viewer.zoom(1.5), farther: () => viewer.zoom(1 / 1.5), whole: () => viewer.home(), "to-marker": toMarker })) $(id).addEventListener("click", act);
  document.body.classList.toggle("no-markers", !index.markers.length);
  document.body.classList.toggle("no-board", !index.board);

  const asked = new URLSearchParams(location.hash.slice(1));
  S.step = Math.max(0, Number.parseInt(asked.get("step"), 10) || 0);
  S.marker = index.markers.includes(asked.get("marker")) ? index.markers.indexOf(asked.get("marker")) : null;
  await selectCamera(index.cameras.includes(asked.get("camera")) ? asked.get("camera") : index.cameras[0], asked.get("capture"));
  setMode(["wipe", "blink", "difference"].includes(asked.get("mode")) ? asked.get("mode") : "wipe");
  explorer.state = () => ({ ...S, tilts: [...S.tilts], bins: [...S.bins], kept: kept.length, viewer: viewer.state() });
};

explorer.start().catch((error) => {
  const line = document.getElementById("failed");
  line.hidden = false;
  line.textContent = `This page could not be shown: ${error.message}. Are explore.html and its folder explore still side by side?`;
});
