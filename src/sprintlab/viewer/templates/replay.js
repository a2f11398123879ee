// The replay page: forward kinematics of a recorded run, drawn with WebGL 2. No library.
// Names and units: metres, seconds, quaternions w x y z, z points up, the run goes along x.
"use strict";

const element = (name) => document.getElementById(name);
const data = JSON.parse(element("data").textContent);
const LANE = 1.22; // width of a lane

// --- numbers ------------------------------------------------------------------------------------------------

function unpack(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (a) => { const size = Math.hypot(...a) || 1; return a.map((value) => value / size); };

function multiply(p, q) {
  return [
    p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
    p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
    p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
    p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
  ];
}

function rotate(q, v) {
  const axis = [q[1], q[2], q[3]];
  const twice = cross(axis, v).map((value) => 2 * value);
  return add(add(v, twice.map((value) => q[0] * value)), cross(axis, twice));
}

// Column-major matrix of a pose.
function poseMatrix(position, [w, x, y, z]) {
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
    ...position, 1,
  ]);
}

function matrixProduct(a, b) {
  const product = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) product[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return product;
}

function perspective(angle, aspect, near, far) {
  const scale = 1 / Math.tan(angle / 2), depth = near - far;
  return new Float32Array([scale / aspect, 0, 0, 0, 0, scale, 0, 0,
    0, 0, (far + near) / depth, -1, 0, 0, 2 * far * near / depth, 0]);
}

