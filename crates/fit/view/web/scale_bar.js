// A bar of a round length, where the scene's unit is known.

import { element } from "./status.js";
import { lengthText } from "./units.js";

/** Pixels that the bar has at most. */
const LONGEST = 130;

/** The largest of 1, 2, 5, 10, 20, ... and 0.5, 0.2, ... that is at most a length. */
function round(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].find((digit) => digit * power <= length) * power;
}

export class ScaleBar {
  /** Shows the length at the distance that one turns about; nothing where the meters of a unit are unknown. */
  show(camera, distance, meters) {
    element("scale").hidden = !meters;
    if (!meters) return;
    const pixels = camera.K[0] / distance / meters;
    const length = round(LONGEST / pixels);
    element("scale").style.width = `${length * pixels}px`;
    element("scale").textContent = lengthText(length / meters, meters);
  }
}
