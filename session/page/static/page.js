// The light table: the photo with its tools, from what the server says of the session.
import { $, button, closePanel, make } from "./dom.js";
import { showAdvice } from "./advice.js";
import * as inspector from "./inspector.js";
import * as panels from "./panels.js";
import { PhotoView } from "./photo.js";
import { ask, base, get, upload } from "./server.js";
import { follow, freeName, mark, refresh, regions, say, send, session, severalPhotos, state } from "./session.js";
import { problemsOf, settled, stateWords, upToDate, verdictOf } from "./words.js";

const HINTS = {
  look: "Point at a colour. Drag to move, wheel to zoom.",
  scene: "Point at a pixel to read its signals. Drag to move, wheel to zoom.",
  region: "Drag a rectangle over one colour.",
  polygon: "Click the corners of one colour, three or more, then Save.",
  compare: "Click two colours, marked or not, here or in the list.",
  white: "Drag a rectangle over a white or grey card of known reflectance.",
  chart: "Drag the four corners onto the chart: first patch, end of the first row, last patch, start of the last row (of a ColorChecker dark skin, bluish green, black, white).",
  box: "Choose a corner's name and click it, six corners or more; then Save. Delete the line fov_deg in session.toml unless you measured it.",
};
const TOUCH_HINTS = { scene: "Drag to move, two fingers to zoom.", look: "Tap a colour to see its spectrum. Hold a finger on it to mark it.", region: "Drag a finger over one colour." };
const TOOL_KEYS = { p: "look", r: "region", g: "polygon", c: "compare", w: "white", k: "chart", b: "box" };
const KEYS = [["P", "point"], ["R", "region"], ["G", "polygon"], ["C", "compare"], ["W", "white card"], ["K", "chart"], ["F", "whole photo"], ["O", "the photo as the camera saw it"], ["I", "fold the inspector"], ["+ −", "zoom"],
  ["Space", "move the photo while it is held"], ["Arrows", "move the photo, or the selected mark; with Shift by ten"], ["Enter", "set a point in the middle"], ["Delete", "remove the selected mark"], ["Ctrl Z", "undo"], ["Esc", "let go"]];
const POINTER_PX = 12, MIN_SIDE = 12;       // of the square under the pointer: on the screen, and at least of the photo
const DRAWS = ["region", "white"];
const CORNERS = ["1", "2", "3", "4"];       // of the chart, in the order of its layout
const finger = matchMedia("(pointer: coarse)"), narrow = matchMedia("(max-width: 60rem)");
let mode = "look", named = [], chosenMode = false, begun = false, saving = false, reportStamp = null, quad = null;

const view = new PhotoView($("canvas"), { point, pointer, leave: inspector.leave, draw: pointAt, rect: addRect, edit: moved, select });

async function open(role) {
  session.role = role; clearPoints(); inspector.clearPicks();
  try {
    about = await get(`/api/size?${new URLSearchParams({ role })}`);
    if (session.role !== role) return;
    const look = wantedLook();
    await view.show(about, tilesOf(role, look));
    document.body.dataset.photo = role; showLook(look);
  } catch (error) { say(error.message); }
  show();
}

// ---- the colours that the photo is shown in: of the calibration, before it of the camera, or as the bands read
const LOOKS = { raw: "as the camera saw it", camera: "preview in the camera\u2019s own colours", calibrated: "calibrated colours (sRGB, daylight)", relative: "calibrated colours (sRGB, daylight), as bright as the photo allows" };
let about = null, raw = false, recolouring = false;
const tilesOf = (role, look) => (halvings, column, row) => `${base}/api/tile?${new URLSearchParams({ role, halvings, column, row, look })}`;
function wantedLook() {
  if (raw) return "raw";
  return session.state.photos.find(({ role }) => role === session.role)?.look || (about?.camera ? "camera" : "raw");
}
function showLook(look) {
  document.body.dataset.look = look; $("shown").textContent = LOOKS[look.split("-")[0]];
  $("raw").setAttribute("aria-pressed", String(raw)); $("raw").disabled = !raw && look === "raw";
}
async function followLook() {
  const { role } = session, look = wantedLook();
  if (recolouring || document.body.dataset.photo !== role || document.body.dataset.look === look) return;
  recolouring = true;
  try { await view.recolour(tilesOf(role, look)); if (session.role === role) showLook(look); } catch (error) { say(error.message); }
  recolouring = false;
}
function switchRaw() { raw = !raw; followLook(); }