function lookAt(eye, target) {
  const back = unit(subtract(eye, target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  return new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0,
    right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
}

// --- the recordings -----------------------------------------------------------------------------------------

// One clock for all runs: zero is the first command to move, and every run is shifted to its own.
const runs = data.runs.map((run, lane) => {
  const values = (name) => unpack(run[name], Float32Array);
  return { ...run, lane, model: data.models[run.model], model_index: run.model, time: values("time"), qpos: values("qpos"),
    speed: values("speed"), command: values("command"), power: values("power"), way: values("way"),
    share: unpack(run.share, Uint8Array), shift: data.course === "lap" ? 0 : -LANE * lane };
});
const pace = data.pace && { ...data.pace, lane: runs.length, shift: data.course === "lap" ? 0 : -LANE * runs.length };
const start = Math.min(...runs.map((run) => run.time[0]));
const end = Math.max(...runs.map((run) => run.time[run.time.length - 1]));

// Index before a value of a rising list and how far it is to the next one, 0 to 1.
function locate(list, value) {
  let low = 0, high = list.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (list[middle] <= value) low = middle; else high = middle;
  }
  return [low, Math.min(Math.max((value - list[low]) / (list[high] - list[low]), 0), 1)];
}

function between(values, [index, part]) { return (1 - part) * values[index] + part * values[index + 1]; }

function traceAt(run, name, moment) { return between(run[name], locate(run.time, moment)); }

// Coordinates of a run at a moment; the base's quaternion is interpolated linearly and normalized.
function coordinatesAt(run, moment) {
  const [frame, part] = locate(run.time, moment), count = run.model.coordinates, first = frame * count;
  const qpos = run.qpos, turns = [3, 4, 5, 6].reduce((sum, i) => sum + qpos[first + i] * qpos[first + count + i], 0);
  const sign = turns < 0 ? -1 : 1;
  const values = Array.from({ length: count }, (_, index) => {
    const turned = index >= 3 && index < 7 ? sign : 1;
    return (1 - part) * qpos[first + index] + part * turned * qpos[first + count + index];
  });
  values.splice(3, 4, ...unit(values.slice(3, 7)));
  values[1] += run.shift;
  return values;
}

// Moment at which somebody had come as far as this; null when never.
function momentOf(runner, way) {
  const ways = runner.way, last = ways.length - 1;
  let index = 1;
  while (index < last && ways[index] < way) index++;
  if (ways[index] < way) return null;
  const part = (way - ways[index - 1]) / (ways[index] - ways[index - 1] || 1);
  return (1 - part) * runner.time[index - 1] + part * runner.time[index];
}

function wayAt(runner, moment) { return Math.max(between(runner.way, locate(runner.time, moment)), 0); }

// What a stopwatch shows: zero while the robot still stands, halted at the finish.
function clockAt(run, moment) { return Math.min(Math.max(moment, 0), run.finish ?? run.time[run.time.length - 1]); }

// Position and quaternion of every body (the order of the tree: a parent comes before its children).
function poses(model, values) {
  const result = [{ position: [0, 0, 0], quaternion: [1, 0, 0, 0] }];
  for (const body of model.bodies.slice(1)) {
    const parent = result[body.parent];
    let position = add(parent.position, rotate(parent.quaternion, body.position));
    let quaternion = multiply(parent.quaternion, body.quaternion);
    for (const joint of body.joints) {
      const value = values[joint.address] - joint.reference;
      if (joint.kind === "free") {
        position = values.slice(joint.address, joint.address + 3);
        quaternion = values.slice(joint.address + 3, joint.address + 7);
      } else if (joint.kind === "slide") {
        position = add(position, rotate(quaternion, joint.axis.map((part) => part * value)));
      } else {
        const anchor = add(position, rotate(quaternion, joint.anchor)), sine = Math.sin(value / 2);
        quaternion = multiply(quaternion, [Math.cos(value / 2), ...joint.axis.map((part) => part * sine)]);
        position = subtract(anchor, rotate(quaternion, joint.anchor));
      }
    }
    result.push({ position, quaternion });
  }
  return result;
}

// --- WebGL --------------------------------------------------------------------------------------------------

const ROBOT_VERTEX = `#version 300 es
layout(location=0) in vec3 place; layout(location=1) in vec3 normal;
uniform mat4 view, body; uniform vec3 sun; uniform float flatten;
out vec3 world; out vec3 facing;
void main() {
  vec4 point = body * vec4(place, 1.0);
  if (flatten > 0.5) point.xyz -= sun * (max(point.z, 0.0) - 0.002) / sun.z;
  world = point.xyz; facing = mat3(body) * normal;
  gl_Position = view * point;
}`;

const ROBOT_FRAGMENT = `#version 300 es
precision highp float;
in vec3 world; in vec3 facing; uniform vec3 color, sun, eye; uniform float flatten; out vec4 pixel;
void main() {
  if (flatten > 0.5) { pixel = vec4(0.0, 0.0, 0.0, 0.38); return; }
  vec3 n = normalize(facing), v = normalize(eye - world), h = normalize(v + sun);
  float diffuse = max(dot(n, sun), 0.0), sky = 0.5 + 0.5 * n.z;
  vec3 light = color * (0.30 + 0.34 * sky + 0.72 * diffuse) + 0.30 * pow(max(dot(n, h), 0.0), 48.0);
  light += 0.10 * pow(1.0 - max(dot(n, v), 0.0), 3.0);
  pixel = vec4(pow(light, vec3(0.85)), 1.0);
}`;

const GROUND_VERTEX = `#version 300 es
layout(location=0) in vec3 place; uniform mat4 view; uniform vec3 centre; out vec3 world;
void main() { world = place + vec3(centre.xy, 0.0); gl_Position = view * vec4(world, 1.0); }`;

// Grass and a track of lanes, straight along x or the oval of 400 m; `run` is the way along it, `side` the
// distance to the left of the line that is run, in the first lane.
const GROUND_FRAGMENT = `#version 300 es
precision highp float;
in vec3 world; uniform vec3 eye, haze; uniform float distance_, lanes_left, lanes_right, oval; out vec4 pixel;
float line(float offset, float half_width) {
  float blur = fwidth(offset) + 1e-4;
  return 1.0 - smoothstep(half_width - blur, half_width + blur, abs(offset));
}
void main() {
  float lane = 1.22, run = world.x, side = world.y;
  if (oval > 0.5) {
    float radius = 36.8, straight = 84.39, bend = 3.14159265 * radius;
    if (world.x >= 0.0) {
      run = radius * atan(world.x, radius - world.y); side = radius - length(vec2(world.x, world.y - radius));
    } else if (world.x <= -straight) {
      run = bend + straight + radius * atan(-(world.x + straight), world.y - radius);
      side = radius - length(vec2(world.x + straight, world.y - radius));
    } else if (world.y > radius) { run = bend - world.x; side = 2.0 * radius - world.y; }
    else { run = 2.0 * bend + 2.0 * straight + world.x; }
  }
  float left = lane * (lanes_left + 0.5), right = -lane * (lanes_right + 0.5);
  float inside = step(right, side) * step(side, left);
  vec3 color = mix(vec3(0.30, 0.42, 0.27), vec3(0.60, 0.28, 0.20), step(right - 0.5, side) * step(side, left + 0.5));
  vec2 tile = floor(world.xy); color *= 0.97 + 0.03 * mod(tile.x + tile.y, 2.0);
  float boundary = side / lane + 0.5;
  float mark = inside * line((boundary - round(boundary)) * lane, 0.025);
  mark = max(mark, max(line(side - left, 0.025), line(side - right, 0.025)));
  float ten = run - 10.0 * round(run / 10.0);
  bool goal = abs(run) < 5.0 || abs(run - distance_) < 5.0;
  mark = max(mark, inside * line(ten, goal ? 0.08 : 0.02));
  float metre = run - round(run);
  mark = max(mark, inside * step(min(left - side, side - right), 0.15) * line(metre, 0.012));
  color = mix(color, vec3(0.93), mark);
  float away = length(world.xy - eye.xy);
  pixel = vec4(mix(color, haze, smoothstep(12.0, 70.0, away)), 1.0);
}`;

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return { made, at: (name) => gl.getUniformLocation(made, name) };
}

