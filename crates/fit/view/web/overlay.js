// What is drawn over the picture: camera frusta, the outline of a selection, lengths and points.

import { Marks } from "./points.js";
import { add, dot, subtract, times } from "./vectors.js";

/** Depth of a frustum as a part of the distance to the target. */
const DEPTH = 0.06;

export class Overlay {
  /** `page` has camera(ratio), shots and viewpoint. */
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.context = canvas.getContext("2d");
    this.frusta = false;
    this.outline = null;
    this.marks = new Marks(this.context);
  }

  draw() {
    const { canvas, context, page } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (this.frusta) this.drawFrusta(page.camera(1));
    if (this.outline) this.drawOutline();
    this.drawMarks(width, height);
  }

  /** Lengths, and the points that a tool took. */
  drawMarks(width, height) {
    const { marks, page } = this;
    const { measure, tool } = page;
    if (!measure || (page.notes.state.lengths.length === 0 && !tool?.clicks)) return;
    marks.camera = page.camera(1);
    marks.near = 1e-3 * page.viewpoint.distance;
    measure.draw(marks);
    if (!tool?.clicks) return;
    for (const point of tool.points ?? []) marks.dot(point);
    marks.cross(width / 2, height / 2);
  }

  drawFrusta(camera) {
    const { context, page } = this;
    const accent = getComputedStyle(document.documentElement).getPropertyValue("--accent");
    const near = 1e-3 * page.viewpoint.distance;
    const [right, down, forward] = [0, 3, 6].map((row) => camera.A.slice(row, row + 3));
    const seen = (point) => {
      const p = subtract(point, camera.eye);
      return [dot(right, p), dot(down, p), dot(forward, p)];
    };
    const line = (a, b) => {
      let [from, to] = [seen(a), seen(b)];
      if (from[2] < near && to[2] < near) return;
      if (from[2] < near) [from, to] = [to, from];
      // The part behind the camera is cut off.
      if (to[2] < near) to = add(from, times(subtract(to, from), (from[2] - near) / (from[2] - to[2])));
      const place = ([x, y, z]) => [(camera.K[0] * x) / z + camera.K[2], (camera.K[1] * y) / z + camera.K[3]];
      context.moveTo(...place(from));
      context.lineTo(...place(to));
    };
    const size = DEPTH * page.shots.spread;
    for (const [i, shot] of page.shots.all.entries()) {
      const { lens, eye, axes } = shot;
      const corner = (u, v) => add(eye, add(add(times(axes[0], (size * (u - lens.cx)) / lens.fx), times(axes[1], (size * (v - lens.cy)) / lens.fy)), times(axes[2], size)));
      const corners = [corner(0, 0), corner(lens.width, 0), corner(lens.width, lens.height), corner(0, lens.height)];
      context.beginPath();
      corners.forEach((point, k) => {
        line(eye, point);
        line(point, corners[(k + 1) % 4]);
      });
      context.lineWidth = i === page.shots.current ? 2.5 : 1.2;
      context.strokeStyle = shot.held_out ? "#e08a1e" : accent;
      context.stroke();
    }
  }

  drawOutline() {
    const { context } = this;
    const { shape, places, radius } = this.outline;
    context.strokeStyle = context.fillStyle = "#ff7300";
    context.lineWidth = 1.5;
    if (shape === "box" && places.length > 1) {
      const [[x0, y0], [x1, y1]] = places;
      context.strokeRect(x0, y0, x1 - x0, y1 - y0);
      context.globalAlpha = 0.12;
      context.fillRect(x0, y0, x1 - x0, y1 - y0);
    } else if (shape === "brush") {
      context.globalAlpha = 0.35;
      context.lineWidth = 2 * radius;
      context.lineCap = context.lineJoin = "round";
      context.beginPath();
      context.moveTo(...places[0]);
      for (const place of places) context.lineTo(...place);
      context.lineTo(places.at(-1)[0] + 0.01, places.at(-1)[1]);
      context.stroke();
    }
    context.globalAlpha = 1;
  }
}
