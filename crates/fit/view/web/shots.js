// The cameras of the photos: a strip to choose from, and a photo beside the render.

import { length, subtract } from "./vectors.js";

export class Shots {
  /** `about.cameras` are name, A, eye, lens, held_out, photo (an address) and coverage, these if there are any; `page` has go(shot) and moved(). */
  constructor(cameras, page) {
    this.page = page;
    this.all = cameras.map((camera) => ({ ...camera, axes: [0, 3, 6].map((row) => camera.A.slice(row, row + 3)) }));
    this.current = -1;
    const middle = [0, 1, 2].map((axis) => this.all.reduce((sum, shot) => sum + shot.eye[axis], 0) / Math.max(1, this.all.length));
    const far = this.all.map((shot) => length(subtract(shot.eye, middle))).sort((a, b) => a - b);
    /** Size of the place that cameras fill, world units. */
    this.spread = far[Math.floor(far.length / 2)] || 1;
    this.strip = document.getElementById("strip");
    this.photo = document.getElementById("photo");
    this.wipe = document.getElementById("wipe");
    this.wipe.addEventListener("input", () => this.cut());
    this.photo.addEventListener("error", () => this.show(false));
    this.strip.hidden = this.all.length === 0;
    this.fill();
  }

  /** A button for each camera. */
  fill() {
    const list = this.strip.querySelector("ul");
    const items = this.all.map((shot, i) => {
      const [item, button] = [document.createElement("li"), document.createElement("button")];
      button.type = "button";
      button.title = shot.held_out ? `${shot.name} (held out)` : shot.name;
      if (typeof shot.coverage === "number") {
        button.title += `: other photos agree about the depth of ${Math.round(100 * shot.coverage)} % of it`;
        button.style.setProperty("--coverage", shot.coverage);
        button.classList.add("covered");
      }
      button.classList.toggle("held-out", Boolean(shot.held_out));
      button.addEventListener("click", () => this.choose(i));
      if (shot.photo) {
        const image = document.createElement("img");
        image.loading = "lazy";
        image.alt = "";
        // A server that ended has no more photos.
        image.addEventListener("error", () => image.replaceWith(document.createElement("i")));
        image.src = shot.thumbnail ?? shot.photo;
        button.append(image);
      } else {
        button.append(document.createElement("i"));
      }
      const label = document.createElement("span");
      label.textContent = shot.name.split("/").at(-1).replace(/\.[a-z0-9]{1,5}$/i, "");
      button.append(label);
      item.append(button);
      return item;
    });
    list.replaceChildren(...items);
    this.buttons = items.map((item) => item.firstChild);
  }

  /** Goes to a camera, and shows its photo if there is one. */
  choose(i) {
    const shot = this.all[i];
    if (!shot) return;
    this.current = i;
    this.buttons.forEach((button, k) => {
      if (k === i) button.setAttribute("aria-current", "true");
      else button.removeAttribute("aria-current");
    });
    // Within the strip alone: the page itself does not scroll.
    const list = this.strip.querySelector("ul");
    const button = this.buttons[i];
    list.scrollTo({ left: button.offsetLeft - (list.clientWidth - button.offsetWidth) / 2 });
    this.page.go(shot);
    if (shot.photo) {
      this.photo.src = shot.photo;
      this.photo.alt = `Photo ${shot.name}`;
    }
    this.show(Boolean(shot.photo));
    this.page.overlay.draw();
  }

  step(by) {
    const count = this.all.length;
    if (count > 0) this.choose((this.current + by + count) % count);
  }

  /** Another view was taken: the photo no longer fits. */
  leave() {
    if (this.current < 0) return;
    this.buttons[this.current].removeAttribute("aria-current");
    this.current = -1;
    this.show(false);
  }

  show(visible) {
    this.photo.hidden = this.wipe.hidden = !visible;
    document.getElementById("sides").hidden = !visible;
    this.page.difference?.show();
    if (visible) this.cut();
  }

  /** Lays the photo over the lens's image, as far as the slider says: photo to the left, render to the right. */
  cut() {
    const { clientWidth, clientHeight } = this.page.canvas;
    const { left, top, width, height } = this.page.viewpoint.frame(clientWidth, clientHeight);
    const share = Number(this.wipe.value);
    const error = document.getElementById("error");
    for (const element of [this.photo, error, this.wipe, document.getElementById("sides")]) {
      Object.assign(element.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
    }
    for (const element of [this.wipe, document.getElementById("sides")]) element.style.setProperty("--at", `${share}%`);
    this.photo.style.clipPath = error.style.clipPath = `inset(0 ${100 - share}% 0 0)`;
  }

  /** The up axis that cameras agree about: the mean of their image's upward directions. */
  up() {
    const sum = [0, 1, 2].map((axis) => this.all.reduce((total, shot) => total - shot.axes[1][axis], 0));
    return this.all.length > 0 && length(sum) > 0.1 * this.all.length ? sum : null;
  }
}

/** A viewpoint's place for a shot: its eye, and a target straight ahead. */
export function placeOf(shot, distance) {
  const [, down, forward] = shot.axes;
  return { eye: shot.eye, target: shot.eye.map((x, i) => x + distance * forward[i]), down, lens: shot.lens };
}
