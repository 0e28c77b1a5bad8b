// What opens beside a button: the verdict, the state, a condition, a further photo, export, the keys.
import { $, button, choice, labelled, make, panelShows, showPanel } from "./dom.js";
import { address, upload } from "./server.js";
import { mark, regions, say, send, session, state } from "./session.js";
import { STAGES, STAGE_STATES, STANDINGS, capital, conditionWords, problemsOf, stateWords, upToDate, verdictOf } from "./words.js";

const LIGHT_KINDS = ["unknown", "daylight", "halogen", "led", "fluorescent", "D65", "A"];
const HOW = [["lamp", "under another lamp"], ["filter", "through a filter (a gel), under the same lamp"], ["moved", "with the lamp moved"]];
const title = (text) => make("h2", { text }), soft = (text) => make("p", { className: "soft", text });

export function verdictPanel(anchor) {
  const verdict = verdictOf(session.state), charts = Object.entries(session.state.live?.charts ?? {});
  showPanel(anchor, "verdict", [title("Verdict"),
    make("p", { text: verdict ? `${verdict.status.toUpperCase()}: ${verdict.says}` : "Mark a colour: the verdict on it stands here." }),
    ...charts.map(([role, { verdict: word, reasons }]) => make("p", {}, make("strong", { className: word, text: `Chart ${word}` }),
      ` (${role}): ${word === "GOOD" ? "it can be used" : reasons.join(" ")}`))], "Verdict");
}

// ---- the one state, with what is behind it
export function statePanel(anchor) { showPanel(anchor, "state", stateNodes(), "State"); }
export function followState() {
  if (panelShows("export") && exported !== String(session.state.exports)) { exported = String(session.state.exports); $("panel").replaceChildren(...exportNodes()); }
  if (!panelShows("state")) return;
  const open = $("log-box")?.open; $("panel").replaceChildren(...stateNodes()); $("log-box").open = open;
}
function stateNodes() {
  const { run, stages, photos } = session.state, log = run.lines.join("\n");
  return [title(capital(stateWords(session.state))), ...problemsOf(session.state).map((text) => make("p", { className: "bad", text })),
    ...photos.filter(({ there }) => !there).map(({ role, file }) => make("p", { className: "bad", text: `${role}: ${file} is not there yet` })),
    ...(run.stopped ? [soft("What was finished is kept; Report goes on from there.")] : []),
    make("ul", { id: "stages" }, ...stages.map(({ name, state: how, reasons }) => make("li", { title: reasons.join("; ") }, `${STAGES[name] ?? name}: `,
      make("span", { className: how === "done" ? "good" : "soft", text: STAGE_STATES[how] ?? how })))),
    make("details", { id: "log-box" }, make("summary", { text: "Messages" }), make("pre", { id: "log", tabIndex: 0, role: "log", "aria-label": "Messages of the run", text: log || "none" }))];
}

// ---- the session: its name
export function namePanel(anchor) {
  const input = make("input", { id: "session-name", value: session.state.name, on: { change: () => stateSession({ name: input.value.trim() }, anchor) } });
  showPanel(anchor, "name", [title("This session"), labelled("Name", input)], "This session");
}
async function stateSession(stated) { if (await mark({ kind: "session", stated })) { say("written"); $("panel").hidePopover(); } }

