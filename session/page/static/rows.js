// Small drawings in rows: the colour, and its spectrum.
import { drawn } from "./dom.js";

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
