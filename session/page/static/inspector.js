// The inspector: the colour that is looked at, all marked colours in one plot and one list, two compared.
import { $, button, choice, labelled, make } from "./dom.js";
import { smallSpectrum, spectraPlot } from "./pieces/spectra.js";
import { meterPanel } from "./meter.js";
import { pairOf, sparkline, swatch } from "./rows.js";
import { post, upload } from "./server.js";
import { mark, regions, say, session, severalPhotos, state } from "./session.js";
import { LIGHTS, details, labOf, labWords, one } from "./words.js";

const FAMILIES = ["paint", "textile", "leaves", "skin", "white", "earth", "animal"], SURFACES = ["matt", "satin", "glossy"];
const options = (values) => [["", "not stated"], ...values.map((value) => [value, value])];
export const chosen = { selected: "", picks: [] };      // picks: at most two, {name} or {role, x0, y0, x1, y1, at}
let on = { fix() {}, select() {}, picked() {}, rename() {}, remove() {} }, pointed = null, pointing = false;
export const follow = (handlers) => { on = handlers; };

// ---- the colour under the pointer, or of the selected mark
export function showPointed(answer) { pointed = answer; pointing = true; showLooked(); }
export function leave() { if (pointing && chosen.selected) { pointing = false; showLooked(); } }
export function showLooked() {
  const named = session.spectra[chosen.selected], mine = !pointing && named;
  const answer = mine ? named : pointed, name = mine ? chosen.selected : "under the pointer";
  $("looked-at").hidden = !session.state?.live;
  $("looked-empty").hidden = Boolean(answer);
  $("looked-empty").textContent = session.state?.live?.ready ? matchMedia("(pointer: coarse)").matches ? "Tap a colour of the photo: its spectrum stands here." : "Point at the photo: the spectrum of what is under the pointer stands here." : "The spectrum under the pointer stands here once camera and light are calibrated.";
  $("looked-plot").hidden = !answer?.mean; $("looked-at").classList.toggle("filled", Boolean(answer?.mean));
  if (!answer) { $("looked-head").replaceChildren(); $("looked-words").replaceChildren(); return; }
  if (answer.refused) { $("looked-head").replaceChildren(make("p", { className: "bad", text: answer.refused })); $("looked-words").replaceChildren(); return; }
  $("looked-head").replaceChildren(swatch(answer.hex), make("div", {}, make("strong", { text: name }), make("p", { className: "lab", text: labWords(answer) })));
  $("looked-words").replaceChildren(...details(answer).flatMap(([about, text]) => [make("dt", { text: about }), make("dd", { text })]));
  $("looked-plot").replaceChildren(smallSpectrum(`Reflectance of ${name} over wavelength, with its 95 % band`, answer));
  document.body.dataset.looked = answer.hex;
}

// ---- all marked colours
let waiting = null, plotted = [], plot = null;
export function showSpectra(name) {
  if (name !== undefined) showRow(name);
  waiting ??= requestAnimationFrame(() => { waiting = null; showPlot(); showLooked(); });
}
// Drawn anew only where a spectrum has changed.
function showPlot() {
  const shown = Object.keys(regions()).filter((name) => session.spectra[name]?.mean), answers = shown.map((name) => session.spectra[name]);
  $("all").hidden = !shown.length;
  if (answers.length !== plotted.length || answers.some((answer, i) => answer !== plotted[i])) {
    plotted = answers;
    plot = shown.length ? spectraPlot(`Reflectances of ${shown.length} marked colours over wavelength`, shown.map((name, i) => ({ name, ...answers[i] })), { width: 400, height: 260,
      onShow: (_, words) => { $("all-words").textContent = words || "\u00a0"; }, onChoose: (index) => on.select(shown[index]) }) : null;
    $("all-plot").replaceChildren(...(plot ? [plot.svg] : []));
  }
  plot?.choose(shown.flatMap((name, i) => name === chosen.selected || chosen.picks.some((each) => each.name === name) ? [i] : []));
}

