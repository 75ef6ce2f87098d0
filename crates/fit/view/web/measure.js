// Lengths between points, the scale that one of them sets, and the ground through three points.

import { PointTool } from "./points.js";
import { control, element, fill, say } from "./status.js";
import { UNITS, lengthText, positive } from "./units.js";
import { cross, dot, length, subtract, unit } from "./vectors.js";

/** Smallest sine of an angle of a triangle that is taken for the ground. */
const THIN = 0.02;

export class Measure {
  constructor(page) {
    this.page = page;
    this.chosen = -1;
    this.length = new PointTool(page, 2, (ends) => this.measured(ends));
    this.ground = new PointTool(page, 3, (points) => this.level(points));
    element("measure").addEventListener("click", () => page.panel.tool("measure"));
    element("ground").addEventListener("click", () => page.panel.tool("ground"));
    element("unit").replaceChildren(...UNITS.map(([size, name]) => new Option(name, size, size === 1, size === 1)));
    element("known-length").addEventListener("submit", (event) => {
      event.preventDefault();
      this.scale(element("known").value);
    });
    element("no-scale").addEventListener("click", () => page.notes.change((notes) => (notes.meters = null)));
  }

  measured(ends) {
    this.chosen = this.page.notes.state.lengths.length;
    this.page.notes.change(({ lengths }) => lengths.push(ends.map((end) => end.map((x) => Number(x.toPrecision(6))))));
  }

  /** Sets the unit of the scene by the true length of the chosen line. */
  scale(text) {
    const [known, ends] = [positive(text), this.page.notes.state.lengths[this.chosen]];
    if (!known) return say(`The length must be a number above 0, as 0.42; "${text}" is none.`, true);
    const measured = length(subtract(...ends));
    if (!(measured > 0)) return say("Both ends are one point: it has no length.", true);
    this.page.notes.change((notes) => (notes.meters = Number(((known * Number(element("unit").value)) / measured).toPrecision(6))));
  }

  /** Makes the normal of three points, on the side of the cameras, the up axis. */
  level(points) {
    const { page } = this;
    const [a, b] = [subtract(points[1], points[0]), subtract(points[2], points[0])];
    const normal = cross(a, b);
    const longest = Math.max(length(a), length(b), length(subtract(a, b)));
    if (!(length(normal) > THIN * longest ** 2)) return say("The three points lie on a line. Take three that are apart, as the corners of a table.", true);
    const above = (eye) => Math.sign(dot(normal, subtract(eye, points[0])));
    const sides = page.shots.all.reduce((sum, shot) => sum + above(shot.eye), 0) || above(page.viewpoint.eye);
    page.panel.tool("ground");
    page.setUp(unit(normal).map((x) => Number((Math.sign(sides) * x).toPrecision(6))));
  }

  refresh() {
    const { lengths, meters } = this.page.notes.state;
    this.chosen = Math.min(this.chosen, lengths.length - 1);
    const rows = lengths.map((ends, i) => {
      const item = document.createElement("li");
      const text = lengthText(length(subtract(...ends)), meters);
      const choose = control(text, `Length ${i + 1}, ${text}`, () => {
        this.chosen = i;
        this.refresh();
        this.page.overlay.draw();
      });
      if (i === this.chosen) choose.setAttribute("aria-current", "true");
      item.append(choose, control("✕", `Remove length ${i + 1}`, () => this.page.notes.move("lengths", i, 0)));
      return item;
    });
    fill(element("lengths"), rows);
    element("known-length").hidden = this.chosen < 0;
    element("scale-is").hidden = !meters;
    element("meters").textContent = meters ? `A unit is ${lengthText(1, meters)}.` : "";
  }

  draw(marks) {
    const { lengths, meters } = this.page.notes.state;
    lengths.forEach(([a, b], i) => marks.line(a, b, lengthText(length(subtract(a, b)), meters), i === this.chosen));
  }
}
