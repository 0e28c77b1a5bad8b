// Spectra as drawings, on the page and in the report alike. A spectrum is {nm, mean}, with band
// {lower, upper} and measured truth {nm, values} where there are any; of many each has {name, hex}
// too. Everything is text or numbers; nothing is parsed as HTML.
// Its name as the browser has it: a report holds no address of the web, not even this one.
const SVG = Object.assign(document.createElement("template"), { innerHTML: "<svg></svg>" }).content.firstChild.namespaceURI;

export function node(name, attributes, text) {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  if (text !== undefined) one.textContent = text;
  return one;
}

// Axes from 0 to 1 or what is higher, over the wavelengths of the first spectrum.
function axes(spectra, [left, top, right, bottom], stepNm, step) {
  const { nm } = spectra[0], ends = [nm[0], nm.at(-1)], parts = [];
  const highest = Math.max(1, ...spectra.flatMap((one) => [...one.mean, ...(one.upper ?? [])]));
  const across = (at) => left + (at - ends[0]) / (ends[1] - ends[0]) * (right - left);
  const up = (value) => bottom - Math.min(Math.max(value, 0), highest) / highest * (bottom - top);
  for (let level = 0; level <= highest + 1e-9; level += step) parts.push(
    node("path", { class: "grid", d: `M${left} ${up(level).toFixed(1)}H${right}` }),
    node("text", { x: left - 5, y: (up(level) + 3.5).toFixed(1), "text-anchor": "end" }, +level.toFixed(2)));
  for (let at = Math.ceil(ends[0] / stepNm) * stepNm; at <= ends[1]; at += stepNm) parts.push(
    node("path", { class: "grid", d: `M${across(at).toFixed(1)} ${top}V${bottom}` }),
    node("text", { x: across(at).toFixed(1), y: bottom + 14, "text-anchor": "middle" }, at));
  const points = (of, values) => of.map((at, i) => [at, values[i]])
    .filter(([at, value]) => Number.isFinite(value) && at >= ends[0] && at <= ends[1])
    .map(([at, value]) => `${across(at).toFixed(1)},${up(value).toFixed(1)}`);
  const line = (cls, of, values, more = {}) => node("polyline", { class: cls, points: points(of, values).join(" "), ...more });
  const band = ({ nm: of, lower, upper }, more = {}) => node("polygon", { class: "band",
    points: [...points(of, lower), ...points(of, upper).reverse()].join(" "), ...more });
  return { parts, ends, across, up, line, band };
}

// Mean and band of one spectrum; `others` are further spectra, drawn as dashed lines. What has a colour
// (hex) is drawn in it, on a rim that is seen on any ground.
export function smallSpectrum(label, spectrum, others = []) {
  const svg = node("svg", { class: "spectrum", role: "img", "aria-label": label, viewBox: "0 0 256 123" });
  const { parts, line, band } = axes([spectrum, ...others], [24, 6, 244, 106], 100, 0.5);
  svg.append(...parts);
  if (spectrum.lower) svg.append(band(spectrum));
  const drawn = (cls, { nm, mean, hex }, more) => hex ? [line("casing", nm, mean, { "stroke-width": 4 }), line(cls, nm, mean, { stroke: hex, "stroke-width": 2.4, ...more })] : [line(cls, nm, mean)];
  svg.append(...drawn("mean", spectrum, {}), ...others.flatMap((one) => drawn("other", one, { "stroke-dasharray": "7 4" })));
  if (spectrum.truth) svg.append(line("truth", spectrum.truth.nm, spectrum.truth.values));
  return svg;
}

export function valueAt(nm, values, at) {
  const after = nm.findIndex((each) => each >= at), i = after < 0 ? nm.length - 1 : after;
  if (i === 0 || nm[i] === at) return values[i];
  return values[i - 1] + (values[i] - values[i - 1]) * (at - nm[i - 1]) / (nm[i] - nm[i - 1]);
}

// What is known of a spectrum at a wavelength, in words.
export function valueWords(spectrum, at) {
  const [mean, lower, upper] = ["mean", "lower", "upper"].map((curve) => spectrum[curve] && valueAt(spectrum.nm, spectrum[curve], at).toFixed(3));
  return `${spectrum.name} at ${at}\u00a0nm: ${mean}` + (lower ? ` (${lower} to ${upper})` : ", as given");
}

