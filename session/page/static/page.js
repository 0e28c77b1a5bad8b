// What the page shows, from what the server says of the session; the server keeps all that lasts.
import { PhotoView } from "./photo.js";
import { comparison, details, labWords, plot, swatch } from "./spectrum.js";

const base = location.pathname.replace(/\/(page)?$/, "");     // of this session, where one server has several
const token = handedToken();
const $ = (id) => document.getElementById(id);
const HINTS = {
  look: "Wheel or two fingers zoom, dragging moves. Arrow keys, + and - do the same.",
  region: "Drag a rectangle over one colour; its spectrum is shown at once. Click a region to move or size it. Space or the middle button moves the photo.",
  compare: "Click two colours, marked or not, here or in the list: they are shown side by side under five lights.",
  chart: "Click the four corners in the order of the chart; on a ColorChecker: dark skin, bluish green, black, white.",
  box: "Choose a corner's name and click it, six corners or more; then Save. Delete the line fov_deg in session.toml unless you measured it.",
  reference: "Click the four corners of a grey card that is in both photos.",
};
const FAMILIES = ["paint", "textile", "leaves", "skin", "white", "earth", "animal"], SURFACES = ["matt", "satin", "glossy"];
const POINTER_PX = 12;          // side of the square under the pointer on the screen
const MIN_SIDE = 12;            // and its least, in pixels of the photo
const STAGE_WORDS = { chart: "finding the chart", photo: "reading the photo", calibrate: "calibrating camera and light" };
const STAGES = { chart: "Find the chart", photo: "Measure the photo", calibrate: "Calibrate camera and light", reconstruct: "Fit the scene",
  signals: "Signals of the colours", sample: "Spectra", picture: "Picture of spectra" };
const STATE_WORDS = { missing: "not run yet", stale: "to run again" };
let state = null, role = "", mode = "look", named = [], asking = false, reportStamp = null, size = [1, 1];
let picks = [];                 // at most two: {name}, or {role, x0, y0, x1, y1, at}
let spectra = {}, spectraOf = "", saving = false, chosenMode = false;

// The token leaves the address bar; this tab keeps it, so that the page can be loaded again.
function handedToken() {
  const given = new URLSearchParams(location.search).get("token");
  if (given === null) return sessionStorage.getItem("token") ?? "";
  sessionStorage.setItem("token", given); history.replaceState(null, "", `${base}/page`);
  return given;
}

async function ask(path, options = {}) {
  const answer = await fetch(base + path, { ...options, headers: { Authorization: `Bearer ${token}`, ...(options.headers ?? {}) } });
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).error ?? `${answer.status}`);
  return answer;
}
const get = async (path) => (await ask(path)).json();
// One change after the other: each says which text of the session it has seen.
let sending = Promise.resolve(), changes = 0;
function send(path, body) { return sending = sending.then(() => sendNow(path, body)); }
async function sendNow(path, body) {
  let answer = null;
  changes += 1;                   // odd while one is on its way
  try { answer = await (await ask(path, { method: "POST", body: JSON.stringify({ digest: state.digest, ...body }) })).json(); }
  catch (error) { say(error.message); }
  finally { changes += 1; }       // news that were asked for meanwhile may be older
  if (answer === null) { await refresh(); return false; }
  update(answer);
  return true;
}
const mark = (marked) => send("/api/mark", { mark: marked });
const say = (text) => { $("said").textContent = text; };
const words = (tag, text, cls) => { const node = document.createElement(tag); node.textContent = text; if (cls) node.className = cls; return node; };
const fill = (list, nodes) => $(list).replaceChildren(...nodes);
const item = (...nodes) => { const one = document.createElement("li"); one.append(...nodes); return one; };
function button(text, does, current) {
  const one = words("button", text); one.addEventListener("click", does);
  if (current) one.setAttribute("aria-current", "true");
  return one;
}

