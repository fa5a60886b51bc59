// The network: wires that carry commands, modules and their states, time constants that run down.

import { setClass, setText } from "./drawing.js";

const SVG = "http://www.w3.org/2000/svg";
const LARGE_HEIGHT = 1100;
const LARGEST_SCALE = 1.4;
const READABLE_SCALE = 0.8;
const CLASSES = {
  won: "won", active: "active", suppressed: "active", inhibited: "active", overruled: "trouble",
  overridden: "active", "locked out": "active", stopped: "active", inactive: "inactive", silent: "silent",
  unknown: "unknown", late: "trouble", lost: "trouble", refused: "trouble",
};

export class Network {
  constructor(host, zoom, scene, onChoose) {
    this.scene = scene;
    this.chosen = null;
    const svg = document.importNode(
      new DOMParser().parseFromString(scene.network, "image/svg+xml").documentElement, true);
    svg.setAttribute("role", "group");
    svg.setAttribute("aria-label", "the network");
    host.replaceChildren(svg);
    const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    svg.style.maxWidth = `${width * LARGEST_SCALE}px`;
    svg.style.setProperty("--width", `${width * READABLE_SCALE}px`);
    svg.style.margin = "0 auto";
    const isLarge = height > LARGE_HEIGHT;
    host.classList.toggle("large", isLarge);
    zoom.hidden = !isLarge;
    zoom.onclick = () => zoom.setAttribute("aria-pressed", host.classList.toggle("readable"));
    this.wires = [...svg.querySelectorAll(".wire")].map((wire) => {
      const kind = wire.getAttribute("class");
      return { wire, kind, from: Number(wire.dataset.from), key: `${wire.dataset.from}>${wire.dataset.to}` };
    });
    this.actuators = [...svg.querySelectorAll(".actuator")].map((box) => ({ box, name: box.dataset.name }));
    this.nodes = [...svg.querySelectorAll("g[data-node].suppressor, g[data-node].inhibitor")].map((group) =>
      this.node(group));
    this.modules = [...svg.querySelectorAll(".module")].map((group) => this.module(group, onChoose));
  }

  node(group) {
    const index = Number(group.dataset.node);
    const circle = group.querySelector("circle");
    let timer = null;
    if (this.scene.windows[index]) {
      timer = document.createElementNS(SVG, "circle");
      const { cx, cy } = { cx: circle.getAttribute("cx"), cy: circle.getAttribute("cy") };
      for (const [name, value] of Object.entries({
        cx, cy, r: 19, pathLength: 1, class: "timer", visibility: "hidden", transform: `rotate(-90 ${cx} ${cy})`,
      })) timer.setAttribute(name, value);
      group.append(timer);
    }
    const label = group.querySelector(".window");
    return { group, index, kind: group.getAttribute("class"), timer, label, text: label?.textContent };
  }

  module(group, onChoose) {
    const name = group.dataset.module;
    const boxes = group.querySelectorAll("rect");
    for (const box of boxes) box.setAttribute("class", "box");
    const [rect] = boxes;
    const index = this.scene.modules.indexOf(name);
    group.append(swatch(rect, index));
    const state = document.createElementNS(SVG, "text");
    state.setAttribute("class", "state");
    state.setAttribute("x", Number(rect.getAttribute("x")) + 2);
    state.setAttribute("y", Number(rect.getAttribute("y")) + Number(rect.getAttribute("height")) + 11);
    group.append(" ", state);
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.addEventListener("click", () => onChoose(name));
    group.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") {
        event.preventDefault();
        event.stopPropagation();
        onChoose(name);
      }
    });
    return { group, name, state, index, shown: null };
  }

  choose(name) {
    this.chosen = name;
    for (const module of this.modules) module.group.classList.toggle("chosen", module.name === name);
  }

  show(snapshot) {
    for (const module of this.modules) {
      const state = snapshot.modules[module.index];
      if (state === module.shown) continue;
      module.shown = state;
      setText(module.state, state);
      const chosen = module.name === this.chosen ? " chosen" : "";
      setClass(module.group, `module ${CLASSES[state] ?? "unknown"}${chosen}`);
      module.group.setAttribute("aria-label", `${module.name} ${state}`);
    }
    const active = new Set(snapshot.active);
    const live = new Set(snapshot.live.map(([from, to]) => `${from}>${to}`));
    const driven = new Set(snapshot.live.map(([, to]) => to));
    for (const { wire, kind, from, key } of this.wires) {
      setClass(wire, live.has(key) ? `${kind} live` : active.has(from) ? `${kind} active` : kind);
    }
    for (const { box, name } of this.actuators) setClass(box, driven.has(name) ? "actuator live" : "actuator");
    for (const node of this.nodes) this.showNode(node, active, snapshot.windows[node.index]);
  }

  showNode(node, active, left) {
    setClass(node.group, active.has(node.index) ? `${node.kind} node-active` : node.kind);
    if (!node.timer) return;
    node.timer.setAttribute("visibility", left ? "visible" : "hidden");
    if (left) node.timer.setAttribute("stroke-dashoffset", 1 - left / this.scene.windows[node.index]);
    setText(node.label, left ? `${left.toFixed(1)} s` : node.text);
  }
}

/** The color that a module has in the timeline, below its box. */
function swatch(box, index) {
  const mark = document.createElementNS(SVG, "rect");
  const [x, y, width, height] = ["x", "y", "width", "height"].map((name) => Number(box.getAttribute(name)));
  for (const [name, value] of Object.entries({
    x: x + width - 22, y: y + height + 4, width: 20, height: 6, rx: 2, class: `swatch w${index % 8}`,
  })) mark.setAttribute(name, value);
  return mark;
}
