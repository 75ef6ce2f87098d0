// Gaussians that float: faint, huge or lonely ones, hidden by sliders until they are deleted.

import { element, say } from "./status.js";
import { lengthText } from "./units.js";

/** A slider's limits from its weakest to its strongest end: opacity, times the median size, times the median room. */
const LIMITS = { faint: [0, 0.5], huge: [300, 3], lonely: [64, 2] };
const NAMES = Object.keys(LIMITS);

export class Clean {
  constructor(page) {
    this.page = page;
    for (const name of NAMES) element(name).addEventListener("input", () => this.look());
    element("clean-delete").addEventListener("click", () => this.remove());
    element("clean-reset").addEventListener("click", () => this.reset());
  }

  /** The limit of a slider; null where it is at rest. */
  limit(name) {
    const share = Number(element(name).value) / 100;
    if (share === 0) return null;
    const [weak, strong] = LIMITS[name];
    return weak === 0 ? strong * share : weak * (strong / weak) ** share;
  }

  /** Finds and hides what the sliders say; the worker measures a scene once. */
  async look() {
    const { page } = this;
    if (!this.scores && NAMES.some((name) => this.limit(name))) {
      const asking = (this.asking ??= page.background.call("floaters"));
      try {
        const scores = await asking;
        // Of a scene that another one replaced meanwhile.
        if (asking !== this.asking) return;
        this.scores = scores;
      } catch (error) {
        this.asking = null;
        return say(`The Gaussians could not be measured: ${error.message}`, true);
      }
    }
    const { opacity, size, room, medianSize, medianRoom } = this.scores ?? {};
    const [faint, huge, lonely] = NAMES.map((name) => this.limit(name));
    const { flags } = page.selection;
    const preview = (this.preview ??= new Uint8Array(flags.length));
    let count = 0;
    for (let i = 0; i < flags.length; i++) {
      const floats = !(flags[i] & 4) && ((faint && opacity[i] < faint) || (huge && size[i] > huge * medianSize) || (lonely && room[i] > lonely * medianRoom));
      preview[i] = floats ? 1 : 0;
      if (floats) count++;
    }
    this.count = count;
    const { meters } = page.notes.state;
    element("faint-value").textContent = faint ? `below ${faint.toFixed(2)}` : "off";
    element("huge-value").textContent = huge ? `above ${lengthText(huge * medianSize, meters)}` : "off";
    element("lonely-value").textContent = lonely ? `within ${lengthText(lonely * medianRoom, meters)}` : "off";
    element("cleaned").textContent = faint || huge || lonely ? `${count.toLocaleString("en")} of ${flags.length.toLocaleString("en")} Gaussians are hidden.` : "";
    element("clean-delete").disabled = count === 0;
    page.edited();
  }

  /** Deletes what is hidden, as one step to undo. */
  remove() {
    const { preview } = this;
    if (!this.count) return;
    this.page.selection.change((flag, i) => (preview[i] ? (flag | 4) & ~1 : flag));
    this.reset();
  }

  reset() {
    for (const name of NAMES) element(name).value = 0;
    this.look();
  }

  /** Another scene is there. */
  forget() {
    const { preview } = this;
    this.scores = this.asking = this.preview = null;
    if (preview) this.reset();
  }
}