// ---- the spectrum under the pointer: one question at a time, the latest position next
let next = null, asking = false, soon = null;
function pointAt(rect) {
  next = rect;
  if (!asking && session.state?.live?.ready) askSpectra();
}
async function askSpectra() {
  asking = true;
  while (next) {
    const [[x0, y0], [x1, y1]] = next; next = null;
    try { inspector.showPointed(await get(`/api/spectrum?${new URLSearchParams({ role: session.role, x0, y0, x1, y1 })}`)); } catch { /* a later question will be answered */ }
  }
  asking = false;
}
function pointer(at) {
  if (!session.role || !view.holds(at)) return;
  if (session.state?.live) pointAt(squareAt(at));
  if (session.state?.live?.ready) return;
  clearTimeout(soon);         // without spectra the signals of the pixel
  soon = setTimeout(async () => {
    try {
      const [x, y] = at, { signal, saturated } = await get(`/api/value?${new URLSearchParams({ role: session.role, x, y })}`);
      $("values").hidden = false;
      $("values").textContent = `Signal at (${x.toFixed(0)}, ${y.toFixed(0)}): ` + signal.map((value, band) => `${(100 * value).toFixed(1)} %${saturated[band] ? " clipped" : ""}`).join("  ");
    } catch { /* the pointer has gone on */ }
  }, 60);
}
const squareAt = (at) => view.squareAt(at, Math.max(POINTER_PX / 2, MIN_SIDE / 2 * view.scale));

// ---- marking
const ownPhoto = () => severalPhotos() && !session.state.live && !session.role.startsWith("shot:") ? session.role : "";
async function addRect(rect, byFinger) {
  if (session.state.facts.scene) return;
  const card = mode === "white", name = freeName(card ? "white card" : "sample");
  if (!await mark({ kind: "region", name, points: rect, photo: ownPhoto() })) { offerUnclipped(rect, byFinger); return; }
  say(`${name} is marked`); view.select(name);
  if (card) { panels.cardPanel($("tools").querySelector("[data-mode=white]"), name); return; }
  const input = document.querySelector(`#marks input[data-name="${CSS.escape(name)}"]`);
  if (!byFinger && !finger.matches) { input?.select(); input?.focus({ preventScroll: true }); }
}
// What is refused since a part of it is clipped can be marked without that part.
async function offerUnclipped([[x0, y0], [x1, y1]], byFinger) {
  const { rect } = await get(`/api/unclipped?${new URLSearchParams({ role: session.role, x0, y0, x1, y1 })}`);
  if (!rect || rect.every((at, i) => Math.abs(at - [Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)][i]) < 2 * view.step)) return;
  $("said").append(" ", button("Mark the part that is not clipped", () => { $("said").hidden = true; addRect([rect.slice(0, 2), rect.slice(2)], byFinger); }, { id: "fix-clipped" }));
}
function moved(name, outline) {
  if (name === "chart" && quad) { quad = outline; showOutlines(); return; }
  const region = regions()[name], { photo, rect } = region;
  region.outline = outline; showOutlines();      // where it was put, while the change is on its way
  mark({ kind: "region", name, points: rect ? [outline[0], outline[2]] : outline, photo: photo ?? "" });
}
async function remove(name) { if (await mark({ kind: "region", name, points: [] })) say(`${name} is removed; Undo brings it back`); }
async function rename(name, to, input) {
  if (to && to !== name && await mark({ kind: "rename", name, names: [to] })) { view.select(to); say(`${name} is ${to} now`); }
  else input.value = name;
}
async function undo() { if (session.state?.undo && await send("/api/undo")) say("undone"); }
function select(name) { inspector.chosen.selected = name in regions() ? name : ""; inspector.leave(); inspector.showMarks(); inspector.showSpectra(); advise(); }
const advise = () => showAdvice(inspector.chosen.selected, { choose, addPhoto: panels.photoPanel });

