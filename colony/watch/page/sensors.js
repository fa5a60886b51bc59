// Sensors by their kind: around the robot, over time, as rows, lamps and words.

import { palette, Surface, element, number, setClass, setText } from "./drawing.js";
import { Polar } from "./polar.js";

const SPAN_S = 20;
const HELD_MS = 1000;

export class Sensors {
  /** `tune(name, value)` changes a tunable param; null where it cannot be changed. */
  constructor(hosts, scene, tune) {
    this.hosts = hosts;
    this.views = scene.sensors.map((sensor) => view(sensor, tune));
    this.scene = scene;
    for (const host of Object.values(hosts)) host.replaceChildren();
  }

  show(snapshot) {
    const stale = new Set(snapshot.stale);
    this.views.forEach((view, i) => {
      const value = snapshot.sensors[i];
      if (!view.shown && (value !== null || this.scene.sensors[i].is_read)) this.reveal(view, i);
      if (view.shown) view.show(value, stale.has(i), snapshot.t);
    });
  }

  /** Show a sensor from now on, in its place. */
  reveal(view, i) {
    view.shown = true;
    const later = this.views.slice(i + 1).find((other) => other.shown && other.place === view.place);
    this.hosts[view.place].insertBefore(view.node, later ? later.node : null);
  }

  history(snapshots) {
    this.views.forEach((view, i) => view.reset?.(snapshots.map((s) => [s.t, s.sensors[i]])));
  }
}

function view(sensor, tune) {
  switch (sensor.kind) {
    case "polar": {
      const polar = new Polar(sensor);
      return { place: "polars", node: polar.figure, show: (value, isStale) => polar.show(value, isStale) };
    }
    case "slider":
      return new Slider(sensor, tune);
    case "strip":
      return new Strip(sensor);
    case "lamp":
      return new Lamp(sensor);
    default:
      return new Text(sensor);
  }
}

class Lamp {
  place = "lamps";

  constructor(sensor) {
    this.node = element("li", { class: "lamp" }, element("i"), sensor.name);
    this.name = sensor.name;
  }

  show(value, isStale) {
    setClass(this.node, value === null || isStale ? "lamp missing" : value ? "lamp on" : "lamp");
  }
}

/** An enumerator, or an array without bearings. */
class Text {
  place = "strips";

  constructor(sensor) {
    this.sensor = sensor;
    this.output = element("output", { "aria-live": "off" });
    this.node = element("div", { class: "strip" }, element("span", { title: sensor.name }, sensor.name), element("span"), this.output);
  }

  show(value, isStale) {
    const { words, numbers, unit } = this.sensor;
    const word = (x) => (words.length ? words[numbers.indexOf(Number(x))] ?? "?" : number(x));
    const list = Array.isArray(value) ? value.slice(0, 6).map(word).join(" ") : value === null ? "missing" : word(value);
    setText(this.output, `${list} ${words.length ? "" : unit}`);
    setClass(this.node, value === null || isStale ? "strip missing" : "strip");
  }
}

/** A tunable param within its interval. The value of the frame is shown, but not while a hand is on the slider. */
class Slider {
  place = "strips";

  constructor({ name, low, high, unit }, tune) {
    this.unit = unit;
    const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 1e-6) / 50));
    this.input = element("input", { type: "range", min: low, max: high, step, "aria-label": name });
    this.input.disabled = !tune;
    this.input.addEventListener("input", () => this.hold());
    this.input.addEventListener("change", () => tune(name, this.input.valueAsNumber));
    this.output = element("output", { "aria-live": "off" });
    this.node = element("div", { class: "strip" }, element("span", { title: name }, name), this.input, this.output);
  }

  hold() {
    this.heldUntil = performance.now() + HELD_MS;
    this.write(this.input.valueAsNumber);
  }

  show(value) {
    if (value === null || performance.now() < this.heldUntil) return;
    this.input.value = value;
    this.write(value);
  }

  write(value) {
    setText(this.output, `${number(value)} ${this.unit}`);
  }
}

/** A quantity over the last seconds. */
class Strip {
  place = "strips";

  constructor(sensor) {
    this.sensor = sensor;
    this.points = [];
    this.low = this.high = null;
    this.output = element("output", { "aria-live": "off" });
    const canvas = element("canvas", { role: "img", "aria-label": `${sensor.name} over the last ${SPAN_S} seconds` });
    this.node = element("div", { class: "strip" }, element("span", { title: `${sensor.name}, ${sensor.origin}` }, sensor.name), canvas, this.output);
    this.surface = new Surface(canvas, (context, width, height) => this.draw(context, width, height));
  }

  reset(points) {
    this.points = points;
  }

  show(value, isStale, t) {
    const last = this.points.at(-1);
    if (last && t < last[0]) this.points = [];
    if (!last || t > last[0]) this.points.push([t, value]);
    while (this.points.length && this.points[0][0] < t - SPAN_S) this.points.shift();
    this.t = t;
    setText(this.output, value === null ? "missing" : `${number(value)} ${this.sensor.unit}`);
    setClass(this.node, value === null || isStale ? "strip missing" : "strip");
    this.surface.redraw();
  }

  draw(context, width, height) {
    context.strokeStyle = palette.line;
    context.strokeRect(0.5, 0.5, width - 1, height - 1);
    let low = Infinity;
    let high = -Infinity;
    for (const [, value] of this.points) {
      if (value !== null) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (low > high) return;
    const room = Math.max((high - low) * 0.1, Math.abs(high) * 0.01, 1e-9);
    this.low = widen(this.low, low - room, Math.min);
    this.high = widen(this.high, high + room, Math.max);
    context.strokeStyle = palette.live;
    context.lineWidth = 1.4;
    context.beginPath();
    let isDown = false;
    for (const [t, value] of this.points) {
      const x = width * (1 - (this.t - t) / SPAN_S);
      const y = height - 2 - ((value - this.low) / (this.high - this.low)) * (height - 4);
      if (value === null) isDown = false;
      else if (isDown) context.lineTo(x, y);
      else context.moveTo(x, y);
      isDown = value !== null;
    }
    context.stroke();
  }
}

/** The end of a scale moves out at once, and in slowly. */
function widen(end, wanted, choose) {
  return end === null ? wanted : choose(wanted, end + (wanted - end) * 0.02);
}