// Normals that are smooth where neighbouring vertices are shared and sharp where they are not.
function normalsOf(vertices, faces) {
  const sums = new Float32Array(vertices.length);
  const corner = (index) => [vertices[3 * index], vertices[3 * index + 1], vertices[3 * index + 2]];
  for (let face = 0; face < faces.length; face += 3) {
    const [a, b, c] = [corner(faces[face]), corner(faces[face + 1]), corner(faces[face + 2])];
    const area = cross(subtract(b, a), subtract(c, a));
    for (let k = 0; k < 3; k++) for (let i = 0; i < 3; i++) sums[3 * faces[face + k] + i] += area[i];
  }
  for (let i = 0; i < sums.length; i += 3) sums.set(unit([sums[i], sums[i + 1], sums[i + 2]]), i);
  return sums;
}

function upload(gl, vertices, faces, normals) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  [vertices, normals].forEach((values, location) => {
    if (!values) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
  });
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  return { array, count: faces.length };
}

function modelMeshes(gl, model) {
  const places = Float32Array.from(unpack(model.vertices, Int16Array), (value) => value * model.unit);
  const indices = unpack(model.faces, Uint16Array);
  let vertex = 0, face = 0;
  return model.surfaces.map((surface) => {
    const vertices = places.subarray(3 * vertex, 3 * (vertex += surface.vertices));
    const faces = indices.subarray(3 * face, 3 * (face += surface.faces));
    return { ...upload(gl, vertices, faces, normalsOf(vertices, faces)), body: surface.body, color: surface.color };
  });
}

// A runner of boxes for a pace without a recording: joint [x, y, z], size, swing in radians.
const FIGURE = [[[0, 0, 0.98], [0.22, 0.34, 0.62], 0, 0.62], [[0, 0, 1.72], [0.19, 0.17, 0.24], 0, 0.1],
  [[0, 0.09, 0.95], [0.13, 0.13, 0.95], 0.75, -0.95], [[0, -0.09, 0.95], [0.13, 0.13, 0.95], -0.75, -0.95],
  [[0, 0.23, 1.5], [0.09, 0.09, 0.6], -0.8, -0.6], [[0, -0.23, 1.5], [0.09, 0.09, 0.6], 0.8, -0.6]];

function figureMeshes(gl, color) {
  return FIGURE.map(([, [length, width, height], , rise], body) => {
    const low = Math.min(rise, 0), vertices = new Float32Array(72), faces = new Uint16Array(36);
    let corner = 0;
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]].forEach(([out, a, b]) => [1, -1].forEach((sign) => {
      [[-1, -1], [sign, -sign], [1, 1], [-sign, sign]].forEach(([u, v], index) => {
        const point = [0, 0, 0];
        point[out] = sign; point[a] = u; point[b] = v;
        vertices.set([point[0] * length / 2, point[1] * width / 2, low + (point[2] + 1) * height / 2], 3 * (corner + index));
      });
      faces.set([0, 1, 2, 0, 2, 3].map((index) => corner + index), corner / 4 * 6);
      corner += 4;
    }));
    return { ...upload(gl, vertices, faces, normalsOf(vertices, faces)), body, color };
  });
}

