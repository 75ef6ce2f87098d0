// A second scene over this one, cut by a slider: one that the page came with, or a file that is opened or dropped onto it.

import { Background } from "./background.js";
import { Order } from "./order.js";
import { Renderer } from "./renderer.js";
import { element, say } from "./status.js";

export class Second {
  /** `page` has canvas, look, shots, keyframes and changed(). */
  constructor(page) {
    Object.assign(this, { page, canvas: element("second"), split: element("split"), scene: null });
    this.split.addEventListener("input", () => this.cut());
    element("open-second").addEventListener("click", () => element("second-file").click());
    element("remove-second").addEventListener("click", () => this.remove());
    element("second-file").addEventListener("change", ({ target }) => {
      if (target.files[0]) this.take(target.files[0]);
      target.value = "";
    });
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      const [file] = event.dataTransfer.files;
      if (file) this.take(file);
    });
  }

  /** Takes a file of Gaussians; one of JSON is a camera path. */
  async take(file) {
    if (file.name.endsWith(".json")) return this.page.keyframes.take(file.name, await file.text());
    await this.open(file.name, async () => ({ bytes: await file.arrayBuffer() }));
  }

  /** Shows the scene of this name; `load` promises its bytes, or its text in base64. */
  async open(name, load) {
    say(`Loading ${name}.`, true);
    try {
      this.background ??= new Background();
      const source = await load();
      const scene = await this.background.call("load", source, source.bytes ? [source.bytes] : []);
      if (this.renderer) this.renderer.setScene(scene);
      else this.renderer = new Renderer(this.canvas, scene);
      this.order ??= new Order(this.background, this.renderer, () => this.page.changed());
      this.order.row = null;
      this.scene = scene;
      element("second-name").textContent = `${name}, ${scene.n.toLocaleString("en")} Gaussians, right of the slider.`;
      element("comparing").open = true;
      element("remove-second").disabled = false;
      say("");
      this.cut();
      this.page.changed();
    } catch (error) {
      say(`${name}: ${error.message}`, true);
    }
  }

  remove() {
    this.scene = null;
    element("second-name").textContent = "";
    element("remove-second").disabled = true;
    this.page.changed();
  }

  cut() {
    const share = Number(this.split.value);
    this.canvas.style.clipPath = `inset(0 0 0 ${share}%)`;
    this.split.style.setProperty("--at", `${share}%`);
  }

  /** Draws the second scene for the camera of the first; a photo that is compared takes its place. */
  draw(camera, look) {
    const shown = this.scene !== null && this.page.shots.photo.hidden;
    this.canvas.hidden = this.split.hidden = !shown;
    if (!shown) return;
    if (this.canvas.width !== camera.width) this.canvas.width = camera.width;
    if (this.canvas.height !== camera.height) this.canvas.height = camera.height;
    this.order.follow(camera, look);
    this.renderer.draw(camera, look);
  }
}