const view = new PhotoView($("canvas"), { onPoint: point, onPointer: pointer, onDraw: pointAt, onRect: addRect, onEdit: moveRegion, onSelect: showMarks });

async function open(chosen) {
  role = chosen; clearPoints(); showPicks(); say(`opening ${chosen} …`);
  try {
    const about = `role=${encodeURIComponent(chosen)}`;
    const [pixels, { size: of }] = await Promise.all([ask(`/api/photo?${about}`).then((a) => a.blob()), get(`/api/size?${about}`)]);
    if (role !== chosen) return;
    size = of; view.show(await createImageBitmap(pixels), of); say("");
    document.body.dataset.photo = chosen;
  } catch (error) { say(error.message); }
  show();
}

// ---- the spectrum under the pointer: one question at a time, the latest position next
let next = null, askingSpectrum = false;
function pointAt(rect) {
  next = rect;
  if (!askingSpectrum && state?.live?.ready) askSpectra();
}
async function askSpectra() {
  askingSpectrum = true;
  while (next) {
    const [[x0, y0], [x1, y1]] = next, about = new URLSearchParams({ role, x0, y0, x1, y1 }); next = null;
    try { showPointed(await get(`/api/spectrum?${about}`)); } catch { /* a later question will be answered */ }
  }
  askingSpectrum = false;
}
function showPointed(answer) {
  $("pointed").hidden = false;
  if (answer.refused) { fill("pointer-spectrum", [words("p", answer.refused, "soft")]); return; }
  fill("pointer-spectrum", described("the colour under the pointer", answer));
  document.body.dataset.pointed = answer.hex;
}
function described(name, answer, whole = true) {
  const head = document.createElement("p"); head.className = "colour";
  head.append(swatch(answer.hex), words("span", labWords(answer)));
  if (!whole) return [head];
  const list = document.createElement("dl");
  for (const [about, text] of details(answer)) list.append(words("dt", about), words("dd", text));
  return [head, plot(`Reflectance of ${name} over wavelength in nm`, answer), list];
}

let waiting = null;
const outside = ([x, y]) => !role || x < -0.5 || y < -0.5 || x > size[0] - 0.5 || y > size[1] - 0.5;
function pointer([x, y]) {
  clearTimeout(waiting);
  if (outside([x, y])) { $("values").textContent = "\u00a0"; return; }
  pointAt(squareAt([x, y]));
  waiting = setTimeout(async () => {
    const about = `role=${encodeURIComponent(role)}`;
    try {
      const [value, part] = await Promise.all([get(`/api/value?${about}&x=${x.toFixed(1)}&y=${y.toFixed(1)}`),
        ask(`/api/part?${about}&left=${(x - 24).toFixed(1)}&top=${(y - 24).toFixed(1)}&side=48`).then((a) => a.blob())]);
      $("values").textContent = `(${x.toFixed(0)}, ${y.toFixed(0)})  ` + value.signal.map((signal, band) =>
        `${(100 * signal).toFixed(1)} %${value.saturated[band] ? " clipped" : ""}`).join("  ");
      const picture = await createImageBitmap(part); const c = $("loupe").getContext("2d");
      c.imageSmoothingEnabled = false; c.drawImage(picture, 0, 0, 192, 192);
      c.strokeStyle = "#00e5ff"; c.strokeRect(88, 88, 16, 16);
    } catch { /* the pointer has gone on */ }
  }, 60);
}

