// A scene that moves: the time that is shown, and the film in a loop.

import { element, say, token } from "./status.js";

/** Seconds of the whole film. */
const FILM = 4;

export class Moment {
  /** `page` has replace(source, same), and about with the lengths of the moments that a file of its own holds. */
  constructor(page) {
    Object.assign(this, { page, time: 0.5 });
    element("moment").hidden = false;
    element("time").addEventListener("input", ({ target }) => this.show(Number(target.value)));
    element("play").addEventListener("click", () => this.play());
  }

  /** Shows a time; one question at a time, the last one wanted follows. */
  async show(time) {
    this.time = time;
    element("time").value = time;
    element("time-value").textContent = time.toFixed(2);
    if (this.asking) return;
    this.asking = true;
    try {
      for (let shown = null; shown !== this.time; ) {
        shown = this.time;
        if (this.place() === this.last) continue;
        this.last = this.place();
        await this.page.replace(await this.scene(), true);
      }
    } catch (error) {
      this.playing = false;
      say(`This time could not be loaded: ${error.message}`, true);
    } finally {
      this.asking = false;
    }
  }

  address() {
    return `scene?time=${this.time}`;
  }

  /** The number of the nearest moment in this file; where a server has all moments, the time itself. */
  place() {
    const { moments } = this.page.about;
    return moments ? Math.round(this.time * (moments.length - 1)) : this.time;
  }

  /** The scene at this time: from the server, or the nearest moment in this file. */
  async scene() {
    const { moments } = this.page.about;
    if (moments) {
      const text = element(`moment-${this.place()}`)?.textContent ?? "";
      if (text.length !== moments[this.place()]) throw new Error("this file is incomplete");
      return { text, antialiased: this.page.about.look.antialiased };
    }
    const answer = await fetch(this.address(), { headers: { "X-Token": token() } });
    if (!answer.ok) throw new Error(await answer.text());
    return { bytes: await answer.arrayBuffer() };
  }

  async play() {
    this.playing = !this.playing;
    for (let last = performance.now(); this.playing; ) {
      element("play").setAttribute("aria-pressed", "true");
      const now = await new Promise(requestAnimationFrame);
      await this.show((this.time + Math.max(0, now - last) / 1000 / FILM) % 1);
      last = now;
    }
    element("play").setAttribute("aria-pressed", "false");
  }
}
