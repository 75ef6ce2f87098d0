// Drawing by WebGL2: projection into textures, then quads from front to back.

import { BATCH, MODES, over, projection, splatting, splattingAtOnce } from "./shaders.js";

/** Targets of blending: the format, and the extension that makes it one. */
const TARGETS = {
  float: ["RGBA32F", "FLOAT", "EXT_float_blend"],
  half: ["RGBA16F", "HALF_FLOAT", "EXT_color_buffer_half_float"],
  byte: ["RGBA8", "UNSIGNED_BYTE", null],
};

function program(gl, [vertex, fragment]) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.bindAttribLocation(made, 0, "corner");
  gl.linkProgram(made);
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    places[name] = gl.getUniformLocation(made, name);
  }
  return { made, places };
}

export class Renderer {
  constructor(canvas, scene) {
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true, powerPreference: "high-performance" }));
    if (!gl) throw new Error("no WebGL2");
    this.floats = Boolean(gl.getExtension("EXT_color_buffer_float"));
    const halfs = this.floats || Boolean(gl.getExtension("EXT_color_buffer_half_float"));
    gl.getExtension("EXT_float_blend");
    /** What pictures are blended in. */
    this.kind = halfs ? "half" : "byte";
    this.wide = Math.min(4096, gl.getParameter(gl.MAX_TEXTURE_SIZE));
    this.splat = program(gl, this.floats ? splatting : splattingAtOnce);
    this.project = this.floats ? program(gl, projection) : null;
    this.over = program(gl, over);
    this.targets = {};
    this.shapes();
    this.setScene(scene);
  }

  /** The quad of the whole image, and the indices of a batch of quads. */
  shapes() {
    const { gl } = this;
    this.whole = gl.createVertexArray();
    gl.bindVertexArray(this.whole);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.batch = gl.createVertexArray();
    gl.bindVertexArray(this.batch);
    const indices = Uint16Array.from({ length: 6 * BATCH }, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  }

  /** Takes another scene, as the worker packs it. */
  setScene(scene) {
    const { gl, wide } = this;
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    for (const texture of this.textures ?? []) gl.deleteTexture(texture);
    this.scene = scene;
    this.harmonicTexels = scene.harmonics.length / 4 / Math.max(scene.n, 1);
    const texels = Math.max(3, this.harmonicTexels) * scene.n;
    if (texels > wide * most) throw new Error(`${scene.n} Gaussians are more than this device draws (${Math.floor((wide * most) / Math.max(3, this.harmonicTexels))})`);
    this.splats = this.texture("RGBA32F", "RGBA", "FLOAT", scene.splats, 4);
    this.harmonics = this.texture("RGBA32UI", "RGBA_INTEGER", "UNSIGNED_INT", scene.harmonics, 4);
    this.flags = this.texture("R16UI", "RED_INTEGER", "UNSIGNED_SHORT", new Uint16Array(scene.n), 1);
    /** A byte per Gaussian: how like it is to what was asked for. */
    this.alike = null;
    this.order = this.texture("R32UI", "RED_INTEGER", "UNSIGNED_INT", new Uint32Array(scene.n), 1);
    this.textures = [this.splats, this.harmonics, this.flags, this.order];
    // The device has them now.
    scene.splats = scene.harmonics = null;
    this.drawn = 0;
    if (this.floats) {
      const rows = Math.max(1, Math.ceil(scene.n / wide));
      this.projected = [0, 1, 2].map(() => this.texture("RGBA32F", "RGBA", "FLOAT", null, 4, rows));
      this.textures.push(...this.projected);
      gl.deleteFramebuffer(this.projecting ?? null);
      this.projecting = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.projecting);
      this.projected.forEach((texture, i) => gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, texture, 0));
      gl.drawBuffers([0, 1, 2].map((i) => gl.COLOR_ATTACHMENT0 + i));
      this.projectedRows = rows;
    }
  }

  /** A texture of `wide` texels in a row, filled row by row so that the numbers are copied once. */
  texture(internal, format, type, values, per, rows = Math.max(1, Math.ceil(values.length / per / this.wide))) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl[internal], this.wide, rows);
    for (const [name, value] of [["MIN_FILTER", gl.NEAREST], ["MAG_FILTER", gl.NEAREST]]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], value);
    if (values) this.fill(texture, format, type, values, per);
    return texture;
  }

  fill(texture, format, type, values, per) {
    const { gl, wide } = this;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const texels = values.length / per;
    const rows = Math.floor(texels / wide);
    if (rows > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, wide, rows, gl[format], gl[type], values.subarray(0, rows * wide * per));
    const rest = texels - rows * wide;
    if (rest > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, rows, rest, 1, gl[format], gl[type], values.subarray(rows * wide * per));
  }

  /** Takes the order of drawing, from front to back. */
  setOrder(order) {
    this.fill(this.order, "RED_INTEGER", "UNSIGNED_INT", order, 1);
    this.drawn = order.length;
  }

  /** Takes a byte per Gaussian: 1 selected, 2 hidden, 4 deleted; those of `preview` are hidden too, and how alike they are goes along. */
  setFlags(flags, preview) {
    const { alike } = this;
    const words = Uint16Array.from(flags, alike || preview ? (flag, i) => flag | (preview?.[i] ? 2 : 0) | ((alike?.[i] ?? 0) << 8) : undefined);
    this.fill(this.flags, "RED_INTEGER", "UNSIGNED_SHORT", words, 1);
  }

  target(kind, width, height) {
    const { gl } = this;
    const last = this.targets[kind];
    if (last?.width === width && last?.height === height) return last;
    if (last) {
      gl.deleteTexture(last.texture);
      gl.deleteFramebuffer(last.frame);
    }
    const [texture, frame] = [gl.createTexture(), gl.createFramebuffer()];
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl[TARGETS[kind][0]], width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return (this.targets[kind] = { texture, frame, width, height });
  }

  /** Uniforms and textures of projection. */
  bindProjection({ places }, camera, look) {
    const { gl, scene } = this;
    [this.splats, this.harmonics, this.flags].forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.uniform1i(places.splats, 0);
    gl.uniform1i(places.harmonics, 1);
    gl.uniform1i(places.flags, 2);
    gl.uniform1i(places.degree, Math.min(look.degree ?? scene.degree, scene.degree));
    gl.uniform1i(places.harmonicTexels, this.harmonicTexels);
    gl.uniform1i(places.wide, this.wide);
    gl.uniform1i(places.mode, MODES[look.mode]);
    gl.uniformMatrix3fv(places.A, true, camera.A);
    gl.uniform3fv(places.t, camera.t);
    gl.uniform3fv(places.eye, camera.eye);
    gl.uniform4fv(places.K, camera.K);
    gl.uniform2f(places.size, camera.width, camera.height);
    gl.uniform2f(places.range, look.near, look.far);
    gl.uniform1i(places.antialiased, look.antialiased ? 1 : 0);
  }

  /**
   * Draws Gaussians into a target. `camera` has A (3 x 3, row by row), t, eye, K (fx, fy, cx, cy), width and height; `look` has mode, degree,
   * near, far, alphaMax, antialiased. `window` is the part of the image that is needed, [x, y, width, height] from below.
   */
  splatsInto(target, camera, look, window) {
    const { gl, scene } = this;
    gl.disable(gl.BLEND);
    if (this.floats) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.projecting);
      gl.viewport(0, 0, this.wide, this.projectedRows);
      gl.useProgram(this.project.made);
      this.bindProjection(this.project, camera, look);
      gl.uniform1i(this.project.places.count, scene.n);
      gl.bindVertexArray(this.whole);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.viewport(0, 0, target.width, target.height);
    if (window) {
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(...window);
    }
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    if (look.mode === "count") gl.blendFunc(gl.ONE, gl.ONE);
    else gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE);
    const { made, places } = this.splat;
    gl.useProgram(made);
    if (this.floats) {
      ["centers", "covs", "colors"].forEach((name, i) => {
        gl.activeTexture(gl.TEXTURE3 + i);
        gl.bindTexture(gl.TEXTURE_2D, this.projected[i]);
        gl.uniform1i(places[name], 3 + i);
      });
      gl.uniform1i(places.wide, this.wide);
      gl.uniform2f(places.size, camera.width, camera.height);
      gl.uniform1i(places.mode, MODES[look.mode]);
    } else {
      this.bindProjection(this.splat, camera, look);
    }
    gl.activeTexture(gl.TEXTURE6);
    gl.bindTexture(gl.TEXTURE_2D, this.order);
    gl.uniform1i(places.order, 6);
    gl.uniform1i(places.orderWide, this.wide);
    gl.uniform1i(places.total, this.drawn);
    gl.uniform1f(places.alphaMax, look.mode === "centers" ? 1 : look.alphaMax);
    gl.bindVertexArray(this.batch);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * BATCH, gl.UNSIGNED_SHORT, 0, Math.ceil(this.drawn / BATCH));
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Draws on the canvas, whose size must be that of the camera. */
  draw(camera, look, kind = this.kind) {
    const { gl } = this;
    const target = this.target(kind, camera.width, camera.height);
    this.splatsInto(target, camera, look);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, camera.width, camera.height);
    const { made, places } = this.over;
    gl.useProgram(made);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.uniform1i(places.picture, 0);
    gl.uniform3fv(places.background, look.background);
    gl.uniform1i(places.mode, MODES[look.mode]);
    gl.uniform2fv(places.depths, look.depths ?? [0, 1]);
    gl.uniform1f(places.exposure, look.exposure ?? 0);
    gl.bindVertexArray(this.whole);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** The expected depth at a pixel, or null where hardly anything is; it takes targets of floats or halfs. */
  depthAt(camera, look, x, y) {
    const { gl } = this;
    if (this.kind === "byte") return null;
    const target = this.target(this.kind, camera.width, camera.height);
    const from = [Math.round(x), camera.height - 1 - Math.round(y)];
    this.splatsInto(target, camera, { ...look, mode: "depth" }, [...from, 1, 1]);
    const found = new Float32Array(4);
    gl.readPixels(...from, 1, 1, gl.RGBA, gl.FLOAT, found);
    return found[3] < 0.1 ? null : found[0] / found[3];
  }

  /** The canvas's pixels, RGBA, from the top row down. */
  pixels(width, height) {
    const { gl } = this;
    const upward = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, upward);
    const rows = Array.from({ length: height }, (_, y) => upward.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)));
    const downward = new Uint8Array(upward.length);
    rows.forEach((row, y) => downward.set(row, 4 * width * y));
    return downward;
  }
}
