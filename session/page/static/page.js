import { PhotoView } from "./photo.js";

const token = handedToken();
const $ = (id) => document.getElementById(id);
const HINTS = {
  look: "Wheel zooms, dragging moves. Arrow keys, + and - do the same.",
  region: "Two opposite corners of a rectangle, or with Polygon as many as you like and then Save.",
  chart: "Four corners in the order of the chart: of a ColorChecker dark skin, bluish green, black, white.",
  box: "Six corners or more, each by its name; then Save. A fov_deg in session.toml is taken as known: delete the line if it is not yours.",
  reference: "Four corners of a neutral reference that both photos show.",
};
let state = null, role = "", mode = "look", named = [], asking = false, reportStamp = null, size = [1, 1];

// The token leaves the address bar; this tab keeps it, so that the page can be loaded again.
function handedToken() {
  const given = new URLSearchParams(location.search).get("token");
  if (given === null) return sessionStorage.getItem("token") ?? "";
  sessionStorage.setItem("token", given); history.replaceState(null, "", "/page");
  return given;
}

async function ask(path, options = {}) {
  const answer = await fetch(path, { ...options, headers: { Authorization: `Bearer ${token}`, ...(options.headers ?? {}) } });
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).error ?? `${answer.status}`);
  return answer;
}
const get = async (path) => (await ask(path)).json();
async function send(path, body) {
  try {
    update(await (await ask(path, { method: "POST", body: JSON.stringify({ digest: state.digest, ...body }) })).json());
    return true;
  } catch (error) { say(error.message); await refresh(); return false; }
}
const say = (text) => { $("said").textContent = text; };
const words = (tag, text, cls) => { const node = document.createElement(tag); node.textContent = text; if (cls) node.className = cls; return node; };
const fill = (list, nodes) => $(list).replaceChildren(...nodes);
const item = (...nodes) => { const one = document.createElement("li"); one.append(...nodes); return one; };
function button(text, does, current) {
  const one = words("button", text); one.addEventListener("click", does);
  if (current) one.setAttribute("aria-current", "true");
  return one;
}

const view = new PhotoView($("canvas"), { onPoint: point, onPointer: pointer });

async function open(chosen) {
  role = chosen; clearPoints(); say(`opening ${chosen} …`);
  try {
    const about = `role=${encodeURIComponent(chosen)}`;
    const [pixels, { size: of }] = await Promise.all([ask(`/api/photo?${about}`).then((a) => a.blob()), get(`/api/size?${about}`)]);
    if (role !== chosen) return;
    size = of; view.show(await createImageBitmap(pixels), of); say("");
    document.body.dataset.photo = chosen;
  } catch (error) { say(error.message); }
  show();
}

let waiting = null;
function pointer([x, y]) {
  clearTimeout(waiting);
  waiting = setTimeout(async () => {
    if (!role || x < -0.5 || y < -0.5 || x > size[0] - 0.5 || y > size[1] - 0.5) { $("values").textContent = "\u00a0"; return; }
    const about = `role=${encodeURIComponent(role)}`;
    try {
      const [found, part] = await Promise.all([get(`/api/value?${about}&x=${x.toFixed(1)}&y=${y.toFixed(1)}`),
        ask(`/api/part?${about}&left=${(x - 24).toFixed(1)}&top=${(y - 24).toFixed(1)}&side=48`).then((a) => a.blob())]);
      $("values").textContent = `(${x.toFixed(0)}, ${y.toFixed(0)})  ` + found.signal.map((value, band) =>
        `${(100 * value).toFixed(1)} %${found.saturated[band] ? " clipped" : ""}`).join("  ");
      const picture = await createImageBitmap(part); const c = $("loupe").getContext("2d");
      c.imageSmoothingEnabled = false; c.drawImage(picture, 0, 0, 192, 192);
      c.strokeStyle = "#00e5ff"; c.strokeRect(88, 88, 16, 16);
    } catch { /* the pointer has gone on */ }
  }, 60);
}

async function point(at) {
  if (mode === "look" || !role) return;
  if (mode === "box") { named = named.filter(([name]) => name !== $("corner").value); named.push([$("corner").value, at]);
    view.points = named.map(([, place]) => place); nextCorner(); view.draw(); show(); return; }
  view.points.push(at); view.draw();
  const needed = mode === "region" ? 2 : 4;
  if (mode === "region" ? !$("polygon").checked && view.points.length === needed : view.points.length === needed) await save();
  show();
}
function nextCorner() {
  const left = [...$("corner").options].map((one) => one.value).filter((name) => !named.some(([taken]) => taken === name));
  if (left.length) $("corner").value = left[0];
}
async function save() {
  const points = view.points.map(([x, y]) => [x, y]);
  const several = state.photos.filter(({ role: one }) => !one.endsWith("chart")).length > 1;
  const mark = {
    region: { kind: "region", name: $("mark-name").value.trim(), points, photo: several && !role.startsWith("shot:") ? role : "" },
    chart: { kind: "chart corners", points },
    box: { kind: "box corners", points: named.map(([, at]) => at), names: named.map(([name]) => name) },
    reference: { kind: "reference", name: role === "chart" ? "chart" : "object", points },
  }[mode];
  if (await send("/api/mark", { mark })) say("marked");
  clearPoints();
}
function clearPoints() { named = []; view.points = []; view.draw(); }

