// A photo on a canvas: zoom, pan, rectangles drawn by dragging, handles, points. All positions are
// pixels of the photo; only this file knows how they lie on the screen.
const HANDLE = 7;               // half a handle, and how near a press must be, in CSS pixels
const MOVED = 4;                // CSS pixels after which a press is a drag

export class PhotoView {
  constructor(canvas, { onPoint, onPointer, onRect, onDraw, onEdit, onSelect }) {
    this.canvas = canvas; this.context = canvas.getContext("2d");
    Object.assign(this, { onPoint, onPointer, onRect, onDraw, onEdit, onSelect });
    this.image = null; this.size = [1, 1]; this.scale = 1; this.left = 0; this.top = 0;
    this.outlines = []; this.points = []; this.patches = []; this.picks = []; this.selected = ""; this.draws = false;
    this.drag = null; this.rubber = null; this.space = false; this.fingers = new Map(); this.pinch = null;
    canvas.addEventListener("wheel", (event) => { event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1.25 : 0.8, this.at(event)); }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => { this.fingers.delete(event.pointerId); this.cancel(); });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("keyup", (event) => this.keyUp(event));
    canvas.addEventListener("blur", () => { this.space = false; });
    new ResizeObserver(() => this.fitCanvas()).observe(canvas.parentElement);
  }
  show(image, size) { this.image = image; this.size = size; this.fitCanvas(); this.whole(); }
  fitCanvas() {
    const width = Math.max(300, Math.round(this.canvas.parentElement.clientWidth));
    if (this.canvas.width !== width) { this.canvas.width = width; this.canvas.height = Math.round(width / 1.5); }
    this.draw();
  }
  whole() { this.scale = Math.min(this.canvas.width / this.size[0], this.canvas.height / this.size[1]);
    this.left = (this.size[0] - this.canvas.width / this.scale) / 2;
    this.top = (this.size[1] - this.canvas.height / this.scale) / 2; this.draw(); }
  perPixel() { return this.canvas.width / this.canvas.getBoundingClientRect().width / this.scale; }
  at(event) { const box = this.canvas.getBoundingClientRect(); const per = this.perPixel();
    return [this.left + (event.clientX - box.left) * per - 0.5, this.top + (event.clientY - box.top) * per - 0.5]; }
  middle() { return [this.left + this.canvas.width / this.scale / 2 - 0.5, this.top + this.canvas.height / this.scale / 2 - 0.5]; }
  inside([x, y]) { return [Math.min(Math.max(x, -0.5), this.size[0] - 0.5), Math.min(Math.max(y, -0.5), this.size[1] - 0.5)]; }
  zoom(factor, around) {
    const [x, y] = around ?? this.middle(); const next = Math.min(32, Math.max(0.02, this.scale * factor));
    this.left = x + 0.5 - (x + 0.5 - this.left) * this.scale / next;
    this.top = y + 0.5 - (y + 0.5 - this.top) * this.scale / next; this.scale = next; this.draw();
  }

  // What a press begins: panning, an edit of the selected outline, or a rectangle.
  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    if (event.pointerType === "touch") {
      this.fingers.set(event.pointerId, event);
      if (this.fingers.size === 2) { this.cancel(); this.pinch = this.spread(); return; }
      if (this.fingers.size > 2) return;
    }
    const at = this.at(event), pans = !this.draws || this.space || event.button === 1;
    if (event.button > 1) return;
    if (event.button === 1) event.preventDefault();
    const edit = pans ? null : this.editAt(at);
    this.drag = { x: event.clientX, y: event.clientY, left: this.left, top: this.top, at, pans, edit, moved: false };
  }
  move(event) {
    if (this.fingers.has(event.pointerId)) this.fingers.set(event.pointerId, event);
    if (this.pinch) { this.movePinch(); return; }
    const here = this.at(event), { drag } = this;
    if (drag) {
      const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
      if (Math.hypot(dx, dy) > MOVED) drag.moved = true;
      if (drag.moved && drag.pans) { const per = this.perPixel(); this.left = drag.left - dx * per; this.top = drag.top - dy * per; }
      else if (drag.moved && drag.edit) drag.edit.outline = edited(drag.edit, drag.at, this.inside(here));
      else if (drag.moved) { this.rubber = [this.inside(drag.at), this.inside(here)]; this.onDraw(this.rubber); }
      if (drag.moved) this.draw();
    }
    if (!this.rubber) this.onPointer(here);
  }
  up(event) {
    this.fingers.delete(event.pointerId);
    if (this.pinch) { if (!this.fingers.size) this.pinch = null; return; }
    const { drag, rubber } = this; this.drag = this.rubber = null;
    if (!drag) return;
    if (rubber) this.onRect(rubber);
    else if (drag.edit && drag.moved) this.onEdit(drag.edit.name, drag.edit.outline);
    else if (!drag.moved) { const at = this.at(event); if (this.draws) this.select(this.outlineAt(at)); this.onPoint(at); }
    this.draw();
  }
  cancel() { this.drag = this.rubber = null; this.draw(); }
  spread() { const [a, b] = [...this.fingers.values()];
    return { length: Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY), x: (a.clientX + b.clientX) / 2, y: (a.clientY + b.clientY) / 2 }; }
  movePinch() {
    if (this.fingers.size < 2) return;
    const next = this.spread(), per = this.perPixel();
    this.left -= (next.x - this.pinch.x) * per; this.top -= (next.y - this.pinch.y) * per;
    this.zoom(next.length / Math.max(this.pinch.length, 1), this.at({ clientX: next.x, clientY: next.y })); this.pinch = next;
  }

  // The outline under a point, the smallest first; handles of the selected one.
  outlineAt(at) {
    const hit = this.outlines.filter(({ edits, outline }) => edits && within(outline, at));
    return hit.sort((a, b) => area(a.outline) - area(b.outline))[0]?.name ?? "";
  }
  select(name) { if (name !== this.selected) { this.selected = name; this.onSelect(name); this.draw(); } }
  selectedOutline() { return this.outlines.find(({ name, edits }) => edits && name === this.selected); }
  handles({ outline, rect }) { return rect ? rectHandles(outline) : outline; }
  editAt(at) {
    const one = this.selectedOutline(); if (!one) return null;
    const near = HANDLE * 1.5 * this.perPixel();
    const handle = this.handles(one).findIndex(([x, y]) => Math.hypot(x - at[0], y - at[1]) < near);
    if (handle < 0 && !within(one.outline, at)) return null;
    return { name: one.name, rect: one.rect, handle, before: one.outline, outline: one.outline };
  }

  key(event) {
    const step = event.shiftKey ? 10 : 1;
    const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    const chosen = this.selectedOutline();
    if (by) {
      event.preventDefault();
      if (this.points.length) { const last = this.points.at(-1); last[0] += by[0]; last[1] += by[1]; this.onPointer(last); }
      else if (chosen) { chosen.outline = chosen.outline.map(([x, y]) => [x + by[0], y + by[1]]); this.nudged = chosen; }
      else { this.left += by[0] * 10 / this.scale; this.top += by[1] * 10 / this.scale; }
      this.draw();
    } else if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else if (event.key === " ") { event.preventDefault(); this.space = true; }
    else if (event.key === "Escape") { this.cancel(); this.select(""); }
    else if (event.key === "Enter") { event.preventDefault(); this.onPoint(this.middle()); }
  }
  keyUp(event) {
    if (event.key === " ") this.space = false;
    if (this.nudged && event.key.startsWith("Arrow")) { const { name, outline } = this.nudged; this.nudged = null; this.onEdit(name, outline); }
  }

  put(x, y) { return [(x + 0.5 - this.left) * this.scale, (y + 0.5 - this.top) * this.scale]; }
  draw() {
    const { context: c, canvas } = this;
    c.fillStyle = "#111"; c.fillRect(0, 0, canvas.width, canvas.height);
    if (!this.image) return;
    c.imageSmoothingEnabled = this.scale < 2;
    c.drawImage(this.image, -this.left * this.scale, -this.top * this.scale, this.size[0] * this.scale, this.size[1] * this.scale);
    for (const patch of this.patches) this.path(patch, "", "#00e5ff", true, 1);
    for (const { name, outline } of this.outlines) {
      const moving = this.drag?.edit?.name === name && this.drag.edit.outline;
      this.path(moving || outline, name, name === this.selected ? "#fff" : "#ffd400", true);
    }
    const chosen = this.selectedOutline();
    if (chosen) for (const handle of this.handles({ ...chosen, outline: this.drag?.edit?.outline ?? chosen.outline })) this.square(handle);
    for (const { at, label } of this.picks) { this.cross(at, "#fff"); this.label(label, at, "#fff"); }
    if (this.rubber) this.path(rectOutline(this.rubber), "", "#00e5ff", true);
    if (this.points.length) this.path(this.points, "", "#00e5ff", false);
    for (const point of this.points) this.cross(point, "#00e5ff");
  }
  path(outline, name, colour, closed, width = 2) {
    const c = this.context; if (!outline.length) return;
    if (outline.length === 1) this.cross(outline[0], colour);
    else for (const [ink, wide] of [["#000", width + 2], [colour, width]]) {
      c.strokeStyle = ink; c.lineWidth = wide; c.beginPath();
      outline.forEach(([x, y], i) => { const [u, v] = this.put(x, y); i ? c.lineTo(u, v) : c.moveTo(u, v); });
      if (closed) c.closePath(); c.stroke();
    }
    if (name) this.label(name, outline[0], colour);
  }
  label(text, at, colour) {
    const c = this.context, [u, v] = this.put(...at); c.font = "14px system-ui"; c.lineWidth = 4; c.strokeStyle = "#000";
    c.strokeText(text, u + 6, v - 6); c.fillStyle = colour; c.fillText(text, u + 6, v - 6);
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
