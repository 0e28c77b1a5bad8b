// The session as the server last said, and changes to it. The server keeps all that lasts.
import { get, post } from "./server.js";

export const session = { state: null, role: "", spectra: {} };
const heard = { update() {}, say() {}, spectra() {} };
export const follow = (handlers) => Object.assign(heard, handlers);
export const say = (text) => heard.say(text);

// One change after the other: each says which text of the session it has seen.
let sending = Promise.resolve(), changes = 0, asking = false;
export function send(path, body = {}) { return sending = sending.then(() => sendNow(path, body)); }
async function sendNow(path, body) {
  let answer = null;
  changes += 1;                   // odd while one is on its way
  try { answer = await post(path, { digest: session.state.digest, ...body }); }
  catch (error) { say(error.message); }
  finally { changes += 1; }       // news that were asked for meanwhile may be older
  if (answer === null) { await refresh(); return false; }
  update(answer);
  return true;
}
export const mark = (marked) => send("/api/mark", { mark: marked });
export const state = (name, stated) => mark({ kind: "stated", name, stated });

export async function refresh() {
  if (asking) return;
  asking = true;
  const before = changes;
  try {
    const fresh = await get("/api/state");
    if (changes === before && changes % 2 === 0) update(fresh);    // else what a change answers says it
  } catch (error) { say(`no answer: ${error.message}`); }
  finally { asking = false; }
}

function update(fresh) {
  session.state = fresh;
  heard.update();
  refreshSpectra();
}

// Spectra of all regions, asked for again where session.toml or the calibration has changed.
let spectraOf = "";
const texts = new Map();
async function refreshSpectra() {
  const { state: now } = session, of = now.live?.ready ? now.digest : "";
  if (of === spectraOf) return;
  spectraOf = of;
  const names = of ? Object.keys(now.marks.regions) : [];
  for (const name of Object.keys(session.spectra)) if (!names.includes(name)) { delete session.spectra[name]; texts.delete(name); }
  heard.spectra();
  for (const name of names) {
    if (spectraOf !== of) return;
    try {
      const answer = await get(`/api/region?name=${encodeURIComponent(name)}`), text = JSON.stringify(answer);
      if (texts.get(name) === text) continue;       // what has not changed is not drawn again
      texts.set(name, text); session.spectra[name] = answer; heard.spectra(name);
    } catch { spectraOf = ""; return; }             // a session with a fault, or one that has just changed
  }
}

export const regions = () => session.state?.marks.regions ?? {};
export const severalPhotos = () => session.state.photos.filter(({ role }) => !role.endsWith("chart")).length > 1;
export function freeName(stem) {
  const taken = regions();
  if (stem !== "sample" && !(stem in taken)) return stem;
  for (let number = stem === "sample" ? 1 : 2; ; number++) if (!(`${stem} ${number}` in taken)) return `${stem} ${number}`;
}
