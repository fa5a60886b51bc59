// Commands against their limits, contracts, and memory.

import { element, number, setClass, setText } from "./drawing.js";

const SVG = "http://www.w3.org/2000/svg";
const SIGNS = { held: "✓", broken: "✕", unknown: "?" };

export class Commands {
  constructor(host, scene) {
    this.views = scene.actuators.map((actuator) => {
      const note = element("small");
      const fault = element("span", { class: "fault" });
      const fields = actuator.fields.map((field) => new Field(field));
      const title = element("h3", {}, `${actuator.name} `, note, fault);
      const node = element("div", { class: "command" }, title, ...fields.map((f) => f.node));
      return { note, fault, fields, node };
    });
    host.replaceChildren(...this.views.map((view) => view.node));
  }

  show(snapshot) {
    this.views.forEach((view, i) => {
      const command = snapshot.commands[i];
      setText(view.note, whom(command));
      setText(view.fault, command.fault ? ` ${command.fault}` : "");
      view.fields.forEach((field, k) =>
        field.show(command.sent?.[k] ?? null, command.low[k], command.high[k], command.heard?.[k] ?? null),
      );
    });
  }
}

function whom({ by, outside, hold, is_decided, sent }) {
  if (!is_decided) return "not heard";
  if (outside) return `by ${outside}, from outside`;
  if (hold) return hold === "stopped" ? "emergency stop" : "locked";
  return by ? `by ${by}` : sent ? "idle" : "holds";
}

class Field {
  constructor(field) {
    this.field = field;
    this.most = Math.max(Math.abs(field.low ?? 0), Math.abs(field.high ?? 0)) || null;
    this.bars = {};
    this.svg = document.createElementNS(SVG, "svg");
    this.svg.setAttribute("viewBox", "-100 0 200 16");
    this.svg.setAttribute("preserveAspectRatio", "none");
    this.svg.setAttribute("aria-hidden", "true");
    for (const [name, y, height] of [["range", 3, 10], ["limits", 3, 10], ["zero", 1, 14], ["sent", 5, 6], ["end", 1, 14]]) {
      const bar = document.createElementNS(SVG, "rect");
      bar.setAttribute("class", name);
      bar.setAttribute("y", y);
      bar.setAttribute("height", height);
      this.bars[name] = bar;
      this.svg.append(bar);
    }
    this.output = element("output", { "aria-live": "off" });
    this.node = element("div", { class: "field" }, element("span", { title: field.name }, field.name), this.svg, this.output);
  }

  show(sent, low, high, heard) {
    const { words, numbers, unit } = this.field;
    const shown = (value) => (words.length ? words[numbers.indexOf(Number(value))] : number(value));
    const beside = heard === null ? "" : ` (controller ${shown(heard)})`;
    setText(this.output, (sent === null ? "–" : `${shown(sent)} ${unit}`) + beside);
    const value = Number(sent ?? 0);
    this.most = Math.max(this.most ?? 0, Math.abs(value), Math.abs(low ?? 0), Math.abs(high ?? 0)) || 1;
    place(this.bars.range, this.x(this.field.low ?? -this.most), this.x(this.field.high ?? this.most));
    place(this.bars.limits, this.x(low ?? -this.most), this.x(high ?? this.most));
    place(this.bars.zero, -0.4, 0.4);
    place(this.bars.sent, Math.min(0, this.x(value)), Math.max(0, this.x(value)));
    const near = this.most * 1e-6;
    const isAt = sent !== null && value !== 0 && ((high !== null && value >= high - near) || (low !== null && value <= low + near));
    place(this.bars.end, this.x(value) - (value > 0 ? 1.5 : 0), this.x(value) + (value > 0 ? 0 : 1.5));
    this.bars.end.setAttribute("visibility", isAt ? "visible" : "hidden");
  }

  x(value) {
    return Math.max(-100, Math.min(100, (value / this.most) * 100));
  }
}

function place(bar, from, to) {
  bar.setAttribute("x", from.toFixed(2));
  bar.setAttribute("width", Math.max(0, to - from).toFixed(2));
}

// A sequence is a row of its phases: tasks in order, and around them where it waits and ends.
function sequence(state) {
  const phases = state.words.map((word) => {
    const kind = state.tasks.includes(word) ? "task" : "end";
    return { word, node: element("li", { class: kind }, word) };
  });
  const row = element("ol", { "aria-label": `tasks of ${state.name}` }, ...phases.map((p) => p.node));
  return { state, phases, node: element("li", { class: "sequence" }, `${state.name} `, row) };
}

function markPresent(phases, present) {
  phases.forEach(({ word, node }) => {
    if (word !== present) node.removeAttribute("aria-current");
    else if (!node.hasAttribute("aria-current")) node.setAttribute("aria-current", "step");
  });
}

export class Judged {
  constructor(hosts, scene) {
    this.scene = scene;
    this.contracts = scene.contracts.map((name) => {
      const sign = element("i", { "aria-hidden": "true" });
      const note = element("small");
      return { sign, name, note, node: element("li", {}, sign, name, note) };
    });
    this.states = scene.states.map((state) => {
      if (state.tasks.length) return sequence(state);
      const value = element("b");
      return { state, value, node: element("li", {}, `${state.name} `, value) };
    });
    hosts.contracts.replaceChildren(...this.contracts.map((c) => c.node));
    hosts.states.replaceChildren(...this.states.map((s) => s.node));
  }

  show(snapshot) {
    this.contracts.forEach(({ sign, node, name, note }, i) => {
      const state = snapshot.contracts[i];
      setText(sign, SIGNS[state]);
      setText(note, snapshot.heard_broken.includes(i) ? " broken by the controller" : "");
      if (node.getAttribute("class") !== state) {
        node.setAttribute("class", state);
        node.setAttribute("title", `${name}: ${state}`);
      }
    });
    this.states.forEach(({ state, value, phases }, i) => {
      const x = snapshot.states[i];
      const word = state.words.length && x !== null ? state.words[state.numbers.indexOf(Number(x))] : null;
      if (phases) return markPresent(phases, word);
      setText(value, word ?? `${number(x === null || typeof x === "boolean" ? x : x * state.factor)} ${state.unit}`);
    });
  }
}