// ---- two colours beside each other
function squareAt([x, y]) {
  const half = Math.max(POINTER_PX * view.perPixel(), MIN_SIDE) / 2;
  return [view.inside([x - half, y - half]), view.inside([x + half, y + half])];
}
async function pick(one) {
  picks = [...picks, one].slice(-2); showPicks();
  if (picks.length < 2) return;
  try {
    const asked = picks, answer = await (await ask("/api/compare", { method: "POST", body: JSON.stringify({ picked: asked }) })).json();
    if (picks === asked) fill("comparison", answer.refused ? [words("p", answer.refused, "bad")] : comparison(answer));
  } catch (error) { fill("comparison", [words("p", error.message, "bad")]); }
}
function pickAt(at) {
  const name = view.outlineAt(at), [[x0, y0], [x1, y1]] = squareAt(at);
  return pick(name ? { name } : { role, x0, y0, x1, y1, at });
}
function showPicks() {
  $("compare").hidden = mode !== "compare";
  if (picks.length < 2) fill("comparison", [words("p", picks.length ? "Click the second colour." : "Click two colours.", "soft")]);
  view.picks = picks.flatMap(({ role: of, at, name }, i) => name ? [] : of === role ? [{ at, label: `point ${i + 1}` }] : []); view.draw();
}

// ---- marking
const severalPhotos = () => state.photos.filter(({ role: one }) => !one.endsWith("chart")).length > 1;
const ownPhoto = () => severalPhotos() && (!state.live || $("alone").checked) && !role.startsWith("shot:") ? role : "";
const freeName = () => $("mark-name").value.trim() || nextName();
function nextName() {
  for (let number = 1; ; number++) if (!(`sample ${number}` in state.marks.regions)) return `sample ${number}`;
}
async function addRect(rect) {
  const name = freeName();
  if (await mark({ kind: "region", name, points: rect, photo: ownPhoto() })) {
    $("mark-name").value = ""; say(`${name} is marked`); view.select(name); showMarks();
    const input = document.querySelector(`#marks input[data-name="${CSS.escape(name)}"]`); input?.select(); input?.focus({ preventScroll: true });
  }
}
function moveRegion(name, outline) {
  const region = state.marks.regions[name], { photo, rect } = region;
  region.outline = outline; showMarks();      // where it was put, while the change is on its way
  return mark({ kind: "region", name, points: rect ? [outline[0], outline[2]] : outline, photo: photo ?? "" });
}
async function removeRegion(name) { if (await mark({ kind: "region", name, points: [] })) say(`${name} is removed; Undo brings it back`); }
async function rename(name, to, input) {
  if (to && to !== name && await mark({ kind: "rename", name, names: [to] })) { view.select(to); say(`${name} is ${to} now`); }
  else input.value = name;
}
async function undo() { if (state?.undo && await send("/api/undo", {})) say("undone"); }

async function point(at) {
  if (mode === "look" || !role || outside(at)) return;
  if (mode === "compare") { if (state.live?.ready) await pickAt(at); return; }
  if (mode === "box") { named = named.filter(([name]) => name !== $("corner").value); named.push([$("corner").value, at]);
    view.points = named.map(([, position]) => position); nextCorner(); view.draw(); show(); return; }
  if (mode === "region" && view.selected && !$("polygon").checked && !view.points.length) return;
  view.points.push(at); view.draw();
  const needed = mode === "region" ? 2 : 4;
  if (mode === "region" && $("polygon").checked) { show(); return; }
  if (mode === "region" && view.points.length === needed) { const rect = view.points; clearPoints(); await addRect(rect); }
  else if (view.points.length === needed) await save();
  show();
}
function nextCorner() {
  const left = [...$("corner").options].map((one) => one.value).filter((name) => !named.some(([taken]) => taken === name));
  if (left.length) $("corner").value = left[0];
}
async function save() {
  const points = view.points.map(([x, y]) => [x, y]);
  const marked = {
    region: { kind: "region", name: mode === "region" ? freeName() : "", points, photo: ownPhoto() },
    chart: { kind: "chart corners", points },
    box: { kind: "box corners", points: named.map(([, at]) => at), names: named.map(([name]) => name) },
    reference: { kind: "reference", name: role === "chart" ? "chart" : "object", points },
  }[mode];
  if (await mark(marked)) { say("marked"); if (mode === "region") $("mark-name").value = ""; }
  clearPoints();
}
function clearPoints() { named = []; view.points = []; view.draw(); }