// Where a runner of boxes stands at a way along the track; a whole stride is 4.9 m.
function figurePoses(way) {
  const phase = 2 * Math.PI * way / 4.9, [place, turn] = trackPose(way, pace.shift);
  return FIGURE.map(([joint, , swing]) => {
    const angle = swing * Math.sin(phase) * Math.min(way, 1), tilt = [Math.cos(angle / 2), 0, Math.sin(angle / 2), 0];
    return { position: add(place, rotate(turn, joint)), quaternion: multiply(turn, tilt) };
  });
}

// Point and orientation at a way along the line of the first lane, `side` to its left.
function trackPose(way, side) {
  const turned = (angle) => [Math.cos(angle / 2), 0, 0, Math.sin(angle / 2)];
  if (data.course !== "lap") return [[way, side, 0], turned(0)];
  const radius = 36.8, straight = 84.39, bend = Math.PI * radius, along = way % (2 * (bend + straight));
  const arc = (x, angle) => [[x + (radius - side) * Math.sin(angle), radius - (radius - side) * Math.cos(angle), 0], turned(angle)];
  if (along <= bend) return arc(0, along / radius);
  if (along <= bend + straight) return [[bend - along, 2 * radius - side, 0], turned(Math.PI)];
  if (along <= 2 * bend + straight) return arc(-straight, (along - straight) / radius);
  return [[along - 2 * (bend + straight), side, 0], turned(0)];
}

const mixed = (color, tint, share) => color.map((value, index) => (1 - share) * value + share * tint[index]);
const rgb = (hex) => [1, 3, 5].map((place) => parseInt(hex.slice(place, place + 2), 16) / 255);

const SUN = unit([-0.35, -0.5, 1.1]), HAZE = [0.70, 0.78, 0.86];

class Scene {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: true, stencil: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser offers no WebGL 2");
    this.gl = gl;
    this.canvas = canvas;
    this.robot = program(gl, ROBOT_VERTEX, ROBOT_FRAGMENT);
    this.ground = program(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    const models = data.models.map((model) => modelMeshes(gl, model));
    // The first run keeps the robot's own colours, the others wear their line's.
    this.crowd = runs.map((run, index) => models[run.model_index].map((mesh) => (
      { ...mesh, color: index ? mixed(mesh.color, rgb(run.color), 0.55) : mesh.color })));
    if (pace) this.crowd.push(figureMeshes(gl, rgb(pace.color)));
    const far = 120;
    this.plane = upload(gl, new Float32Array([-far, -far, 0, far, -far, 0, far, far, 0, -far, far, 0]),
      new Uint16Array([0, 1, 2, 0, 2, 3]), null);
    gl.enable(gl.DEPTH_TEST);
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
  }

  draw(crowdPoses, eye, target) {
    const gl = this.gl;
    this.resize();
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...HAZE, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const aspect = this.canvas.width / Math.max(this.canvas.height, 1);
    const view = matrixProduct(perspective(0.72, aspect, 0.05, 300), lookAt(eye, target));
    this.drawGround(view, eye);
    gl.useProgram(this.robot.made);
    gl.uniformMatrix4fv(this.robot.at("view"), false, view);
    gl.uniform3fv(this.robot.at("sun"), SUN);
    gl.uniform3fv(this.robot.at("eye"), eye);
    this.matrices = crowdPoses.map((bodies) => bodies.map((pose) => poseMatrix(pose.position, pose.quaternion)));
    this.view = view;
    this.drawShadow();
    this.drawCrowd(0);
  }

  // Place of a point on the canvas [CSS pixels]; null behind the camera.
  project([x, y, z]) {
    const at = (row) => this.view[row] * x + this.view[4 + row] * y + this.view[8 + row] * z + this.view[12 + row];
    const depth = at(3);
    if (depth <= 0) return null;
    return [0.5 * (1 + at(0) / depth) * this.canvas.clientWidth, 0.5 * (1 - at(1) / depth) * this.canvas.clientHeight];
  }