// Many spectra in one plot, each line in its own colour with its name at the right; the band of the
// one under the pointer, and of those that are chosen. `onShow(index, words)` is told which line the
// pointer is at (index -1: none), `onChoose(index)` which one was clicked or, with Enter, chosen.
// Arrow keys move along a line and to the next. Returns {svg, show(index), choose(indices)}.
export function spectraPlot(label, spectra, { width = 640, height = 420, onShow = () => {}, onChoose = () => {} } = {}) {
  const named = spectra.length * 13 <= height - 40, right = width - (named ? 130 : 10), bottom = height - 34;
  const svg = node("svg", { class: "spectra", role: "img", "aria-label": label, tabindex: 0, viewBox: `0 0 ${width} ${height}` });
  const { parts, ends, across, up, line, band } = axes(spectra, [34, 8, right, bottom], 50, 0.2);
  svg.append(...parts, node("text", { x: (34 + right) / 2, y: height - 4, "text-anchor": "middle" }, "Wavelength (nm)"));
  const curves = spectra.map((one) => {
    const curve = node("g", { class: "curve" });
    if (one.lower) curve.append(band(one, { fill: one.hex }));
    curve.append(line("casing", one.nm, one.mean), line("mean", one.nm, one.mean, { stroke: one.hex }));
    if (one.truth) curve.append(line("truth", one.truth.nm, one.truth.values));
    return curve;
  });
  if (named) labelled();
  const pointer = node("path", { class: "pointer", d: "" });
  svg.append(...curves, pointer);
  let shown = -1, chosen = new Set(), at = Math.round((ends[0] + ends[1]) / 2);

  // Names beside the ends of their lines, from top to bottom in that order, none over another.
  function labelled() {
    const ordered = spectra.map((one, i) => [up(one.mean.at(-1)), i]).sort((a, b) => a[0] - b[0]);
    const gap = Math.min(17, (bottom - 8) / spectra.length), places = [];
    ordered.forEach(([y], k) => places.push(Math.max(y, k ? places[k - 1] + gap : 14)));
    for (let k = places.length - 1, lowest = bottom; k >= 0; k -= 1, lowest = places[k + 1] - gap) places[k] = Math.min(places[k], lowest);
    ordered.forEach(([y, i], k) => {
      const name = spectra[i].name, short = name.length > 13 ? `${name.slice(0, 12)}…` : name;
      curves[i].append(node("path", { class: "lead", d: `M${right + 1} ${y.toFixed(1)}L${right + 9} ${places[k].toFixed(1)}` }),
        node("rect", { x: right + 10, y: (places[k] - 5).toFixed(1), width: 10, height: 10, fill: spectra[i].hex, stroke: "#8b929b" }),
        node("text", { x: right + 25, y: (places[k] + 4).toFixed(1) }, short));
    });
  }
  function drawn() {
    curves.forEach((curve, i) => { curve.classList.toggle("shown", i === shown); curve.classList.toggle("chosen", chosen.has(i)); });
    svg.classList.toggle("some", shown >= 0 || chosen.size > 0);
    if (shown >= 0) svg.insertBefore(curves[shown], pointer);       // above the others
  }
  function show(index) { shown = index; drawn(); }
  function tell(index, nm) {
    at = Math.min(Math.max(Math.round(nm), ends[0]), ends[1]);
    pointer.setAttribute("d", index < 0 ? "" : `M${across(at).toFixed(1)} 8V${bottom}`);
    show(index); onShow(index, index < 0 ? "" : valueWords(spectra[index], at));
  }
  const inside = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  function nearest(event) {
    const owner = event.target.closest(".curve"), { x, y } = inside(event);
    const nm = Math.min(Math.max(ends[0] + (x - 34) / (right - 34) * (ends[1] - ends[0]), ends[0]), ends[1]);
    if (x > right && owner) return [curves.indexOf(owner), nm];
    const far = spectra.map((one) => Math.abs(up(valueAt(one.nm, one.mean, nm)) - y));
    return [far.indexOf(Math.min(...far)), nm];
  }
  svg.addEventListener("pointermove", (event) => tell(...nearest(event)));
  svg.addEventListener("pointerleave", () => tell(-1, at));
  svg.addEventListener("click", (event) => onChoose(nearest(event)[0]));
  svg.addEventListener("blur", () => tell(-1, at));
  svg.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1, along = { ArrowLeft: at - step, ArrowRight: at + step, Home: ends[0], End: ends[1] }[event.key];
    const next = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (event.key === "Enter" && shown >= 0) onChoose(shown);
    else if (along !== undefined) tell(Math.max(shown, 0), along);
    else if (next) tell((Math.max(shown, next < 0 ? 0 : -1) + next + spectra.length) % spectra.length, at);
    else return;
    event.preventDefault();
  });
  return { svg, show, choose(indices) { chosen = new Set(indices); drawn(); } };
}
