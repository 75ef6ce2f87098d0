// A scene turned so that its up axis becomes -y, in the worker.

import { coefficients } from "./scene.js";

/** Directions by which harmonics are turned: more than the coefficients of the largest degree, and well spread. */
const DIRECTIONS = 64;

/** Values of the real harmonics up to degree 4 at a direction, with the signs of the 3DGS reference implementation. */
function basis([x, y, z]) {
  const [xx, yy, zz, xy, yz, xz] = [x * x, y * y, z * z, x * y, y * z, x * z];
  return [0.28209479177387814, -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
    1.0925484305920792 * xy, -1.0925484305920792 * yz, 0.31539156525252005 * (2 * zz - xx - yy), -1.0925484305920792 * xz, 0.5462742152960396 * (xx - yy),
    -0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * xy * z, -0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
    -0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy), -0.5900435899266435 * x * (xx - 3 * yy),
    2.5033429417967046 * xy * (xx - yy), -1.7701307697799304 * yz * (3 * xx - yy), 0.9461746957575601 * xy * (7 * zz - 1), -0.6690465435572892 * yz * (7 * zz - 3),
    0.10578554691520431 * (zz * (35 * zz - 30) + 3), -0.6690465435572892 * xz * (7 * zz - 3), 0.47308734787878004 * (xx - yy) * (7 * zz - 1),
    -1.7701307697799304 * xz * (xx - 3 * yy), 0.6258357354491761 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy))];
}

/** The quaternion wxyz of the smallest turn that takes a unit vector to -y. */
function turnOf([x, y, z]) {
  // Half way between both lies the axis of half a turn; opposite ones turn half about x.
  const w = 1 - y;
  if (w < 1e-9) return [0, 1, 0, 0];
  const length = Math.hypot(w, x, z);
  return [w / length, z / length, 0, -x / length];
}

const rows = ([w, x, y, z]) => [
  [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
  [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
  [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
];

/** Solves a x = b, both n x n, for a positive definite a; x replaces b. */
function solve(a, b, n) {
  for (let p = 0; p < n; p++) {
    for (let row = 0; row < n; row++) {
      const factor = row === p ? 0 : a[row * n + p] / a[p * n + p];
      for (let k = 0; k < n; k++) {
        a[row * n + k] -= factor * a[p * n + k];
        b[row * n + k] -= factor * b[p * n + k];
      }
    }
  }
  for (let row = 0; row < n; row++) for (let k = 0; k < n; k++) b[row * n + k] /= a[row * n + row];
}

/** A matrix for each degree from 1 on that turns its coefficients with the world, by least squares over directions. */
function harmonicTurns(degree, matrix) {
  const golden = Math.PI * (3 - Math.sqrt(5));
  const pairs = Array.from({ length: DIRECTIONS }, (_, i) => {
    const z = 1 - (2 * i + 1) / DIRECTIONS;
    const r = Math.sqrt(1 - z * z);
    const d = [r * Math.cos(golden * i), r * Math.sin(golden * i), z];
    return [basis(matrix.map((row) => row[0] * d[0] + row[1] * d[1] + row[2] * d[2])), basis(d)];
  });
  return Array.from({ length: degree }, (_, k) => {
    const [first, n] = [coefficients(k), 2 * k + 3];
    const [normal, right] = [new Float64Array(n * n), new Float64Array(n * n)];
    for (const [turned, before] of pairs) {
      for (let i = 0; i < n; i++) {
        for (let j = 0; j < n; j++) {
          normal[i * n + j] += turned[first + i] * turned[first + j];
          right[i * n + j] += turned[first + i] * before[first + j];
        }
      }
    }
    solve(normal, right, n);
    return right;
  });
}

/** The table of a scene whose up axis, a unit vector, becomes -y by the smallest turn: means, rotations and harmonics. */
export function upright(table, up) {
  const { n, degree, stride, at } = table;
  const values = table.values.slice();
  const q = turnOf(up);
  const matrix = rows(q);
  const turns = harmonicTurns(degree, matrix);
  const rest = coefficients(degree) - 1;
  const before = new Float64Array(rest);
  for (let i = 0; i < n; i++) {
    const row = i * stride;
    const [x, y, z] = values.subarray(row + at.mean, row + at.mean + 3);
    matrix.forEach((m, axis) => (values[row + at.mean + axis] = m[0] * x + m[1] * y + m[2] * z));
    const [a, b, c, d] = q;
    const [e, f, g, h] = values.subarray(row + at.quat, row + at.quat + 4);
    values.set([a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e], row + at.quat);
    for (let channel = 0; channel < 3; channel++) {
      const from = row + at.rest + channel * rest;
      for (let k = 0; k < rest; k++) before[k] = values[from + k];
      turns.forEach((turn, k) => {
        const [first, count] = [coefficients(k) - 1, 2 * k + 3];
        for (let j = 0; j < count; j++) {
          let sum = 0;
          for (let l = 0; l < count; l++) sum += turn[j * count + l] * before[first + l];
          values[from + first + j] = sum;
        }
      });
    }
  }
  return { ...table, values };
}