async function point(at, byKey = false) {
  if (!session.role || !view.holds(at)) return;
  if (mode === "compare") { if (session.state.live?.ready) await pickAt(at); return; }
  if (mode === "look" && byKey) pointer(at);
  if (mode === "look" || (DRAWS.includes(mode) && !view.points.length && !byKey)) { view.select(view.outlineAt(at)); return; }
  if (mode === "box") named = [...named.filter(([name]) => name !== $("corner").value), [$("corner").value, at]];
  view.points = mode === "box" ? named.map(([, position]) => position) : [...view.points, at];
  if (mode === "box") nextCorner();
  if (DRAWS.includes(mode) && view.points.length === 2) { const rect = view.points; clearPoints(); await addRect(rect); }
  else if (mode === "chart" && view.points.length === 4) await save();
  view.draw(); show();
}
function pickAt(at) {
  const name = view.outlineAt(at), [[x0, y0], [x1, y1]] = squareAt(at);
  return inspector.pick(name ? { name } : { role: session.role, x0, y0, x1, y1, at });
}
function nextCorner() {
  const left = [...$("corner").options].map((one) => one.value).filter((name) => !named.some(([taken]) => taken === name));
  if (left.length) $("corner").value = left[0];
}
async function save() {
  const points = view.points.length ? view.points.map(([x, y]) => [x, y]) : quad;
  const marked = {
    polygon: { kind: "region", name: freeName("sample"), points, photo: ownPhoto() },
    chart: { kind: "chart corners", points },
    box: { kind: "box corners", points: named.map(([, at]) => at), names: named.map(([name]) => name) },
  }[mode];
  if (await mark(marked)) { say("marked"); if (mode === "chart") { choose("look"); return; } if (mode === "polygon") view.select(marked.name); }
  clearPoints(); show();
}
function clearPoints() { named = []; view.points = []; view.draw(); }

function choose(nextMode) {
  mode = nextMode; chosenMode = true; clearPoints(); view.select(""); inspector.clearPicks();
  view.draws = DRAWS.includes(mode); $("canvas").dataset.over = view.draws ? "draw" : "photo";
  for (const one of document.querySelectorAll("[data-mode]")) one.setAttribute("aria-pressed", String(one.dataset.mode === mode));
  quad = mode === "chart" ? session.state?.marks.chart_corners ?? quarterOf(view.size) : null;
  showOutlines(); if (quad) view.select("chart");
  show();
}
// Where the chart's corners begin to be dragged.
const quarterOf = (size) => size && [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]].map(([x, y]) => [x * size[0], y * size[1]]);

