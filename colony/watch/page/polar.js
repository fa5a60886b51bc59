// Arrays with bearings, around the robot: ahead is up, and bearings grow counterclockwise.

import { palette, Surface, element, number } from "./drawing.js";

const WIDEST_DEG = 30;

export class Polar {
  constructor(sensor) {
    this.sensor = sensor;
    this.values = null;
    this.canvas = element("canvas", { role: "img", "aria-label": `${sensor.name} around the robot` });
    this.caption = element("figcaption", {}, sensor.name);
    this.figure = element("figure", { class: "polar" }, this.canvas, this.caption);
    this.halves = halfWidths(sensor.bearings);
    this.top = sensor.high;
    this.surface = new Surface(this.canvas, (context, width, height) => this.draw(context, width, height));
  }

  show(values, isStale) {
    this.values = values;
    this.isStale = isStale;
    if (values && !this.sensor.words.length && this.top === null) {
      this.top = Math.max(1, ...values.filter((x) => x !== null));
    }
    this.caption.textContent = this.text(values);
    this.surface.redraw();
  }

  text(values) {
    const { name, unit, words, is_distance, high } = this.sensor;
    if (!values) return `${name}: missing`;
    if (words.length) return `${name}: ${values.filter((x) => x === true).length} of ${values.length}`;
    const seen = values.filter((x) => x !== null && (!is_distance || high === null || x < high));
    if (!seen.length) return `${name}: nothing within ${number(high)} ${unit}`;
    const best = is_distance ? Math.min(...seen) : Math.max(...seen);
    return `${name}: ${is_distance ? "nearest" : "highest"} ${number(best)} ${unit}`;
  }

  draw(context, width, height) {
    const radius = Math.min(width, height) / 2 - 4;
    const reach = this.scale();
    context.translate(width / 2, height / 2);
    context.lineWidth = 1;
    context.strokeStyle = palette.line;
    context.fillStyle = palette.muted;
    context.font = "10px sans-serif";
    for (const ring of [0.25, 0.5, 0.75, 1]) {
      context.beginPath();
      context.arc(0, 0, radius * ring, 0, 7);
      context.stroke();
    }
    if (this.values) this.sectors(context, radius, reach);
    if (!this.sensor.words.length) {
      context.fillStyle = palette.muted;
      context.fillText(`${number(reach)} ${this.sensor.unit}`, 3, radius - 4);
    }
    context.fillStyle = palette.ink;
    context.beginPath();
    context.moveTo(0, -7);
    context.lineTo(5, 6);
    context.lineTo(-5, 6);
    context.fill();
  }

  /** The value of the outermost ring. It follows the values in steps of two, so that nothing jumps. */
  scale() {
    const { high, is_distance, words } = this.sensor;
    if (words.length) return 1;
    if (!is_distance || high === null) return this.top ?? 1;
    const seen = (this.values ?? []).filter((x) => x !== null && x < high);
    const far = Math.max(0, ...seen);
    this.reach ??= high;
    while (this.reach / 2 >= 1 && far < this.reach * 0.4) this.reach /= 2;
    while (far > this.reach && this.reach < high) this.reach = Math.min(high, this.reach * 2);
    return this.reach;
  }

  sectors(context, radius, reach) {
    const { bearings, is_distance, high, words } = this.sensor;
    context.fillStyle = this.isStale ? palette.line : palette["live-soft"];
    context.strokeStyle = this.isStale ? palette.muted : palette.scan;
    const edges = new Path2D();
    const areas = new Path2D();
    for (let i = 0; i < bearings.length; i += 1) {
      const value = this.values[i];
      if (value === null || value === false) continue;
      if (words.length && value !== true && !(value > 0)) continue;
      const isOpen = is_distance && high !== null && value >= high;
      const length = words.length ? radius : radius * Math.min(1, Math.max(0, value / reach));
      const middle = -Math.PI / 2 - (bearings[i] * Math.PI) / 180;
      const [from, to] = [middle - this.halves[i], middle + this.halves[i]];
      areas.moveTo(0, 0);
      areas.arc(0, 0, length, from, to);
      areas.closePath();
      if (isOpen || value > reach) continue;
      edges.moveTo(length * Math.cos(from), length * Math.sin(from));
      edges.arc(0, 0, length, from, to);
    }
    context.fill(areas);
    context.lineWidth = 2;
    context.stroke(edges);
  }
}

/** Half the width of each element's sector in radians: halfway to its nearest neighbor. */
function halfWidths(bearings) {
  const sorted = [...new Set(bearings)].sort((a, b) => a - b);
  return bearings.map((angle) => {
    const place = sorted.indexOf(angle);
    const before = (angle - sorted.at(place - 1) + 360) % 360 || 360;
    const after = (sorted[(place + 1) % sorted.length] - angle + 360) % 360 || 360;
    return (Math.min(before, after, WIDEST_DEG) / 2) * (Math.PI / 180);
  });
}