// Rows are made anew only where names have changed: what is being typed is left alone.
export function showMarks() {
  const names = Object.keys(regions()), others = otherMarks();
  $("marks-title").textContent = names.length ? `Marked colours (${names.length})` : "Marked colours";
  $("marks-about").hidden = !names.length || !session.state.live;
  $("marks-empty").hidden = names.length > 0 || others.length > 0;
  if (session.state.facts.scene) $("marks-empty").textContent = "In a scene, materials are measured instead of marked regions: their spectra and colours are in the report.";
  const listed = JSON.stringify([names, others, Boolean(session.state.live), severalPhotos()]);
  if (listed !== $("marks").dataset.listed) {
    $("marks").dataset.listed = listed;
    $("marks").replaceChildren(...names.map(row), ...others.map(otherRow));
    showSpectra();
  }
  for (const name of names) showRow(name);
}
function otherMarks() {
  const { chart_corners: chart, box_corners: box } = session.state.marks, others = [];
  if (chart) others.push({ name: "chart corners", drop: { kind: "chart corners" } });
  if (box) others.push({ name: `${Object.keys(box).length} box corners` });
  return others;
}
const otherRow = ({ name, drop }) => make("li", {}, make("div", { className: "mark" }, make("span", { className: "fill", text: name }),
  drop ? button("Remove", () => mark({ ...drop, points: [] })) : null));

const rowOf = (name) => document.querySelector(`#marks li[data-name="${CSS.escape(name)}"]`);
function row(name) {
  const input = make("input", { value: name, "aria-label": `Name of ${name}`, data: { name }, on: {
    change: () => on.rename(name, input.value.trim(), input), focus: () => on.select(name),
    mousedown: (event) => {     // a first press takes the whole name, whatever moves under it then
      if (document.activeElement === input) return;
      event.preventDefault(); input.focus({ preventScroll: true }); input.select();
    },
    keydown: (event) => { if (event.key === "Enter") $("canvas").focus({ preventScroll: true }); } } });
  const tick = make("input", { type: "checkbox", title: "Compare", "aria-label": `Compare ${name}`, on: { change: () => pick({ name }) } });
  const head = make("div", { className: "mark" }, make("span", { className: "sw" }), input, make("span", { className: "lab" }), make("span", { className: "sp" }), ...(session.state.live ? [tick] : []));
  const one = make("li", { data: { name } }, head);
  head.addEventListener("click", (event) => {
    if (event.target === tick) return;
    if (event.shiftKey || event.ctrlKey || event.metaKey || on.comparing()) pick({ name });
    else if (event.target !== input) on.select(chosen.selected === name ? "" : name);
  });
  return one;
}
// What has changed of a row, and of the selected one what is stated.
function showRow(name) {
  const one = rowOf(name), answer = session.spectra[name]; if (!one) return;
  const head = one.firstChild, [sw, , lab, sp] = head.children, selected = chosen.selected === name;
  if (one.shown !== answer) {
    one.shown = answer;
    sw.replaceChildren(...(answer?.hex ? [swatch(answer.hex)] : []));
    lab.textContent = answer?.lab ? labOf(answer) : answer?.refused ? "no spectrum" : "…"; lab.classList.toggle("bad", Boolean(answer?.refused || answer?.doubt || answer?.larger_part)); lab.title = answer?.refused ?? answer?.doubt ?? "";
    sp.replaceChildren(...(answer?.mean ? [sparkline(answer)] : []));
  }
  const tick = head.querySelector("[type=checkbox]"); if (tick) tick.checked = chosen.picks.some((each) => each.name === name);
  one.classList.toggle("selected", selected);
  const stated = selected ? JSON.stringify([regions()[name], session.state.live && !answer?.mean ? answer?.refused : "", answer?.doubt, answer?.notes, answer?.larger_part]) : "";
  if (one.dataset.stated !== stated && !one.querySelector(".statements :focus")) {
    one.dataset.stated = stated;
    one.children[1]?.remove();          // the row itself stays: its name may have the focus
    if (selected) one.append(statedOf(name));
    if (selected) one.scrollIntoView({ block: "nearest" });
  }
}