  drawGround(view, eye) {
    const gl = this.gl;
    gl.useProgram(this.ground.made);
    gl.uniformMatrix4fv(this.ground.at("view"), false, view);
    gl.uniform3fv(this.ground.at("centre"), eye);
    gl.uniform3fv(this.ground.at("eye"), eye);
    gl.uniform3fv(this.ground.at("haze"), HAZE);
    gl.uniform1f(this.ground.at("distance_"), data.distance);
    gl.uniform1f(this.ground.at("oval"), data.course === "lap" ? 1 : 0);
    gl.uniform1f(this.ground.at("lanes_left"), data.course === "lap" ? 0 : 4);
    gl.uniform1f(this.ground.at("lanes_right"), data.course === "lap" ? 7 : 4);
    gl.bindVertexArray(this.plane.array);
    gl.drawElements(gl.TRIANGLES, this.plane.count, gl.UNSIGNED_SHORT, 0);
  }

  // The robot pressed flat along the sunlight; the stencil keeps overlapping parts from darkening twice.
  drawShadow() {
    const gl = this.gl;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    this.drawCrowd(1);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.BLEND);
  }

  drawCrowd(flatten) {
    const gl = this.gl;
    gl.uniform1f(this.robot.at("flatten"), flatten);
    this.crowd.forEach((meshes, who) => meshes.forEach((mesh) => {
      gl.uniformMatrix4fv(this.robot.at("body"), false, this.matrices[who][mesh.body]);
      gl.uniform3fv(this.robot.at("color"), mesh.color);
      gl.bindVertexArray(mesh.array);
      gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_SHORT, 0);
    }));
  }
}

// --- camera -------------------------------------------------------------------------------------------------

class Orbit {
  constructor(canvas) {
    const upright = Math.max(1, 0.8 * canvas.clientHeight / Math.max(canvas.clientWidth, 1));
    Object.assign(this, { azimuth: -0.9, elevation: 0.22, distance: 2.6 * upright, centre: [0, 0, 0.4], pointers: new Map() });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0012 * event.deltaY));
    }, { passive: false });
  }

  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 0.6), 60); }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const here = [event.clientX, event.clientY];
    if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const span = (place) => Math.hypot(place[0] - other[0], place[1] - other[1]) || 1;
      this.zoom(span(before) / span(here));
    } else if (event.buttons & 2 || event.shiftKey) {
      this.pan(here[0] - before[0], here[1] - before[1]);
    } else {
      this.azimuth -= 0.006 * (here[0] - before[0]);
      this.elevation = Math.min(Math.max(this.elevation + 0.006 * (here[1] - before[1]), 0.02), 1.5);
    }
    this.pointers.set(event.pointerId, here);
  }

  pan(right, down) {
    const scale = 0.0012 * this.distance, side = [-Math.sin(this.azimuth), Math.cos(this.azimuth)];
    this.centre = [this.centre[0] - scale * right * side[0], this.centre[1] - scale * right * side[1],
      Math.max(this.centre[2] + scale * down, 0.05)];
  }

  eye() {
    const level = Math.cos(this.elevation) * this.distance;
    return add(this.centre, [Math.cos(this.azimuth) * level, Math.sin(this.azimuth) * level,
      Math.sin(this.elevation) * this.distance]);
  }
}

// --- the page -----------------------------------------------------------------------------------------------

const state = { now: start, playing: true, rate: 1, follow: true, last: null, focus: 0 };
const everybody = pace ? [...runs, pace] : runs;
let bars = [];

function made(tag, className, text, parent) {
  const node = document.createElement(tag);
  node.className = className;
  node.textContent = text;
  parent.append(node);
  return node;
}

const rows = everybody.length < 2 ? [] : everybody.map((runner, index) => {
  const row = made("button", "runner", "", element("gaps"));
  row.type = "button";
  made("i", "", "", row).style.background = runner.color;
  made("span", "who", runner.name, row);
  const gap = made("span", "gap", "", row);
  if (index < runs.length) row.addEventListener("click", () => setFocus(index)); else row.disabled = true;
  const label = made("div", "label", runner.name, document.body);
  label.style.borderColor = runner.color;
  return { row, gap, label };
});
element("gaps").hidden = rows.length === 0;