// ---- what the server says
function update() {
  const now = session.state, { live } = now;
  $("name").textContent = now.name; document.title = `${now.name} - spectrabox`;
  document.body.dataset.ready = String(Boolean(live?.ready)); document.body.dataset.result = String(Boolean(live?.result_now));
  if (!session.role) { const first = now.photos.find(({ there }) => there); if (first) open(first.role); }
  if (live && !begun) { begun = true; if (!chosenMode) { choose(finger.matches ? "look" : "region"); chosenMode = false; } }
  if (live?.error && !chosenMode && view.size && !Object.keys(live.charts).length && /chart/i.test(live.error)) choose("chart");
  show(); followLook();
  if (now.report !== reportStamp && !now.run.running) {
    reportStamp = now.report;
    if (now.report !== null) loadReport(now.report);
  }
  if (saving && !now.run.running && !now.run.waiting) { saving = false; if (now.run.verdict) showReport(true); }
}
// A report may be a stranger's: its frame has an origin of its own, and no address with the token.
async function loadReport(stamp) {
  try {
    const html = await (await ask("/report")).text(), frame = $("report-frame");
    frame.addEventListener("load", () => frame.contentWindow.postMessage(html, "*"), { once: true });
    frame.src = `/static/report.html?${new URLSearchParams({ at: stamp })}`;
  } catch (error) { say(error.message); }
}
function show() {
  const now = session.state; if (!now) return;
  const { run, live, photos } = now, verdict = verdictOf(now), listed = JSON.stringify([photos, now.facts.views, session.role]);
  if ($("photos").dataset.listed !== listed) { $("photos").dataset.listed = listed; $("photos").replaceChildren(...photos.map(photoItem)); }
  $("add-photo").hidden = !live || !session.role;
  const charts = Object.values(live?.charts ?? {}), bad = charts.some((one) => one.verdict !== "GOOD"), judging = !settled(now) && live.ready && Object.keys(regions()).length > 0,
    word = verdict ? verdict.status.toUpperCase() : judging ? "Verdict …" : charts.length ? `Chart ${bad ? "RE-SHOOT" : "GOOD"}` : "";
  $("verdict").hidden = !word; $("verdict").className = verdict ? verdict.status : judging ? "judging" : bad ? "fail" : "pass";
  $("verdict").replaceChildren(make("strong", { text: word }), make("span", { text: verdict ? (verdict.status === "pass" && verdict.condition ? ` if ${verdict.condition}` : ` ${verdict.says}`) : bad && !judging ? ` ${charts.find((one) => one.reasons.length)?.reasons[0] ?? ""}` : "" }));
  const problems = problemsOf(now); $("progress").textContent = stateWords(now); $("progress").title = problems.join("\n"); $("progress").className = problems.length ? "bad" : upToDate(now) ? "good" : "";
  $("undo").disabled = !now.undo; $("stop").hidden = !run.running || Boolean(run.until && !run.waiting);
  $("run").disabled = $("report").hidden && ((run.running && !run.until) || run.waiting || now.problems.length > 0 || (live && !Object.keys(now.marks.regions).length));
  for (const [tool, hidden] of [["region", now.facts.scene], ["polygon", now.facts.scene], ["compare", !live], ["white", !live], ["box", !now.corner_names.length]])
    document.querySelector(`[data-mode="${tool}"]`).hidden = hidden;
  $("corner-label").hidden = mode !== "box";
  $("save").hidden = !(mode === "box" && named.length >= 6) && !(mode === "polygon" && view.points.length > 2) && !(mode === "chart" && quad && !view.points.length);
  $("save").textContent = mode === "chart" ? "Use these corners" : "Save"; $("clear").hidden = !view.points.length;
  $("points").hidden = ["corner-label", "save", "clear"].every((id) => $(id).hidden);
  if ($("corner").options.length !== now.corner_names.length) $("corner").replaceChildren(...now.corner_names.map((value) => make("option", { text: value, value })));
  showMissing(); showHint(problems); showOutlines(); inspector.showMarks(); inspector.showLooked(); advise(); panels.showChips({ choose }); panels.showAsk({ choose }); panels.followState(); showShooting();
}
// One line on the photo: what the tool does, while nothing is marked with it; a problem before that.
function showHint(problems) {
  const { live } = session.state, first = problems[0] && (mode === "chart" && !live?.ready ? `${problems[0].split("\n")[0]} ${HINTS.chart}` : problems[0].split("\n")[0]);
  const busy = ["look", "region"].includes(mode) && Object.keys(regions()).length > 0;
  const about = mode === "look" && session.state.facts.scene ? "scene" : mode, text = first ?? (busy ? "" : (finger.matches && TOUCH_HINTS[about]) || HINTS[about]);
  if ($("hint").textContent !== text) $("hint").textContent = text;
  $("hint").hidden = !text || (!view.size && !problems.length) || !$("drop").hidden; $("hint").className = first ? "problem" : "";
}
function showMissing() {
  const missing = session.state.photos.filter(({ there }) => !there);
  $("drop").hidden = Boolean(session.role) || !missing.length;
  $("wanted").textContent = missing.length ? `Drop ${missing[0].file.replace(/^.*\//, "")} here: the photo that this session waits for (${missing[0].file}).` : "";
}
// A photo under the name that the session gives it.
async function giveMissing(file) {
  const wanted = session.state.photos.find(({ there }) => !there)?.file ?? "", end = (name) => name.replace(/^.*\./, ".").toLowerCase();
  if (!/^photos\/[^/]+$/.test(wanted) || end(file.name) !== end(wanted)) { say(`the session waits for ${wanted}; copy the photo there, or name another in session.toml`); return; }
  try { say(`copying ${file.name} …`); await upload(file, "/api/file", wanted.slice(7)); say("copied"); await refresh(); } catch (error) { say(error.message); }
}
function photoItem({ role, file, there }) {
  const shown = there ? button(role, () => open(role), { title: file, ...(role === session.role ? { "aria-current": "true" } : {}) }) : make("span", { className: "bad", text: `${role} is missing`, title: file });
  const drop = session.state.facts.views.includes(role) ? button("×", () => mark({ kind: "view", name: role }), { "aria-label": `Remove the photo ${role}` }) : null;
  return make("li", {}, shown, drop);
}
function showOutlines() {
  const { marks, photos, live } = session.state ?? {}, { role } = session; if (!marks) return;
  const { chart_corners: chart, box_corners: box } = marks, ofChart = role.endsWith("chart");
  const onChart = photos.some((one) => one.role === "chart") ? ofChart : true;
  view.patches = mode === "chart" ? [] : live?.charts[role]?.patches ?? [];
  view.outlines = [
    ...Object.entries(marks.regions).filter(([, { photo }]) => !ofChart && (!photo || photo === role || photo.includes?.(role)))
      .map(([name, { outline, rect }]) => ({ name, outline, rect, edits: mode !== "chart" && outline.length > 2, selects: outline.length > 2 })),
    ...(quad ? [{ name: "chart", outline: quad, edits: !view.points.length, labels: CORNERS }] : chart && onChart ? [{ name: "chart", outline: chart }] : []),
    ...(box && !ofChart ? Object.entries(box).map(([name, at]) => ({ name, outline: [at] })) : []),
  ];
  view.picks = inspector.chosen.picks.flatMap(({ role: of, at, name }, i) => name || of !== role ? [] : [{ at, label: `point ${i + 1}` }]);
  view.draw();
}
function showShooting() {
  const { shooting, photos } = session.state;
  $("shooting").hidden = !shooting; if (!shooting) return;
  $("watched").textContent = `in ${shooting.folder}` + (shooting.arriving.length ? `, arriving: ${shooting.arriving.join(", ")}` : "");
  $("shots").replaceChildren(...shooting.shots.map((shot) => make("li", {}, make("strong", { className: shot.verdict, text: shot.verdict }), " ",
    button(shot.file, () => open(`shot:${shot.file}`), session.role === `shot:${shot.file}` ? { "aria-current": "true" } : {}),
    ` ${shot.chart ? "chart found. " : ""}${shot.reasons.join(" ")} (${Math.abs(shot.stops).toFixed(1)} stops ${shot.stops > 0 ? "longer" : "shorter"} would be best)`)));
  const missing = photos.filter(({ there }) => !there).map(({ role, file }) => `${role} (${file})`);
  $("missing").textContent = missing.length ? `Still missing: ${missing.join(", ")}` : "Nothing is missing.";
}

