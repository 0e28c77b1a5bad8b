// What numbers of the server are called on the page.
export const one = (value) => value.toFixed(1).replace("-", "−");
const percent = (share) => `${Math.round(100 * share)}\u00a0%`;
const shares = (list, most) => list.slice(0, most).map(([name, share]) => `${name} ${percent(share)}`).join(", ");

export const labOf = ({ lab }) => lab.map(one).join(" ");
export const labWords = (answer) => `L*a*b* ${labOf(answer)}` + (answer.lab_error ? ` ± ${answer.lab_error.map(one).join(" ")}` : "");

// What is known of a spectrum, by what it is about.
export function details({ causes, light, notes, next_nm: next, given, truth, doubt }) {
  if (given) return doubt ? [["Spectrum", "as stated"], ["Not used", doubt]] : [["Spectrum", "as stated"]];
  return [...(truth ? [["Measured", `${labOf(truth)}, \u0394E00 ${one(truth.delta_e00)}`]] : []), ["Width of the band from", shares(causes, 3)],
    ["Light here", `${light[0].toFixed(2)} times that on the chart, ± ${(100 * light[1]).toFixed(1)}\u00a0%`],
    ...(next ? [["A reading helps most at", `${next.toFixed(0)} nm`]] : []), ...notes.map((note) => ["Note", note])];
}

export const LIGHTS = { D65: "daylight (D65)", A: "incandescent (A)", FL11: "fluorescent (FL11)", "LED-B3": "white LED (LED-B3)", "LED-RGB1": "RGB LED (LED-RGB1)" };
export const STAGES = { chart: "Find the chart", photo: "Read the photos", calibrate: "Calibrate camera and light", reconstruct: "Fit the scene",
  signals: "Signals of the colours", sample: "Spectra", picture: "Picture of spectra" };
const CALIBRATED = { chart: 10, photo: 35, calibrate: 45 };      // per cent, when the stage begins
export const STAGE_STATES = { done: "done", missing: "to do", stale: "to do again", "not needed": "not needed" };

export const upToDate = ({ digest, report, reported, stages }) => report !== null && reported?.session === digest
  && stages.every(({ state }) => state === "done" || state === "not needed");

// The one state of the session, in a few words.
export function stateWords(now) {
  const { run, live, problems, stages, photos } = now, last = (run.lines.at(-1) ?? "").split(" ")[0];
  if (problems.length) return problems.length > 1 ? `${problems.length} problems` : "1 problem";
  if (run.running && run.until) return `calibrating ${CALIBRATED[last] ?? 5}\u00a0%` + (run.waiting ? ", then the report" : "");
  if (run.running) return `report: ${(STAGES[last] ?? "writing it").toLowerCase()}, ${run.seconds.toFixed(0)} s`;
  if (run.stopped) return "stopped";
  if (live?.error) return "1 problem";
  if (run.exit_code && run.error) return "1 problem";
  if (photos.some(({ there }) => !there)) return "a photo is missing";
  if (live && !live.ready) return "calibrating 90\u00a0%";
  if (upToDate(now)) return "up to date";
  if (now.report !== null) return "changed since the report";
  return live ? "calibrated" : stages.some(({ state }) => state === "done") ? "partly done" : "not run yet";
}
export function problemsOf({ problems, live, run }) {
  return [...problems, ...(live?.error ? [live.error] : run.error && !run.running && !run.stopped ? [run.error] : [])];
}

// The verdict of what is marked now; none while it is being worked out, as it may be another.
export const settled = ({ live }) => !live || live.result_now;
export const verdictOf = (now) => settled(now) ? now.live?.result ?? now.reported ?? null : null;

export const STANDINGS = { measured: ["●", "measured"], stated: ["◆", "stated"], assumed: ["○", "assumed"] };
export const capital = (text) => text[0].toUpperCase() + text.slice(1);
export function conditionWords({ error, known_by: by, cost, to_measure: measure }) {
  return [`Known by: ${by}.`, ...(cost ? [`If it does not hold: ${cost}.`] : []),
    ...(error ? [`The bands allow for ${one(100 * error)} %.`] : []), ...(measure ? [`To measure it: ${measure}.`] : [])];
}