function choose(nextMode) {
  mode = nextMode; view.select(""); clearPoints(); setDrawing(); picks = []; showPicks();
  for (const one of document.querySelectorAll("[data-mode]")) one.setAttribute("aria-pressed", String(one.dataset.mode === nextMode));
  $("hint").textContent = HINTS[nextMode]; show();
}
function setDrawing() { view.draws = mode === "region" && !$("polygon").checked; $("canvas").dataset.draws = view.draws; }

// ---- what the server says
function update(fresh) {
  state = fresh; $("name").textContent = state.name; document.title = `${state.name} - spectrabox`;
  if (state.live && !chosenMode) { chosenMode = true; choose("region"); }
  document.body.dataset.ready = String(Boolean(state.live?.ready));
  show(); refreshSpectra();
  if (state.report !== reportStamp && !state.run.running) {
    reportStamp = state.report; $("report").hidden = state.report === null;
    if (state.report !== null) $("report-frame").src = `${base}/report?token=${encodeURIComponent(token)}&at=${state.report}`;
  }
  if (saving && !state.run.running && !state.run.waiting) {
    saving = false; if (state.run.verdict) $("report").scrollIntoView();
  }
}

// Spectra of all regions, asked for again where session.toml or the calibration has changed.
async function refreshSpectra() {
  const of = state.live?.ready ? state.digest : "";
  if (of === spectraOf) return;
  spectraOf = of; if (!of) { spectra = {}; showMarks(); return; }
  const fresh = {};
  for (const name of Object.keys(state.marks.regions)) {
    if (spectraOf !== of) return;
    try { fresh[name] = await get(`/api/region?name=${encodeURIComponent(name)}`); }
    catch { spectraOf = ""; return; }         // a session with a fault, or one that has just changed
    spectra = { ...spectra, [name]: fresh[name] }; showMarks();
  }
  spectra = fresh; showMarks();
}

function verdictWords(verdict, says) { return `verdict ${verdict.toUpperCase()}${says ? `: ${says}` : ""}`; }
function progressWords({ run, live, reported }) {
  if (run.running && run.until) return `${STAGE_WORDS[(run.lines.at(-1) ?? "").split(" ")[0]] ?? "starting"} …` + (run.waiting ? " then the report" : "");
  if (run.running) return `running, ${run.seconds.toFixed(0)} s`;
  if (run.stopped) return "stopped: finished stages are kept, Save report goes on from there";
  if (run.verdict) return verdictWords(run.verdict, run.says);
  if (run.exit_code) return run.error ?? `ended with ${run.exit_code}`;
  if (reported) return `last report: ${verdictWords(reported.status, reported.says)}`;
  return live?.ready ? "calibrated: point at a colour, or drag a rectangle over it" : live && !live.error && !state.problems.length ? "reading the photo …" : "";
}