// ---- the report lies over the photo
function showReport(shown) {
  $("report").hidden = !shown; document.querySelector("main").inert = shown;
  $("run").textContent = shown ? "Back to the photo" : "Report"; closePanel(); show();
}
function report() {
  if (!$("report").hidden) showReport(false);
  else if (upToDate(session.state)) showReport(true);
  else { saving = true; send("/api/run"); }
}
function fold(shut = $("fold").getAttribute("aria-expanded") === "true") {
  for (const id of ["fold", "handle"]) $(id).setAttribute("aria-expanded", String(!shut));
  document.body.classList.toggle("folded", shut);
}

document.addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select, textarea")) return;
  const key = event.key.toLowerCase(), plain = !event.ctrlKey && !event.metaKey && !event.altKey;
  const tool = TOOL_KEYS[key];
  if ((event.ctrlKey || event.metaKey) && key === "z") { event.preventDefault(); undo(); }
  else if (key === "escape" && !$("report").hidden) showReport(false);
  else if ((event.key === "Delete" || event.key === "Backspace") && view.selected in regions()) { event.preventDefault(); remove(view.selected); }
  else if (plain && tool && !document.querySelector(`[data-mode="${tool}"]`).hidden) choose(tool);
  else if (plain && key === "f") view.whole();
  else if (plain && key === "o") switchRaw();
  else if (plain && key === "i") fold();
  else if (event.key === "?") panels.keysPanel($("keys"), KEYS);
});
for (const one of document.querySelectorAll("[data-mode]")) one.addEventListener("click", () => choose(one.dataset.mode));
for (const [id, does] of [["run", report], ["stop", panels.stop], ["undo", undo], ["save", save], ["clear", () => { clearPoints(); show(); }], ["fit", () => view.whole()], ["raw", switchRaw], ["closer", () => view.zoom(1.5)], ["farther", () => view.zoom(1 / 1.5)],
  ["name", () => { if (session.state?.live) panels.namePanel($("name")); }], ["verdict", () => panels.verdictPanel($("verdict"))], ["progress", () => panels.statePanel($("progress"))], ["export", () => panels.exportPanel($("export"))], ["keys", () => panels.keysPanel($("keys"), KEYS)],
  ["add-photo", () => panels.photoPanel($("add-photo"))], ["fold", () => fold()], ["handle", () => fold()], ["no-compare", () => { inspector.clearPicks(); if (mode === "compare") choose(finger.matches ? "look" : "region"); }]]) $(id).addEventListener("click", does);
