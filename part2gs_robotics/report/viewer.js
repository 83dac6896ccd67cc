// The twin in 3D: a graph of parts moved by their joints, and what of it is shown.
"use strict";
const data = JSON.parse(document.getElementById("twin").textContent);
const $ = name => document.getElementById(name);
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
THREE.ColorManagement.enabled = false;  // colours go from the photos to the screen as they are

// ---- parts -------------------------------------------------------------------------------------
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
const up = new THREE.Vector3(...data.up);
const root = new THREE.Group();
const groups = data.parts.map(part => {
  const group = new THREE.Group();
  group.name = part.name;
  group.matrixAutoUpdate = false;  // the joint's matrix, nothing else
  return group;
});
data.parts.forEach((part, i) => (part.parent < 0 ? root : groups[part.parent]).add(groups[i]));
const joints = data.parts.map(part => part.joint);
const at = joints.map(() => 0);  // joint positions, rad or scene units; 0 = state 0

// World at q from world at 0: a turn about the line through `origin` and a slide along it.
function motion(joint, q) {
  const turn = joint.kind === "prismatic" ? 0 : q;
  const slide = joint.kind === "prismatic" ? q : joint.pitch * q;
  const axis = new THREE.Vector3(...joint.axis), origin = new THREE.Vector3(...joint.origin);
  const matrix = new THREE.Matrix4().makeRotationAxis(axis, turn);
  const shift = origin.clone().sub(origin.clone().applyMatrix4(matrix)).addScaledVector(axis, slide);
  return matrix.setPosition(shift);
}

function place(index, q) {
  at[index] = q;
  groups[index].matrix.copy(motion(joints[index], q));
  groups[index].matrixWorldNeedsUpdate = true;
  draw();
}

// ---- what is drawn -----------------------------------------------------------------------------
function shape(mesh) {
  const found = new THREE.BufferGeometry();
  found.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(mesh.points)), 3));
  found.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(mesh.faces)), 1));
  if (mesh.uv) {
    found.setAttribute("uv", new THREE.BufferAttribute(new Uint16Array(bytes(mesh.uv)), 2, true));
  }
  if (mesh.colors) {
    found.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(bytes(mesh.colors)), 3, true));
  }
  return found;
}

function surface(part) {
  const mesh = part.surface;
  const look = mesh.image
    ? new THREE.MeshBasicMaterial({ side: THREE.DoubleSide })  // the photos' light is in the picture
    : new THREE.MeshLambertMaterial({ vertexColors: true, flatShading: true, side: THREE.DoubleSide });
  if (mesh.image) {
    const picture = new Image();
    picture.onload = () => { look.map.needsUpdate = true; draw(); };
    look.map = new THREE.Texture(picture);
    picture.src = mesh.image;
  }
  return new THREE.Mesh(shape(mesh), look);
}

function pieces(part, index) {
  const group = new THREE.Group();
  const line = new THREE.LineBasicMaterial({ color: 0x000000, transparent: true, opacity: 0.35 });
  part.pieces.forEach((piece, n) => {
    const hue = (0.61803 * (n + 7 * index)) % 1;  // golden steps: neighbours never look alike
    const look = new THREE.MeshLambertMaterial({
      color: new THREE.Color().setHSL(hue, 0.5, index ? 0.62 : 0.75), flatShading: true,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    const solid = shape(piece);
    group.add(new THREE.Mesh(solid, look));
    group.add(new THREE.LineSegments(new THREE.EdgesGeometry(solid, 15), line));
  });
  return group;
}

// One round disc per Gaussian, 1.4 of its deviations to either side: wide enough to close walls.
const DISC = new THREE.ShaderMaterial({
  uniforms: { high: { value: 1 } },
  vertexShader: `attribute float radius; attribute vec3 color; varying vec3 tone; uniform float high;
    void main() { tone = color; vec4 p = modelViewMatrix * vec4(position, 1.0);
      gl_PointSize = max(1.5, 1.4 * radius * high * projectionMatrix[1][1] / -p.z);
      gl_Position = projectionMatrix * p; }`,
  fragmentShader: `varying vec3 tone; void main() {
    if (length(gl_PointCoord - 0.5) > 0.5) discard; gl_FragColor = vec4(tone, 1.0); }`,
});

function discs(part) {
  const found = new THREE.BufferGeometry(), splats = part.splats;
  if (splats) {
    found.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(splats.points)), 3));
    found.setAttribute("radius", new THREE.BufferAttribute(new Float32Array(bytes(splats.radius)), 1));
    found.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(bytes(splats.colors)), 3, true));
  }
  return new THREE.Points(found, DISC);
}

// The line a part turns about or slides along; it stays where the part's carrier is.
function axisLine(joint) {
  const axis = new THREE.Vector3(...joint.axis), middle = new THREE.Vector3(...joint.origin);
  const from = middle.clone().addScaledVector(axis, -0.3 * data.size);
  const arrow = new THREE.ArrowHelper(axis, from, 0.6 * data.size, 0xe0218a, 0.04 * data.size, 0.02 * data.size);
  arrow.line.material.depthTest = arrow.cone.material.depthTest = false;
  arrow.line.renderOrder = arrow.cone.renderOrder = 1;
  return arrow;
}

