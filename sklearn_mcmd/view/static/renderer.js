/* WebGL 2: points to a texture with depth, then edges of depth darkened onto the canvas. */

const POINT_VERTEX = `#version 300 es
in vec3 position;
in vec4 color;
in float visible;
uniform mat4 matrix;
uniform float scale, least, most;
out vec3 tint;
out float size;
void main() {
  gl_Position = matrix * vec4(position, 1.0);
  size = clamp(scale / gl_Position.w, least, most);
  if (visible > 1.5) size = max(1.7 * size, least + 1.5);
  if (visible < 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = size;
  tint = color.rgb;
}`;
const POINT_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 tint;
in float size;
out vec4 paint;
void main() {
  vec2 place = 2.0 * gl_PointCoord - 1.0;
  if (size > 2.5 && dot(place, place) > 1.0) discard;
  paint = vec4(tint, 1.0);
}`;
const LINE_VERTEX = `#version 300 es
in vec3 position;
uniform mat4 matrix;
void main() { gl_Position = matrix * vec4(position, 1.0); }`;
const LINE_FRAGMENT = `#version 300 es
precision mediump float;
uniform vec3 tint;
out vec4 paint;
void main() { paint = vec4(tint, 1.0); }`;
const WHOLE_VERTEX = `#version 300 es
void main() {
  vec2 place = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  gl_Position = vec4(4.0 * place - 1.0, 0.0, 1.0);
}`;
// Eye-dome lighting (Boucheny 2009): a pixel is darker the more its neighbors are before it.
const SHADE_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D colors, depths;
uniform vec3 background;
uniform vec2 planes;
uniform float strength, flatness, reach;
uniform int radius;
out vec4 paint;
const vec2 ASIDE[8] = vec2[8](vec2(1.0, 0.0), vec2(0.7, 0.7), vec2(0.0, 1.0), vec2(-0.7, 0.7),
  vec2(-1.0, 0.0), vec2(-0.7, -0.7), vec2(0.0, -1.0), vec2(0.7, -0.7));
float remoteness(float depth) {
  float d = 2.0 * depth - 1.0, near = planes.x, far = planes.y;
  if (flatness > 0.0) return 1.4427 * 0.5 * (d * (far - near) + far + near) / reach;
  return log2(2.0 * near * far / (far + near - d * (far - near)));
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(depths, 0) - 1;
  float depth = texelFetch(depths, at, 0).r;
  if (depth == 1.0) { paint = vec4(background, 1.0); return; }
  float here = remoteness(depth), sum = 0.0;
  for (int i = 0; i < 8; i++) {
    ivec2 aside = at + ivec2(round(float(radius) * ASIDE[i]));
    float other = texelFetch(depths, clamp(aside, ivec2(0), last), 0).r;
    if (other < 1.0) sum += clamp(here - remoteness(other), 0.0, 0.06);
  }
  float shade = max(exp(-strength * sum / 8.0), 0.18);
  paint = vec4(texelFetch(colors, at, 0).rgb * shade, 1.0);
}`;

class Renderer {
  constructor(canvas, scene, camera) {
    const gl = canvas.getContext("webgl2", { antialias: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("This browser has no WebGL 2, which the page needs.");
    Object.assign(this, { canvas, gl, scene, camera });
    this.points = program(gl, POINT_VERTEX, POINT_FRAGMENT);
    this.lines = program(gl, LINE_VERTEX, LINE_FRAGMENT);
    this.shade = program(gl, WHOLE_VERTEX, SHADE_FRAGMENT);
    this.empty = gl.createVertexArray();
    this.buffers = scene.clouds.map((cloud) => this.cloudBuffers(cloud));
    this.lineSets = new Map(); // name -> { array, buffer, n, tint }
    this.targets = [null, null]; // that on the screen, and the next one
    this.background = [0, 0, 0];
    this.pointSize = 1; // chosen by the user
    this.shading = true;
    this.strength = 60; // of the shading
    this.split = null; // { left, right, at }: two clouds side by side, at a share of the width
    this.budget = 1.5e6; // points in one frame
    this.moving = false;
    this.pass = null; // of the picture that is being drawn
    this.current = false; // whether the canvas shows the newest state
    this.spacing = scene.manifest.spacing;
  }

  cloudBuffers(cloud) {
    const gl = this.gl, vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const made = {
      vao,
      positions: attributeBuffer(gl, this.points, "position", 12 * cloud.n, 3, gl.FLOAT, false),
      colors: attributeBuffer(gl, this.points, "color", 4 * cloud.n, 4, gl.UNSIGNED_BYTE, true),
      visible: attributeBuffer(gl, this.points, "visible", cloud.n, 1, gl.UNSIGNED_BYTE, false),
    };
    gl.bindVertexArray(null);
    return made;
  }

  /** Hand over points that were loaded. */
  grow(cloud, start, stop) {
    const { positions } = this.buffers[this.scene.clouds.indexOf(cloud)];
    const places = new Float32Array(3 * (stop - start));
    for (let i = 0; i < places.length; i++) places[i] = cloud.steps[3 * start + i] * cloud.step;
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, positions);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 12 * start, places);
    this.refreshColors(cloud, start, stop);
    this.refreshVisible(cloud, start, stop);
  }

