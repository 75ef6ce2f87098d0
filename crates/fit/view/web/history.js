// Changes of any kind that can be undone, in one order.

/** Changes that are kept. */
const MOST = 50;

export class History {
  constructor() {
    this.forget();
  }

  forget() {
    this.past = [];
    this.future = [];
  }

  /** Makes a change by going from one state to another; `set` takes a state. */
  change(set, before, after) {
    this.past.push({ set, before, after });
    if (this.past.length > MOST) this.past.shift();
    this.future = [];
    set(after);
  }

  undo() {
    const change = this.past.pop();
    if (!change) return;
    this.future.push(change);
    change.set(change.before);
  }

  redo() {
    const change = this.future.pop();
    if (!change) return;
    this.past.push(change);
    change.set(change.after);
  }
}
