// Points on the surface that are clicked, and what is drawn of them.

import { say } from "./status.js";

/** A tool that takes so many points, then calls `done(points)`; dragging turns the view as ever. */
export class PointTool {
  constructor(page, count, done) {
    Object.assign(this, { page, count, done, points: [], clicks: true });
  }

  click(x, y) {
    const point = this.page.pointAt(x, y);
    if (!point) return say("Nothing is there to take a point of.", true);
    this.points.push(point);
    if (this.points.length === this.count) this.done(this.points.splice(0));
    this.page.overlay.draw();
  }

  cancel() {
    this.points.length = 0;
    this.page.overlay.draw();
  }
}

/** Draws lines with labels between points, and points that were taken. */
export class Marks {
  constructor(context) {
    Object.assign(this, { context, camera: null, near: 0 });
  }

  /** Where a point is in the picture; null behind the camera. */
  place([x, y, z]) {
    const { A, t, K } = this.camera;
    const depth = A[6] * x + A[7] * y + A[8] * z + t[2];
    if (depth < this.near) return null;
    return [(K[0] * (A[0] * x + A[1] * y + A[2] * z + t[0])) / depth + K[2], (K[1] * (A[3] * x + A[4] * y + A[5] * z + t[1])) / depth + K[3]];
  }

  dot(point) {
    const at = this.place(point);
    if (!at) return;
    const { context } = this;
    context.beginPath();
    context.arc(at[0], at[1], 4.5, 0, 2 * Math.PI);
    context.fillStyle = "#fff";
    context.fill();
    context.lineWidth = 2;
    context.strokeStyle = "#2f5fd0";
    context.stroke();
  }

  line(a, b, label, strong) {
    const [from, to] = [this.place(a), this.place(b)];
    const { context } = this;
    if (from && to) {
      for (const [width, color] of [[strong ? 5 : 4, "rgb(255 255 255 / 85%)"], [strong ? 2.5 : 1.5, "#2f5fd0"]]) {
        context.beginPath();
        context.moveTo(...from);
        context.lineTo(...to);
        context.lineWidth = width;
        context.strokeStyle = color;
        context.stroke();
      }
    }
    this.dot(a);
    this.dot(b);
    if (from && to && label) this.label((from[0] + to[0]) / 2, (from[1] + to[1]) / 2, label);
  }

  label(x, y, text) {
    const { context } = this;
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    const wide = context.measureText(text).width + 14;
    context.fillStyle = "#2f5fd0";
    context.beginPath();
    context.roundRect(x - wide / 2, y - 11, wide, 22, 11);
    context.fill();
    context.fillStyle = "#fff";
    context.fillText(text, x, y + 0.5);
  }

  /** A cross in the middle, where Enter takes a point. */
  cross(x, y) {
    const { context } = this;
    for (const [width, color] of [[3, "rgb(0 0 0 / 45%)"], [1, "#fff"]]) {
      context.beginPath();
      context.moveTo(x - 9, y);
      context.lineTo(x + 9, y);
      context.moveTo(x, y - 9);
      context.lineTo(x, y + 9);
      context.lineWidth = width;
      context.strokeStyle = color;
      context.stroke();
    }
  }
}
