// A smooth path through keyframes, by the formula of weaver_scene::Keyframes.

import { add, mixed, subtract, times } from "./vectors.js";

/** The quaternion wxyz of a rotation with these columns. */
function quaternion(x, y, z) {
  const [a, b, c] = [x[0], y[1], z[2]];
  if (a + b + c > 0) {
    const s = 2 * Math.sqrt(1 + a + b + c);
    return [s / 4, (y[2] - z[1]) / s, (z[0] - x[2]) / s, (x[1] - y[0]) / s];
  }
  if (a >= b && a >= c) {
    const s = 2 * Math.sqrt(1 + a - b - c);
    return [(y[2] - z[1]) / s, s / 4, (y[0] + x[1]) / s, (z[0] + x[2]) / s];
  }
  if (b >= c) {
    const s = 2 * Math.sqrt(1 + b - a - c);
    return [(z[0] - x[2]) / s, (y[0] + x[1]) / s, s / 4, (z[1] + y[2]) / s];
  }
  const s = 2 * Math.sqrt(1 + c - a - b);
  return [(x[1] - y[0]) / s, (z[0] + x[2]) / s, (z[1] + y[2]) / s, s / 4];
}

const product = ([a, b, c, d], [e, f, g, h]) => [a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e];

/** Columns of the rotation of a unit quaternion: an image's right, down and forward. */
const columns = ([w, x, y, z]) => [
  [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
  [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
  [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
];

/** The shorter turn from one rotation to another, axis times angle. */
function turnBetween([a, b, c, d], to) {
  const q = product([a, -b, -c, -d], to);
  const sign = q[0] < 0 ? -1 : 1;
  const sine = Math.hypot(q[1], q[2], q[3]);
  if (sine < 1e-12) return [0, 0, 0];
  return times(q.slice(1), (sign * 2 * Math.atan2(sine, sign * q[0])) / sine);
}

function turned(q, turn) {
  const angle = Math.hypot(...turn);
  const s = angle < 1e-12 ? 0.5 : Math.sin(angle / 2) / angle;
  return product(q, [Math.cos(angle / 2), ...times(turn, s)]);
}

/** De Casteljau's construction with a way to go from one point to another. */
function bezier(a, b, c, d, go) {
  const [ab, bc, cd] = [go(a, b), go(b, c), go(c, d)];
  return go(go(ab, bc), go(bc, cd));
}

export class Path {
  /** Viewpoints, and the seconds from each one to the next; the last ones do not count. */
  constructor(viewpoints, seconds) {
    this.times = [0];
    seconds.slice(0, -1).forEach((s) => this.times.push(this.times.at(-1) + s));
    // Eye, distance of the target and focal length in one: all go along curves in flat space.
    this.flat = viewpoints.map(({ eye, distance, lens }) => [...eye, Math.log(distance), Math.log(lens.fx / lens.width)]);
    this.turn = viewpoints.map(({ right, down, forward }) => quaternion(right, down, forward));
    const slopes = this.times.slice(1).map((time, i) => {
      const h = time - this.times[i];
      return { flat: times(subtract(this.flat[i + 1], this.flat[i]), 1 / h), turn: times(turnBetween(this.turn[i], this.turn[i + 1]), 1 / h) };
    });
    this.tangents = this.times.map((time, i) => {
      if (i === 0 || i === slopes.length) return slopes[Math.min(i, slopes.length - 1)];
      const share = (time - this.times[i - 1]) / (this.times[i + 1] - this.times[i - 1]);
      return { flat: mixed(slopes[i - 1].flat, slopes[i].flat, share), turn: mixed(slopes[i - 1].turn, slopes[i].turn, share) };
    });
  }

  get seconds() {
    return this.times.at(-1);
  }

  /** The camera at a time: eye, right, down, forward, distance of the target, and focal length in widths. */
  at(time) {
    const { times: t, flat, turn, tangents } = this;
    let i = 0;
    while (i < t.length - 2 && time >= t[i + 1]) i++;
    const h = t[i + 1] - t[i];
    const u = Math.min(1, Math.max(0, (time - t[i]) / h));
    const [from, to] = [tangents[i], tangents[i + 1]];
    const between = (a, b) => mixed(a, b, u);
    const [x, y, z, distance, focal] = bezier(flat[i], add(flat[i], times(from.flat, h / 3)), subtract(flat[i + 1], times(to.flat, h / 3)), flat[i + 1], between);
    const q = bezier(turn[i], turned(turn[i], times(from.turn, h / 3)), turned(turn[i + 1], times(to.turn, -h / 3)), turn[i + 1], (a, b) => turned(a, times(turnBetween(a, b), u)));
    const [right, down, forward] = columns(times(q, 1 / Math.hypot(...q)));
    return { eye: [x, y, z], right, down, forward, distance: Math.exp(distance), focal: Math.exp(focal) };
  }
}
