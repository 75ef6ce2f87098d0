// The page: it loads the scene, draws when something changes, and keeps the view in the address.

import { Address } from "./address.js";
import { Alike } from "./alike.js";
import { Background } from "./background.js";
import { Clean } from "./clean.js";
import { Controls } from "./controls.js";
import { Difference } from "./difference.js";
import { History } from "./history.js";
import { Keyframes } from "./keyframes.js";
import { Live } from "./live.js";
import { Measure } from "./measure.js";
import { Moment } from "./moment.js";
import { Notes, checked } from "./notes.js";
import { Order, rowOf } from "./order.js";
import { Original } from "./original.js";
import { Overlay } from "./overlay.js";
import { Panel } from "./panel.js";
import { Renderer } from "./renderer.js";
import { ScaleBar } from "./scale_bar.js";
import { Second } from "./second.js";
import { Selection, SelectionTool } from "./selection.js";
import { Shots, placeOf } from "./shots.js";
import { element, say, token } from "./status.js";
import { Tour } from "./tour.js";
import { add, times, unit } from "./vectors.js";
import { Viewpoint, between } from "./viewpoint.js";

/** Milliseconds of a frame above which the picture is drawn coarser while it moves. */
const SLOW = 50;
/** Milliseconds of the way from one camera to another. */
const TRAVEL = 450;

