// Selecting, hiding and deleting Gaussians.

/** Bits of a Gaussian's flags. */
const [SELECTED, HIDDEN, DELETED] = [1, 2, 4];
/** Radius of the brush, pixels of the page. */
const BRUSH = 24;

export class Selection {
  /** `changed` is called after every change, also when one is undone. */
  constructor(means, history, changed) {
    this.means = means;
    this.flags = new Uint8Array(means.length / 3);
    this.history = history;
    this.changed = changed;
  }

  count(bit) {
    let count = 0;
    for (const flag of this.flags) if ((flag & bit) === bit && !(flag & DELETED & ~bit)) count++;
    return count;
  }

  /** Changes the flags of all Gaussians by a function of flag and number, as one step to undo. */
  change(of) {
    const before = this.flags;
    const after = before.map(of);
    if (after.every((flag, i) => flag === before[i])) return;
    const set = (flags) => {
      this.flags = flags;
      this.changed();
    };
    this.history.change(set, before, after);
  }

  clear() {
    this.change((flag) => flag & ~SELECTED);
  }

  invert() {
    this.change((flag) => (flag & (HIDDEN | DELETED) ? flag : flag ^ SELECTED));
  }

  hide() {
    this.change((flag) => (flag & SELECTED ? (flag | HIDDEN) & ~SELECTED : flag));
  }

  show() {
    this.change((flag) => flag & ~HIDDEN);
  }

  remove() {
    this.change((flag) => (flag & SELECTED ? (flag | DELETED) & ~SELECTED : flag));
  }

  /** Selects the visible Gaussians whose numbers `hit` accepts, in place of what is selected. */
  selectBy(hit) {
    this.change((flag, i) => (flag & (HIDDEN | DELETED) ? flag : hit(i) ? flag | SELECTED : flag & ~SELECTED));
  }

  /** The number of the visible Gaussian whose center is nearest to a point; -1 where there is none. */
  nearest(point) {
    const { means, flags } = this;
    let [found, least] = [-1, Infinity];
    for (let i = 0; point && i < flags.length; i++) {
      if (flags[i] & (HIDDEN | DELETED)) continue;
      const distance = (means[3 * i] - point[0]) ** 2 + (means[3 * i + 1] - point[1]) ** 2 + (means[3 * i + 2] - point[2]) ** 2;
      if (distance < least) [found, least] = [i, distance];
    }
    return found;
  }

  /** Selects the visible Gaussians whose centers `inside(x, y)` accepts; adds to what is selected, or takes away, or replaces it. */
  select(camera, inside, how) {
    const { means } = this;
    const { A, t, K } = camera;
    this.change((flag, i) => {
      if (flag & (HIDDEN | DELETED)) return flag;
      const [x, y, z] = [means[3 * i], means[3 * i + 1], means[3 * i + 2]];
      const depth = A[6] * x + A[7] * y + A[8] * z + t[2];
      const u = (K[0] * (A[0] * x + A[1] * y + A[2] * z + t[0])) / depth + K[2];
      const v = (K[1] * (A[3] * x + A[4] * y + A[5] * z + t[1])) / depth + K[3];
      const hit = depth > 0 && inside(u, v);
      if (how === "remove") return hit ? flag & ~SELECTED : flag;
      if (how === "add") return hit ? flag | SELECTED : flag;
      return hit ? flag | SELECTED : flag & ~SELECTED;
    });
  }

  /** A byte for each Gaussian: whether it is deleted. */
  deleted() {
    return this.flags.map((flag) => (flag & DELETED ? 1 : 0));
  }
}

const how = (event) => (event.altKey ? "remove" : event.shiftKey ? "add" : "replace");

/** A tool that selects in a rectangle or along a stroke; `page` has camera(), selection and overlay. */
export class SelectionTool {
  constructor(page, shape) {
    this.page = page;
    this.shape = shape;
  }

  begin(place) {
    this.places = [place];
    this.outline();
  }

  drag(place) {
    if (this.shape === "box") this.places[1] = place;
    else this.places.push(place);
    this.outline();
  }

  outline() {
    this.page.overlay.outline = { shape: this.shape, places: this.places, radius: BRUSH };
    this.page.overlay.draw();
  }

  cancel() {
    this.page.overlay.outline = null;
    this.page.overlay.draw();
  }

  end(place, event) {
    const { places } = this;
    this.cancel();
    const camera = this.page.camera(1);
    if (this.shape === "box") {
      const [[x0, y0], [x1, y1]] = [places[0], places[1] ?? place];
      const [left, right, top, bottom] = [Math.min(x0, x1), Math.max(x0, x1), Math.min(y0, y1), Math.max(y0, y1)];
      this.page.selection.select(camera, (x, y) => x >= left && x <= right && y >= top && y <= bottom, how(event));
    } else {
      this.page.selection.select(camera, (x, y) => places.some(([a, b]) => (x - a) ** 2 + (y - b) ** 2 <= BRUSH ** 2), how(event));
    }
  }
}
