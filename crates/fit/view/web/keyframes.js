// The camera path: its keys, playing it, and its file.

import { Path } from "./path.js";
import { control, element, fill, say } from "./status.js";
import { positive } from "./units.js";
import { length, times } from "./vectors.js";

/** Seconds from a new key to the next one. */
const SECONDS = 2;
/** Width of the pictures that a file asks for. */
const WIDTH = 1280;

/** Keys {view, seconds} of a transforms.json with a time for each frame; `text` writes a view. */
export function keysOf(json, distance, text) {
  let file;
  try {
    file = JSON.parse(json);
  } catch (error) {
    throw new Error(`expected JSON: ${error.message}`);
  }
  const frames = file?.frames;
  if (!Array.isArray(frames)) throw new Error("frames: expected a list");
  if (frames.length < 2) throw new Error(`frames: expected at least two keys, found ${frames.length}`);
  const keys = frames.map((frame, i) => {
    const place = `frames[${i}]`;
    const { time, transform_matrix: rows, fl_x, w, camera_angle_x } = { fl_x: file.fl_x, w: file.w, camera_angle_x: file.camera_angle_x, ...frame };
    if (!Number.isFinite(time)) throw new Error(`${place}.time: expected a time in seconds`);
    if (i > 0 && !(time > frames[i - 1].time)) throw new Error(`${place}.time: expected a time after ${frames[i - 1].time}, found ${time}`);
    const column = (j) => [0, 1, 2].map((row) => rows?.[row]?.[j]);
    const [right, up, back, eye] = [0, 1, 2, 3].map(column);
    if (![right, up, back, eye].flat().every(Number.isFinite)) throw new Error(`${place}.transform_matrix: expected 4 rows of 4 numbers`);
    if ([right, up, back].some((axis) => Math.abs(length(axis) - 1) > 1e-3)) throw new Error(`${place}.transform_matrix: expected a rigid transform`);
    const focal = fl_x > 0 && w > 0 ? fl_x / w : 0.5 / Math.tan(camera_angle_x / 2);
    if (!(focal > 0 && Number.isFinite(focal))) throw new Error(`${place}.fl_x: expected fl_x and w, or camera_angle_x`);
    return { time, view: text(eye, times(back, -distance), up, focal) };
  });
  return keys.map(({ time, view }, i) => ({ view, seconds: Number(((keys[i + 1]?.time ?? time + SECONDS) - time).toPrecision(6)) }));
}

export class Keyframes {
  constructor(page) {
    this.page = page;
    const act = (id, of) => element(id).addEventListener("click", of);
    act("add-key", () => this.add());
    act("play-path", () => this.play());
    act("export-path", () => page.offer(new Blob([JSON.stringify(this.file(), null, 1)], { type: "application/json" }), "path.json"));
    act("import-path", () => element("path-file").click());
    element("path-file").addEventListener("change", async ({ target }) => {
      const [file] = target.files;
      if (file) this.take(file.name, await file.text());
      target.value = "";
    });
  }

  get keys() {
    return this.page.notes.state.keys;
  }

  add() {
    element("film").open = true;
    this.page.notes.change(({ keys }) => keys.push({ view: this.page.viewpoint.toText(), seconds: SECONDS }));
  }

  /** Takes the keys of a file in place of these. */
  take(name, json) {
    const { page } = this;
    try {
      const keys = keysOf(json, page.viewpoint.distance, (eye, ahead, up, focal) => page.viewpoint.textOf(eye, ahead, up, focal));
      page.notes.change((notes) => (notes.keys = keys));
      say(`${keys.length} keys of ${name}.`, true);
    } catch (error) {
      say(`${name}: ${error.message}`, true);
    }
  }

  path() {
    return new Path(this.keys.map(({ view }) => this.page.viewpoint.ofText(view)), this.keys.map(({ seconds }) => seconds));
  }

  /** The keys as a transforms.json with times, which `render --path` films. */
  file() {
    let time = 0;
    const frames = this.keys.map(({ view, seconds }, i) => {
      const { eye, right, down, forward, lens } = this.page.viewpoint.ofText(view);
      const rows = [0, 1, 2].map((row) => [right[row], -down[row], -forward[row], eye[row]]);
      const height = Math.round((WIDTH * lens.height) / lens.width / 2) * 2;
      const focal = (WIDTH * lens.fx) / lens.width;
      const frame = { file_path: `key-${i + 1}`, time, w: WIDTH, h: height, fl_x: focal, fl_y: focal, cx: WIDTH / 2, cy: height / 2, transform_matrix: [...rows, [0, 0, 0, 1]] };
      time = Number((time + seconds).toPrecision(9));
      return frame;
    });
    return { frames };
  }

  play() {
    const { page } = this;
    if (page.travel?.path) return page.moved();
    if (this.keys.length < 2) return say("A path takes two keys at least. J adds one at this view.", true);
    const path = this.path();
    page.shots.leave();
    page.follow({ path, time: 1000 * path.seconds, view: (t) => page.viewpoint.along(path.at(t * path.seconds)) });
  }

  duration(i, input) {
    const seconds = positive(input.value);
    if (seconds) return this.page.notes.change(({ keys }) => (keys[i].seconds = seconds));
    say(`The seconds to the next key must be a number above 0; "${input.value}" is none.`, true);
    input.value = this.keys[i].seconds;
  }

  refresh() {
    const { page, keys } = this;
    const rows = keys.map(({ view, seconds }, i) => {
      const item = document.createElement("li");
      const go = control(`${i + 1}`, `Go to key ${i + 1}`, () => page.travelTo(page.viewpoint.ofText(view)));
      const input = Object.assign(document.createElement("input"), { type: "text", inputMode: "decimal", value: seconds, disabled: i === keys.length - 1 });
      input.setAttribute("aria-label", `Seconds from key ${i + 1} to the next`);
      input.addEventListener("change", () => this.duration(i, input));
      const up = control("↑", `Move key ${i + 1} up`, () => page.notes.move("keys", i, -1));
      const down = control("↓", `Move key ${i + 1} down`, () => page.notes.move("keys", i, 1));
      [up.disabled, down.disabled] = [i === 0, i === keys.length - 1];
      item.append(go, input, up, down, control("✕", `Remove key ${i + 1}`, () => page.notes.move("keys", i, 0)));
      return item;
    });
    fill(element("path-keys"), rows);
    const seconds = keys.slice(0, -1).reduce((sum, key) => sum + key.seconds, 0);
    element("path-length").textContent = keys.length > 1 ? `${keys.length} keys, ${Number(seconds.toPrecision(4))} seconds.` : "";
    element("play-path").disabled = element("export-path").disabled = keys.length < 2;
  }
}
