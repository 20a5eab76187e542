"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const floats = (text) => new Float32Array(bytes(text).buffer);
const time = floats(data.time), frames = time.length;
const [places, com, axes, sizes] = [data.places, data.com, data.axes, data.sizes].map(floats);
const feet = floats(data.feet);
const aims = data.aims.map((a) => ({ points: floats(a.points), wanted: floats(a.wanted) }));
const colour = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
const principal = data.colours.principal.map(colour);
const shown = { robot: true, ground: true, ellipsoid: true, masses: true, com: true, leg: true,
  soles: true, obstacles: true, targets: true, follow: true };
let frame = 0, playing = false, clock = 0, last = 0;

// ------------------------------------------------------------------ matrices, column by column
const mul = (a, b) => { const c = new Float32Array(16);
  for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) { let s = 0;
    for (let k = 0; k < 4; k++) s += a[4 * k + i] * b[4 * j + k]; c[4 * j + i] = s; } return c; };
const sub = (a, b) => a.map((x, k) => x - b[k]), dot = (a, b) => a.reduce((s, x, k) => s + x * b[k], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };
const affine = (x, y, z, o) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...o, 1]);
const at = (o, s) => affine([s, 0, 0], [0, s, 0], [0, 0, s], o);
const pose = (k, joint) => { const p = 7 * (k * data.joints + joint);
  const [ox, oy, oz, x, y, z, w] = places.subarray(p, p + 7);
  return affine([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], [ox, oy, oz]); };
