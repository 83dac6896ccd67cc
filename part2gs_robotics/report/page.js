// What a reader moves: sliders of joints, states, what is shown, the camera, and wipes of photos.
"use strict";
const $ = name => document.getElementById(name);
const { joints, at, place, show, shown, view, standAt, home, draw, calm, data } = window.twin;
document.documentElement.classList.add("js");

// ---- joints: a slider counts thousandths of its joint's range ------------------------------------
const sliders = joints.map((joint, i) => joint ? $(`joint-${i}`) : null);
const STEPS = 1000;

function said(joint, q) {
  return joint.kind === "prismatic" ? `${(q * sizes.factor).toPrecision(3)} ${sizes.unit}`
    : `${(q * 180 / Math.PI).toFixed(1)}°`;
}
const sizes = JSON.parse($("units").textContent);

function tell(i) {
  const [low, high] = joints[i].limits, text = said(joints[i], at[i]);
  sliders[i].value = high > low ? STEPS * (at[i] - low) / (high - low) : 0;
  sliders[i].setAttribute("aria-valuetext", text);
  $(`value-${i}`).textContent = text;
}

function move(i, q) { place(i, q); tell(i); }

sliders.forEach((slider, i) => {
  if (!slider) return;
  const [low, high] = joints[i].limits;
  slider.addEventListener("input", () => {
    stop();
    place(i, low + (high - low) * slider.value / STEPS);
    const text = said(joints[i], at[i]);
    slider.setAttribute("aria-valuetext", text);
    $(`value-${i}`).textContent = text;
  });
  tell(i);
});

// ---- states: a way of a second, smooth at both ends; at once for who wants no motion ------------
let playing = 0;
function stop() { cancelAnimationFrame(playing); playing = 0; $("play").setAttribute("aria-pressed", "false"); }

function goTo(state, then) {
  const from = [...at], began = performance.now();
  const step = now => {
    const t = calm ? 1 : Math.min(1, (now - began) / 1100), share = t * t * (3 - 2 * t);
    joints.forEach((joint, i) => {
      if (joint) move(i, from[i] + share * ((state ? joint.state_1 : 0) - from[i]));
    });
    if (t < 1) playing = requestAnimationFrame(step);
    else if (then) then();
    else stop();
  };
  cancelAnimationFrame(playing);
  playing = requestAnimationFrame(step);
}

function play(state) { goTo(state, () => play(1 - state)); }

$("state-0").addEventListener("click", () => { stop(); goTo(0); });
$("state-1").addEventListener("click", () => { stop(); goTo(1); });
$("play").hidden = calm;
$("play").addEventListener("click", () => {
  if (playing) { stop(); return; }
  $("play").setAttribute("aria-pressed", "true");
  play(joints.some((joint, i) => joint && Math.abs(at[i]) > Math.abs(joint.state_1) / 2) ? 0 : 1);
});

// ---- what is shown -------------------------------------------------------------------------------
document.querySelectorAll('input[name="shown"]').forEach(choice =>
  choice.addEventListener("change", () => show(choice.value)));
$("axes").addEventListener("change", event => {
  shown.axes.forEach(line => { line.visible = event.target.checked; });
  draw();
});

// ---- camera: drag turns, two fingers or right button shift, wheel and pinch come nearer ----------
const canvas = $("view"), fingers = new Map();

function turn(dx, dy) { view.around -= dx; view.above += dy; draw(); }
function nearer(factor) { view.far *= factor; draw(); }
function shift(dx, dy) {
  const step = 2 * view.far * Math.tan(view.fov * Math.PI / 360) / canvas.clientHeight;
  const eyes = window.twin.sides();
  view.target.addScaledVector(eyes[0], -dx * step).addScaledVector(eyes[1], dy * step);
  draw();
}

canvas.addEventListener("pointerdown", event => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, event);
});
canvas.addEventListener("pointermove", event => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
  if (fingers.size === 2) {
    const still = [...fingers].find(([id]) => id !== event.pointerId)[1];
    const gap = finger => Math.hypot(finger.clientX - still.clientX, finger.clientY - still.clientY);
    nearer(Math.max(gap(before), 1) / Math.max(gap(event), 1));
    shift(dx / 2, dy / 2);
  } else if (event.buttons === 2 || event.shiftKey) shift(dx, dy);
  else turn(dx / 150, dy / 150);
  fingers.set(event.pointerId, event);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, event => fingers.delete(event.pointerId));
}
canvas.addEventListener("contextmenu", event => event.preventDefault());
canvas.addEventListener("wheel", event => {  // the page scrolls on until the picture is clicked
  if (document.activeElement !== canvas && !event.ctrlKey) return;
  event.preventDefault();
  nearer(Math.exp(event.deltaY / 600));
}, { passive: false });
const KEYS = {
  ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1),
  ArrowDown: () => turn(0, -0.1), "+": () => nearer(0.9), "=": () => nearer(0.9),
  "-": () => nearer(1.1), "0": home };
canvas.addEventListener("keydown", event => {
  if (!KEYS[event.key] || event.ctrlKey || event.metaKey) return;
  event.preventDefault();
  KEYS[event.key]();
});
$("nearer").addEventListener("click", () => nearer(0.85));
$("farther").addEventListener("click", () => nearer(1 / 0.85));
$("home").addEventListener("click", home);
document.querySelectorAll("[data-camera]").forEach(button => button.addEventListener("click", () => {
  const photo = data.cameras[button.dataset.camera];
  standAt(photo);
  stop();
  goTo(photo.state);
  if (button.dataset.far) canvas.scrollIntoView({ block: "center", behavior: calm ? "auto" : "smooth" });
}));

// ---- wipes: the render covers the photo from the slider on ----------------------------------------
document.querySelectorAll(".wipe").forEach(wipe => {
  const slider = wipe.querySelector("input");
  const set = () => {
    wipe.style.setProperty("--at", `${slider.value}%`);
    slider.setAttribute("aria-valuetext", `${slider.value} % photo, the rest render`);
  };
  slider.addEventListener("input", set);
  set();
});
