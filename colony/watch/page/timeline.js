// The timeline: who commanded, what began where, and the position.

import { palette, Surface } from "./drawing.js";

const MARKS = [
  [2, "bad", "square"], [4, "warn", "triangle"], [8, "warn", "circle"], [16, "bad", "bar"], [32, "muted", "bar"],
];

export class Timeline {
  constructor(canvas, onSeek) {
    this.canvas = canvas;
    this.onSeek = onSeek;
    this.data = null;
    this.t = 0;
    this.surface = new Surface(canvas, (context, width, height) => this.draw(context, width, height));
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.seekTo(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.seekTo(event);
    });
  }

  seekTo(event) {
    if (!this.data) return;
    const box = this.canvas.getBoundingClientRect();
    const part = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    this.onSeek(this.data.first + part * (this.data.last - this.data.first));
  }

  /** Show nothing, until data come. */
  clear() {
    this.data = null;
    this.surface.redraw();
  }

  load(data) {
    this.data = data;
    this.canvas.setAttribute("aria-valuemin", data.first.toFixed(1));
    this.canvas.setAttribute("aria-valuemax", data.last.toFixed(1));
    this.surface.redraw();
  }

  show(t) {
    this.t = t;
    if (this.data) this.data.last = Math.max(this.data.last, t);
    const text = t.toFixed(1);
    if (this.canvas.getAttribute("aria-valuenow") !== text) {
      this.canvas.setAttribute("aria-valuenow", text);
      this.canvas.setAttribute("aria-valuetext", `${text} seconds`);
    }
    this.surface.redraw();
  }

  draw(context, width, height) {
    context.fillStyle = palette.faint;
    context.fillRect(0, 14, width, 10);
    if (!this.data?.times.length) return;
    const { first, last, times, winners, marks } = this.data;
    const x = (t) => (last > first ? (t - first) / (last - first) : 1) * width; // a run of one frame ends with it
    for (let i = 0; i < times.length; i += 1) {
      const from = x(times[i]);
      const to = i + 1 < times.length ? x(times[i + 1]) : x(last);
      if (winners[i] >= 0) {
        context.fillStyle = palette.winners[winners[i] % palette.winners.length];
        context.fillRect(Math.floor(from), 14, Math.max(1, Math.ceil(to) - Math.floor(from)), 10);
      }
      for (const [bit, color, shape] of MARKS) if (marks[i] & bit) mark(context, shape, palette[color], from);
    }
    const here = x(this.t);
    context.fillStyle = palette.ink;
    context.fillRect(here - 1, 8, 2, height - 8);
    context.beginPath();
    context.arc(here, height - 5, 4.5, 0, 7);
    context.fill();
  }
}

function mark(context, shape, color, x) {
  context.fillStyle = color;
  context.beginPath();
  if (shape === "circle") context.arc(x, 6, 4, 0, 7);
  else if (shape === "square") context.rect(x - 3.5, 2.5, 7, 7);
  else if (shape === "bar") context.rect(x - 1.5, 1, 3, 10);
  else {
    context.moveTo(x, 1);
    context.lineTo(x + 4.5, 10);
    context.lineTo(x - 4.5, 10);
  }
  context.fill();
}
