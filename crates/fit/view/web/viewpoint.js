// Where one looks from: a camera that turns about a point, and its lens.

import { add, cross, dot, length, mixed, subtract, times, turned, unit } from "./vectors.js";

/** Nearest angle between the direction of view and the up axis, radians. */
const STEEP = 0.03;

export class Viewpoint {
  /** `lens` has fx, fy, cx, cy, width and height, pixels of any unit; up is where the head points. */
  constructor({ eye, target, up, down, lens }) {
    this.up = unit(up);
    this.lens = lens;
    this.place(eye, target, down);
  }

  /** Moves to a place, level with the up axis unless `down` says how the image is rolled. */
  place(eye, target, down) {
    this.eye = [...eye];
    this.distance = Math.max(length(subtract(target, eye)), 1e-6);
    this.forward = unit(subtract(target, eye));
    const below = down ?? times(this.up, -1);
    const side = cross(below, this.forward);
    this.right = length(side) > 1e-6 ? unit(side) : unit(cross(this.forward, [this.forward[1], this.forward[2], -this.forward[0]]));
    this.down = cross(this.forward, this.right);
  }

  copy() {
    return Object.assign(Object.create(Viewpoint.prototype), structuredClone({ ...this }));
  }

  get target() {
    return add(this.eye, times(this.forward, this.distance));
  }

  /** Turns about the target: about the up axis, then about the image's horizontal axis. */
  orbit(yaw, pitch) {
    const { target } = this;
    this.turn(yaw, pitch);
    this.eye = subtract(target, times(this.forward, this.distance));
  }

  /** Turns on the spot. */
  turn(yaw, pitch) {
    for (const axis of ["forward", "right", "down"]) this[axis] = turned(this[axis], this.up, yaw);
    const height = Math.acos(Math.min(1, Math.max(-1, dot(this.forward, this.up))));
    // Steep views that a camera file demands are left as they are; turning makes them no steeper.
    const wanted = Math.min(Math.PI - STEEP, Math.max(STEEP, height - pitch));
    const angle = height - wanted;
    if (Math.abs(dot(this.right, this.up)) < 0.9) for (const axis of ["forward", "down"]) this[axis] = turned(this[axis], this.right, angle);
    this.down = unit(cross(this.forward, this.right));
  }

  /** Moves sideways and up or down, in pixels of an image as large as `scale` times the lens's. */
  pan(dx, dy, scale) {
    const per = this.distance / (this.lens.fx * scale);
    this.eye = add(this.eye, add(times(this.right, -dx * per), times(this.down, -dy * per)));
  }

  /** Moves toward the target, to `factor` times the distance. */
  zoom(factor) {
    const { target } = this;
    this.distance = Math.max(this.distance * factor, 1e-4);
    this.eye = subtract(target, times(this.forward, this.distance));
  }

  /** Moves along the image's axes by parts of the distance to the target. */
  fly(right, down, forward) {
    const moved = add(add(times(this.right, right), times(this.down, down)), times(this.forward, forward));
    this.eye = add(this.eye, times(moved, this.distance));
  }

  /** Turns about a point from now on, without moving. */
  aim(point) {
    const { eye } = this;
    this.distance = Math.max(dot(subtract(point, eye), this.forward), 1e-4);
    this.place(eye, point);
  }

  /** Pixels of the canvas to a pixel of the lens, and where the lens's image lies. */
  frame(width, height) {
    const scale = Math.min(width / this.lens.width, height / this.lens.height);
    const [w, h] = [this.lens.width * scale, this.lens.height * scale];
    return { scale, left: (width - w) / 2, top: (height - h) / 2, width: w, height: h };
  }

  /** The camera of an image of this size: the lens's image as large as fits in, and what is around it. */
  camera(width, height) {
    const { scale, left, top } = this.frame(width, height);
    const { fx, fy, cx, cy } = this.lens;
    const A = [...this.right, ...this.down, ...this.forward];
    const t = [this.right, this.down, this.forward].map((axis) => -dot(axis, this.eye));
    return { A, t, eye: this.eye, K: [fx * scale, fy * scale, cx * scale + left, cy * scale + top], width, height };
  }

  /** A text that keeps the view, for the address. */
  toText() {
    return this.textOf(this.eye, times(this.forward, this.distance), times(this.down, -1), this.lens.fx / this.lens.width);
  }

  /** The text of a view from an eye along a vector to the target, with a focal length in widths of the image. */
  textOf(eye, ahead, up, focal) {
    return [...eye, ...add(eye, ahead), ...up, focal].map((x) => Number(x.toPrecision(6))).join(",");
  }

  /** The viewpoint of such a text; null where it is none. */
  ofText(text) {
    const numbers = text.split(",").map(Number);
    if (numbers.length !== 10 || !numbers.every(Number.isFinite) || !(numbers[9] > 0)) return null;
    const [eye, target, up] = [0, 3, 6].map((from) => numbers.slice(from, from + 3));
    const made = this.copy();
    made.lens = freeLens(numbers[9], this.lens);
    made.place(eye, target, times(up, -1));
    // Numbers too large to be squared, and a view in no direction, would leave nothing that one could turn.
    const { right, down, forward, distance } = made;
    if (![distance, ...right, ...down].every(Number.isFinite) || !(length(right) > 0.5 && length(forward) > 0.5)) return null;
    return made;
  }

  /** Becomes the camera of a path. */
  along({ eye, right, down, forward, distance, focal }) {
    return Object.assign(this, { eye, right, down, forward, distance, lens: freeLens(focal, this.lens) });
  }
}

/** A lens without a photo: the focal length in widths of the image. */
export function freeLens(focal, { width, height }) {
  return { fx: focal * width, fy: focal * width, cx: width / 2, cy: height / 2, width, height };
}

/** The viewpoint between two, `t` from 0 to 1. */
export function between(from, to, t) {
  const made = to.copy();
  made.place(mixed(from.eye, to.eye, t), add(mixed(from.eye, to.eye, t), unit(mixed(from.forward, to.forward, t))), mixed(from.down, to.down, t));
  made.distance = from.distance + t * (to.distance - from.distance);
  const lens = (name) => from.lens[name] / from.lens.width + t * (to.lens[name] / to.lens.width - from.lens[name] / from.lens.width);
  if (from.lens.width !== to.lens.width || from.lens.fx !== to.lens.fx) {
    const { width, height } = to.lens;
    made.lens = { fx: lens("fx") * width, fy: lens("fy") * width, cx: lens("cx") * width, cy: to.lens.cy, width, height };
  }
  return made;
}