  refreshColors(cloud, start = 0, stop = cloud.loaded) {
    upload(this.gl, this.buffers[this.scene.clouds.indexOf(cloud)].colors, cloud.colors, start, stop);
    this.changed();
  }

  refreshVisible(cloud, start = 0, stop = cloud.loaded) {
    upload(this.gl, this.buffers[this.scene.clouds.indexOf(cloud)].visible, cloud.visible, start, stop);
    this.changed();
  }

  /** Lines between pairs of points; null removes them. */
  setLines(name, array, tint) {
    const gl = this.gl;
    let set = this.lineSets.get(name);
    if (!array) {
      if (set) gl.deleteBuffer(set.buffer);
      this.lineSets.delete(name);
      return this.changed();
    }
    if (!set) {
      const vao = gl.createVertexArray();
      gl.bindVertexArray(vao);
      set = { vao, buffer: attributeBuffer(gl, this.lines, "position", 0, 3, gl.FLOAT, false) };
      gl.bindVertexArray(null);
      this.lineSets.set(name, set);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, set.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.DYNAMIC_DRAW);
    Object.assign(set, { n: array.length / 3, tint });
    this.changed();
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.max(1, Math.round(clientWidth * ratio));
    const height = Math.max(1, Math.round(clientHeight * ratio));
    this.ratio = ratio;
    this.camera.width = Math.max(1, clientWidth);
    this.camera.height = Math.max(1, clientHeight);
    if (this.canvas.width !== width || this.canvas.height !== height || !this.targets[0]) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.targets.forEach((target) => deleteTarget(this.gl, target));
      this.targets = [makeTarget(this.gl, width, height), makeTarget(this.gl, width, height)];
    }
    this.changed();
  }

  /** Draw anew soon. While changes follow each other, only as many points as one frame allows. */
  changed() {
    this.moving = true;
    this.current = false;
    this.lastChange = performance.now();
    this.pass = null;
    this.schedule();
  }

  schedule() {
    if (!this.scheduled) {
      this.scheduled = true;
      requestAnimationFrame((now) => this.frame(now));
    }
  }

  frame(now) {
    this.scheduled = false;
    if (this.moving) this.adapt(now);
    if (!this.current) this.draw();
    const settled = performance.now() - this.lastChange > 140;
    if (this.moving && settled && !this.pass) {
      this.moving = false;
      this.current &&= this.drawnShare >= 1; // else all points are to be drawn
    }
    if (this.moving || !this.current) this.schedule();
    else this.lastFrame = null;
  }

  /** A part of the points, and the picture once it is complete. */
  draw() {
    this.pass ??= this.begin(this.moving ? Math.min(1, this.budget / this.scene.n) : 1);
    const step = this.moving ? this.budget : Math.max(this.budget, 0.08 * this.scene.n);
    this.advance(this.pass, step / this.scene.n);
    this.drew = true;
    if (this.pass.share < this.pass.end) return;
    this.targets.reverse();
    this.present();
    this.drawnShare = this.pass.end;
    this.pass = null;
    this.current = true;
    this.afterFrame?.();
  }

  /** Aim at 30 frames a second, by the time since the last frame if that one drew. */
  adapt(now) {
    if (this.lastFrame && this.drew) {
      const took = now - this.lastFrame, most = Math.min(this.budget, this.scene.n);
      if (took > 45) this.budget = Math.max(60_000, most * Math.max(0.5, 33 / took));
      else if (took < 24) this.budget = Math.min(1.12 * this.budget, 2e7);
    }
    this.lastFrame = now;
    this.drew = false;
  }

  begin(end) {
    const gl = this.gl, target = this.targets[1];
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.viewport(0, 0, target.width, target.height);
    gl.clearColor(...this.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const matrix = new Float32Array(this.camera.matrix());
    this.drawLines(matrix);
    return { target, share: 0, end, matrix };
  }

  advance(pass, step) {
    const gl = this.gl, next = Math.min(pass.end, pass.share + step);
    gl.bindFramebuffer(gl.FRAMEBUFFER, pass.target.frame);
    gl.viewport(0, 0, pass.target.width, pass.target.height);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.points.handle);
    gl.uniformMatrix4fv(this.points.uniform("matrix"), false, pass.matrix);
    const { scale, least, most } = this.pointScale(pass.end);
    gl.uniform1f(this.points.uniform("scale"), scale);
    gl.uniform1f(this.points.uniform("least"), least);
    gl.uniform1f(this.points.uniform("most"), most);
    for (const { cloud, from, to } of this.shownParts()) {
      this.clip(from, to, pass.target);
      const start = Math.floor(pass.share * cloud.n);
      const stop = Math.min(cloud.loaded, next >= 1 ? cloud.n : Math.floor(next * cloud.n));
      gl.bindVertexArray(this.buffers[this.scene.clouds.indexOf(cloud)].vao);
      if (stop > start) gl.drawArrays(gl.POINTS, start, stop - start);
    }
    gl.disable(gl.SCISSOR_TEST);
    gl.bindVertexArray(null);
    pass.share = next;
  }

  /** Diameter of a point in pixels times its depth: that of the spacing, more if few are drawn. */
  pointScale(share) {
    const { camera } = this;
    const loaded = this.scene.clouds.reduce((sum, cloud) => sum + cloud.loaded, 0);
    const thin = Math.min(3, Math.sqrt(this.scene.total / Math.max(1, share * loaded)));
    const pixels = (this.ratio * camera.height) / (2 * Math.tan(camera.fov / 2));
    const world = 1.15 * this.pointSize * thin * this.scene.manifest.reach;
    const scale = camera.flat ? (world * pixels) / camera.distance : world * pixels;
    return { scale, least: this.ratio * Math.max(1, this.pointSize), most: 14 * this.ratio * this.pointSize };
  }

  /** Clouds to draw, each with its part of the width. */
  shownParts() {
    if (!this.split) {
      return this.scene.clouds.filter((c) => c.shown).map((cloud) => ({ cloud, from: 0, to: 1 }));
    }
    const { left, right, at } = this.split;
    return [
      { cloud: left, from: 0, to: at },
      { cloud: right, from: at, to: 1 },
    ];
  }

  clip(from, to, target) {
    const gl = this.gl, start = Math.round(from * target.width);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(start, 0, Math.round(to * target.width) - start, target.height);
  }

  drawLines(matrix) {
    const gl = this.gl;
    gl.useProgram(this.lines.handle);
    gl.uniformMatrix4fv(this.lines.uniform("matrix"), false, matrix);
    for (const set of this.lineSets.values()) {
      gl.bindVertexArray(set.vao);
      gl.uniform3fv(this.lines.uniform("tint"), set.tint);
      gl.drawArrays(gl.LINES, 0, set.n);
    }
    gl.bindVertexArray(null);
  }

  /** The finished texture to the canvas. */
  present() {
    const { gl, camera } = this, [target] = this.targets;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, target.width, target.height);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.shade.handle);
    bindTexture(gl, 0, target.colors, this.shade.uniform("colors"));
    bindTexture(gl, 1, target.depths, this.shade.uniform("depths"));
    const { near, far } = camera.planes();
    gl.uniform2f(this.shade.uniform("planes"), near, far);
    gl.uniform3fv(this.shade.uniform("background"), this.background);
    gl.uniform1f(this.shade.uniform("strength"), this.shading ? this.strength : 0);
    gl.uniform1f(this.shade.uniform("flatness"), camera.flat ? 1 : 0);
    gl.uniform1f(this.shade.uniform("reach"), camera.distance);
    gl.uniform1i(this.shade.uniform("radius"), Math.max(1, Math.round(1.3 * this.ratio)));
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }

  /** All points now, for a picture; the canvas holds them until the browser's next frame. */
  drawWhole() {
    const pass = this.begin(1);
    this.advance(pass, 1);
    this.targets.reverse();
    this.present();
    this.pass = null;
  }
}

