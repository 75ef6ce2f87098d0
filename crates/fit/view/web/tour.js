// Viewpoints with a title and a text, and their presentation.

import { control, element, fill, say } from "./status.js";

/** Milliseconds of the way from one viewpoint to the next. */
const WAY = 1400;

export class Tour {
  constructor(page) {
    Object.assign(this, { page, chosen: -1, presenting: false });
    const act = (id, of) => element(id).addEventListener("click", of);
    act("keep", () => this.keep());
    act("present", () => this.present(true));
    act("card-previous", () => this.step(-1));
    act("card-next", () => this.step(1));
    act("card-end", () => this.present(false));
    act("place-up", () => this.move(-1));
    act("place-down", () => this.move(1));
    act("place-here", () => page.notes.change(({ views }) => (views[this.chosen].view = page.viewpoint.toText())));
    act("place-remove", () => page.notes.move("views", this.chosen, 0));
    for (const name of ["title", "text"]) {
      element(`place-${name}`).addEventListener("change", ({ target }) => page.notes.change(({ views }) => (views[this.chosen][name] = target.value)));
    }
  }

  get views() {
    return this.page.notes.state.views;
  }

  keep() {
    element("tour").open = true;
    this.chosen = this.views.length;
    const title = `View ${this.views.length + 1}`;
    this.page.notes.change(({ views }) => views.push({ title, text: "", view: this.page.viewpoint.toText() }));
  }

  move(by) {
    const i = this.chosen;
    this.chosen += by;
    this.page.notes.move("views", i, by);
  }

  go(i) {
    this.chosen = i;
    const { page } = this;
    page.shots.leave();
    page.travelTo(page.viewpoint.ofText(this.views[i].view), WAY);
    this.refresh();
  }

  /** Goes to the next viewpoint, or by another number of them. */
  step(by) {
    const count = this.views.length;
    if (count === 0) return say("There are no viewpoints. O keeps this one.", true);
    this.go(this.chosen < 0 ? (by > 0 ? 0 : count - 1) : (this.chosen + by + count) % count);
  }

  present(on) {
    this.presenting = on && this.views.length > 0;
    document.body.classList.toggle("presenting", this.presenting);
    element("card").hidden = !this.presenting;
    if (this.presenting) {
      this.go(Math.max(0, this.chosen));
      element("card-next").focus();
    } else {
      element("view").focus({ preventScroll: true });
    }
  }

  refresh() {
    const { views } = this;
    this.chosen = Math.min(this.chosen, views.length - 1);
    const items = views.map(({ title }, i) => {
      const item = document.createElement("li");
      const button = control(title || `View ${i + 1}`, `Go to ${title || `view ${i + 1}`}`, () => this.go(i));
      if (i === this.chosen) button.setAttribute("aria-current", "true");
      item.append(button);
      return item;
    });
    fill(element("places"), items);
    element("present").disabled = views.length === 0;
    const view = views[this.chosen];
    element("place").hidden = !view;
    if (!view) return this.presenting && this.present(false);
    for (const name of ["title", "text"]) {
      element(`place-${name}`).value = view[name];
      element(`card-${name}`).textContent = view[name];
    }
    element("card-text").hidden = !view.text;
    element("card-number").textContent = `${this.chosen + 1} of ${views.length}`;
    [element("place-up").disabled, element("place-down").disabled] = [this.chosen === 0, this.chosen === views.length - 1];
  }
}
