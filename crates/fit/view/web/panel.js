// The panel: what its controls do, and the keys that do the same.

import { element, say } from "./status.js";
import { freeLens } from "./viewpoint.js";

const degrees = (focal) => Math.round((360 / Math.PI) * Math.atan(0.5 / focal));
const hex = (color) => `#${color.map((x) => Math.round(255 * x).toString(16).padStart(2, "0")).join("")}`;

export class Panel {
  constructor(page) {
    this.page = page;
    this.upAxis();
    this.look();
    this.edit();
    this.keys();
    element("home").addEventListener("click", () => page.home());
    element("level").addEventListener("click", () => page.level());
    element("shot").addEventListener("click", () => page.picture());
    element("menu").addEventListener("click", () => this.fold());
    element("keys").addEventListener("click", () => element("help").showModal());
    this.small = matchMedia("(max-width: 700px), (max-height: 480px)");
    if (this.small.matches) this.fold();
  }

  fold() {
    const folded = document.body.classList.toggle("folded");
    element("menu").setAttribute("aria-expanded", String(!folded));
  }

  upAxis() {
    const { page } = this;
    const choices = [["as it is", null], ["−y", [0, -1, 0]], ["+y", [0, 1, 0]], ["+z", [0, 0, 1]], ["−z", [0, 0, -1]], ["+x", [1, 0, 0]], ["−x", [-1, 0, 0]]];
    const up = element("up");
    const points = Object.assign(new Option("by points", choices.length), { hidden: true });
    up.replaceChildren(...choices.map(([name], i) => new Option(name, i)), points);
    this.showUp = () => {
      const at = choices.findIndex(([, axis]) => String(axis) === String(page.notes.state.up));
      up.value = at < 0 ? choices.length : at;
      element("turn-saved").disabled = !page.notes.state.up;
    };
    up.addEventListener("change", () => {
      page.setUp(Number(up.value) === 0 ? null : choices[Number(up.value)][1]);
    });
    element("fov").addEventListener("input", ({ target }) => {
      const { viewpoint } = page;
      viewpoint.lens = freeLens(0.5 / Math.tan((Number(target.value) * Math.PI) / 360), viewpoint.lens);
      page.moved();
    });
  }

  look() {
    const { page } = this;
    const { look } = page;
    for (const input of document.querySelectorAll("input[name=mode]")) input.addEventListener("change", () => this.mode(input.value));
    const degree = element("degree");
    degree.max = degree.value = page.scene.degree;
    degree.disabled = page.scene.degree === 0;
    element("degree-value").textContent = degree.value;
    degree.addEventListener("input", () => {
      look.degree = Number(degree.value);
      element("degree-value").textContent = degree.value;
      page.changed();
    });
    const exposure = element("exposure");
    element("exposure-value").textContent = "0";
    exposure.addEventListener("input", () => {
      look.exposure = Number(exposure.value);
      element("exposure-value").textContent = `${look.exposure > 0 ? "+" : ""}${look.exposure}`;
      page.changed();
    });
    const background = element("background");
    background.value = hex(look.background);
    background.addEventListener("input", () => {
      look.background = [1, 3, 5].map((at) => parseInt(background.value.slice(at, at + 2), 16) / 255);
      page.changed();
    });
    element("frusta").addEventListener("change", ({ target }) => {
      page.overlay.frusta = target.checked;
      page.overlay.draw();
    });
    element("error-switch").hidden = !page.shots.all.some((shot) => shot.photo);
    element("frusta").parentElement.hidden = page.shots.all.length === 0;
  }

  mode(name) {
    this.page.look.mode = name;
    for (const input of document.querySelectorAll("input[name=mode]")) input.checked = input.value === name;
    this.page.changed();
  }

