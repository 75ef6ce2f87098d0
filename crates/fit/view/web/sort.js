// The order of Gaussians from front to back, in the worker.

const BUCKETS = 65536;

/** Sorts the same Gaussians again and again, by their depths along changing directions. */
export class Sorter {
  constructor(means) {
    this.means = means;
    this.n = means.length / 3;
    this.keys = new Float32Array(this.n);
    this.bits = new Uint32Array(this.keys.buffer);
    this.counts = new Uint32Array(BUCKETS + 1);
  }

  /**
   * Numbers of the Gaussians between the near and far plane, from front to back; `row` is the third row of [A | t]. In buckets of
   * equal depth unless `exact`.
   */
  order({ row, near, far, exact }) {
    const { means, n, keys } = this;
    const { fround } = Math;
    const [a, b, c, d] = row.map(fround);
    let [low, high] = [Infinity, -Infinity];
    for (let i = 0; i < n; i++) {
      const [x, y, z] = [means[3 * i], means[3 * i + 1], means[3 * i + 2]];
      // Rounded as the rasterizer rounds, so that nearly equal depths have the same order.
      const depth = (keys[i] = fround(fround(fround(fround(a * x) + fround(b * y)) + fround(c * z)) + d));
      if (depth >= near && depth <= far) {
        if (depth < low) low = depth;
        if (depth > high) high = depth;
      }
    }
    if (low > high) return { order: new Uint32Array(0), range: [0, 1] };
    return exact ? this.exactly(low, high) : this.inBuckets(low, high);
  }

  /** Counting sort: one pass, depths rounded to 65536 steps. */
  inBuckets(low, high) {
    const { n, keys, counts } = this;
    const scale = (BUCKETS - 1) / Math.max(high - low, 1e-30);
    counts.fill(0);
    let drawn = 0;
    for (let i = 0; i < n; i++) {
      const depth = keys[i];
      if (depth >= low && depth <= high) {
        counts[(((depth - low) * scale) | 0) + 1]++;
        drawn++;
      }
    }
    for (let b = 0; b < BUCKETS; b++) counts[b + 1] += counts[b];
    const at = (share) => low + counts.findIndex((count) => count >= share * drawn) / scale;
    const range = [at(0.02), at(0.9)];
    const order = new Uint32Array(drawn);
    for (let i = 0; i < n; i++) {
      const depth = keys[i];
      if (depth >= low && depth <= high) order[counts[((depth - low) * scale) | 0]++] = i;
    }
    return { order, range };
  }

  /** Radix sort of the bits of positive floats, two passes of 16 bits; equal depths in the order of their numbers. */
  exactly(low, high) {
    const { n, keys, bits, counts } = this;
    const all = [];
    for (let i = 0; i < n; i++) if (keys[i] >= low && keys[i] <= high) all.push(i);
    let order = Uint32Array.from(all);
    for (const shift of [0, 16]) {
      counts.fill(0);
      for (const i of order) counts[((bits[i] >>> shift) & 65535) + 1]++;
      for (let b = 0; b < BUCKETS; b++) counts[b + 1] += counts[b];
      const next = new Uint32Array(order.length);
      for (const i of order) next[counts[(bits[i] >>> shift) & 65535]++] = i;
      order = next;
    }
    return { order, range: [low, high] };
  }
}
