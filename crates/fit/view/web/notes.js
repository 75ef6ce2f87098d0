// Notes on a scene: its unit and up axis, lengths, viewpoints, and the keys of a camera path.

const NONE = { meters: null, up: null, lengths: [], views: [], keys: [] };

const finite = (value, count) => Array.isArray(value) && value.length === count && value.every(Number.isFinite);
const isView = (value) => typeof value === "string" && finite(value.split(",").map(Number), 10);
const positive = (value) => Number.isFinite(value) && value > 0;

/** Notes of a value from elsewhere; an error names what is not as it should be. */
export function checked(value) {
  const fail = (key, expected) => {
    throw new Error(`${key}: expected ${expected}`);
  };
  if (typeof value !== "object" || value === null || Array.isArray(value)) fail("notes", "an object");
  const { meters, up, lengths, views, keys } = { ...NONE, ...value };
  if (meters !== null && !positive(meters)) fail("meters", "a positive number");
  if (up !== null && !(finite(up, 3) && Math.hypot(...up) > 0)) fail("up", "three numbers that are not all 0");
  const all = (key, list, expected, good) => (Array.isArray(list) ? list.forEach((entry, i) => good(entry ?? {}) || fail(`${key}[${i}]`, expected)) : fail(key, "a list"));
  all("lengths", lengths, "two points", (ends) => Array.isArray(ends) && ends.length === 2 && ends.every((end) => finite(end, 3)));
  all("views", views, "title, text and view", ({ title, text, view }) => typeof title === "string" && typeof text === "string" && isView(view));
  all("keys", keys, "a view and positive seconds", ({ view, seconds }) => isView(view) && positive(seconds));
  return { meters, up, lengths, views, keys };
}

export class Notes {
  /** `changed(before, after)` is called after every change, also when one is undone. */
  constructor(history, changed) {
    Object.assign(this, { history, changed, state: NONE });
  }

  set(state) {
    const before = this.state;
    this.state = state;
    this.changed(before, state);
  }

  /** Changes a copy of the notes by a function, as one step to undo. */
  change(by) {
    const after = structuredClone(this.state);
    by(after);
    this.history.change((state) => this.set(state), this.state, after);
  }

  /** Takes out an entry of a list, or moves it by some places. */
  move(list, i, by) {
    this.change((notes) => {
      const [entry] = notes[list].splice(i, 1);
      if (by) notes[list].splice(i + by, 0, entry);
    });
  }

  /** The notes as JSON, without what is empty; "" where all is. */
  toText() {
    const full = Object.entries(this.state).filter(([, value]) => value !== null && value.length !== 0);
    return full.length > 0 ? JSON.stringify(Object.fromEntries(full)) : "";
  }
}