function program(gl, vertex, fragment) {
  const handle = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
      throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  const places = new Map();
  const uniform = (name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(handle, name));
    return places.get(name);
  };
  return { handle, uniform };
}

function attributeBuffer(gl, { handle }, name, bytes, size, type, normalized) {
  const buffer = gl.createBuffer(), place = gl.getAttribLocation(handle, name);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.DYNAMIC_DRAW);
  gl.enableVertexAttribArray(place);
  gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
  return buffer;
}

function upload(gl, buffer, array, start, stop) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  const offset = start * array.BYTES_PER_ELEMENT;
  gl.bufferSubData(gl.ARRAY_BUFFER, offset, array, start, stop - start);
}

function makeTarget(gl, width, height) {
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  const colors = texture(gl, gl.RGBA8, width, height);
  const depths = texture(gl, gl.DEPTH_COMPONENT32F, width, height);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, colors, 0);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depths, 0);
  return { frame, colors, depths, width, height };
}

function deleteTarget(gl, target) {
  if (!target) return;
  gl.deleteFramebuffer(target.frame);
  gl.deleteTexture(target.colors);
  gl.deleteTexture(target.depths);
}

function texture(gl, format, width, height) {
  const handle = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, handle);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return handle;
}

function bindTexture(gl, unit, handle, place) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, handle);
  gl.uniform1i(place, unit);
}
