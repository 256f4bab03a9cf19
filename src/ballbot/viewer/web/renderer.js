// Drawing in WebGL 2: lit meshes, their shadow on the floor, the floor's grid, flat strips, arrows.

const LIGHT = unit([0.35, -0.5, 1]);

const MESH_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 color;
uniform mat4 screen, model;
out vec3 world, outward, local, paint;
void main() {
  vec4 placed = model * vec4(position, 1.0);
  world = placed.xyz;
  outward = mat3(model) * normal;
  local = position;
  paint = color;
  gl_Position = screen * placed;
}`;

const MESH_FRAGMENT = `#version 300 es
precision highp float;
in vec3 world, outward, local, paint;
uniform vec3 eye, light, pattern, tint;
uniform float alpha, flatness, tinted;
out vec4 shown;
void main() {
  vec3 base = mix(paint, tint, tinted);
  if (pattern.x >= 0.0) {  // eight sectors and two belts of a ball, with soft edges
    vec3 d = normalize(local);
    vec3 edge = d.x * d.y * d.z / max(fwidth(d.x * d.y * d.z), 1e-5) * vec3(1.0);
    float cap = smoothstep(0.955, 0.965, max(max(abs(d.x), abs(d.y)), abs(d.z)));
    base = mix(mix(vec3(0.95, 0.93, 0.88), pattern, clamp(edge.x + 0.5, 0.0, 1.0)), vec3(0.2, 0.22, 0.25), cap);
  }
  vec3 n = normalize(outward);
  vec3 towards = normalize(eye - world);
  float lit = 0.42 + 0.16 * n.z + 0.46 * max(dot(n, light), 0.0);
  float shine = 0.18 * pow(max(dot(reflect(-light, n), towards), 0.0), 24.0);
  shown = vec4(mix(base * lit + shine, base, flatness), alpha);
}`;

const FLAT_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
uniform mat4 screen;
out vec3 world;
void main() { world = position; gl_Position = screen * vec4(position, 1.0); }`;

const STRIP_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 color;
out vec4 shown;
void main() { shown = color; }`;

const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec3 world;
uniform vec3 ground, line, center;
uniform float spacing, reach;
out vec4 shown;
float grid(float step) {
  vec2 at = world.xy / step;
  vec2 width = fwidth(at);
  vec2 near = abs(fract(at - 0.5) - 0.5) / width;
  return (1.0 - min(min(near.x, near.y), 1.0)) * (1.0 - smoothstep(0.1, 0.6, max(width.x, width.y)));
}
void main() {
  float strength = max(0.45 * grid(spacing), grid(5.0 * spacing));
  float far = distance(world.xy, center.xy) / reach;
  shown = vec4(mix(ground, line, strength * (1.0 - smoothstep(0.4, 0.95, far))), 1.0);
}`;

