// The address of the page, which keeps the view and the notes.

import { checked } from "./notes.js";
import { say } from "./status.js";

export class Address {
  /** `page` has viewpoint, notes and moved(). */
  constructor(page) {
    this.page = page;
    this.given = page.notes.toText();
    this.read();
    addEventListener("hashchange", () => this.read() && page.moved());
  }

  /** Takes what the address has; false where it has no other view. */
  read() {
    const { page } = this;
    const parts = new URLSearchParams(location.hash.slice(1));
    const [view, notes] = [parts.get("view"), parts.get("notes")];
    if (notes && notes !== page.notes.toText()) {
      try {
        const taken = checked(JSON.parse(notes));
        page.notes.change((state) => Object.assign(state, taken));
      } catch (error) {
        say(`The notes of this address cannot be read: ${error.message}`, true);
      }
    }
    const made = view && view !== this.view ? page.viewpoint.ofText(view) : null;
    if (made) page.viewpoint = made;
    return Boolean(made);
  }

  /** Writes the view and the notes into the address, a moment after the last change. */
  write() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.view = this.page.viewpoint.toText();
      const notes = this.page.notes.toText();
      const added = notes === this.given ? "" : `&notes=${encodeURIComponent(notes || "{}")}`;
      try {
        history.replaceState(null, "", `#view=${this.view}${added}`);
      } catch {
        // Some browsers forbid it for files; the page works without.
      }
    }, 300);
  }
}