class Page {
  constructor(about, background, scene, original) {
    Object.assign(this, { about, background, scene, original });
    this.canvas = element("view");
    this.renderer = new Renderer(this.canvas, scene);
    this.order = new Order(background, this.renderer, (range) => {
      this.look.depths = range;
      this.changed();
    });
    this.look = { mode: "color", degree: scene.degree, exposure: 0, depths: [0, 1], ...about.look };
    this.viewpoint = new Viewpoint(about.home);
    this.ratio = 1;
    this.overlay = new Overlay(element("over"), this);
    this.scaleBar = new ScaleBar();
    this.history = new History();
    this.notes = new Notes(this.history, (before, after) => this.noted(before, after));
    this.shots = new Shots(about.cameras, this);
    this.selection = new Selection(scene.means, this.history, () => this.edited());
    this.panel = new Panel(this);
    this.controls = new Controls(this.canvas, this);
    this.measure = new Measure(this);
    this.tour = new Tour(this);
    this.keyframes = new Keyframes(this);
    this.clean = new Clean(this);
    this.difference = new Difference(this);
    this.second = new Second(this);
    if (about.features) this.alike = new Alike(this);
    this.notes.set(checked({ meters: about.look.meters, ...about.notes }));
    this.address = new Address(this);
    this.history.forget();
    new ResizeObserver(() => this.resized()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", () => say("The graphics card was lost. Load the page again."));
    if (this.renderer.kind === "byte") say("This device blends in 8 bits: colors are coarser than those of the scene.", true);
  }

  /** The camera of the canvas; `ratio` is pixels of the picture over those of the page. */
  camera(ratio = this.ratio) {
    const { clientWidth, clientHeight } = this.canvas;
    return this.viewpoint.camera(Math.max(1, Math.round(clientWidth * ratio)), Math.max(1, Math.round(clientHeight * ratio)));
  }

  /** The view changed by hand. */
  moved() {
    this.travel = null;
    this.shots.leave();
    this.turned();
  }

  turned() {
    this.movedAt = performance.now();
    this.changed();
    this.address?.write();
  }

  /** The notes changed. */
  noted(before, after) {
    if (String(before.up) !== String(after.up)) {
      this.viewpoint.up = unit(after.up ?? this.about.up);
      this.level();
    }
    for (const part of [this.measure, this.tour, this.keyframes]) part.refresh();
    this.panel.showUp();
    this.panel.selected();
    this.turned();
  }

  /** Sets the up axis; null is that of the scene. */
  setUp(up) {
    this.notes.change((notes) => (notes.up = up));
  }

  /** Something is to be drawn anew. */
  changed() {
    this.overlay.draw();
    this.scaleBar.show(this.camera(1), this.viewpoint.distance, this.notes.state.meters);
    this.panel.refresh();
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  resized() {
    if (this.shots.current >= 0 && !this.shots.photo.hidden) this.shots.cut();
    this.changed();
  }

  edited() {
    this.renderer.setFlags(this.selection.flags, this.clean.preview);
    this.panel.selected();
    this.changed();
  }

  frame(now) {
    this.pending = false;
    if (this.travel) this.goOn(now);
    const full = devicePixelRatio || 1;
    const moving = now - (this.movedAt ?? 0) < 200;
    // Coarser by what the last frames took, while something moves; sharp as soon as it rests.
    this.ratio = moving && this.pace > SLOW ? Math.max(0.35, full * Math.sqrt(SLOW / this.pace)) : full;
    const camera = this.camera();
    if (this.canvas.width !== camera.width) this.canvas.width = camera.width;
    if (this.canvas.height !== camera.height) this.canvas.height = camera.height;
    this.order.follow(camera, this.look);
    const start = performance.now();
    this.renderer.draw(camera, this.look);
    this.second.draw(camera, this.look);
    // Reading a pixel waits for the picture, so that the time is that of drawing.
    const { gl } = this.renderer;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    const took = performance.now() - start;
    const scaled = took * (full / this.ratio) ** 2;
    this.pace = this.pace === undefined ? scaled : 0.7 * this.pace + 0.3 * scaled;
    this.canvas.classList.add("shown");
    element("poster").hidden = true;
    const pace = 1000 / Math.max(took, 1);
    element("pace").textContent = `· ${pace < 10 ? pace.toFixed(1) : pace.toFixed(0)} per second`;
    element("pace").title = `${took.toFixed(1)} ms for a picture of ${camera.width} x ${camera.height}`;
    if (!moving) this.difference.measure();
    if (this.ratio < full) setTimeout(() => this.changed(), 220);
  }

  get sorting() {
    return this.order.busy;
  }

  /** Travels to a shot. */
  go(shot) {
    const next = this.viewpoint.copy();
    const { eye, target, down, lens } = placeOf(shot, this.viewpoint.distance);
    next.lens = lens;
    next.place(eye, target, down);
    this.travelTo(next);
  }

  travelTo(next, time = TRAVEL) {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.viewpoint = next;
      return this.turned();
    }
    const from = this.viewpoint.copy();
    this.follow({ time, view: (t) => (t < 1 ? between(from, next, t * t * (3 - 2 * t)) : next) });
  }

  /** Shows `view(t)` while t goes from 0 to 1 within so many milliseconds. */
  follow(travel) {
    this.travel = { ...travel, start: performance.now() };
    this.turned();
  }

  goOn(now) {
    const { view, time, start } = this.travel;
    const t = Math.min(1, Math.max(0, (now - start) / time));
    this.viewpoint = view(t);
    if (t === 1) this.travel = null;
    this.turned();
    if (t === 1 && this.shots.current >= 0 && !this.shots.photo.hidden) this.shots.cut();
  }

  home() {
    this.shots.leave();
    const { up } = this.viewpoint;
    const next = new Viewpoint({ ...this.about.home, up });
    this.travelTo(next);
  }

  level() {
    this.viewpoint.place(this.viewpoint.eye, this.viewpoint.target);
    this.moved();
  }

  /** The point of what is seen at a pixel of the page; null where hardly anything is. */
  pointAt(x, y) {
    const camera = this.camera(1);
    const depth = this.renderer.depthAt(camera, this.look, x, y);
    if (depth === null) return null;
    const [u, v] = [(x - camera.K[2]) / camera.K[0], (y - camera.K[3]) / camera.K[1]];
    const { eye, right, down, forward } = this.viewpoint;
    return add(eye, add(add(times(right, u * depth), times(down, v * depth)), times(forward, depth)));
  }

  /** Turns about what is seen at a pixel of the page. */
  pick(x, y) {
    const point = this.pointAt(x, y);
    if (!point) return say("Nothing is there to turn about.", true);
    const next = this.viewpoint.copy();
    next.aim(point);
    this.shots.leave();
    this.travelTo(next);
  }

  get tool() {
    return this.toolName ? this.tools[this.toolName] : null;
  }

  setTool(name) {
    this.tools ??= { box: new SelectionTool(this, "box"), brush: new SelectionTool(this, "brush"), like: this.alike, measure: this.measure.length, ground: this.measure.ground };
    this.tool?.cancel();
    this.toolName = name;
    this.canvas.classList.toggle("tool", Boolean(name));
  }

  /** Offers bytes as a file. */
  offer(blob, name) {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  picture() {
    this.renderer.draw(this.camera(), this.look);
    this.canvas.toBlob((blob) => this.offer(blob, "view.png"));
  }

  async download() {
    const { blob } = await this.background.call("ply", { dropped: this.selection.deleted(), up: this.savedUp() });
    this.offer(blob, "scene.ply");
  }

  /** The up axis that saved files are turned by, if they are. */
  savedUp() {
    return element("turn-saved").checked && !element("turn-saved").disabled ? unit(this.notes.state.up) : null;
  }

  /** Keeps the notes: beside the scene of a server, else in this page, saved again. False where they could not be kept. */
  async saveNotes() {
    const text = this.notes.toText();
    if (this.original) return this.offer(this.original.file(JSON.parse(text || "{}")), "view.html");
    const answer = await fetch("notes", { method: "POST", headers: { "X-Token": token() }, body: text || "{}" });
    say(await answer.text(), true);
    if (answer.ok) this.savedNotes = text;
    return answer.ok;
  }

  async save(format) {
    say(`Saving as ${format}.`, true);
    if ((this.savedNotes ?? this.address.given) !== this.notes.toText() && !(await this.saveNotes())) return;
    const up = this.savedUp();
    const answer = await fetch(`save?format=${encodeURIComponent(format)}${up ? `&up=${up}` : ""}`, { method: "POST", headers: { "X-Token": token() }, body: this.selection.deleted() });
    say(await answer.text(), true);
  }

  /** Takes a scene in place of this one, from the same place; `same` Gaussians keep what was selected, hidden and deleted. */
  async replace(source, same = false) {
    const scene = await this.background.call("load", source, source.bytes ? [source.bytes] : []);
    const row = rowOf(this.camera());
    const { order, range } = await this.background.call("order", { row, near: this.look.near, far: this.look.far });
    // At once from here on: no picture has the one scene in the order of the other.
    this.scene = scene;
    this.renderer.setScene(scene);
    this.renderer.setOrder(order);
    [this.order.row, this.look.depths] = [row, range];
    if (same && scene.n === this.selection.flags.length) this.selection.means = scene.means;
    else {
      this.history.forget();
      this.selection = new Selection(scene.means, this.history, () => this.edited());
    }
    this.clean.forget();
    this.counted();
    this.edited();
  }

  counted() {
    element("count").textContent = `${this.scene.n.toLocaleString("en")} Gaussians`;
  }

  /** Draws one exact picture for a given camera, for tests: {width, height, ...} as cameras of `about` are; RGBA in base64. */
  async exactly(shot, look = {}, kind = this.renderer.kind) {
    const [width, height] = [shot.lens.width, shot.lens.height];
    const { fx, fy, cx, cy } = shot.lens;
    const t = [0, 3, 6].map((row) => -(shot.A[row] * shot.eye[0] + shot.A[row + 1] * shot.eye[1] + shot.A[row + 2] * shot.eye[2]));
    const camera = { A: shot.A, t, eye: shot.eye, K: [fx, fy, cx, cy], width, height };
    const { order } = await this.background.call("order", { row: [...shot.A.slice(6), t[2]], near: this.look.near, far: this.look.far, exact: true });
    this.renderer.setOrder(order);
    this.canvas.width = width;
    this.canvas.height = height;
    this.renderer.draw(camera, { ...this.look, ...look }, kind);
    const pixels = this.renderer.pixels(width, height);
    this.order.row = null;
    let text = "";
    for (let i = 0; i < pixels.length; i += 32768) text += String.fromCharCode(...pixels.subarray(i, i + 32768));
    return btoa(text);
  }
}

/** The scene as the file or the server has it; of a server a part, if that is said. */
async function request(about, part = "") {
  if (about.source) {
    const answer = await fetch(about.source + part, { headers: { "X-Token": token() } });
    if (!answer.ok) throw new Error(`The scene could not be loaded: ${await answer.text()}`);
    return { bytes: await answer.arrayBuffer(), antialiased: about.look.antialiased };
  }
  const text = element("scene")?.textContent ?? "";
  if (text.length !== about.length) {
    throw new Error(`This file is incomplete: ${text.length.toLocaleString("en")} of ${about.length.toLocaleString("en")} bytes of the scene are there. Copy it again.`);
  }
  return { text, antialiased: about.look.antialiased };
}

/** The scene over the first one. */
async function second(about) {
  return about.source ? request(about, "?part=second") : { text: element("second-scene").textContent };
}

/** Puts all of a scene in the place of its beginning. */
async function complete(page, about) {
  say("These are the Gaussians that show most. The others are being loaded.");
  try {
    await page.replace(await request(about));
    say("");
  } catch (error) {
    say(`The rest of the scene is missing: ${error.message}`);
  }
}

async function begin() {
  const about = JSON.parse(element("about").textContent);
  const probe = document.createElement("canvas").getContext("webgl2");
  if (!probe) return say("This browser has no WebGL2: this is a picture of the scene.", false);
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  const original = about.source ? null : new Original(about);
  say("Loading the scene.");
  const background = new Background();
  const source = await request(about, about.beginning ? "?part=beginning" : "");
  const scene = await background.call("load", source, source.bytes ? [source.bytes] : []);
  element("scene")?.remove();
  say("");
  const page = new Page(about, background, scene, original);
  globalThis.splatweaver = page;
  page.counted();
  page.turned();
  if (about.report) {
    element("report").href = about.report;
    element("report").hidden = false;
  }
  const moment = about.moves ? new Moment(page) : null;
  if (about.beginning) await complete(page, about);
  if (about.second) await page.second.open(about.second, () => second(about));
  if (about.live) new Live((bytes) => page.replace({ bytes }, Boolean(moment)), () => moment?.address() ?? "scene");
}

begin().catch((error) => {
  document.body.classList.add("failed");
  say(error.message);
});
