// Spectra as small drawings, and what is known of them in words. Everything is text or numbers of
// the server; nothing is parsed as HTML.
const SVG = "http://www.w3.org/2000/svg";
const [LEFT, TOP, WIDTH, HEIGHT] = [24, 6, 220, 100];

function node(name, attributes, text) {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  if (text !== undefined) one.textContent = text;
  return one;
}

// Mean and 95 % band over wavelength; `others` are further spectra, drawn as lines.
export function plot(label, spectrum, others = []) {
  const { nm, mean, lower, upper } = spectrum;
  const top = Math.max(1, ...mean, ...(upper ?? []));
  const across = (at) => LEFT + (at - nm[0]) / (nm.at(-1) - nm[0]) * WIDTH;
  const up = (value) => TOP + HEIGHT * (1 - Math.min(Math.max(value, 0), top) / top);
  const points = (of, values) => values.map((value, i) => `${across(of[i]).toFixed(1)},${up(value).toFixed(1)}`);
  const svg = node("svg", { class: "spectrum", role: "img", "aria-label": label, viewBox: `0 0 ${LEFT + WIDTH + 12} ${TOP + HEIGHT + 17}` });
  for (const level of [0, 0.5, 1]) svg.append(
    node("path", { class: "grid", d: `M${LEFT} ${up(level)}h${WIDTH}` }),
    node("text", { x: LEFT - 4, y: up(level) + 3.5, "text-anchor": "end" }, level));
  for (const at of [400, 500, 600, 700]) svg.append(
    node("path", { class: "grid", d: `M${across(at)} ${TOP}v${HEIGHT}` }),
    node("text", { x: across(at), y: TOP + HEIGHT + 13, "text-anchor": "middle" }, at));
  if (lower) svg.append(node("polygon", { class: "band", points: [...points(nm, lower), ...points(nm, upper).reverse()].join(" ") }));
  svg.append(node("polyline", { class: "mean", points: points(nm, mean).join(" ") }));
  for (const other of others) svg.append(node("polyline", { class: "other", points: points(other.nm, other.mean).join(" ") }));
  return svg;
}

export function swatch(hex) {
  const svg = node("svg", { class: "swatch", viewBox: "0 0 20 20", role: "img", "aria-label": `colour ${hex}` });
  svg.append(node("rect", { width: 20, height: 20, fill: hex }));
  return svg;
}

const one = (value) => value.toFixed(1).replace("-", "−");
const shares = (list) => list.map(([name, share]) => `${name} ${Math.round(100 * share)}\u00a0%`).join(", ");

export function labWords({ lab, lab_error: error }) {
  return `L*a*b* ${lab.map(one).join(" ")}` + (error ? ` ± ${error.map(one).join(" ")}` : "");
}

// Sentences on a spectrum, by what they are about.
export function details({ families, causes, light, notes, next_nm: next, given }) {
  if (given) return [["Spectrum", "as stated"]];
  const told = [["Probably", shares(families)], ["Why the band is this wide", shares(causes)],
    ["Light here", `${light[0].toFixed(2)} times that on the chart, ± ${(100 * light[1]).toFixed(1)}\u00a0%`]];
  if (next) told.push(["A meter reading would help most at", `${next.toFixed(0)} nm`]);
  return [...told, ...notes.map((note) => ["Note", note])];
}

const LIGHTS = { D65: "daylight (D65)", A: "incandescent (A)", FL11: "fluorescent (FL11)", "LED-B3": "white LED (LED-B3)", "LED-RGB1": "RGB LED (LED-RGB1)" };

// Two colours under five lights: both swatches touch, as the eye compares best.
export function comparison({ names, lights, spectra, says, distinct }) {
  const table = document.createElement("table"), head = table.createTHead().insertRow();
  for (const title of ["Light", `${names[0]} | ${names[1]}`, "\u0394E00"]) {
    const cell = document.createElement("th"); cell.scope = "col"; cell.textContent = title; head.append(cell); }
  const body = table.createTBody();
  for (const { light, hex, delta_e00: delta, error } of lights) {
    const row = body.insertRow(), both = row.insertCell();
    row.insertBefore(Object.assign(document.createElement("th"), { scope: "row", textContent: LIGHTS[light] ?? light }), both);
    both.append(pairOf(hex)); row.insertCell().textContent = `${one(delta)} ± ${one(error)}`;
  }
  const verdict = document.createElement("p"); verdict.className = distinct ? "" : "bad"; verdict.textContent = says;
  return [plot(`Reflectances of ${names[0]} and ${names[1]} over wavelength in nm`, spectra[0], [spectra[1]]), verdict, table];
}

function pairOf(hex) {
  const svg = node("svg", { class: "pair", viewBox: "0 0 64 20", role: "img", "aria-label": `colours ${hex[0]} and ${hex[1]}` });
  hex.forEach((colour, i) => svg.append(node("rect", { x: 32 * i, width: 32, height: 20, fill: colour })));
  return svg;
}
