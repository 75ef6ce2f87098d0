// Lifted features: the Gaussians that are like the one at a point that is clicked.

import { element, say, token } from "./status.js";

/** A tool that takes a click; `page` has pointAt(x, y), selection, renderer, panel and edited(). */
export class Alike {
  constructor(page) {
    this.page = page;
    element("features").hidden = false;
    element("like").addEventListener("click", () => page.panel.tool("like"));
    const least = element("least");
    least.addEventListener("input", () => (element("least-value").textContent = Number(least.value).toFixed(2)));
    element("select-alike").addEventListener("click", () => this.select(Number(least.value)));
  }

  begin() {}

  drag() {}

  cancel() {}

  async end([x, y]) {
    const { page } = this;
    const gaussian = page.selection.nearest(page.pointAt(x, y));
    if (gaussian < 0) return say("Nothing is there to be like.", true);
    try {
      const answer = await fetch(`alike?gaussian=${gaussian}`, { headers: { "X-Token": token() } });
      if (!answer.ok) throw new Error(await answer.text());
      page.renderer.alike = new Uint8Array(await answer.arrayBuffer());
      page.edited();
      element("alike").disabled = element("select-alike").disabled = false;
      page.panel.mode("alike");
    } catch (error) {
      say(`This point could not be compared: ${error.message}`, true);
    }
  }

  /** Selects what is at least so alike, and shows it in its colors. */
  select(least) {
    const { alike } = this.page.renderer;
    this.page.selection.selectBy((i) => alike[i] >= 255 * least);
    this.page.panel.mode("color");
  }
}