function show() {
  if (!state) return;
  const { run, live } = state, regions = Object.keys(state.marks.regions);
  const listed = JSON.stringify([state.photos, role]);        // a button that has the focus keeps it
  if ($("photos").dataset.listed !== listed) { $("photos").dataset.listed = listed; fill("photos", state.photos.map(photoItem)); }
  showFacts();
  $("undo").disabled = !state.undo; $("stop").disabled = !run.running;
  $("run").disabled = (run.running && !run.until) || run.waiting || state.problems.length > 0 || (live && !regions.length);
  document.querySelector('[data-mode="compare"]').hidden = !live;
  document.querySelector('[data-mode="box"]').hidden = !state.corner_names.length;
  $("name-label").hidden = $("polygon-label").hidden = mode !== "region"; $("corner-label").hidden = mode !== "box";
  $("mark-name").placeholder = nextName();
  $("alone-label").hidden = mode !== "region" || !live || !severalPhotos();
  $("save").hidden = !(mode === "box" && named.length >= 6) && !(mode === "region" && $("polygon").checked && view.points.length > 2);
  $("clear").hidden = !view.points.length;
  if ($("corner").options.length !== state.corner_names.length)
    fill("corner", state.corner_names.map((name) => { const one = words("option", name); one.value = name; return one; }));
  fill("stages", state.stages.map(({ name, state: how, reasons }) => item(words("span", `${STAGES[name] ?? name}: ${STATE_WORDS[how] ?? how}`, how in STATE_WORDS ? "soft" : how), reasons.length ? ` ${reasons.join("; ")}` : "")));
  fill("problems", [...state.problems, ...(live?.error ? [live.error] : [])].map((text) => words("p", text)));
  $("progress").textContent = progressWords(state); $("progress").className = run.running ? "" : (run.verdict ?? state.reported?.status ?? "").toUpperCase();
  const log = run.lines.join("\n"); if ($("log").textContent !== log) { $("log").textContent = log; $("log").scrollTop = $("log").scrollHeight; }
  const exported = state.exports.join("\n"); $("exports").hidden = !exported;
  if ($("exports").dataset.listed !== exported) { $("exports").dataset.listed = exported; fill("export-list", state.exports.map((file) => {
    const link = words("a", file); link.href = `${base}/api/export?file=${encodeURIComponent(file)}&token=${encodeURIComponent(token)}`; link.download = ""; return item(link); })); }
  showChart(); showMarks(); showShooting();
}

function photoItem({ role: one, file, there }) {
  const shown = there ? button(`${one}: ${file}`, () => open(one), one === role) : words("span", `${one}: ${file} is not there yet`, "missing");
  if (!state.facts.views.includes(one)) return item(shown);
  const drop = button("×", () => mark({ kind: "view", name: one })); drop.setAttribute("aria-label", `Remove the photo ${one}`);
  return item(shown, " ", drop);
}

