// Scenes in the worker: the bytes of a PLY or SPZ file as a table of numbers, and the table as textures.

/** Coefficients of one color channel. */
export const coefficients = (degree) => (degree + 1) ** 2;

/** Signs of harmonics of degree 0 to 4 where the world turns half about x. */
const HALF_TURN = [..."+--+-++-+-+--+-+-+-++-+-+"].map((sign) => (sign === "+" ? 1 : -1));

/** The line of a PLY file that says how its Gaussians were trained. */
const MIP = "comment SplatRenderMode: mip";

/** Columns of a 3DGS PLY file, in the order of the reference implementation. */
export function columnNames(degree) {
  const numbered = (prefix, count) => Array.from({ length: count }, (_, i) => prefix + i);
  const rest = 3 * (coefficients(degree) - 1);
  return ["x", "y", "z", "nx", "ny", "nz", ...numbered("f_dc_", 3), ...numbered("f_rest_", rest), "opacity",
    ...numbered("scale_", 3), ...numbered("rot_", 4)];
}

/** Where a table has what. */
function places(names) {
  const at = (name) => {
    const place = names.indexOf(name);
    if (place < 0) throw new Error(`The scene has no property ${name}.`);
    return place;
  };
  const rest = names.filter((name) => name.startsWith("f_rest_")).length;
  return { mean: at("x"), dc: at("f_dc_0"), rest: rest > 0 ? at("f_rest_0") : 0, opacity: at("opacity"), scale: at("scale_0"),
    quat: at("rot_0"), degree: Math.sqrt(rest / 3 + 1) - 1 };
}

/** The table of a file of Gaussians: {n, degree, stride, at, values}. */
export function parse(bytes) {
  const magic = String.fromCharCode(...bytes.subarray(0, 4));
  if (magic.startsWith("ply")) return parsePly(bytes);
  if (magic === "NGSP") return parseSpz(bytes);
  throw new Error("The scene is neither PLY nor SPZ.");
}

function parsePly(bytes) {
  const head = new TextDecoder("latin1").decode(bytes.subarray(0, 1 << 16));
  const end = head.indexOf("end_header\n");
  if (end < 0) throw new Error("The scene's header has no end.");
  const lines = head.slice(0, end).split("\n");
  const n = Number(/^element vertex (\d+)/m.exec(head)?.[1] ?? NaN);
  const names = lines.filter((line) => line.startsWith("property")).map((line) => line.split(" ")[2]);
  if (!lines.every((line) => !line.startsWith("property") || line.startsWith("property float "))) throw new Error("The scene has numbers that are no 32-bit floats.");
  const at = places(names);
  const start = end + "end_header\n".length;
  const length = 4 * n * names.length;
  if (!(bytes.length - start >= length)) throw new Error(`The scene is incomplete: ${bytes.length - start} of ${length} bytes are there.`);
  // A copy, because floats begin at multiples of four bytes.
  const values = new Float32Array(bytes.slice(start, start + length).buffer);
  return { n, degree: at.degree, stride: names.length, at, values, names, antialiased: head.includes(MIP) };
}

/** SPZ of version 3, unpacked; its axes are turned by half a turn about x. */
function parseSpz(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const [version, n] = [view.getUint32(4, true), view.getUint32(8, true)];
  const [degree, fraction] = [bytes[12], bytes[13]];
  if (version !== 3) throw new Error(`The scene is SPZ of version ${version}, expected 3.`);
  const per = coefficients(degree);
  const names = columnNames(degree);
  const [stride, at] = [names.length, places(names)];
  const sizes = [9, 1, 3, 3, 4, 3 * (per - 1)];
  const starts = sizes.map((_, i) => 16 + n * sizes.slice(0, i).reduce((sum, size) => sum + size, 0));
  if (bytes.length < starts[5] + n * sizes[5]) throw new Error("The scene is incomplete.");
  const values = new Float32Array(n * stride);
  const unit = 2 ** -fraction;
  const quat = new Float64Array(4);
  for (let i = 0; i < n; i++) {
    const row = i * stride;
    for (let axis = 0; axis < 3; axis++) {
      const p = starts[0] + 9 * i + 3 * axis;
      const fixed = ((bytes[p] | (bytes[p + 1] << 8) | (bytes[p + 2] << 16)) << 8) >> 8;
      values[row + at.mean + axis] = (axis > 0 ? -fixed : fixed) * unit;
      values[row + at.dc + axis] = (bytes[starts[2] + 3 * i + axis] / 255 - 0.5) / 0.15;
      values[row + at.scale + axis] = bytes[starts[3] + 3 * i + axis] / 16 - 10;
    }
    const opacity = bytes[starts[1] + i] / 255;
    values[row + at.opacity] = Math.log(opacity / (1 - opacity));
    smallestThree(view.getUint32(starts[4] + 4 * i, true), quat);
    values.set([quat[3], quat[0], -quat[1], -quat[2]], row + at.quat);
    for (let k = 1; k < per; k++) {
      for (let c = 0; c < 3; c++) {
        const byte = bytes[starts[5] + 3 * ((per - 1) * i + k - 1) + c];
        values[row + at.rest + c * (per - 1) + k - 1] = (HALF_TURN[k] * (byte - 128)) / 128;
      }
    }
  }
  return { n, degree, stride, at, values, names, antialiased: (bytes[14] & 1) === 1 };
}