  edit() {
    const { page } = this;
    const act = (id, of) => element(id).addEventListener("click", of);
    act("box", () => this.tool("box"));
    act("brush", () => this.tool("brush"));
    for (const name of ["invert", "hide"]) act(name, () => page.selection[name]());
    for (const name of ["undo", "redo"]) act(name, () => page.history[name]());
    act("save-notes", () => page.saveNotes());
    element("save-notes").hidden = !page.original && !page.about.formats?.length;
    element("save-notes").textContent = page.original ? "Save page" : "Save notes";
    act("unhide", () => page.selection.show());
    act("delete", () => page.selection.remove());
    act("ply", () => page.download());
    for (const name of page.about.formats ?? []) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      button.setAttribute("aria-label", `Save as ${name}`);
      button.addEventListener("click", () => page.save(name));
      element("save").hidden = false;
      element("save").append(button);
    }
    this.selected();
  }

  tool(name) {
    const { page } = this;
    const on = page.toolName === name ? null : name;
    page.setTool(on);
    if (on === "measure" || on === "ground") {
      element("measuring").open = true;
      if (this.small.matches && !document.body.classList.contains("folded")) this.fold();
      say(on === "measure" ? "Click both ends. Enter takes the point under the cross." : "Click three points of the ground. Enter takes the point under the cross.", true);
    }
    page.overlay.draw();
    for (const id of ["box", "brush", "like", "measure", "ground"]) element(id).setAttribute("aria-pressed", String(id === on));
  }

  /** Opens a part of the panel and goes to its first control. */
  open(part, first) {
    if (document.body.classList.contains("folded")) this.fold();
    element(part).open = true;
    element(first).focus();
  }

  /** Says what is selected, and which buttons have something to do. */
  selected() {
    const { selection, history } = this.page;
    const [selected, hidden, deleted] = [1, 2, 4].map((bit) => selection.count(bit));
    const parts = [selected > 0 && `${selected.toLocaleString("en")} selected`, hidden > 0 && `${hidden.toLocaleString("en")} hidden`, deleted > 0 && `${deleted.toLocaleString("en")} deleted`];
    element("selected").textContent = parts.filter(Boolean).join(", ") || "Nothing is selected.";
    element("hide").disabled = element("delete").disabled = selected === 0;
    element("unhide").disabled = hidden === 0;
    element("undo").disabled = history.past.length === 0;
    element("redo").disabled = history.future.length === 0;
  }

  /** Brings what depends on the view up to date. */
  refresh() {
    const { viewpoint, look, travel } = this.page;
    element("play-path").setAttribute("aria-pressed", String(Boolean(travel?.path)));
    const value = degrees(viewpoint.lens.fx / viewpoint.lens.width);
    element("fov").value = value;
    element("fov-value").textContent = `${value}°`;
    const legend = element("legend");
    const ends = { depth: look.depths.map((x) => x.toPrecision(3)), count: ["0", "511 per pixel"], coverage: ["nothing", "all of a pixel"], alike: ["unlike", "alike"] };
    legend.hidden = !ends[look.mode];
    legend.classList.toggle("reversed", look.mode === "depth");
    const [low, high] = ends[look.mode] ?? ["", ""];
    element("legend-low").textContent = low;
    element("legend-high").textContent = high;
  }

  keys() {
    const { page } = this;
    // Elsewhere these keys scroll, or go through a control.
    const tours = () => page.tour.presenting || document.activeElement === page.canvas;
    const actions = {
      h: () => page.home(), l: () => page.level(), p: () => page.picture(), m: () => this.fold(), n: () => page.shots.step(1), v: () => page.shots.step(-1),
      f: () => element("frusta").click(), t: () => page.about.moves && element("play").click(), b: () => this.tool("box"), r: () => this.tool("brush"), i: () => page.selection.invert(),
      x: () => page.selection.hide(), u: () => page.selection.show(), 1: () => this.mode("color"), 2: () => this.mode("depth"),
      3: () => this.mode("count"), 4: () => this.mode("coverage"), 5: () => this.mode("centers"), 6: () => page.renderer.alike && this.mode("alike"), k: () => page.alike && this.tool("like"), "?": () => element("help").showModal(),
      g: () => this.tool("measure"), y: () => this.tool("ground"), o: () => page.tour.keep(), "[": () => page.tour.step(-1), "]": () => page.tour.step(1), ".": () => page.tour.present(!page.tour.presenting),
      j: () => page.keyframes.add(), 0: () => page.keyframes.play(), c: () => this.open("cleaning", "faint"), "/": () => element("open-second").click(), z: () => !element("errors").disabled && element("errors").click(),
      delete: () => (page.clean.count > 0 ? page.clean.remove() : page.selection.remove()), backspace: () => actions.delete(),
      pageup: () => tours() && page.tour.step(-1), pagedown: () => tours() && page.tour.step(1),
      arrowright: () => page.tour.presenting && page.tour.step(1), arrowleft: () => page.tour.presenting && page.tour.step(-1),
      escape: () => (page.tour.presenting ? page.tour.present(false) : page.toolName ? this.tool(page.toolName) : page.selection.clear()),
    };
    addEventListener("keydown", (event) => {
      if (element("help").open || event.target.matches("select, textarea, input[type=color], input[type=text]")) return;
      const key = event.key.toLowerCase();
      if (event.ctrlKey || event.metaKey) {
        const name = key === "y" || (key === "z" && event.shiftKey) ? "redo" : key === "z" ? "undo" : null;
        if (name) {
          event.preventDefault();
          page.history[name]();
        }
      } else if (actions[key] && !event.altKey) {
        actions[key]();
      }
    });
  }
}
