// The pictures of the robot's cameras, with boxes around what was found in them.

import { element, palette, setText } from "./drawing.js";

export class Cameras {
  constructor(host) {
    this.host = host;
    this.figures = new Map();
    host.hidden = true;
    host.replaceChildren();
  }

  show(pictures) {
    const names = new Set(pictures.map((picture) => picture.camera));
    for (const [name, { figure }] of this.figures) {
      if (names.has(name)) continue;
      figure.remove();
      this.figures.delete(name);
    }
    for (const picture of pictures) this.draw(this.figure(picture.camera), picture);
    this.host.hidden = this.figures.size === 0;
  }

  /** Show no pictures while the page looks back: they are of now. */
  setFollowing(isFollowing) {
    this.host.classList.toggle("past", !isFollowing);
  }

  figure(name) {
    if (!this.figures.has(name)) {
      const canvas = element("canvas", { role: "img" });
      const caption = element("figcaption");
      const figure = element("figure", {}, canvas, caption);
      this.host.append(figure);
      this.figures.set(name, { figure, canvas, caption });
    }
    return this.figures.get(name);
  }

  draw({ canvas, caption }, picture) {
    const { camera, width, height, found } = picture;
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    const context = canvas.getContext("2d");
    context.putImageData(new ImageData(rgba(picture), width, height), 0, 0);
    context.strokeStyle = palette.winners[1];
    context.lineWidth = Math.max(1.5, width / 160);
    for (const { corners } of found) {
      context.beginPath();
      for (const [x, y] of corners) context.lineTo(x + 0.5, y + 0.5);
      context.closePath();
      context.stroke();
    }
    const words = found.map(({ kind, label }) => `${kind} ${label}`.trim()).join(", ");
    const text = words ? `${camera}: ${words}` : camera;
    setText(caption, text);
    canvas.setAttribute("aria-label", `picture of ${text}`);
  }
}

function rgba({ width, height, channels, pixels }) {
  const bytes = atob(pixels);
  const out = new Uint8ClampedArray(width * height * 4).fill(255);
  for (let i = 0; i < width * height; i += 1) {
    for (let c = 0; c < 3; c += 1) out[4 * i + c] = bytes.charCodeAt(channels === 3 ? 3 * i + c : i);
  }
  return out;
}
