// A photo that fills its part of the window: OpenSeadragon shows its tiles, zooms and moves them; what is
// marked lies on a canvas above. All positions are pixels of the photo; only this file knows how they lie
// on the screen.
import { headers } from "./server.js";
const { OpenSeadragon } = window;
const HANDLE = 7, FINGER = 18;  // how near a press must be to a handle, in CSS pixels: of a mouse, of a finger
const MOVED = 4;                // CSS pixels after which a press is a drag
const LONG_MS = 450;            // after which a finger that stays draws
const TAPPED = 14;              // CSS pixels, half a side of what a long press alone marks

export class PhotoView {
  constructor(host, handlers) {
    this.host = host; this.on = handlers;       // point, pointer, leave, rect, draw, edit, select
    Object.assign(this, { size: null, step: 1, scale: 1, left: 0, top: 0, outlines: [], points: [], patches: [],
      picks: [], selected: "", draws: false, drag: null, rubber: null, space: false, atHome: true, middle: null });
    this.viewer = OpenSeadragon({ element: host, showNavigationControl: false, drawer: "canvas", animationTime: 0.35,
      springStiffness: 9, zoomPerScroll: 1.25, minZoomImageRatio: 0.5, maxZoomPixelRatio: 48, visibilityRatio: 0.4,
      loadTilesWithAjax: true, ajaxHeaders: headers, keyboardNavEnabled: false, tabIndex: -1, imageLoaderLimit: 4,
      minPixelRatio: 0.9, gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: false },
      gestureSettingsTouch: { clickToZoom: false, dblClickToZoom: false, pinchRotate: false } });
    this.canvas = document.createElement("canvas"); this.canvas.className = "marks"; this.context = this.canvas.getContext("2d");
    this.viewer.container.append(this.canvas);
    const listen = (name, does) => this.viewer.addHandler(name, does);
    listen("update-viewport", () => this.follow());
    listen("after-resize", () => queueMicrotask(() => { this.fitCanvas(); if (this.atHome) this.whole(true); }));
    listen("canvas-press", (event) => this.down(event));
    listen("canvas-drag", (event) => { if (this.drag && !this.drag.pans) event.preventDefaultAction = true; else this.atHome = false; this.move(event.position); });
    listen("canvas-drag-end", (event) => { if (this.drawn) event.preventDefaultAction = true; });
    listen("canvas-release", (event) => this.up(event.position));
    listen("canvas-scroll", () => { this.atHome = false; });
    listen("canvas-pinch", () => { this.atHome = false; this.cancel(); });
    listen("canvas-nonprimary-press", ({ button, originalEvent }) => { if (button === 1) { originalEvent.preventDefault(); this.middle = originalEvent; } });
    listen("canvas-nonprimary-release", () => { this.middle = null; });
    host.addEventListener("pointermove", (event) => this.hover(event));
    host.addEventListener("pointerleave", () => this.on.leave());
    host.addEventListener("keydown", (event) => this.key(event));
    host.addEventListener("keyup", (event) => this.keyUp(event));
    host.addEventListener("blur", () => { this.space = false; });
    host.addEventListener("contextmenu", (event) => { if (this.drag?.long) event.preventDefault(); });
    this.fitCanvas();
  }

  // A photo, by what the server says of its tiles and where they are.
  show({ size, step, pixels: [width, height], tile }, addressOf) {
    const top = Math.max(0, Math.ceil(Math.log2(Math.max(width, height) / tile)));
    return new Promise((done, failed) => {
      this.viewer.addOnceHandler("open", () => { Object.assign(this, { size, step }); this.whole(true); done(); });
      this.viewer.addOnceHandler("open-failed", ({ message }) => failed(new Error(message)));
      this.source = (address) => ({ width, height, tileSize: tile, tileOverlap: 0, minLevel: 0, maxLevel: top,
        getTileUrl: (level, column, row) => address(top - level, column, row) });
      this.viewer.open(this.source(addressOf));
    });
  }
  // The same photo in other colours, where it lies now.
  recolour(addressOf) {
    return new Promise((done, failed) => this.viewer.addTiledImage({ tileSource: this.source(addressOf), index: 0, replace: true,
      success: done, error: ({ message }) => failed(new Error(message)) }));
  }
  fitCanvas() {
    const { clientWidth: width, clientHeight: height } = this.host, dots = devicePixelRatio || 1;
    this.canvas.width = width * dots; this.canvas.height = height * dots;
    this.context.setTransform(dots, 0, 0, dots, 0, 0); this.draw();
  }
  whole(atOnce = false) { this.atHome = true; this.viewer.viewport?.goHome(atOnce); }
  zoom(factor) { this.atHome = false; this.viewer.viewport.zoomBy(factor); this.viewer.viewport.applyConstraints(); }

  // Where the photo lies now, in CSS pixels; asked for by every frame.
  follow() {
    const { viewport } = this.viewer; if (!this.size || !viewport) return;
    const at = (x) => viewport.pixelFromPoint(viewport.imageToViewportCoordinates(x, 0), true);
    const [from, to] = [at(0), at(1000)];
    Object.assign(this, { left: from.x, top: from.y, scale: (to.x - from.x) / 1000 / this.step });
    this.viewer.drawer?.setImageSmoothingEnabled?.(this.scale * this.step < 2);
    this.host.dataset.view = [this.left, this.top, this.scale].map((one) => one.toFixed(4)).join(" ");
    this.paint();
  }
  put(x, y) { return [this.left + (x + 0.5) * this.scale, this.top + (y + 0.5) * this.scale]; }
  at({ x, y }) { return [(x - this.left) / this.scale - 0.5, (y - this.top) / this.scale - 0.5]; }
  centre() { return this.at({ x: this.host.clientWidth / 2, y: this.host.clientHeight / 2 }); }
  inside([x, y]) { return [Math.min(Math.max(x, -0.5), this.size[0] - 0.5), Math.min(Math.max(y, -0.5), this.size[1] - 0.5)]; }
  holds([x, y]) { return Boolean(this.size) && x > -0.5 && y > -0.5 && x < this.size[0] - 0.5 && y < this.size[1] - 0.5; }

  // What a press begins: moving the photo, an edit of the selected outline, or a rectangle.
  down({ position, originalEvent: { pointerType } }) {
    if (!this.size) return;
    this.host.focus({ preventScroll: true });
    const at = this.at(position), finger = pointerType === "touch", edit = this.space ? null : this.editAt(at, finger ? FINGER : HANDLE * 1.5);
    this.drawn = false;
    this.drag = { from: position, at, finger, edit, pans: this.space || !(this.draws || edit), moved: false, long: false };
    clearTimeout(this.held);
    if (finger && this.drag.pans) this.held = setTimeout(() => this.longPress(), LONG_MS);
  }
  longPress() {
    const { drag } = this; if (!drag || drag.moved) return;
    Object.assign(drag, { pans: false, long: true }); navigator.vibrate?.(15);
    this.rubber = this.squareAt(drag.at, TAPPED); this.draw();
  }
  move(position) {
    const { drag } = this; if (!drag) return;
    const here = this.at(position);
    if (Math.hypot(position.x - drag.from.x, position.y - drag.from.y) > (drag.finger ? 2 * MOVED : MOVED)) drag.moved = true;
    if (!drag.moved) return;
    if (drag.pans) { clearTimeout(this.held); return; }
    this.drawn = true;
    if (drag.edit) drag.edit.outline = edited(drag.edit, drag.at, this.inside(here));
    else { this.rubber = [this.inside(drag.at), this.inside(here)]; this.on.draw(this.rubber); }
    this.draw();
  }
  up(position) {
    clearTimeout(this.held);
    const { drag, rubber } = this; this.drag = this.rubber = null;
    if (!drag) return;
    const at = this.at(position);
    if (rubber) this.on.rect(rubber, drag.finger);
    else if (drag.edit && drag.moved) this.on.edit(drag.edit.name, drag.edit.outline);
    else if (!drag.moved) {
      if (drag.finger) this.on.pointer(at);
      this.on.point(at);
    }
    this.draw();
  }
  hover(event) {
    const box = this.host.getBoundingClientRect(), here = { x: event.clientX - box.left, y: event.clientY - box.top };
    if (this.middle) {
      const by = new OpenSeadragon.Point(this.middle.clientX - event.clientX, this.middle.clientY - event.clientY);
      this.viewer.viewport.panBy(this.viewer.viewport.deltaPointsFromPixels(by), true); this.middle = event; this.atHome = false;
    } else if (!this.drag && event.pointerType !== "touch") {
      const at = this.at(here), edit = this.space ? null : this.editAt(at, HANDLE * 1.5);
      this.host.dataset.over = edit ? "mark" : this.draws ? "draw" : "photo"; this.on.pointer(at);
    }
  }
  cancel() { clearTimeout(this.held); this.drag = this.rubber = null; this.draw(); }

  // The outline under a point, the smallest first; handles of the selected one.
  outlineAt(at) {
    const hit = this.outlines.filter(({ selects, outline }) => selects && within(outline, at));
    return hit.sort((a, b) => area(a.outline) - area(b.outline))[0]?.name ?? "";
  }
  select(name) { if (name !== this.selected) { this.selected = name; this.on.select(name); this.draw(); } }
  selectedOutline() { return this.outlines.find(({ name, edits }) => edits && name === this.selected); }
  handles({ outline, rect }) { return rect ? rectHandles(outline) : outline; }
  editAt(at, near) {
    const one = this.selectedOutline(); if (!one) return null;
    const handle = this.handles(one).findIndex(([x, y]) => Math.hypot(x - at[0], y - at[1]) < near / this.scale);
    if (handle < 0 && !within(one.outline, at)) return null;
    return { name: one.name, rect: one.rect, handle, before: one.outline, outline: one.outline };
  }
  squareAt([x, y], half) {
    const side = Math.max(half / this.scale, 6);
    return [this.inside([x - side, y - side]), this.inside([x + side, y + side])];
  }

  key(event) {
    if (!this.size || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 10 : 1;
    const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    const chosen = this.selectedOutline();
    if (by) {
      event.preventDefault();
      if (this.points.length) { const last = this.points.at(-1); last[0] += by[0]; last[1] += by[1]; this.on.pointer(last); }
      else if (chosen) { chosen.outline = chosen.outline.map(([x, y]) => [x + by[0], y + by[1]]); this.nudged = chosen; }
      else { this.atHome = false; this.viewer.viewport.panBy(this.viewer.viewport.deltaPointsFromPixels(new OpenSeadragon.Point(by[0] * 40, by[1] * 40))); }
      this.draw();
    } else if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else if (event.key === " ") { event.preventDefault(); this.space = true; }
    else if (event.key === "Escape") { this.cancel(); this.select(""); }
    else if (event.key === "Enter") { event.preventDefault(); this.on.point(this.centre(), true); }
  }
  keyUp(event) {
    if (event.key === " ") this.space = false;
    if (this.nudged && event.key.startsWith("Arrow")) { const { name, outline } = this.nudged; this.nudged = null; this.on.edit(name, outline); }
  }

  // Marks are painted once a frame, however often something changes.
  draw() { this.asked ??= requestAnimationFrame(() => { this.asked = null; this.paint(); }); }
  paint() {
    const { context: c } = this;
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.size) return;
    for (const patch of this.patches) this.path(patch, "", "#fff", true, 1);
    for (const { name, outline, labels } of this.outlines) {
      const moving = this.drag?.edit?.name === name && this.drag.edit.outline;
      this.path(moving || outline, labels ? "" : name, name === this.selected ? "#fff" : "#ffd400", true);
    }
    const chosen = this.selectedOutline();
    if (chosen) this.handles({ ...chosen, outline: this.drag?.edit?.outline ?? chosen.outline }).forEach((handle, i) => {
      this.square(handle); if (chosen.labels) this.label(chosen.labels[i], handle, "#fff"); });
    for (const { at, label } of this.picks) { this.cross(at, "#fff"); this.label(label, at, "#fff"); }
    if (this.rubber) this.path(rectOutline(this.rubber), "", "#fff", true);
    if (this.points.length) this.path(this.points, "", "#fff", false);
    for (const point of this.points) this.cross(point, "#fff");
  }
  path(outline, name, colour, closed, width = 2) {
    const c = this.context; if (!outline.length) return;
    if (outline.length === 1) this.cross(outline[0], colour);
    else for (const [ink, wide] of [["#000", width + 2], [colour, width]]) {
      c.strokeStyle = ink; c.lineWidth = wide; c.beginPath();
      outline.forEach(([x, y], i) => { const [u, v] = this.put(x, y); i ? c.lineTo(u, v) : c.moveTo(u, v); });
      if (closed) c.closePath(); c.stroke();
    }
    if (name) this.label(name === this.selected ? name : this.shortened(name, outline), outline[0], colour);
  }
  // Of many marks each name gets the room of its mark; the whole name is in the list.
  shortened(name, outline) {
    if (this.outlines.length < 9) return name;
    const across = outline.map(([x]) => x), room = Math.floor(this.scale * (Math.max(...across) - Math.min(...across)) / 6.5);
    const number = /\d*$/.exec(name)[0], stem = room - 1 - number.length;
    return name.length <= room ? name : stem < 1 ? "" : `${name.slice(0, stem)}…${number}`;
  }
  label(text, at, colour) {
    const c = this.context, [u, v] = this.put(...at); c.font = "13px system-ui, sans-serif"; c.lineWidth = 3; c.lineJoin = "round"; c.strokeStyle = "#000";
    c.strokeText(text, u + 2, v - 6); c.fillStyle = colour; c.fillText(text, u + 2, v - 6);
  }
  square([x, y]) {
    const c = this.context, [u, v] = this.put(x, y), half = HANDLE * 0.6;
    c.fillStyle = "#fff"; c.strokeStyle = "#000"; c.lineWidth = 1;
    c.fillRect(u - half, v - half, 2 * half, 2 * half); c.strokeRect(u - half, v - half, 2 * half, 2 * half);
  }
  cross([x, y], colour) {
    const c = this.context; const [u, v] = this.put(x, y);
    for (const [ink, wide] of [["#000", 4], [colour, 2]]) { c.strokeStyle = ink; c.lineWidth = wide; c.beginPath();
      c.moveTo(u - 8, v); c.lineTo(u + 8, v); c.moveTo(u, v - 8); c.lineTo(u, v + 8); c.stroke(); }
  }
}

