// A photo on a canvas: zoom with the wheel, move by dragging, and points in pixels of the photo.
export class PhotoView {
  constructor(canvas, { onPoint, onPointer }) {
    this.canvas = canvas; this.context = canvas.getContext("2d");
    this.onPoint = onPoint; this.onPointer = onPointer;
    this.image = null; this.size = [1, 1]; this.scale = 1; this.left = 0; this.top = 0;
    this.outlines = []; this.points = []; this.drag = null;
    canvas.addEventListener("wheel", (event) => { event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1.25 : 0.8, this.at(event)); }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId);
      this.drag = { x: event.clientX, y: event.clientY, left: this.left, top: this.top, moved: false }; });
    canvas.addEventListener("pointermove", (event) => {
      const here = this.at(event);
      if (this.drag) {
        const [dx, dy] = [event.clientX - this.drag.x, event.clientY - this.drag.y];
        if (Math.hypot(dx, dy) > 4) this.drag.moved = true;
        if (this.drag.moved) { const per = this.perPixel();
          this.left = this.drag.left - dx * per; this.top = this.drag.top - dy * per; this.draw(); }
      }
      this.onPointer(here);
    });
    canvas.addEventListener("pointerup", (event) => {
      const clicked = this.drag && !this.drag.moved; this.drag = null;
      if (clicked) this.onPoint(this.at(event));
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
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
  zoom(factor, around) {
    const [x, y] = around ?? this.middle(); const next = Math.min(32, Math.max(0.02, this.scale * factor));
    this.left = x + 0.5 - (x + 0.5 - this.left) * this.scale / next;
    this.top = y + 0.5 - (y + 0.5 - this.top) * this.scale / next; this.scale = next; this.draw();
  }
  key(event) {
    const step = event.shiftKey ? 10 : 1;
    const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (by) {
      event.preventDefault();
      if (this.points.length) { const last = this.points.at(-1); last[0] += by[0]; last[1] += by[1]; this.onPointer(last); }
      else { this.left += by[0] * 10 / this.scale; this.top += by[1] * 10 / this.scale; }
      this.draw();
    } else if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else if (event.key === "Enter") { event.preventDefault(); this.onPoint(this.middle()); }
  }
  put(x, y) { return [(x + 0.5 - this.left) * this.scale, (y + 0.5 - this.top) * this.scale]; }
  draw() {
    const { context: c, canvas } = this;
    c.fillStyle = "#111"; c.fillRect(0, 0, canvas.width, canvas.height);
    if (!this.image) return;
    c.imageSmoothingEnabled = this.scale < 2;
    c.drawImage(this.image, -this.left * this.scale, -this.top * this.scale, this.size[0] * this.scale, this.size[1] * this.scale);
    for (const { name, outline } of this.outlines) this.path(outline, name, "#ffd400", true);
    if (this.points.length) this.path(this.points, "", "#00e5ff", false);
    for (const point of this.points) this.cross(point, "#00e5ff");
  }
  path(outline, name, colour, closed) {
    const c = this.context; if (!outline.length) return;
    if (outline.length === 1) this.cross(outline[0], colour);
    else for (const [ink, wide] of [["#000", 4], [colour, 2]]) {
      c.strokeStyle = ink; c.lineWidth = wide; c.beginPath();
      outline.forEach(([x, y], i) => { const [u, v] = this.put(x, y); i ? c.lineTo(u, v) : c.moveTo(u, v); });
      if (closed) c.closePath(); c.stroke();
    }
    if (name) { const [u, v] = this.put(...outline[0]); c.font = "14px system-ui"; c.lineWidth = 4; c.strokeStyle = "#000";
      c.strokeText(name, u + 6, v - 6); c.fillStyle = colour; c.fillText(name, u + 6, v - 6); }
  }
  cross([x, y], colour) {
    const c = this.context; const [u, v] = this.put(x, y);
    for (const [ink, wide] of [["#000", 4], [colour, 2]]) { c.strokeStyle = ink; c.lineWidth = wide; c.beginPath();
      c.moveTo(u - 8, v); c.lineTo(u + 8, v); c.moveTo(u, v - 8); c.lineTo(u, v + 8); c.stroke(); }
  }
}
