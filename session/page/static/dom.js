// Elements made of text; nothing that a server or a person wrote is parsed as HTML.
const SVG = "http://www.w3.org/2000/svg";
export const $ = (id) => document.getElementById(id);

export function make(tag, { text, className, on = {}, data = {}, ...properties } = {}, ...children) {
  const one = document.createElement(tag);
  if (text !== undefined) one.textContent = text;
  if (className) one.className = className;
  for (const [name, value] of Object.entries(properties)) if (name.startsWith("aria-") || name === "role") one.setAttribute(name, value); else one[name] = value;
  for (const [name, does] of Object.entries(on)) one.addEventListener(name, does);
  Object.assign(one.dataset, data);
  one.append(...children.filter((child) => child !== null && child !== undefined));
  return one;
}
export const button = (text, does, properties = {}) => make("button", { text, type: "button", on: { click: does }, ...properties });
export const labelled = (text, control) => make("label", { className: "known" }, make("span", { text }), control);

export function drawn(tag, attributes = {}, ...children) {
  const one = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
  one.append(...children);
  return one;
}

export function choice(options, value, does) {
  const one = make("select", { on: { change: () => does(one.value) } },
    ...options.map(([key, text]) => make("option", { value: key, text })));
  one.value = value;
  return one;
}

// One panel at a time, beside what opened it.
let filled = "";
export function showPanel(anchor, key, nodes, label) {
  const panel = $("panel");
  if (panel.matches(":popover-open") && filled === key) { panel.hidePopover(); return; }
  panel.replaceChildren(...nodes); panel.setAttribute("aria-label", label); filled = key;
  panel.hidePopover(); panel.showPopover();
  const from = anchor.getBoundingClientRect(), { offsetWidth: width, offsetHeight: height } = panel;
  const left = Math.min(Math.max(8, from.left), Math.max(8, innerWidth - width - 8));
  const below = from.bottom + 6, top = below + height < innerHeight ? below : Math.max(8, from.top - height - 6);
  panel.style.left = `${left}px`; panel.style.top = `${top}px`;
  panel.querySelector("input, select, button, a")?.focus({ preventScroll: true });
}
export const panelShows = (key) => filled === key && $("panel").matches(":popover-open");
export const closePanel = () => { if ($("panel").matches(":popover-open")) $("panel").hidePopover(); };