function choose(next) {
  mode = next; clearPoints();
  for (const one of document.querySelectorAll("[data-mode]")) one.setAttribute("aria-pressed", String(one.dataset.mode === next));
  $("hint").textContent = HINTS[next]; show();
}

function update(next) {
  state = next; $("name").textContent = state.name; document.title = `${state.name} - spectrabox`;
  show();
  if (state.report !== reportStamp && !state.run.running) {
    reportStamp = state.report; $("report").hidden = state.report === null;
    if (state.report !== null) $("report-frame").src = `/report?token=${encodeURIComponent(token)}&at=${state.report}`;
  }
}

function show() {
  if (!state) return;
  const { run } = state;
  fill("photos", state.photos.map(({ role: one, file, there }) => item(there
    ? button(`${one}: ${file}`, () => open(one), one === role) : words("span", `${one}: ${file} is not there yet`, "missing"))));
  $("undo").disabled = !state.undo; $("run").disabled = run.running || state.problems.length > 0; $("stop").disabled = !run.running;
  document.querySelector('[data-mode="box"]').hidden = !state.corner_names.length;
  $("name-label").hidden = $("polygon-label").hidden = mode !== "region"; $("corner-label").hidden = mode !== "box";
  $("save").hidden = !(mode === "box" && named.length >= 6) && !(mode === "region" && $("polygon").checked && view.points.length > 2);
  $("clear").hidden = !view.points.length;
  if ($("corner").options.length !== state.corner_names.length)
    fill("corner", state.corner_names.map((name) => { const one = words("option", name); one.value = name; return one; }));
  fill("stages", state.stages.map(({ name, state: how, reasons }) => item(words("span", `${name}: ${how}`, how), reasons.length ? ` ${reasons.join("; ")}` : "")));
  fill("problems", state.problems.map((text) => words("p", text)));
  $("progress").textContent = run.running ? `running, ${run.seconds.toFixed(0)} s` : run.exit_code === null ? ""
    : run.stopped ? "stopped: finished stages are kept, Run goes on from there" : run.verdict ? `verdict ${run.verdict.toUpperCase()}, ${run.seconds.toFixed(0)} s` : `ended with ${run.exit_code}: ${run.error ?? ""}`;
  const log = run.lines.join("\n"); if ($("log").textContent !== log) { $("log").textContent = log; $("log").scrollTop = $("log").scrollHeight; }
  showMarks(); showShooting();
}

function showMarks() {
  const { regions, chart_corners: chart, box_corners: box, references } = state.marks;
  const marks = Object.entries(regions).map(([name, { outline }]) => ({ name, outline, drop: { kind: "region", name } }));
  const onChart = state.photos.some(({ role: one }) => one === "chart") ? role.endsWith("chart") : true;
  view.outlines = [
    ...Object.entries(regions).filter(([, { photo }]) => !role.endsWith("chart") && (!photo || photo === role || photo.includes?.(role)))
      .map(([name, { outline }]) => ({ name, outline })),
    ...(chart && onChart ? [{ name: "chart", outline: chart }] : []),
    ...(box && !role.endsWith("chart") ? Object.entries(box).map(([name, at]) => ({ name, outline: [at] })) : []),
    ...((role === "chart" ? references.chart : role === "photo" ? references.object : null) ?? []).map((outline) => ({ name: "reference", outline })),
  ];
  if (chart) marks.push({ name: "chart corners", drop: { kind: "chart corners" } });
  if (box) marks.push({ name: `${Object.keys(box).length} box corners` });
  for (const where of ["chart", "object"]) if (references[where]?.length)
    marks.push({ name: `${references[where].length} reference in the ${where} photo`, drop: { kind: "reference", name: where } });
  fill("marks", marks.map(({ name, drop }) => item(words("span", `${name} `),
    ...(drop ? [button("remove", () => send("/api/mark", { mark: { ...drop, points: [] } }))] : []))));
  view.draw();
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
  try { update(await get("/api/state")); if (!role) { const first = state.photos.find(({ there }) => there); if (first) await open(first.role); } }
  catch (error) { say(`no answer: ${error.message}`); }
  finally { asking = false; }
}

for (const one of document.querySelectorAll("[data-mode]")) one.addEventListener("click", () => choose(one.dataset.mode));
$("run").addEventListener("click", () => send("/api/run", {}));
$("stop").addEventListener("click", () => send("/api/stop", {}));
$("undo").addEventListener("click", async () => { if (await send("/api/undo", {})) say("taken back"); });
$("save").addEventListener("click", save);
$("clear").addEventListener("click", () => { clearPoints(); show(); });
$("fit").addEventListener("click", () => view.whole());
choose("look");
await refresh();
setInterval(refresh, 1000);