// What the operator knows of a mark, and what can be done with it.
function statedOf(name) {
  const { stated, photo, rect, outline } = regions()[name], box = make("div", { className: "statements" });
  const answer = session.spectra[name];
  if (answer?.refused) box.append(make("p", { className: "bad", text: answer.refused }));
  if (answer?.doubt) box.append(make("p", { className: "bad", text: `Not used: ${answer.doubt}` }));
  for (const note of answer?.notes ?? []) box.append(make("p", { className: "bad", text: note }));
  if (answer?.larger_part) box.append(make("div", { className: "buttons" }, button("Fix this region", (event) => { event.currentTarget.blur(); on.fix(name, answer.larger_part); }, { "aria-label": `Fix ${name}`, title: "Keep its larger part, on one side of the edge" })));
  if (session.state.live) {
    const known = make("input", { inputMode: "decimal", size: 8, placeholder: stated.known ?? "0.9", data: { key: "known" },
      on: { change: () => state(name, { known: known.value.trim() }) } });
    box.append(labelled("Kind of surface", choice(options(FAMILIES), stated.family ?? "", (family) => state(name, { family }))),
      labelled("Finish", choice(options(SURFACES), stated.surface ?? "", (surface) => state(name, { surface }))),
      labelled("Known reflectance", known), labelled("… from a file", fileOf(name, "known")),
      labelled("Measured, to compare with", fileOf(name, "truth")),
      make("div", { className: "buttons" }, button("Measure this colour now", (event) => meterPanel(event.currentTarget, name), { "aria-label": `Measure ${name} now` })));
    if (stated.known) box.append(make("p", { className: "soft" }, `known: ${stated.known} `, button("Not known", () => state(name, { known: "" }))));
    if (stated.truth) box.append(make("p", { className: "soft", text: `compared with ${stated.truth}` }));
    if (severalPhotos() && !session.role.startsWith("shot:")) box.append(labelled("In", choice([["", "all photos"], [session.role, "this photo alone"]], typeof photo === "string" && photo ? session.role : "",
      (alone) => mark({ kind: "region", name, points: rect ? [outline[0], outline[2]] : outline, photo: alone }))));
  }
  box.append(make("div", { className: "buttons" }, button("Remove", () => on.remove(name), { "aria-label": `Remove ${name}` })));
  return box;
}
function fileOf(name, key) {
  const file = make("input", { type: "file", data: { key: `${key} file` }, on: { change: async () => {
    try { if (await state(name, { [key]: await upload(file.files[0]) })) say("written"); } catch (error) { say(error.message); } } } });
  return file;
}

// ---- two colours beside each other
export async function pick(one) {
  const again = one.name !== undefined && chosen.picks.some(({ name }) => name === one.name);
  chosen.picks = again ? chosen.picks.filter(({ name }) => name !== one.name) : [...chosen.picks, one].slice(-2);
  showPicks();
  if (chosen.picks.length < 2) return;
  const asked = chosen.picks;
  try {
    const answer = await post("/api/compare", { picked: asked });
    if (chosen.picks === asked) showComparison(answer);
  } catch (error) { if (chosen.picks === asked) refuse(error.message); }
}
export function clearPicks() { chosen.picks = []; showPicks(); }
function showPicks() {
  for (const name of Object.keys(regions())) showRow(name);
  showSpectra();
  $("compare").hidden = chosen.picks.length === 0 && !on.comparing();
  if (chosen.picks.length < 2) {
    $("comparison").replaceChildren(make("p", { className: "soft", text: chosen.picks.length ? "Choose the second colour, in the list or on the photo." : "Choose two colours, in the list or on the photo." }));
  }
  on.picked();
}
export const showCompare = showPicks;
const refuse = (text) => { $("comparison").replaceChildren(make("p", { className: "bad", text })); };
// Both swatches touch, as the eye compares best.
function showComparison({ names, lights, spectra, says, distinct, refused }) {
  if (refused) { refuse(refused); return; }
  const colours = lights.find(({ light }) => light === "D65").hex;
  const table = make("table"), head = table.createTHead().insertRow(), body = table.createTBody();
  for (const text of ["Light", `${names[0]} | ${names[1]}`, "\u0394E00 (95 %)"]) head.append(make("th", { scope: "col", text }));
  for (const { light, hex, delta_e00: delta, lower, upper } of lights)
    body.append(make("tr", {}, make("th", { scope: "row", text: LIGHTS[light] ?? light }), make("td", {}, pairOf(hex)), make("td", { text: `${one(delta)} (${one(lower)} to ${one(upper)})` })));
  $("comparison").replaceChildren(smallSpectrum(`Reflectances of ${names[0]} and ${names[1]} over wavelength`, { ...spectra[0], hex: colours[0] }, [{ ...spectra[1], hex: colours[1] }]),
    make("p", { className: distinct ? "" : "bad", text: says }), table);
}
