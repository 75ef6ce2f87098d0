// A bar of a round length, where the scene's unit is known.

import { element } from "./status.js";

/** Pixels that the bar has at most. */
const LONGEST = 130;
const UNITS = [[1000, "km"], [1, "m"], [0.01, "cm"], [0.001, "mm"]];

/** The largest of 1, 2, 5, 10, 20, ... and 0.5, 0.2, ... that is at most a length. */
function round(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].find((digit) => digit * power <= length) * power;
}

export class ScaleBar {
  /** `meters` of a unit of the scene; without it, nothing is shown. */
  constructor(meters) {
    this.meters = meters;
    element("scale").hidden = !meters;
  }

  /** Shows the length at the distance that one turns about. */
  show(camera, distance) {
    if (!this.meters) return;
    const pixels = camera.K[0] / distance / this.meters;
    const length = round(LONGEST / pixels);
    const [size, name] = UNITS.find(([size]) => length >= 0.9999 * size) ?? UNITS.at(-1);
    element("scale").style.width = `${length * pixels}px`;
    element("scale").textContent = `${Number((length / size).toPrecision(1))} ${name}`;
  }
}