$("advice").addEventListener("toggle", advise);
$("wanted-file").addEventListener("change", () => giveMissing($("wanted-file").files[0]));
for (const kind of ["dragover", "drop"]) document.addEventListener(kind, (event) => {
  event.preventDefault();
  if (kind !== "drop" || !event.dataTransfer.files.length) return;
  if (!session.role) giveMissing(event.dataTransfer.files[0]); else if (session.state.live) panels.photoPanel($("add-photo"), "lamp", event.dataTransfer.files);
});

let quiet = null;
follow({ update, spectra: inspector.showSpectra, say(text) {
  $("said").textContent = text; $("said").hidden = !text; clearTimeout(quiet);
  quiet = setTimeout(() => { $("said").hidden = true; }, Math.max(4000, 60 * text.length));
} });
inspector.follow({ fix: (name, [x0, y0, x1, y1]) => mark({ kind: "region", name, points: [[x0, y0], [x1, y1]], photo: regions()[name].photo ?? "" }), select: (name) => view.select(name), picked: showOutlines, rename, remove, comparing: () => mode === "compare" });
fold(narrow.matches);
// often until spectra can be shown
for (;;) { await refresh(); await new Promise((go) => setTimeout(go, session.state?.live && !session.state.live.result_now ? 250 : 1000)); }