/** Draws into one canvas; throws if the browser has no WebGL 2. */
class Renderer {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, alpha: false });
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.canvas = canvas;
    this.programs = {
      mesh: this.program(MESH_VERTEX, MESH_FRAGMENT),
      strip: this.program(FLAT_VERTEX, STRIP_FRAGMENT),
      floor: this.program(FLAT_VERTEX, FLOOR_FRAGMENT),
    };
    this.floor = this.strip([]);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(vertex, fragment) {
    const gl = this.gl;
    const handle = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(handle, shader);
    }
    gl.linkProgram(handle);
    if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle) || "shader");
    const locations = {};
    const count = gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i++) {
      const { name } = gl.getActiveUniform(handle, i);
      locations[name] = gl.getUniformLocation(handle, name);
    }
    return { handle, locations };
  }

  /** Take a program, and give its uniforms by name: numbers, vectors or matrices. */
  use(program, uniforms) {
    const gl = this.gl;
    gl.useProgram(program.handle);
    for (const [name, value] of Object.entries(uniforms)) {
      const location = program.locations[name];
      if (typeof value === "number") gl.uniform1f(location, value);
      else if (value.length === 3) gl.uniform3fv(location, value);
      else if (value.length === 4) gl.uniform4fv(location, value);
      else gl.uniformMatrix4fv(location, false, value);
    }
  }

  /** Keep a mesh on the graphics card. */
  mesh(mesh) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(mesh.corners), gl.STATIC_DRAW);
    for (let part = 0; part < 3; part++) {
      gl.enableVertexAttribArray(part);
      gl.vertexAttribPointer(part, 3, gl.FLOAT, false, 36, 12 * part);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(mesh.indices), gl.STATIC_DRAW);
    return { array, count: mesh.indices.length };
  }

  /** Keep a strip of corners on the graphics card. */
  strip(corners) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    const strip = { array, buffer: gl.createBuffer(), count: 0 };
    gl.bindVertexArray(array);
    this.restrip(strip, corners);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    return strip;
  }

  /** Give a strip other corners. */
  restrip(strip, corners) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, strip.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    strip.count = corners.length / 3;
  }

  /** Fill the whole canvas, which shows between the pictures. */
  clear(color) {
    const gl = this.gl;
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(...color, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  /** Begin a picture in a rectangle of the canvas (pixels from the lower left), seen by a camera. */
  begin([x, y, width, height], camera, colors) {
    const gl = this.gl;
    gl.viewport(x, y, width, height);
    gl.scissor(x, y, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    gl.clearColor(...colors.ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const [eye, target] = [camera.eye(), camera.target];
    this.eye = eye;
    this.screen = perspective(eye, camera.axes(), camera.fieldOfView, width / height, 0.02 * camera.distance, 20 * camera.distance);
    const reach = 4 * camera.distance;
    const corners = [[-1, -1], [1, -1], [-1, 1], [1, 1]].flatMap(([a, b]) => [target[0] + a * reach, target[1] + b * reach, 0]);
    this.restrip(this.floor, corners);
    gl.bindVertexArray(this.floor.array);
    const uniforms = { screen: this.screen, ground: colors.ground, line: colors.grid, center: target };
    this.use(this.programs.floor, { ...uniforms, spacing: camera.gridSpacing(), reach });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** Draw the first corners of a strip in a color with opacity (4). */
  drawStrip(strip, color, count = strip.count) {
    const gl = this.gl;
    if (count < 3) return;
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    gl.bindVertexArray(strip.array);
    this.use(this.programs.strip, { screen: this.screen, color });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, count);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  /** Draw meshes, each { mesh, model, and perhaps pattern, tint }; opacity below 1 makes a ghost of them. */
  drawMeshes(parts, opacity = 1) {
    const gl = this.gl;
    if (opacity < 1) {  // depth first, so that nothing within shows through
      gl.enable(gl.POLYGON_OFFSET_FILL);  // behind a robot in the same place, instead of speckled with it
      gl.polygonOffset(1, 8);
      gl.colorMask(false, false, false, false);
      this.drawEach(parts, 1);
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND);
      gl.depthFunc(gl.LEQUAL);
    }
    this.drawEach(parts, opacity);
    gl.disable(gl.BLEND);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.depthFunc(gl.LESS);
  }

  drawEach(parts, alpha) {
    const gl = this.gl;
    for (const { mesh, model, pattern, tint, flatness } of parts) {
      const look = { pattern: pattern || [-1, 0, 0], tint: tint || [0, 0, 0], tinted: tint ? 1 : 0, flatness: flatness || 0 };
      this.use(this.programs.mesh, { screen: this.screen, model, eye: this.eye, light: LIGHT, alpha, ...look });
      gl.bindVertexArray(mesh.array);
      gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    }
  }

  /** Draw the shadow of meshes on the floor, each place of it once. */
  drawShadow(parts, strength) {
    const gl = this.gl;
    const [a, b, height] = [-LIGHT[0] / LIGHT[2], -LIGHT[1] / LIGHT[2], 0.001];
    const flatten = [1, 0, 0, 0, 0, 1, 0, 0, a, b, 0, 0, -a * height, -b * height, height, 1];
    gl.enable(gl.STENCIL_TEST);
    gl.clear(gl.STENCIL_BUFFER_BIT);
    gl.stencilFunc(gl.EQUAL, 0, 0xff);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    const dark = parts.map(({ mesh, model }) => ({ mesh, model: multiply(flatten, model), tint: [0, 0, 0], flatness: 1 }));
    this.drawEach(dark, strength);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.disable(gl.STENCIL_TEST);
  }

  /** Let what follows be drawn over everything that is there. */
  overlay() {
    this.gl.clear(this.gl.DEPTH_BUFFER_BIT);
  }
}
