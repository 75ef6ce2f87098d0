// Pointer, touch, wheel and keys that move the viewpoint.

/** Radians that a drag over the shorter side of the canvas turns. */
const TURN = 3;
/** Parts of the distance to the target that a second of flying covers. */
const SPEED = 0.8;
/** Pixels that a click may move. */
const CLICK = 6;

const FLY = { KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, 1, 0], KeyE: [0, -1, 0] };
const ORBIT = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Controls {
  /** `page` has viewpoint, moved(), pick(x, y), and tool, which takes a drag in place of turning where it is set. */
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.pointers = new Map();
    this.held = new Set();
    const on = (name, act) => canvas.addEventListener(name, act, { passive: false });
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.up(event));
    on("pointercancel", (event) => this.up(event));
    on("contextmenu", (event) => event.preventDefault());
    on("dblclick", (event) => page.tool?.clicks || page.pick(event.offsetX, event.offsetY));
    on("wheel", (event) => this.wheel(event));
    on("keydown", (event) => this.key(event));
    addEventListener("keyup", (event) => this.held.delete(event.code));
    addEventListener("blur", () => this.held.clear());
  }

  down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    const { tool } = this.page;
    this.press = tool?.clicks && event.button === 0 && this.pointers.size === 1 ? [event.offsetX, event.offsetY] : null;
    if (tool && !tool.clicks && event.button === 0 && this.pointers.size === 1) {
      this.tooling = true;
      tool.begin([event.offsetX, event.offsetY], event);
    } else if (this.tooling) {
      this.tooling = false;
      tool?.cancel();
    }
    // Two taps in one place set the center, as two clicks do.
    if (event.pointerType === "touch" && this.pointers.size === 1 && !this.press) {
      const [now, last] = [performance.now(), this.tap];
      this.tap = { at: now, x: event.offsetX, y: event.offsetY };
      if (last && now - last.at < 300 && Math.hypot(last.x - event.offsetX, last.y - event.offsetY) < 24) this.page.pick(event.offsetX, event.offsetY);
    }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    if (this.tooling) return this.page.tool.drag(now, event);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    this.pointers.set(event.pointerId, now);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const { viewpoint } = this.page;
    const scale = viewpoint.frame(this.canvas.clientWidth, this.canvas.clientHeight).scale;
    if (others.length > 0) {
      const apart = (place) => Math.hypot(place[0] - others[0][0], place[1] - others[0][1]);
      viewpoint.zoom(Math.max(apart(before), 1) / Math.max(apart(now), 1));
      viewpoint.pan(dx / 2, dy / 2, scale);
    } else if (event.buttons === 1 && !event.shiftKey) {
      const turn = TURN / Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
      viewpoint.orbit(-dx * turn, -dy * turn);
    } else {
      viewpoint.pan(dx, dy, scale);
    }
    this.page.moved();
  }

  up(event) {
    // A press that hardly moves is a click.
    const { press } = this;
    if (press && event.type === "pointerup" && Math.hypot(event.offsetX - press[0], event.offsetY - press[1]) < CLICK) this.page.tool?.click?.(...press);
    this.press = null;
    if (this.tooling && this.pointers.has(event.pointerId)) {
      this.tooling = false;
      if (event.type === "pointerup") this.page.tool?.end([event.offsetX, event.offsetY], event);
      else this.page.tool?.cancel();
    }
    this.pointers.delete(event.pointerId);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.page.viewpoint.zoom(Math.exp(0.0015 * Math.max(-200, Math.min(200, event.deltaY * lines))));
    this.page.moved();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter" && this.page.tool?.clicks) return this.page.tool.click(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    if (!FLY[event.code] && !ORBIT[event.code] && !["+", "=", "-"].includes(event.key)) return;
    event.preventDefault();
    if (["+", "=", "-"].includes(event.key)) {
      this.page.viewpoint.zoom(event.key === "-" ? 1.1 : 1 / 1.1);
      return this.page.moved();
    }
    if (event.repeat) return;
    // A tap moves by a little, also one that is shorter than a frame.
    this.step(event.code, 0.05);
    this.page.moved();
    this.held.add(event.code);
    if (!this.flying) this.fly();
  }

  step(code, seconds) {
    const { viewpoint } = this.page;
    if (FLY[code]) viewpoint.fly(...FLY[code].map((part) => part * SPEED * seconds));
    else viewpoint.orbit(...ORBIT[code].map((part) => part * 1.2 * seconds));
  }

  /** Moves by the keys that are held, a frame after the other. */
  fly(last = performance.now()) {
    this.flying = this.held.size > 0;
    if (!this.flying) return;
    requestAnimationFrame((now) => {
      const seconds = Math.min(0.1, Math.max(0.008, (now - last) / 1000));
      for (const code of this.held) this.step(code, seconds);
      this.page.moved();
      this.fly(now);
    });
  }
}
