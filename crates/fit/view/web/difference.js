// The error of a photo as a picture: the difference of render and photo in false colors.

import { element, say } from "./status.js";

/** The difference of a channel, of 255, that has the last color. */
const MOST = 64;
const STOPS = [[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]];

/** 256 false colors from black through red to pale yellow. */
const COLORS = Uint8Array.from({ length: 768 }, (_, i) => {
  const place = ((i / 3) | 0) / 255 * (STOPS.length - 1);
  const k = Math.min(place | 0, STOPS.length - 2);
  return STOPS[k][i % 3] + (place - k) * (STOPS[k + 1][i % 3] - STOPS[k][i % 3]);
});

export class Difference {
  constructor(page) {
    this.page = page;
    this.canvas = element("error");
    this.context = this.canvas.getContext("2d", { willReadFrequently: true });
    element("errors").addEventListener("change", () => this.show());
    page.shots.photo.addEventListener("load", () => this.on && page.changed());
  }

  get on() {
    return element("errors").checked && !this.page.shots.photo.hidden;
  }

  /** Follows the switch and the photo. */
  show() {
    const { page } = this;
    element("errors").disabled = page.shots.photo.hidden;
    element("side").textContent = this.on ? "error" : "photo";
    this.canvas.hidden = !this.on;
    element("error-value").textContent = "";
    if (this.on && page.look.mode !== "color") page.panel.mode("color");
    page.changed();
  }

  /** Measures the picture that was just drawn, at its size. */
  measure() {
    const { page, canvas, context } = this;
    const { photo } = page.shots;
    if (!this.on || page.travel || !photo.complete || photo.naturalWidth === 0) return;
    if (page.look.mode !== "color") return (this.canvas.hidden = true);
    this.canvas.hidden = false;
    const { clientWidth, clientHeight } = page.canvas;
    const frame = page.viewpoint.frame(clientWidth, clientHeight);
    const ratio = page.ratio;
    const [left, top, width, height] = [frame.left, frame.top, frame.width, frame.height].map((x) => Math.max(0, Math.round(x * ratio)));
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    context.drawImage(photo, 0, 0, width, height);
    let picture;
    try {
      picture = context.getImageData(0, 0, width, height);
    } catch (error) {
      element("errors").checked = false;
      this.show();
      return say(`The photo's pixels cannot be read: ${error.message}`, true);
    }
    const render = this.rendered(left, top, width, height);
    const { data } = picture;
    let squares = 0;
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const [to, from] = [4 * (y * width + x), 4 * ((height - 1 - y) * width + x)];
        let most = 0;
        for (let c = 0; c < 3; c++) {
          const difference = Math.abs(data[to + c] - render[from + c]);
          squares += difference * difference;
          if (difference > most) most = difference;
        }
        const color = 3 * Math.min(255, (most * 255) / MOST | 0);
        for (let c = 0; c < 3; c++) data[to + c] = COLORS[color + c];
        data[to + 3] = 255;
      }
    }
    context.putImageData(picture, 0, 0);
    const psnr = 10 * Math.log10((255 * 255 * 3 * width * height) / Math.max(squares, 1e-9));
    element("error-value").textContent = `${Math.min(psnr, 99).toFixed(1)} dB`;
  }

  /** The render's pixels, RGBA from the bottom row up. */
  rendered(left, top, width, height) {
    const { gl } = this.page.renderer;
    const bytes = 4 * width * height;
    if (this.bytes?.length !== bytes) this.bytes = new Uint8Array(bytes);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(left, this.page.canvas.height - top - height, width, height, gl.RGBA, gl.UNSIGNED_BYTE, this.bytes);
    return this.bytes;
  }
}