// ---- conditions as chips: what is assumed first
const ORDER = ({ standing, named }) => (named ? 0 : { assumed: 1, stated: 2 }[standing]);
export function showChips(tools) {
  const { live, facts } = session.state, conditions = verdictOf(session.state)?.conditions ?? [];
  const shown = JSON.stringify([conditions, facts.light]);
  if ($("chips").dataset.shown === shown) return;
  $("chips").dataset.shown = shown;
  const lamp = live ? [chip(knownLight(facts.light) ? "stated" : "measured", "lamp", knownLight(facts.light) ? facts.light : "from the chart", (event) => lampPanel(event.currentTarget))] : [];
  const measured = conditions.filter(({ standing }) => standing === "measured");
  $("chips").replaceChildren(...lamp, ...conditions.filter((one) => !measured.includes(one)).sort((a, b) => ORDER(a) - ORDER(b)).map((one) =>
    chip(one.standing, one.name, STANDINGS[one.standing][1], (event) => conditionPanel(event.currentTarget, one, tools))),
  ...(measured.length ? [chip("measured", "measured", measured.length, (event) => measuredPanel(event.currentTarget, measured))] : []));
}
const knownLight = (light) => Boolean(light) && light !== "unknown";
// What is measured is one chip: nothing need be done about it.
function measuredPanel(anchor, conditions) {
  showPanel(anchor, "measured", [title("Measured"), ...conditions.map((one) => make("details", { data: { condition: one.name } }, make("summary", { text: capital(one.name) }), ...conditionWords(one).map((text) => make("p", { text }))))], "What is measured");
}
const chip = (standing, name, text, does) => make("button", { className: `chip ${standing}`, type: "button", data: { chip: name }, on: { click: does } },
  make("span", { "aria-hidden": "true", text: STANDINGS[standing][0] }), ` ${capital(name)}: ${text}`);

function lampPanel(anchor) {
  const input = make("input", { id: "session-light", value: session.state.facts.light, on: { change: () => stateSession({ light: input.value.trim() || "unknown" }) } });
  input.setAttribute("list", "lights");
  showPanel(anchor, "lamp", [title("Lamp"), make("p", { text: "What is not known of the lamp is estimated from the chart. Say what kind it is, if you know it, or the file of its spectrum." }),
    labelled("Kind of light", input), make("datalist", { id: "lights" }, ...LIGHT_KINDS.map((value) => make("option", { value })))], "Lamp");
}
function conditionPanel(anchor, one, tools) {
  const { code, name, standing } = one;
  const does = [];
  if (code === "condition.gloss" && session.state.live) does.push(labelled("Finish of all that says no other", choice(FINISHES, session.state.facts.surface ?? "unknown",
    (surface) => mark({ kind: "session", stated: { surface } }))));
  if (standing !== "measured" && session.state.live) {
    if (["condition.light", "condition.plane"].includes(code)) does.push(button("Mark a white card", () => { $("panel").hidePopover(); tools.choose("white"); }));
    if (["condition.gloss", "condition.plane", "condition.shadow"].includes(code)) does.push(button("Add a photo with the lamp moved", () => photoPanel(anchor, "moved")));
  }
  showPanel(anchor, `condition ${name}`, [title(`${capital(name)}: ${STANDINGS[standing][1]}`), ...conditionWords(one).map((text) => make("p", { text })), make("div", { className: "buttons" }, ...does)], capital(name));
}

// ---- a further photo of the same samples
export function photoPanel(anchor, how = "filter", dropped = null) {
  const file = make("input", { id: "further", type: "file" }), measured = make("input", { id: "further-filter", type: "file" });
  if (dropped) file.files = dropped;
  const ofFilter = labelled("Its transmittance, if measured", measured); ofFilter.id = "filter-label";
  const way = choice(HOW, how, (value) => { ofFilter.hidden = value !== "filter"; }); way.id = "further-how"; ofFilter.hidden = how !== "filter";
  showPanel(anchor, `photo ${how}`, [title("Add a photo"), soft("Of the same samples, from the same tripod."), labelled("Photo", file), labelled("Taken", way), ofFilter,
    make("div", { className: "buttons" }, button("Add photo", () => addPhoto(file.files[0], way.value, measured.files[0]), { id: "further-add" }))], "Add a photo");
}
async function addPhoto(file, how, measured) {
  if (!file) { say("choose a photo first"); return; }
  try {
    say(`copying ${file.name} …`);
    const photo = await upload(file), name = photo.replace(/^photos\/|\.[^.]*$/g, "").replace(/^[^\p{L}\d]+/u, "") || "further photo";
    const lit = { filter: { same_light_as: "photo", filter: measured && how === "filter" ? await upload(measured) : "unknown" },
      moved: { same_light_as: "photo", lamp: "moved" }, lamp: { light: "unknown" } }[how];
    if (await mark({ kind: "view", name, stated: { photo, ...lit } })) { say(`${name} is added`); $("panel").hidePopover(); }
  } catch (error) { say(error.message); }
}

