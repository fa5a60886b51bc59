// The map, the path, the robot, and what its ranges see.

import { palette, Surface } from "./drawing.js";

const MARGIN_MM = 800;
const NEAR_MM = 400;
const LEAST_MM = 4000;

export class WorldMap {
  constructor(canvas) {
    this.surface = new Surface(canvas, (context, width, height) => this.draw(context, width, height));
  }

  /** Show a scene, of whose run nothing is known yet. */
  load(scene) {
    this.scene = scene;
    this.path = [];
    this.pose = null;
    this.ellipse = null;
    this.isFollowing = true;
    this.box = null;
    this.ranges = scene.sensors.map((s, i) => [s, i]).filter(([s]) => s.kind === "polar" && s.is_distance);
    for (const [x0, y0, x1, y1] of scene.map?.walls ?? []) {
      this.cover(x0, y0);
      this.cover(x1, y1);
    }
    this.surface.measure();
    this.surface.redraw();
  }

  cover(x, y, margin = 0) {
    this.box ??= [x - LEAST_MM / 2, y - LEAST_MM / 2, x + LEAST_MM / 2, y + LEAST_MM / 2];
    const [a, b, c, d] = this.box;
    this.box = [Math.min(a, x - margin), Math.min(b, y - margin), Math.max(c, x + margin), Math.max(d, y + margin)];
  }

  reset(points) {
    this.path = points.map(([x, y]) => [x, y]);
    for (const [x, y] of this.path) this.include(x, y);
  }

  /** Make room for a place and for a robot there, in large steps, so that the map rarely moves. */
  include(x, y) {
    const [a, b, c, d] = this.box ?? [Infinity, Infinity, -Infinity, -Infinity];
    if (x < a + NEAR_MM || y < b + NEAR_MM || x > c - NEAR_MM || y > d - NEAR_MM) this.cover(x, y, MARGIN_MM);
  }

  show(snapshot) {
    this.pose = snapshot.pose;
    this.sensors = snapshot.sensors;
    if (snapshot.pose) {
      const [x, y] = snapshot.pose;
      this.include(x, y);
      const last = this.path.at(-1);
      if (!last || Math.hypot(x - last[0], y - last[1]) > 20) this.path.push([x, y]);
      if (this.path.length > 6000) this.path = this.path.filter((_, i) => i % 2 === 0);
    }
    this.surface.redraw();
  }

  /** Show where the pose estimator believes the robot to be, and how surely; null for nothing. */
  setEllipse(ellipse) {
    this.ellipse = ellipse;
    if (ellipse) {
      const room = Math.min(ellipse.major, LEAST_MM);
      this.include(ellipse.x - room, ellipse.y - room);
      this.include(ellipse.x + room, ellipse.y + room);
    }
    this.surface.redraw();
  }

  /** Show no ellipse while the page looks back: it is of now. */
  setFollowing(isFollowing) {
    if (this.isFollowing === isFollowing) return;
    this.isFollowing = isFollowing;
    this.surface.redraw();
  }

  draw(context, width, height) {
    if (!this.box) {
      context.fillStyle = palette.muted;
      context.font = "13px sans-serif";
      context.fillText(this.scene.has_pose ? "no position yet" : "the program reads no position", 12, 24);
      return;
    }
    const [west, south, east, north] = this.box;
    const scale = Math.min((width - 16) / (east - west), (height - 16) / (north - south));
    const at = (x, y) => [
      width / 2 + (x - (west + east) / 2) * scale,
      height / 2 - (y - (south + north) / 2) * scale,
    ];
    this.walls(context, at);
    this.track(context, at);
    if (this.ellipse && this.isFollowing) this.uncertainty(context, at, scale);
    if (this.pose) this.robot(context, at, scale);
    this.ruler(context, scale, height);
  }

  walls(context, at) {
    context.strokeStyle = palette.wall;
    context.lineWidth = 1.5;
    context.beginPath();
    for (const [x0, y0, x1, y1] of this.scene.map?.walls ?? []) {
      context.moveTo(...at(x0, y0));
      context.lineTo(...at(x1, y1));
    }
    context.stroke();
    context.fillStyle = palette.line;
    for (const hole of this.scene.map?.holes ?? []) {
      context.beginPath();
      for (const [x, y] of hole) context.lineTo(...at(x, y));
      context.fill();
    }
  }

  track(context, at) {
    context.strokeStyle = palette.trace;
    context.lineWidth = 1.5;
    context.beginPath();
    for (const [x, y] of this.path) context.lineTo(...at(x, y));
    context.stroke();
  }

  uncertainty(context, at, scale) {
    const { x, y, major, minor, direction } = this.ellipse;
    const [px, py] = at(x, y);
    context.beginPath();
    context.ellipse(
      px, py, Math.max(3, major * scale), Math.max(3, minor * scale), (-direction * Math.PI) / 180, 0, 2 * Math.PI);
    context.strokeStyle = palette.warn;
    context.lineWidth = 1.5;
    context.setLineDash([4, 3]);
    context.stroke();
    context.setLineDash([]);
  }

  robot(context, at, scale) {
    const [x, y, heading] = this.pose;
    const angle = (heading * Math.PI) / 180;
    const place = (ahead, left) =>
      at(x - ahead * Math.sin(angle) - left * Math.cos(angle), y + ahead * Math.cos(angle) - left * Math.sin(angle));
    context.fillStyle = palette.scan;
    for (const [sensor, i] of this.ranges) {
      const values = this.sensors[i] ?? [];
      values.forEach((value, k) => {
        if (value === null || (sensor.high !== null && value >= sensor.high)) return;
        const bearing = (sensor.bearings[k] * Math.PI) / 180;
        const range = value * (sensor.unit === "m" ? 1000 : 1);
        const [px, py] = place(range * Math.cos(bearing), range * Math.sin(bearing));
        context.fillRect(px - 1.2, py - 1.2, 2.4, 2.4);
      });
    }
    const corners = this.scene.footprint_mm.length ? this.scene.footprint_mm : circle(300);
    const least = Math.max(1, 7 / (300 * scale));
    context.beginPath();
    for (const [ahead, left] of corners) context.lineTo(...place(ahead * least, left * least));
    context.closePath();
    context.fillStyle = palette["live-soft"];
    context.fill();
    context.strokeStyle = palette.live;
    context.lineWidth = 2;
    context.stroke();
    context.beginPath();
    context.moveTo(...at(x, y));
    context.lineTo(...place(450 * least, 0));
    context.stroke();
  }

  ruler(context, scale, height) {
    const meters = [1, 2, 5, 10, 20, 50, 100].find((m) => m * 1000 * scale > 40) ?? 100;
    const length = meters * 1000 * scale;
    context.fillStyle = palette.panel;
    context.fillRect(2, height - 26, length + 12, 24);
    context.strokeStyle = context.fillStyle = palette.muted;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(8, height - 10);
    context.lineTo(8 + length, height - 10);
    context.stroke();
    context.font = "11px sans-serif";
    context.fillText(`${meters} m`, 8, height - 14);
  }
}

function circle(radius) {
  return Array.from({ length: 24 }, (_, i) => [
    radius * Math.cos((i * Math.PI) / 12), radius * Math.sin((i * Math.PI) / 12)]);
}