const rod = (a, b, r) => { const z = sub(b, a), u = unit(z);
  const x = unit(cross(Math.abs(u[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], u)), y = cross(u, x);
  return affine(x.map((e) => e * r), y.map((e) => e * r), z, a); };

// ------------------------------------------------------------------ WebGL
const canvas = document.getElementById("scene"), gl = canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
const trouble = document.getElementById("trouble");
const tell = (text) => { trouble.hidden = false; trouble.textContent = text; };
if (!gl) tell("This browser has no WebGL 2: no replay.");
canvas.addEventListener("webglcontextlost", () => tell("The browser has closed the 3-D view; reload the page."));
const shader = (kind, text) => { const s = gl.createShader(kind); gl.shaderSource(s, text);
  gl.compileShader(s); if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
  return s; };
let program, where, ball, pole, parts = [], blocks = [], boards = [];
function surface(vertices, faces) {
  const vao = gl.createVertexArray(); gl.bindVertexArray(vao);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  return { vao, count: faces.length, type: faces.BYTES_PER_ELEMENT === 4 ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT };
}
function unpacked(one) {
  const raw = new Uint16Array(bytes(one.corners).buffer), out = new Float32Array(raw.length);
  for (let k = 0; k < raw.length; k++) out[k] = one.low[k % 3] + one.step[k % 3] * raw[k];
  const faces = bytes(one.faces).buffer;
  return surface(out, one.wide ? new Uint32Array(faces) : new Uint16Array(faces));
}
function round(rings, sides, point) {
  const v = [], f = [];
  for (let i = 0; i <= rings; i++) for (let j = 0; j < sides; j++) v.push(...point(i / rings, 2 * Math.PI * j / sides));
  for (let i = 0; i < rings; i++) for (let j = 0; j < sides; j++) {
    const a = i * sides + j, b = i * sides + (j + 1) % sides; f.push(a, b, a + sides, b, b + sides, a + sides); }
  return surface(new Float32Array(v), new Uint16Array(f));
}
function prepare() {
  program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `#version 300 es
    layout(location=0) in vec3 p; uniform mat4 view, model; out vec3 w;
    void main() { vec4 q = model * vec4(p, 1.0); w = q.xyz; gl_Position = view * q; }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float; in vec3 w; uniform vec4 tint; uniform vec3 eye; uniform float lit; out vec4 c;
    void main() { vec3 n = normalize(cross(dFdx(w), dFdy(w))), e = normalize(eye - w);
      if (dot(n, e) < 0.0) n = -n; float facing = max(dot(n, e), 0.0);
      float l = 0.42 + 0.38 * max(dot(n, normalize(e + vec3(0.1, 0.3, 0.9))), 0.0) + 0.22 * (0.5 + 0.5 * n.z);
      float a = lit > 1.5 ? tint.a * (0.35 + 1.4 * pow(1.0 - facing, 2.0)) : tint.a;
      c = vec4(lit > 0.5 ? tint.rgb * l : tint.rgb, a); }`));
  gl.linkProgram(program); gl.useProgram(program);
  where = Object.fromEntries(["view", "model", "tint", "eye", "lit"].map((n) => [n, gl.getUniformLocation(program, n)]));
  ball = round(16, 24, (u, a) => { const t = Math.PI * u; return [Math.sin(t) * Math.cos(a), Math.sin(t) * Math.sin(a), Math.cos(t)]; });
  pole = round(1, 12, (u, a) => [Math.cos(a), Math.sin(a), u]);
  parts = data.parts.map((one) => ({ joint: one.joint, colour: one.colour, mesh: unpacked(one) }));
  boards = data.boards.map(unpacked);
  blocks = data.obstacles.map((one) => ({ places: floats(one.places), mesh: unpacked(one) }));
  const grid = []; for (let k = -10; k <= 10; k++) grid.push(-2, k / 5, 0, 2, k / 5, 0, k / 5, -2, 0, k / 5, 2, 0);
  lines = gl.createVertexArray(); gl.bindVertexArray(lines);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(grid), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0); lines.count = grid.length / 3;
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA); gl.clearColor(1, 1, 1, 1);
}
let lines;
const camera = { azimuth: 0.6, elevation: 0.25, distance: 3, centre: [0, 0, 0] };
// Where the view has gone by each frame, over the ground: after the CoM, but not its sway. As in wbc view.
function followed(slack) {
  const way = [[com[0], com[1]]];
  for (let k = 1; k < frames; k++) {
    const from = way[k - 1], away = [com[3 * k] - from[0], com[3 * k + 1] - from[1]], far = Math.hypot(...away);
    const part = far > slack ? -Math.expm1(4 * (time[k - 1] - time[k])) * (1 - slack / far) : 0;
    way.push(from.map((x, i) => x + part * away[i])); }
  return way;
}
let way = [];
function look() {
  const heights = com.filter((_, i) => i % 3 === 2), low = Math.min(...heights), high = Math.max(...heights);
  const reach = Math.max(sizes[0] + (high - low) / 2, data.grounded ? Math.abs(com[2]) : 0);  // of all heights of the run
  camera.distance = 6 * reach; camera.centre = [com[0], com[1], (low + high) / 2]; way = followed(0.3 * reach);
}
function draw(mesh, model, rgb, alpha = 1, lit = 1) {
  gl.uniformMatrix4fv(where.model, false, model); gl.uniform4f(where.tint, ...rgb, alpha);
  gl.uniform1f(where.lit, lit); gl.bindVertexArray(mesh.vao);
  gl.drawElements(gl.TRIANGLES, mesh.count, mesh.type, 0);
}
const three = (array, k) => Array.from(array.subarray(3 * k, 3 * k + 3));
function paint() {
  const wide = canvas.clientWidth, high = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(wide * ratio)) { canvas.width = Math.round(wide * ratio); canvas.height = Math.round(high * ratio); }
  gl.viewport(0, 0, canvas.width, canvas.height); gl.depthMask(true);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const { azimuth: a, elevation: e, distance: d } = camera;
  const centre = camera.centre.map((c, i) => c + (shown.follow && i < 2 ? way[frame][i] - way[0][i] : 0));
  const back = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  const eye = centre.map((c, k) => c + d * back[k]), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  const turn = new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0,
    right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
  const f = 1 / Math.tan(0.21), near = 0.02 * d, far = 20 * d;
  const lens = new Float32Array([f * high / wide, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
  gl.uniformMatrix4fv(where.view, false, mul(lens, turn)); gl.uniform3f(where.eye, ...eye);
  const k = frame, middle = three(com, k), size = sizes.subarray(6 * k, 6 * k + 6), dotSize = 0.03 * sizes[0];
  if (shown.ground && data.grounded) {
    const [a, b] = data.slope, x = middle[0] - middle[0] % 0.2, y = middle[1] - middle[1] % 0.2;
    gl.uniformMatrix4fv(where.model, false, affine([1, 0, a], [0, 1, b], [0, 0, 1], [x, y, a * x + b * y]));
    gl.uniform4f(where.tint, 0.87, 0.88, 0.9, 1); gl.uniform1f(where.lit, 0);
    gl.bindVertexArray(lines); gl.drawArrays(gl.LINES, 0, lines.count);
    for (const board of boards) draw(board, at([0, 0, 0], 1), colour(data.colours.board));
  }
  if (shown.robot) for (const part of parts) draw(part.mesh, pose(k, part.joint), part.colour);
  if (shown.soles) for (const sole of data.soles) {
    const m = pose(k, sole.joint), put = (p) => [0, 1, 2].map((i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);
    sole.corners.forEach((p, i) => draw(pole, rod(put(p), put(sole.corners[(i + 1) % sole.corners.length]), 0.12 * dotSize), colour(data.colours.sole), 1, 0)); }
  const axis = [0, 1, 2].map((j) => [0, 1, 2].map((i) => axes[9 * k + 3 * i + j]));
  if (shown.leg && data.stands[k]) { const foot = three(feet, k);
    draw(pole, rod(foot, middle, 0.3 * dotSize), [0.13, 0.13, 0.13]); draw(ball, at(foot, 0.6 * dotSize), [0.13, 0.13, 0.13]); }
  if (shown.masses) axis.forEach((u, j) => { for (const s of [-1, 1]) {
    const tip = middle.map((c, i) => c + s * size[3 + j] * u[i]);
    draw(pole, rod(middle, tip, 0.12 * dotSize), principal[j]); draw(ball, at(tip, 0.8 * dotSize), principal[j]); } });
  if (shown.com) draw(ball, at(middle, dotSize), [0.13, 0.13, 0.13]);
  if (shown.targets) for (const aim of aims) { const p = three(aim.points, k), q = three(aim.wanted, k);
    if (Number.isFinite(q[0]) && Math.hypot(...sub(p, q)) > 5e-3) { draw(ball, at(q, dotSize), colour(data.colours.target));
      draw(pole, rod(p, q, 0.08 * dotSize), [0.3, 0.3, 0.3]); } }
  gl.enable(gl.BLEND); gl.depthMask(false);
  if (shown.obstacles) for (const block of blocks) { const m = block.places.subarray(12 * k, 12 * k + 12);
    if (Number.isFinite(m[0])) draw(block.mesh, new Float32Array([m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, m[3], m[7], m[11], 1]), [0.72, 0.55, 0.38], 0.28); }
  if (shown.ellipsoid) draw(ball, affine(...axis.map((u, j) => u.map((x) => x * size[j])), middle), [0.1, 0.5, 0.78], 0.3, 2);
  gl.disable(gl.BLEND);
}

// ------------------------------------------------------------------ controls
const slider = document.getElementById("slider"), button = document.getElementById("play");
const told = document.getElementById("clock"), speed = document.getElementById("speed");
const cursors = data.plots.map((plot) => {
  const box = document.createElement("div"), img = document.createElement("img"), mark = document.createElement("i");
  box.className = "plot"; img.src = `data:image/png;base64,${plot.png}`; img.alt = plot.title;
  mark.hidden = !plot.times; box.append(img, mark); document.getElementById("plots").append(box); return mark; });
function show(k) {
  frame = Math.max(0, Math.min(frames - 1, k)); slider.value = frame;
  told.textContent = `${time[frame].toFixed(2)} s${data.phases[frame] ? `, ${data.phases[frame]}` : ""}`;
  data.plots.forEach((plot, i) => { if (!plot.times) return; const [a, b] = plot.times, [l, r] = plot.across;
    cursors[i].style.left = `${100 * (l + (r - l) * Math.min(1, Math.max(0, (time[frame] - a) / (b - a || 1))))}%`; });
  if (gl) paint();
}
function play(on) { playing = on; button.textContent = on ? "Pause" : "Play";
  if (on) { if (frame === frames - 1) frame = 0; clock = time[frame]; last = performance.now(); requestAnimationFrame(step); } }
function step(now) {
  if (!playing) return;
  clock += (now - last) / 1000 * Number(speed.value); last = now;
  let k = frame; while (k < frames - 1 && time[k + 1] <= clock) k++;
  if (k !== frame) show(k);
  if (k === frames - 1) play(false); else requestAnimationFrame(step);
}
slider.max = frames - 1;
slider.addEventListener("input", () => { play(false); show(Number(slider.value)); });
button.addEventListener("click", () => play(!playing));
document.addEventListener("keydown", (event) => { if (event.code === "Space" && event.target.tagName !== "BUTTON") { event.preventDefault(); play(!playing); } });
for (const name of data.layers || Object.keys(shown)) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox"; box.checked = true; box.addEventListener("change", () => { shown[name] = box.checked; show(frame); });
  label.append(box, ` ${name}`); document.getElementById("layers").append(label);
}
canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  if (!event.buttons) return;
  const { azimuth: a, distance: d } = camera, s = 0.42 * d / canvas.clientHeight;
  if (event.shiftKey || event.buttons === 2) {
    camera.centre[0] += s * event.movementX * Math.sin(a); camera.centre[1] -= s * event.movementX * Math.cos(a);
    camera.centre[2] += s * event.movementY;
  } else { camera.azimuth -= 0.008 * event.movementX;
    camera.elevation = Math.max(-1.5, Math.min(1.5, camera.elevation + 0.008 * event.movementY)); }
  show(frame); });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => { event.preventDefault(); camera.distance *= Math.exp(0.001 * event.deltaY); show(frame); }, { passive: false });
window.addEventListener("resize", () => show(frame));
if (gl) { prepare(); look(); }
show(0);