const rectOutline = ([[x0, y0], [x1, y1]]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

// Corners and middles of the sides of a rectangle, going round from its first corner.
function rectHandles([a, b, c, d]) {
  const mid = (p, q) => [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
  return [a, mid(a, b), b, mid(b, c), c, mid(c, d), d, mid(d, a)];
}

// The outline after its handle (or all of it) was dragged.
function edited({ rect, handle, before }, from, to) {
  const by = [to[0] - from[0], to[1] - from[1]];
  if (handle < 0) return before.map(([x, y]) => [x + by[0], y + by[1]]);
  if (!rect) return before.map((corner, i) => i === handle ? to : corner);
  let [[x0, y0], , [x1, y1]] = before;
  if ([0, 6, 7].includes(handle)) x0 = to[0];
  if ([2, 3, 4].includes(handle)) x1 = to[0];
  if ([0, 1, 2].includes(handle)) y0 = to[1];
  if ([4, 5, 6].includes(handle)) y1 = to[1];
  return rectOutline([[x0, y0], [x1, y1]]);
}

function within(outline, [x, y]) {
  let odd = false;
  outline.forEach(([xa, ya], i) => { const [xb, yb] = outline[(i + 1) % outline.length];
    if ((ya > y) !== (yb > y) && x < (xb - xa) * (y - ya) / (yb - ya) + xa) odd = !odd; });
  return odd;
}

function area(outline) {
  return Math.abs(outline.reduce((sum, [x, y], i) => { const [u, v] = outline[(i + 1) % outline.length]; return sum + x * v - u * y; }, 0)) / 2;
}