function setFocus(index) {
  state.focus = index;
  rows.forEach(({ row }, other) => row.classList.toggle("chosen", other === index));
  element("bars").replaceChildren();
  bars = runs[index].model.names.map((name) => {
    const row = made("div", "bar", name, element("bars"));
    return made("b", "", "", made("i", "", "", row));
  });
}

function goTo(moment) {
  state.now = Math.min(Math.max(moment, start), end);
}

function setPlaying(playing) {
  if (playing && state.now >= end) state.now = start;
  state.playing = playing;
  element("play").textContent = playing ? "Pause" : "Play";
}

function drawPlot() {
  const canvas = element("plot"), ratio = window.devicePixelRatio || 1, pen = canvas.getContext("2d");
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  pen.scale(ratio, ratio);
  const style = getComputedStyle(document.documentElement), tone = (name) => style.getPropertyValue(name);
  const width = canvas.clientWidth, height = canvas.clientHeight, left = 34, base = height - 16;
  const x = (moment) => left + (width - left - 4) * (moment - start) / (end - start), y = (value) => base - (base - 6) * value / TOP;
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = tone("--quiet");
  pen.strokeStyle = tone("--line");
  const step = (TOP > 6 ? 4 : 1) * (height < 70 ? 2 : 1);
  for (let value = 0; value <= TOP; value += step) {
    pen.beginPath(); pen.moveTo(left, y(value)); pen.lineTo(width - 4, y(value)); pen.stroke();
    pen.textAlign = "right"; pen.fillText(`${value}`, left - 6, y(value) + 4);
  }
  pen.textAlign = "center";
  const every = end > 25 ? 10 : 2;
  for (let moment = 0; moment < end; moment += every) pen.fillText(`${moment} s`, x(moment), height - 3);
  const curve = (run, name, color) => {
    pen.strokeStyle = color; pen.lineWidth = 1.6; pen.beginPath();
    run[name].forEach((value, frame) => pen.lineTo(x(run.time[frame]), y(Math.max(value, 0))));
    pen.stroke();
  };
  if (runs.length > 1) pen.setLineDash([5, 4]); // a colour of its own belongs to each runner there
  curve(runs[state.focus], "command", tone(runs.length > 1 ? "--quiet" : "--warm"));
  pen.setLineDash([]);
  runs.forEach((run, index) => curve(run, "speed", runs.length > 1 && index ? run.color : tone("--accent")));
  pen.strokeStyle = tone("--ink"); pen.lineWidth = 1.2; pen.beginPath();
  pen.moveTo(x(state.now), 2); pen.lineTo(x(state.now), base); pen.stroke();
}

if (runs.length > 1) element("legend").classList.add("several");

const TOP = runs.reduce((top, run) => Math.max(top, ...run.speed, ...run.command), 1) * 1.08;

function showNumbers() {
  const run = runs[state.focus], [frame] = locate(run.time, state.now), joints = run.model.names.length;
  const clock = clockAt(run, state.now);
  element("speed").textContent = traceAt(run, "speed", state.now).toFixed(1);
  element("way").textContent = wayAt(run, clock).toFixed(1);
  element("clock").textContent = clock.toFixed(2);
  element("power").textContent = (traceAt(run, "power", state.now) / 1000).toFixed(1);
  bars.forEach((bar, joint) => {
    const value = run.share[frame * joints + joint];
    bar.style.width = `${value}%`;
    bar.classList.toggle("full", value >= 99);
  });
  element("scrub").value = String((state.now - start) / (end - start));
}