// ---- the session itself: each field is written as soon as it is left
function showFacts() {
  $("facts").hidden = !state.live; if (!state.live) return;
  for (const [id, value] of [["session-name", state.name], ["session-light", state.facts.light]])
    if (document.activeElement !== $(id)) $(id).value = value;
  $("session-picture").checked = state.facts.picture;
  $("filter-label").hidden = $("further-how").value !== "filter";
}
async function stateSession(stated) { if (await mark({ kind: "session", stated })) say("written"); else { document.activeElement?.blur(); showFacts(); } }
async function upload(file) {
  say(`copying ${file.name} …`);
  return (await (await ask(`/api/file?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file })).json()).file;
}
async function addPhoto() {
  const [file] = $("further").files, [measured] = $("further-filter").files, filtered = $("further-how").value === "filter";
  if (!file) { say("choose a photo first"); return; }
  try {
    const photo = await upload(file), name = photo.replace(/^photos\/|\.[^.]*$/g, "").replace(/^[^\p{L}\d]+/u, "") || "further photo";
    const lit = filtered ? { same_light_as: "photo", filter: measured ? await upload(measured) : "unknown" }
      : $("further-how").value === "moved" ? { same_light_as: "photo", lamp: "moved" } : { light: "unknown" };
    const stated = { photo, ...lit };
    if (await mark({ kind: "view", name, stated })) { say(`${name} is added`); $("further").value = $("further-filter").value = ""; }
  } catch (error) { say(error.message); }
}

function showChart() {
  const charts = state.live?.charts ?? {}, chart = charts[role] ?? Object.values(charts)[0];
  view.patches = charts[role]?.patches ?? [];
  $("chart-verdict").hidden = !chart; if (!chart) return;
  $("chart-verdict").replaceChildren(words("strong", chart.verdict, chart.verdict),
    `: ${chart.verdict === "GOOD" ? "the chart can be used" : chart.reasons.join("; ")}`);
}

function showMarks() {
  if (!state) return;
  const { regions, chart_corners: chart, box_corners: box, references } = state.marks;
  const onChart = state.photos.some(({ role: one }) => one === "chart") ? role.endsWith("chart") : true;
  view.outlines = [
    ...Object.entries(regions).filter(([, { photo }]) => !role.endsWith("chart") && (!photo || photo === role || photo.includes?.(role)))
      .map(([name, { outline, rect }]) => ({ name, outline, rect, edits: outline.length > 2 })),
    ...(chart && onChart ? [{ name: "chart", outline: chart }] : []),
    ...(box && !role.endsWith("chart") ? Object.entries(box).map(([name, at]) => ({ name, outline: [at] })) : []),
    ...((role === "chart" ? references.chart : role === "photo" ? references.object : null) ?? []).map((outline) => ({ name: "reference", outline })),
  ];
  const others = [];
  if (chart) others.push({ name: "chart corners", drop: { kind: "chart corners" } });
  if (box) others.push({ name: `${Object.keys(box).length} box corners` });
  for (const where of ["chart", "object"]) if (references[where]?.length)
    others.push({ name: `${references[where].length} reference in the ${where} photo`, drop: { kind: "reference", name: where } });
  $("marks-title").textContent = state.live ? "Colours" : "Marks";
  const listed = JSON.stringify([Object.keys(regions), others]);
  if (listed !== $("marks").dataset.listed) {         // what is being typed is left alone
    $("marks").dataset.listed = listed;
    fill("marks", [...Object.keys(regions).map(regionItem), ...others.map(({ name, drop }) => item(words("span", `${name} `),
      ...(drop ? [button("remove", () => mark({ ...drop, points: [] }))] : [])))]);
  }
  for (const one of document.querySelectorAll("#marks li[data-name]")) showRegion(one, one.dataset.name);
  view.draw();
}

function regionItem(name) {
  const one = item(), input = document.createElement("input"), body = document.createElement("div");
  const head = document.createElement("div"); head.className = "row"; one.dataset.name = name;
  input.value = name; input.size = 14; input.dataset.name = name; input.setAttribute("aria-label", `Name of ${name}`);
  input.addEventListener("change", () => rename(name, input.value.trim(), input));
  input.addEventListener("keydown", (event) => { if (event.key === "Enter") $("canvas").focus({ preventScroll: true }); });
  input.addEventListener("focus", () => { if (mode !== "compare") view.select(name); });
  const drop = button("×", () => removeRegion(name)); drop.setAttribute("aria-label", `Remove ${name}`);
  head.append(input, drop); one.append(head, body, ...(state.live ? [statedOf(name)] : []));
  one.addEventListener("click", ({ target }) => {
    if (mode === "compare" && !target.closest("button, details")) pick({ name });
    else if (!target.closest("input, button, select")) view.select(name);
  });
  return one;
}

// What the operator knows of a region: kind of surface, how it mirrors, the reflectance of a white card.
function statedOf(name) {
  const box = document.createElement("details"); box.append(words("summary", "What you know about it"));
  const control = (key, about, made) => { const label = words("label", `${about} `, "known"); made.dataset.key = key; label.append(made); box.append(label);
    made.addEventListener("change", () => mark({ kind: "stated", name, stated: { [key]: made.value.trim() } })); };
  const choice = (values) => { const one = document.createElement("select");
    for (const value of ["", ...values]) { const option = words("option", value || "not stated"); option.value = value; one.append(option); } return one; };
  control("family", "Kind of surface, if you know it", choice(FAMILIES)); control("surface", "Finish", choice(SURFACES));
  const number = document.createElement("input"); number.inputMode = "decimal"; number.size = 14; control("known", "Known reflectance, for example 0.9 for a white card", number);
  for (const [key, about] of [["known", "or the file of its measured reflectance"], ["truth", "File of a measured spectrum to compare with"]]) {
    const label = words("label", `${about} `, "known"), file = document.createElement("input"), now = words("span", "", "soft"); file.type = "file"; now.dataset.file = key;
    file.addEventListener("change", async () => { try { await mark({ kind: "stated", name, stated: { [key]: await upload(file.files[0]) } }) && say("written"); } catch (error) { say(error.message); } file.value = ""; });
    label.append(file); box.append(label, ...(key === "truth" ? [now] : []));
  }
  return box;
}

// Spectrum and colour of a region, drawn anew only where they have changed.
function showRegion(one, name) {
  const body = one.children[1], stated = state.marks.regions[name].stated, answer = spectra[name], whole = view.selected === name, shown = JSON.stringify([answer, whole, stated]);
  one.classList.toggle("selected", whole);
  if (one.dataset.shown === shown) return;
  one.dataset.shown = shown;
  const controls = one.children[2];
  if (controls) {
    controls.hidden = !whole;
    for (const now of controls.querySelectorAll("[data-file]")) now.textContent = stated[now.dataset.file] ? `compared with ${stated[now.dataset.file]}` : "";
    for (const control of controls.querySelectorAll("[data-key]")) {
      const value = stated[control.dataset.key] ?? "";
      if (control.dataset.key === "known") { control.placeholder = value; control.value = ""; } else control.value = value;
    }
  }
  body.replaceChildren(...(!answer ? [] : answer.refused ? [words("p", answer.refused, "bad")] : described(name, answer, whole)));
}

function showShooting() {
  $("shooting").hidden = !state.shooting; if (!state.shooting) return;
  $("watched").textContent = `in ${state.shooting.folder}` + (state.shooting.arriving.length ? `, arriving: ${state.shooting.arriving.join(", ")}` : "");
  fill("shots", state.shooting.shots.map((shot) => item(words("strong", shot.verdict, shot.verdict), " ",
    button(shot.file, () => open(`shot:${shot.file}`), role === `shot:${shot.file}`),
    ` ${shot.chart ? "chart found. " : ""}${shot.reasons.join("; ")} ` +
    `(${Math.abs(shot.stops).toFixed(1)} stops ${shot.stops > 0 ? "longer" : "shorter"} would be best)`)));
  const missing = state.photos.filter(({ there }) => !there).map(({ role: one, file }) => `${one} (${file})`);
  $("missing").textContent = missing.length ? `Still missing: ${missing.join(", ")}` : "Nothing is missing.";
}

async function refresh() {
  if (asking) return; asking = true;
  const before = changes;
  try {
    const fresh = await get("/api/state");
    if (changes === before && changes % 2 === 0) update(fresh);    // else what a change answers says it
    if (!role) { const first = state.photos.find(({ there }) => there); if (first) await open(first.role); } }
  catch (error) { say(`no answer: ${error.message}`); }
  finally { asking = false; }
}

document.addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select, textarea")) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") { event.preventDefault(); undo(); }
  else if ((event.key === "Delete" || event.key === "Backspace") && view.selected in (state?.marks.regions ?? {})) { event.preventDefault(); removeRegion(view.selected); }
});
for (const one of document.querySelectorAll("[data-mode]")) one.addEventListener("click", () => { chosenMode = true; choose(one.dataset.mode); });
$("polygon").addEventListener("change", () => { clearPoints(); setDrawing(); show(); });
$("run").addEventListener("click", () => { saving = true; send("/api/run", {}); });
$("stop").addEventListener("click", () => send("/api/stop", {}));
$("undo").addEventListener("click", undo);
$("save").addEventListener("click", save);
$("clear").addEventListener("click", () => { clearPoints(); show(); });
$("session-name").addEventListener("change", () => stateSession({ name: $("session-name").value.trim() }));
$("session-light").addEventListener("change", () => stateSession({ light: $("session-light").value.trim() || "unknown" }));
$("session-picture").addEventListener("change", () => stateSession({ picture: $("session-picture").checked ? "on" : "" }));
$("further-how").addEventListener("change", showFacts);
$("further-add").addEventListener("click", addPhoto);
$("fit").addEventListener("click", () => view.whole());
choose("look");
// often until spectra can be shown
for (;;) { await refresh(); await new Promise((go) => setTimeout(go, state?.live && !state.live.ready ? 250 : 1000)); }