// ---- files of spectra
let exported = "";
export function exportPanel(anchor) { exported = String(session.state.exports); showPanel(anchor, "export", exportNodes(), "Export"); }
function exportNodes() {
  const { exports, live, facts } = session.state;
  const every = make("input", { id: "session-picture", type: "checkbox", checked: facts.picture, on: { change: () => mark({ kind: "session", stated: { picture: every.checked ? "on" : "" } }) } });
  const now = exports.filter((file) => file.startsWith("marked.")), old = exports.filter((file) => !now.includes(file));
  const list = (files) => make("ul", {}, ...files.map((file) => make("li", {}, make("a", { text: file, href: address("/api/export", { file }), download: "" }))));
  return [title("Export"), ...(now.length ? [soft("What is marked now:"), list(now)] : []),
    ...(old.length ? [soft(upToDate(session.state) ? "Of the report:" : "Of the last report:"), list(old)] : []),
    ...(exports.length ? [] : [make("p", { text: Object.keys(regions()).length ? "Spectra can be saved once camera and light are calibrated." : "Mark a colour first: its spectrum can then be saved." })]),
    ...(live ? [make("label", { className: "known" }, every, " also the spectrum of every pixel, in the report")] : [])];
}

export function keysPanel(anchor, keys) {
  showPanel(anchor, "keys", [title("Keys"), make("dl", { className: "keys" }, ...keys.flatMap(([key, text]) => [make("dt", {}, make("kbd", { text: key })), make("dd", { text })]))], "Keys");
}

// ---- asked once at the beginning, beside the work: how the samples mirror, then whether a card is there
const FINISHES = [["matt", "matt"], ["satin", "satin"], ["glossy", "glossy"], ["unknown", "don\u2019t know"]];
let card = false;
export function showAsk(tools) {
  const { live, facts } = session.state, what = !live ? "" : facts.surface === null ? "finish" : card && !Object.values(regions()).some(({ stated }) => stated.known) ? "card" : "";
  if ($("ask").dataset.what === what) return;
  $("ask").dataset.what = what; $("ask").hidden = !what;
  if (what === "finish") {
    $("ask").replaceChildren(title("How do your samples look in grazing light?"), soft("It decides how dark their dark colours are, by up to 5 L*."),
      make("div", { className: "buttons" }, ...FINISHES.map(([surface, text]) => button(text, async () => { if (await mark({ kind: "session", stated: { surface } })) { card = true; showAsk(tools); } }, { data: { finish: surface } }))));
  } else if (what === "card") {
    $("ask").replaceChildren(title("Is a white or grey card of known reflectance beside them?"), soft("It says how bright the light on them is. It is not part of the chart."),
      make("div", { className: "buttons" }, button("Mark it", () => tools.choose("white"), { data: { card: "yes" } }), button("No", () => { card = false; showAsk(tools); }, { data: { card: "no" } })));
  }
}

// ---- the reflectance of a white card that has just been marked
export function cardPanel(anchor, name) {
  const onEnter = { keydown: (event) => { if (event.key === "Enter") use(); } };
  const number = make("input", { id: "card-known", size: 8, placeholder: "0.94", on: onEnter }), error = make("input", { id: "card-error", size: 8, placeholder: "0.01", on: onEnter });
  const file = make("input", { type: "file", on: { change: async () => { try { await state(name, { known: await upload(file.files[0]) }); $("panel").hidePopover(); } catch (problem) { say(problem.message); } } } });
  const use = async () => {
    const known = [number.value.trim(), error.value.trim()].filter(Boolean).join(" +- ");
    if (await state(name, { known })) { $("panel").hidePopover(); say(`${name} tells how bright the light is`); }
  };
  showPanel(anchor, `card ${name}`, [title(`Reflectance of ${name}`), make("p", { text: "One number for all wavelengths with its standard error (3 % where you give none), or the file of its spectrum." }), labelled("Reflectance", number), labelled("Standard error", error), labelled("\u2026 or from a file", file),
    make("div", { className: "buttons" }, button("Use it", use))], "White card");
  number.focus();
}
export const stop = () => send("/api/stop");
