// A page in one file as it was sent, to be saved again with other notes.

import { element } from "./status.js";

export class Original {
  /** Called before anything of the page changes. */
  constructor(about) {
    this.about = about;
    const texts = ["about", "scene"].map((id) => [element(id), element(id).textContent]);
    this.scene = new Blob([texts[1][1]]);
    for (const [script] of texts) script.textContent = "";
    this.parts = `<!doctype html>\n${document.documentElement.outerHTML}`.split(/(id="(?:about|scene)">)/);
    for (const [script, text] of texts) script.textContent = text;
  }

  /** The file with these notes. */
  file(notes) {
    const look = { ...this.about.look, meters: notes.meters ?? null };
    const about = JSON.stringify({ ...this.about, look, notes }).replaceAll("<", "\\u003c");
    const [head, first, middle, second, end] = this.parts;
    return new Blob([head, first, about, middle, second, this.scene, end], { type: "text/html" });
  }
}
