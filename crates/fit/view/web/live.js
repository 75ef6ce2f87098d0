// A run that is followed: its steps, curves, and the scene or the picture as it becomes.

import { element, say, token } from "./status.js";

const NAMESPACE = "http://www.w3.org/2000/svg";
/** Milliseconds between two looks at the run. */
const PAUSE = 1000;

/** A number in few characters. */
const short = (value) => (Number.isInteger(value) ? value.toLocaleString("en") : value.toPrecision(4));

/** A line of numbers as a chart. */
function chart(name, values) {
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  const [title, last] = [document.createElement("span"), document.createElement("span")];
  title.textContent = name;
  last.textContent = short(values.at(-1)[1]);
  caption.append(title, last);
  const svg = document.createElementNS(NAMESPACE, "svg");
  svg.setAttribute("viewBox", "0 0 200 56");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `${name}, last ${last.textContent}`);
  const [steps, numbers] = [values.map(([step]) => step), values.map(([, value]) => value)];
  const [left, low] = [Math.min(...steps), Math.min(...numbers)];
  const [wide, high] = [Math.max(...steps) - left || 1, Math.max(...numbers) - low || 1];
  const line = document.createElementNS(NAMESPACE, "polyline");
  line.setAttribute("points", values.map(([step, value]) => `${(200 * (step - left)) / wide},${54 - (52 * (value - low)) / high}`).join(" "));
  for (const [key, value] of [["fill", "none"], ["stroke", "var(--accent)"], ["stroke-width", "1.5"], ["vector-effect", "non-scaling-stroke"]]) line.setAttribute(key, value);
  svg.append(line);
  // Where the pointer is, the nearest value.
  svg.addEventListener("pointermove", ({ offsetX }) => {
    const at = left + (wide * offsetX) / svg.clientWidth;
    const [step, value] = values.reduce((best, next) => (Math.abs(next[0] - at) < Math.abs(best[0] - at) ? next : best));
    last.textContent = `${short(value)} at step ${short(step)}`;
  });
  svg.addEventListener("pointerleave", () => (last.textContent = short(values.at(-1)[1])));
  figure.append(caption, svg);
  return figure;
}

export class Live {
  /** `take` gets the bytes of each new scene, which is at `address()`; without it, the newest picture is shown. */
  constructor(take, address) {
    Object.assign(this, { take, address, curves: new Map(), since: 0, version: 0 });
    element("run").hidden = false;
    element("stop").addEventListener("click", () => this.stop());
    this.look();
  }

  async look() {
    try {
      await this.follow();
      this.lost = 0;
    } catch {
      this.lost = (this.lost ?? 0) + 1;
      if (this.lost === 3) this.end("The run has ended, or its page is gone.");
    }
    if (!this.ended) setTimeout(() => this.look(), PAUSE);
  }

  async follow() {
    const answer = await fetch(`progress?since=${this.since}`, { headers: { "X-Token": token() } });
    if (!answer.ok) throw new Error("no progress");
    const { step, of, records, version, finished } = await answer.json();
    element("steps").max = of;
    element("steps").value = step;
    element("done").textContent = `Step ${step.toLocaleString("en")} of ${of.toLocaleString("en")}`;
    for (const { step: at, values } of records) {
      this.since = Math.max(this.since, at);
      for (const [name, value] of Object.entries(values)) {
        if (!this.curves.has(name)) this.curves.set(name, []);
        this.curves.get(name).push([at, value]);
      }
    }
    if (records.length > 0) {
      const shown = [...this.curves].filter(([name]) => name !== "seconds");
      element("curves").replaceChildren(...shown.map(([name, values]) => chart(name, values)));
    }
    if (version !== this.version) {
      if (this.take) await this.scene();
      else this.picture(version);
      this.version = version;
    }
    if (finished) this.end("The run has ended.");
  }

  async scene() {
    const scene = await fetch(this.address(), { headers: { "X-Token": token() } });
    if (!scene.ok) throw new Error("no scene");
    await this.take(await scene.arrayBuffer());
  }

  picture(version) {
    element("picture").src = `picture?version=${version}&token=${token()}`;
    element("picture").hidden = false;
  }

  end(text) {
    this.ended = true;
    element("stop").disabled = true;
    say(text, true);
  }

  async stop() {
    element("stop").disabled = true;
    const answer = await fetch("stop", { method: "POST", headers: { "X-Token": token() } });
    say(await answer.text(), true);
  }
}