// Who leads, and how far behind the others are in metres and in seconds; times once they have finished.
function gaps() {
  const ways = everybody.map((runner) => wayAt(runner, clockAt(runner, state.now)));
  const done = everybody.map((runner) => runner.finish !== null && state.now >= runner.finish);
  const best = ways.reduce((leader, way, index) => (way > ways[leader] ? index : leader), 0);
  return everybody.map((runner, index) => {
    if (done[index]) return `${runner.finish.toFixed(2)} s`;
    const behind = ways[best] - ways[index], passed = momentOf(everybody[best], ways[index]);
    if (index === best || behind < 0.005) return `${ways[index].toFixed(1)} m`;
    const late = passed === null ? "" : `  +${Math.max(state.now - passed, 0).toFixed(2)} s`;
    return `\u2212${behind.toFixed(1)} m${late}`;
  });
}

function showGaps(scene, crowd) {
  if (!rows.length) return;
  const texts = gaps();
  rows.forEach(({ gap, label }, index) => {
    gap.textContent = texts[index];
    const base = crowd[index][index < runs.length ? 1 : 0].position;
    const place = scene && scene.project([base[0], base[1], index < runs.length ? base[2] + 0.35 : 2.0]);
    label.hidden = !place;
    if (place) label.style.transform = `translate(-50%, -100%) translate(${place[0]}px, ${place[1]}px)`;
  });
}

function bind() {
  element("play").addEventListener("click", () => setPlaying(!state.playing));
  element("rate").addEventListener("change", (event) => { state.rate = Number(event.target.value); });
  element("follow").addEventListener("change", (event) => { state.follow = event.target.checked; });
  element("scrub").addEventListener("input", (event) => {
    setPlaying(false);
    goTo(start + Number(event.target.value) * (end - start));
  });
  const seek = (event) => {
    if (!(event.buttons & 1)) return;
    const area = event.target.getBoundingClientRect(), left = 34;
    setPlaying(false);
    goTo(start + (event.clientX - area.left - left) / (area.width - left - 4) * (end - start));
  };
  for (const name of ["pointerdown", "pointermove"]) element("plot").addEventListener(name, seek);
  window.addEventListener("keydown", (event) => {
    if (/INPUT|SELECT|BUTTON/.test(event.target.tagName) && event.key === " ") return;
    if (event.key === " ") { event.preventDefault(); setPlaying(!state.playing); }
    if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
      setPlaying(false);
      goTo(state.now + (event.key === "ArrowRight" ? 1 : -1) * (event.shiftKey ? 0.5 : 0.02));
    }
  });
}

// The camera keeps its place beside the run that is looked at.
function follow(camera, base, values) {
  const from = base || [values[0], values[1], camera.centre[2]];
  if (!base) camera.centre = [values[0], values[1], camera.centre[2]];
  camera.centre = add(camera.centre, [values[0] - from[0], values[1] - from[1], 0]);
}

function main() {
  let scene;
  try {
    scene = new Scene(element("scene"));
  } catch (error) {
    element("failure").hidden = false;
    element("failure").textContent = `The scene cannot be drawn: ${error.message}. The traces below still work.`;
  }
  const camera = new Orbit(element("scene"));
  if (rows.length) Object.assign(camera, { distance: camera.distance * 1.5, elevation: 0.3 });
  let base = null;
  bind();
  setFocus(0);
  const frame = (stamp) => {
    if (state.playing && state.last !== null) goTo(state.now + state.rate * Math.min((stamp - state.last) / 1000, 0.1));
    if (state.playing && state.now >= end) setPlaying(false);
    state.last = stamp;
    const coordinates = runs.map((run) => coordinatesAt(run, state.now));
    if (state.follow) follow(camera, base, coordinates[state.focus]);
    base = coordinates[state.focus].slice(0, 3);
    const crowd = coordinates.map((values, index) => poses(runs[index].model, values));
    if (pace) crowd.push(figurePoses(wayAt(pace, state.now)));
    if (scene) scene.draw(crowd, camera.eye(), camera.centre);
    drawPlot();
    showNumbers();
    showGaps(scene, crowd);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
  // For the console: replay.goTo(8), replay.setPlaying(false), replay.bodyPosition("FL_shank"), replay.gaps().
  window.replay = { state, goTo, setPlaying, setFocus, camera, start, duration: end - start, gaps,
    bodyPosition: (name, who = 0) => poses(runs[who].model, coordinatesAt(runs[who], state.now))[
      runs[who].model.bodies.findIndex((body) => body.name === name)].position };
}

main();