const shown = { surface: [], pieces: [], splats: [], axes: [] };
data.parts.forEach((part, i) => {
  const made = { surface: surface(part), pieces: pieces(part, i), splats: discs(part) };
  for (const [kind, item] of Object.entries(made)) { shown[kind].push(item); groups[i].add(item); }
  if (joints[i]) {
    const line = axisLine(joints[i]);
    shown.axes.push(line);
    groups[i].parent.add(line);
    groups[i].matrix.copy(motion(joints[i], 0));
  }
});
const light = new THREE.DirectionalLight(0xffffff, 1.6);
root.add(new THREE.AmbientLight(0xffffff, 1.7), light);

function ground() {
  const plate = new THREE.GridHelper(2 * data.size, 20, 0x888888, 0x888888);
  plate.material.transparent = true;
  plate.material.opacity = 0.28;
  plate.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), up);
  plate.position.copy(up).multiplyScalar(data.floor - 0.002 * data.size);
  return plate;
}
root.add(ground());

function show(kind) {
  for (const name of ["surface", "pieces", "splats"]) {
    for (const item of shown[name]) item.visible = name === kind;
  }
  draw();
}

// ---- camera ------------------------------------------------------------------------------------
const camera = new THREE.PerspectiveCamera(35, 1, 0.01 * data.size, 50 * data.size);
const side = new THREE.Vector3(1, 0, 0).projectOnPlane(up);
if (side.length() < 0.1) side.set(0, 1, 0).projectOnPlane(up);
side.normalize();
const other = new THREE.Vector3().crossVectors(up, side);
const view = { around: 0, above: 0, far: 1, target: new THREE.Vector3(), fov: 30 };  // home() sets it

// From where a photo was taken, looking at the point of its line of sight nearest to the middle.
function standAt(photo) {
  const eye = new THREE.Vector3(...photo.eye), ahead = new THREE.Vector3(...photo.ahead);
  const depth = Math.max(-eye.dot(ahead), 0.1 * data.size);
  view.target.copy(eye).addScaledVector(ahead, depth);
  view.far = depth;
  view.fov = photo.fov;
  view.above = Math.asin(Math.max(-1, Math.min(1, -ahead.dot(up))));
  view.around = Math.atan2(-ahead.dot(other), -ahead.dot(side));
  draw();
}

// The whole twin in both states, from the side to which its parts move and a little above.
function home() {
  const facing = new THREE.Vector3(...data.facing);
  const around = Math.atan2(facing.dot(other), facing.dot(side)) + 0.55;
  Object.assign(view, { around, above: 0.4, fov: 30 });
  view.target.set(0, 0, 0);
  view.far = 0.56 * data.size / Math.sin(view.fov * Math.PI / 360);
  draw();
}

function aim() {
  view.above = Math.max(-1.55, Math.min(1.55, view.above));
  view.far = Math.max(0.05 * data.size, Math.min(20 * data.size, view.far));
  const flat = Math.cos(view.above);
  camera.position.copy(view.target)
    .addScaledVector(side, view.far * flat * Math.cos(view.around))
    .addScaledVector(other, view.far * flat * Math.sin(view.around))
    .addScaledVector(up, view.far * Math.sin(view.above));
  camera.up.copy(up);
  camera.lookAt(view.target);
  // a field of view is that of the shorter side: a narrow screen still shows all of it
  const half = Math.tan(view.fov * Math.PI / 360) / Math.min(1, camera.aspect);
  camera.fov = 2 * Math.atan(half) * 180 / Math.PI;
  camera.updateProjectionMatrix();
  light.position.copy(camera.position).addScaledVector(up, view.far);
}

// ---- drawing, only when something changed ------------------------------------------------------
let renderer = null, asked = false;
function draw() {
  if (!renderer || asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; aim(); renderer.render(root, camera); });
}

function fit() {
  const canvas = $("view"), wide = canvas.clientWidth, high = canvas.clientHeight;
  if (!wide || !high) return;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(wide, high, false);
  camera.aspect = wide / high;
  DISC.uniforms.high.value = high * renderer.getPixelRatio();
  draw();
}

try {
  renderer = new THREE.WebGLRenderer({ canvas: $("view"), antialias: true, alpha: true });
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  new ResizeObserver(fit).observe($("view"));
} catch (error) {
  document.documentElement.classList.add("flat");  // the page then says so and hides what needs it
}
show("surface");
shown.axes.forEach(line => { line.visible = false; });
home();
// Unit directions of the screen in the world: to the right, and up.
function sides() {
  return [0, 1].map(column => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, column));
}
window.twin = { sides, data, joints, groups, at, place, show, shown, view, standAt, home, draw, calm };
