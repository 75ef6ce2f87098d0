// How faint, large and lonely Gaussians are, in the worker.

/** Neighbors that a Gaussian has room without. */
const NEIGHBORS = 8;
/** Doublings of the cells. */
const LEVELS = 18;
/** Cells along an axis at most, on both sides of the origin, so that a cell's key is exact in a double. */
const CELLS = 65536;

/** The middle one of some numbers. */
function median(values) {
  const sorted = Float32Array.from(values).sort();
  return sorted[sorted.length >> 1] || 0;
}

/** Numbers of points in the cells of a grid, by open addressing. */
class Grid {
  constructor(n) {
    this.slots = 2 ** Math.ceil(Math.log2(2 * n + 2));
    this.keys = new Float64Array(this.slots);
    this.counts = new Uint32Array(this.slots);
  }

  clear() {
    this.counts.fill(0);
  }

  /** The slot of a key: its own, or a free one. */
  slot(key) {
    const { slots, keys, counts } = this;
    let at = (Math.imul(key % 4294967291, 2654435761) ^ Math.imul(key / 4294967291, 40503)) >>> 0;
    at = (at ^ (at >>> 15)) & (slots - 1);
    while (counts[at] > 0 && keys[at] !== key) at = (at + 1) & (slots - 1);
    return at;
  }

  add(key) {
    const at = this.slot(key);
    this.keys[at] = key;
    this.counts[at]++;
  }
}

/**
 * For each Gaussian the side of the smallest cube of 3 x 3 x 3 cells around it that has eight others; cells double from `cell` on.
 * Infinite where even the largest has fewer.
 */
export function rooms(means, cell) {
  const n = means.length / 3;
  const room = new Float32Array(n).fill(Infinity);
  const grid = new Grid(n);
  const wide = 2 * CELLS + 4;
  const key = (x, y, z) => (x * wide + y) * wide + z;
  const cells = [0, 0, 0];
  /** Finds the cell of a point; false beyond the grid. */
  const find = (i, side) => {
    for (let axis = 0; axis < 3; axis++) {
      const place = Math.floor(means[3 * i + axis] / side);
      if (!(Math.abs(place) <= CELLS)) return false;
      cells[axis] = place + CELLS + 1;
    }
    return true;
  };
  let alone = Uint32Array.from({ length: n }, (_, i) => i);
  for (let level = 0; level < LEVELS && alone.length > 0; level++) {
    const side = cell * 2 ** level;
    grid.clear();
    for (let i = 0; i < n; i++) if (find(i, side)) grid.add(key(...cells));
    alone = alone.filter((i) => {
      if (!find(i, side)) return true;
      const [x, y, z] = cells;
      let others = -1;
      for (let dx = -1; dx <= 1; dx++) {
        for (let dy = -1; dy <= 1; dy++) {
          for (let dz = -1; dz <= 1; dz++) {
            others += grid.counts[grid.slot(key(x + dx, y + dy, z + dz))];
            if (others >= NEIGHBORS) {
              room[i] = 3 * side;
              return false;
            }
          }
        }
      }
      return true;
    });
  }
  return room;
}

/** Opacity, largest standard deviation and room of each Gaussian, with the medians of the last two. */
export function floaters({ n, stride, at, values }, means) {
  const [opacity, size] = [new Float32Array(n), new Float32Array(n)];
  for (let i = 0; i < n; i++) {
    const row = i * stride;
    opacity[i] = 1 / (1 + Math.exp(-values[row + at.opacity]));
    size[i] = Math.exp(Math.max(values[row + at.scale], values[row + at.scale + 1], values[row + at.scale + 2]));
  }
  const middle = [0, 1, 2].map((axis) => median(means.filter((_, i) => i % 3 === axis)));
  const centered = means.map((x, i) => x - middle[i % 3]);
  // About the distance of neighbors on a surface.
  const room = rooms(centered, Math.max(median(centered.map(Math.abs)), 1e-20) / Math.sqrt(n));
  return { opacity, size, room, medianSize: median(size), medianRoom: median(room) };
}