/** A quaternion xyzw from all but its largest component. */
function smallestThree(packed, quat) {
  const largest = packed >>> 30;
  let squares = 0;
  let bits = packed;
  for (let i = 3; i >= 0; i--) {
    if (i === largest) continue;
    const magnitude = ((bits & 511) / 511) * Math.SQRT1_2;
    quat[i] = bits & 512 ? -magnitude : magnitude;
    squares += magnitude * magnitude;
    bits >>>= 10;
  }
  quat[largest] = Math.sqrt(Math.max(0, 1 - squares));
}

/** Bits of the nearest half, from those of a float and the float itself. */
function half(bits, value) {
  const sign = (bits >>> 16) & 0x8000;
  const size = bits & 0x7fffffff;
  if (size >= 0x477ff000) return sign | 0x7bff;
  if (size < 0x38800000) return sign | Math.round(Math.abs(value) * 16777216);
  return sign | ((size - 0x38000000 + 0x1000) >>> 13);
}

/** Texels of a Gaussian's harmonics, eight halfs each. */
export const harmonicTexels = (degree) => Math.ceil((3 * coefficients(degree)) / 8);

/**
 * What the renderer takes: `splats`, three texels each (mean and opacity, quaternion wxyz, scales), `harmonics` as halfs [K, 3],
 * and `means` for the order.
 */
export function pack(table) {
  const { n, degree, stride, at, values } = table;
  const per = coefficients(degree);
  const words = 4 * harmonicTexels(degree);
  const splats = new Float32Array(12 * n);
  const harmonics = new Uint16Array(2 * words * n);
  const means = new Float32Array(3 * n);
  const bits = new Uint32Array(values.buffer);
  for (let i = 0; i < n; i++) {
    const [row, to] = [i * stride, 12 * i];
    for (let axis = 0; axis < 3; axis++) {
      means[3 * i + axis] = splats[to + axis] = values[row + at.mean + axis];
      splats[to + 8 + axis] = Math.exp(values[row + at.scale + axis]);
    }
    splats[to + 3] = 1 / (1 + Math.exp(-values[row + at.opacity]));
    const q = row + at.quat;
    const length = Math.hypot(values[q], values[q + 1], values[q + 2], values[q + 3]);
    for (let j = 0; j < 4; j++) splats[to + 4 + j] = values[q + j] / length;
    for (let c = 0; c < 3; c++) {
      const base = 2 * words * i + c;
      harmonics[base] = half(bits[row + at.dc + c], values[row + at.dc + c]);
      for (let k = 1; k < per; k++) {
        const from = row + at.rest + c * (per - 1) + k - 1;
        harmonics[base + 3 * k] = half(bits[from], values[from]);
      }
    }
  }
  return { n, degree, splats, harmonics: new Uint32Array(harmonics.buffer), means };
}

/** A PLY file of the Gaussians that `dropped` does not mark; every bit of a lossless scene is kept. */
export function toPly(table, dropped) {
  const { n, stride, values, names } = table;
  const kept = [];
  for (let i = 0; i < n; i++) if (!dropped[i]) kept.push(i);
  const comment = table.antialiased ? `${MIP}\n` : "";
  const head = `ply\nformat binary_little_endian 1.0\n${comment}element vertex ${kept.length}\n${names.map((name) => `property float ${name}\n`).join("")}end_header\n`;
  const out = new Float32Array(kept.length * stride);
  kept.forEach((from, to) => out.set(values.subarray(from * stride, (from + 1) * stride), to * stride));
  return new Blob([head, out], { type: "application/octet-stream" });
}
