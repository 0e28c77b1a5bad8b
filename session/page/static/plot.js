// Spectra as plots (uPlot) and as small drawings in rows.
import { drawn, make } from "./dom.js";
const { uPlot } = window;
const NM = Array.from({ length: 61 }, (_, i) => 400 + 5 * i);
const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
const plots = new Set();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((one) => one.redraw()));

// The colour of a surface as a line that can be seen on the panel.
export function lineColour({ lab: [lightness, a, b] }, alpha = 1) {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  return `lab(${(dark ? Math.max(lightness, 52) : Math.min(lightness, 62)).toFixed(1)} ${a.toFixed(1)} ${b.toFixed(1)} / ${alpha})`;
}

// Values at the wavelengths that all plots have; none beyond those that are known.
function resampled(nm, values) {
  let i = 0;
  return NM.map((at) => {
    if (at < nm[0] || at > nm.at(-1)) return null;
    while (i < nm.length - 2 && nm[i + 1] < at) i += 1;
    return values[i] + (values[i + 1] - values[i]) * (at - nm[i]) / (nm[i + 1] - nm[i]);
  });
}

export class SpectrumPlot {
  constructor(host, height, { onChoose = () => {}, reads = true } = {}) {
    Object.assign(this, { host, height, onChoose, curves: [], banded: -1, plot: null });
    this.read = reads ? make("p", { className: "reading", text: "\u00a0" }) : null;
    this.area = make("div", { role: "img" });
    host.replaceChildren(this.area, ...(this.read ? [this.read] : []));
    new ResizeObserver(() => this.plot?.setSize(this.dimensions())).observe(host);
    plots.add(this);
  }
  dimensions() { return { width: Math.max(this.host.clientWidth, 120), height: this.height }; }
  redraw() { this.plot?.redraw(false); }

  // Curves: {name, lab, nm, mean, lower, upper}; the band is drawn of the one that is told of.
  show(curves, label, banded = curves.length === 1 ? 0 : -1) {
    const same = this.plot && curves.length === this.curves.length;
    this.area.setAttribute("aria-label", label);
    Object.assign(this, { curves, chosen: banded, banded });
    this.columns = curves.map(({ nm, mean }) => resampled(nm, mean));
    if (same) { this.fill(); return; }
    this.plot?.destroy();
    this.plot = new uPlot(this.options(), this.data(), this.area);
  }
  clear() { this.plot?.destroy(); this.plot = null; this.curves = []; }
  data() {
    const { lower, upper, nm } = this.curves[this.banded] ?? {};
    const none = NM.map(() => null);
    return [NM, ...this.columns, upper ? resampled(nm, upper) : none, lower ? resampled(nm, lower) : none];
  }
  fill() { this.plot.setData(this.data(), false); this.plot.redraw(true, true); }
  band(index) { if (index !== this.banded) { this.banded = index; this.fill(); } }

  options() {
    const count = this.curves.length, axis = { stroke: () => ink("--soft-ink"), font: "11px system-ui, sans-serif",
      grid: { stroke: () => ink("--grid"), width: 1 }, ticks: { stroke: () => ink("--grid"), size: 4 } };
    const invisible = { stroke: "transparent", width: 0, points: { show: false } };
    const top = () => Math.max(1, ...this.columns.flat().filter((value) => value !== null), ...(this.curves[this.banded]?.upper ?? []));
    return { ...this.dimensions(), legend: { show: false }, padding: [8, 22, 0, 0],
      scales: { x: { time: false, range: () => [400, 700] }, y: { range: () => [0, Math.min(top(), 1.5)] } },
      axes: [{ ...axis, size: 22, gap: 2, values: (_, at) => at.map((nm, i) => i === at.length - 1 ? `${nm} nm` : nm) }, { ...axis, size: 32, gap: 4 }],
      cursor: { y: false, points: { size: 6 }, drag: { x: false, y: false }, focus: { prox: count > 1 ? 24 : -1 },
        bind: { dblclick: () => null } },
      focus: { alpha: 0.25 },
      series: [{}, ...this.curves.map((_, i) => ({ width: 2, points: { show: false }, stroke: () => this.curves[i].colour?.() ?? lineColour(this.curves[i]) })), invisible, invisible],
      bands: [{ series: [count + 1, count + 2], fill: () => this.curves[this.banded] ? lineColour(this.curves[this.banded], 0.28) : "transparent" }],
      hooks: {
        setSeries: [(_, index) => { this.over = index; this.band(index >= 1 && index <= count ? index - 1 : this.chosen); }],
        setCursor: [(plot) => this.say(plot.cursor.idx)],
        ready: [(plot) => plot.over.addEventListener("click", () => { if (this.over >= 1 && this.over <= count) this.onChoose(this.curves[this.over - 1].name); })] } };
  }
  say(idx) {
    if (!this.read) return;
    const one = this.curves[this.curves.length === 1 ? 0 : this.over - 1], at = this.curves.indexOf(one);
    const value = idx === null || idx === undefined || !one ? null : this.columns[at][idx];
    if (value === null) { this.read.textContent = "\u00a0"; return; }
    const [upper, lower] = at === this.banded ? this.plot.data.slice(-2).map((column) => column[idx]) : [null, null];
    this.read.textContent = `${one.name}, ${NM[idx]} nm: ${value.toFixed(3)}` + (lower !== null ? ` (${lower.toFixed(3)} to ${upper.toFixed(3)})` : "");
  }
}

export function swatch(hex) {
  const svg = drawn("svg", { class: "swatch", viewBox: "0 0 20 20", role: "img", "aria-label": `colour ${hex}` });
  svg.append(drawn("rect", { width: 20, height: 20, fill: hex }));
  return svg;
}
export function pairOf(hex) {
  const svg = drawn("svg", { class: "pair", viewBox: "0 0 64 20", preserveAspectRatio: "none", role: "img", "aria-label": `colours ${hex[0]} and ${hex[1]}` });
  hex.forEach((colour, i) => svg.append(drawn("rect", { x: 32 * i, width: 32, height: 20, fill: colour })));
  return svg;
}
export function sparkline({ nm, mean }) {
  const top = Math.max(1, ...mean), points = mean.map((value, i) => `${(60 * (nm[i] - nm[0]) / (nm.at(-1) - nm[0])).toFixed(1)},${(18 - 16 * Math.max(value, 0) / top).toFixed(1)}`);
  return drawn("svg", { class: "spark", viewBox: "0 0 60 20", "aria-hidden": "true" }, drawn("polyline", { points: points.join(" ") }));
}
