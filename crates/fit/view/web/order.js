// The order in which a renderer draws its Gaussians, kept up with the view.

/** The row of a camera by which depths are computed. */
export const rowOf = (camera) => [...camera.A.slice(6), camera.t[2]];

export class Order {
  /** `sorted(range)` is called when a new order is there, with the depths between which most of the scene lies. */
  constructor(background, renderer, sorted) {
    Object.assign(this, { background, renderer, sorted, row: null, busy: false });
  }

  /** Sorts anew where the direction changed; one sort at a time, the last one wanted follows. */
  async follow(camera, { near, far }) {
    const row = rowOf(camera);
    if (this.busy || this.row?.every((x, i) => x === row[i])) return;
    this.busy = true;
    this.row = row;
    const { order, range } = await this.background.call("order", { row, near, far });
    this.renderer.setOrder(order);
    this.busy = false;
    this.sorted(range);
  }
}
