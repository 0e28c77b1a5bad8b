// Measure a marked colour now, with an instrument that is held on it.
import { $, button, closePanel, labelled, make, panelShows, showPanel } from "./dom.js";
import { get, post } from "./server.js";
import { say, state } from "./session.js";
import { one } from "./words.js";

const DONE = { white: "White is calibrated", black: "Black is calibrated" };

export async function meterPanel(anchor, name) {
  const key = `meter ${name}`;
  let now;
  try { now = await get("/api/meter"); } catch (error) { say(error.message); return; }
  const port = make("input", { id: "meter-port", value: now.port || now.ports[0]?.port || "", placeholder: "/dev/ttyUSB0",
    on: { input: () => { now = { ...now, calibrated: [] }; showSteps(); } } });      // another instrument
  port.setAttribute("list", "meter-ports");
  const told = make("p", { id: "meter-told", role: "status" }), steps = make("div", { className: "meter-steps" });
  const without = make("input", { id: "meter-without", type: "checkbox", on: { change: () => showSteps() } });
  const missing = () => Object.keys(now.calibrations).filter((which) => !now.calibrated.includes(which));
  const ready = () => without.checked || !missing().length;
  let busy = false, waiting = false, done = false, queued = Promise.resolve();
  showSteps();            // before the panel, which is placed by its size
  showPanel(anchor, key, [make("h2", { text: `Measure ${name}` }), make("p", { className: "soft", text: "With a CR30 hand spectrophotometer." }),
    labelled("Port", port), make("datalist", { id: "meter-ports" }, ...now.ports.map(({ port: value, words }) => make("option", { value, text: words }))),
    steps, told], `Measure ${name}`);
  waitForPress();

  function showSteps() {
    steps.replaceChildren(
      ...Object.entries(now.calibrations).map(([which, advice]) => make("div", {}, make("p", { text: now.calibrated.includes(which) ? `${DONE[which]}.` : `For ${which}, ${advice}.` }),
        make("div", { className: "buttons" }, button(now.calibrated.includes(which) ? `Calibrate ${which} again` : `Calibrate ${which}`, () => step(which), { disabled: busy, id: `meter-${which}` })))),
      ...(missing().length ? [make("label", {}, without, " Measure without; its file says so")] : []),
      make("p", { text: ready() ? "Hold it on the colour and press its button, or" : "Then measure." }),
      make("div", { className: "buttons" }, button("Measure", () => step("measure"), { disabled: busy || !ready(), id: "meter-measure" })));
    waitForPress();
  }
  // One thing at a time; an answer with a file is a reading.
  async function ask(what) {
    busy = true;
    try {
      const answer = await post("/api/meter/step", { port: port.value.trim(), what, name });
      now = { ...now, calibrated: answer.calibrated };
      return answer;
    } catch (error) { told.className = "bad"; told.textContent = error.message; now = { ...now, calibrated: [] }; return null; }
    finally { busy = false; }
  }
  function step(what) {
    queued = queued.then(async () => {
      told.className = "soft"; told.textContent = what === "measure" ? "measuring …" : "calibrating …";
      const answer = await ask(what);
      if (answer && !answer.file) told.textContent = "";
      if (answer?.file) await taken(answer); else showSteps();
    });
  }
  async function waitForPress() {
    if (waiting || !ready() || !port.value.trim() || !panelShows(key)) return;
    waiting = true;
    let answer = {};
    while (answer && !answer.file && !done && panelShows(key) && steps.isConnected) await (queued = queued.then(async () => { if (!done) answer = await ask("press"); }));
    waiting = false;
    if (answer?.file && !done) await taken(answer);
  }
  async function taken({ file, lab, flags }) {
    done = true;
    if (!await state(name, { truth: file })) return;
    say(`${name} measured: L*a*b* ${lab.map(one).join(" ")} on its display${flags.length ? `. ${flags.join(" ")}` : ""}`);
    closePanel();
    $("canvas").focus({ preventScroll: true });
  }
}
