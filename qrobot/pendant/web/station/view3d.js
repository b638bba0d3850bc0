// The arms in three dimensions: as measured, their setpoints as ghosts, the way their tools have come, and the path ahead.
import { THREE, OrbitControls } from "nicegui-scene";
import { el, setText } from "./dom.js";
import { FenceFigures } from "./fences.js";
import { linkFrame, tip } from "./kinematics.js";
import { PathAhead } from "./path_ahead.js";

const TRAIL = 1100; // samples, half a minute
const LINK = 0xd9d4c7, JOINT = 0x3a5f94, GHOST = 0xe08a1e, TRACE = 0x2a9d8f, TOOL = 0xc0392b, CHOSEN = 0xf0a500, OLD = 0x9aa6b2;
const TAP_PX = 6;
const SLOW_MS = 40, REST = 2, MOST_REST_MS = 400; // after a picture that took longer than SLOW_MS, rest REST times as long
const SEEN = 2e-4; // rad or m of a joint; what moves less is not drawn anew
const SEPARATION = 1.6; // m between arms that are drawn side by side

class ArmFigure {
  // base: its base frame in the picture, whose floor is at z = 0.
  constructor(facts, base) {
    this.facts = facts;
    this.root = new THREE.Group();
    base.decompose(this.root.position, this.root.quaternion, this.root.scale);
    this.solid = this.build((part) => new THREE.MeshStandardMaterial({ color: part.joint ? JOINT : LINK, roughness: 0.6 }));
    this.ghost = this.build(() => new THREE.MeshBasicMaterial({ color: GHOST, wireframe: true, transparent: true, opacity: 0.18 }));
    this.solid[facts.joints.length].add(marker(facts));
    this.fences = facts.fences ? new FenceFigures(facts, this.root, this.solid) : null; // an old log knows none
    this.points = new Float32Array(3 * TRAIL);
    this.count = 0;
    this.trail = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: TRACE }));
    this.trail.geometry.setAttribute("position", new THREE.BufferAttribute(this.points, 3));
    this.trail.frustumCulled = false;
    this.ahead = new PathAhead(facts);
    this.root.add(this.trail, this.ahead.dots);
    this.label = label(facts.name);
    this.label.position.set(0, 0, 0.06 - facts.base_height);
    this.ring = ring();
    this.ring.position.z = 0.004 - facts.base_height;
    this.named = namedAxes();
    this.root.add(this.label, this.ring, this.named);
    this.choose(false, false);
    for (const frames of [this.solid, this.ghost]) frames[0].visible = false; // until it was heard where it is
    this.old = false;
  }

  // Take it out of the picture, and give back what it takes of the graphics processor, which nobody else does.
  leave() {
    this.root.removeFromParent();
    this.root.traverse(({ geometry, material }) => {
      geometry?.dispose();
      material?.map?.dispose();
      material?.dispose();
    });
  }

  // Draw it faintly, without colour: what is shown is old.
  fade(old) {
    if (old === this.old) return false;
    this.old = old;
    this.solid[0].traverse(({ material }) => {
      if (!material?.isMeshStandardMaterial) return;
      material.userData.colour ??= material.color.getHex();
      material.color.setHex(old ? OLD : material.userData.colour);
      material.transparent = old;
      material.opacity = old ? 0.35 : 1;
      material.needsUpdate = true;
    });
    return true;
  }

  // With several arms each has its name, and the one that the page is about a ring on the floor.
  choose(chosen, named) {
    this.label.visible = named;
    this.ring.visible = named && chosen;
  }

  build(material) {
    const frames = [new THREE.Group()];
    this.root.add(frames[0]);
    for (let j = 0; j < this.facts.joints.length; j++) {
      const frame = new THREE.Group();
      frame.matrixAutoUpdate = false;
      frames[j].add(frame);
      frames.push(frame);
    }
    for (const part of this.facts.shape) frames[part.frame].add(cylinder(part, material(part)));
    return frames;
  }

  pose(frames, q) {
    for (let j = 0; j < q.length; j++) linkFrame(this.facts, j, q[j], frames[j + 1].matrix);
  }

  // Whether it would look the same.
  looksLike(state) {
    return this.drawn !== undefined && ["q", "setpoint"].every((name) => state[name].every((value, j) => Math.abs(value - this.drawn[name][j]) < SEEN));
  }

  reveal() {
    for (const frames of [this.solid, this.ghost]) frames[0].visible = true;
  }

  show(state, follow = true) {
    this.reveal();
    this.pose(this.solid, state.q);
    this.pose(this.ghost, state.setpoint);
    this.q = state.q;
    this.drawn = state;
    if (follow) this.extend(tip(this.facts, state.q));
  }

  extend(point) {
    if (this.count === TRAIL) {
      this.points.copyWithin(0, 3);
      this.count -= 1;
    }
    point.toArray(this.points, 3 * this.count);
    this.count += 1;
    this.trail.geometry.attributes.position.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, this.count);
  }

  clearTrail() {
    this.count = 0;
    this.trail.geometry.setDrawRange(0, 0);
  }
}

function cylinder(part, material) {
  const mesh = new THREE.Mesh(new THREE.CylinderGeometry(part.radius, part.radius, part.length, 28), material);
  mesh.rotation.x = Math.PI / 2; // three.js has the axis along y, we along z
  const holder = new THREE.Group();
  holder.matrixAutoUpdate = false;
  holder.matrix.set(...part.T);
  holder.add(mesh);
  return holder;
}

// The tip of the tool: a ball, and the axes of its frame.
function marker(facts) {
  const group = new THREE.Group();
  group.position.set(...facts.tip);
  group.add(new THREE.Mesh(new THREE.SphereGeometry(0.022, 16, 12), new THREE.MeshBasicMaterial({ color: TOOL })));
  group.add(new THREE.AxesHelper(0.14));
  return group;
}

// The axes of a place along which the buttons move the arm.
function namedAxes() {
  const group = new THREE.Group();
  group.matrixAutoUpdate = false;
  group.visible = false;
  group.add(new THREE.AxesHelper(0.25), new THREE.Mesh(new THREE.SphereGeometry(0.012, 12, 8), new THREE.MeshBasicMaterial({ color: CHOSEN })));
  return group;
}

// The name of an arm, in front of its base.
function label(text) {
  const canvas = el("canvas", { width: "512", height: "96" });
  const pen = canvas.getContext("2d");
  pen.font = "bold 56px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillStyle = "#17212c";
  pen.fillText(text, 256, 66, 500);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
  sprite.scale.set(0.64, 0.12, 1);
  return sprite;
}

// Base frames of arms: as they stand in their hall when the deployment tells it of all, side by side else.
function bases(all) {
  if (!all.every((facts) => facts.stand)) return all.map((facts, k) => new THREE.Matrix4().setPosition(SEPARATION * (k - (all.length - 1) / 2), 0, facts.base_height));
  const stands = all.map((facts) => new THREE.Matrix4().set(...facts.stand));
  const lift = Math.max(...all.map((facts, k) => facts.base_height - stands[k].elements[14])); // the lowest floor
  return stands.map((T) => new THREE.Matrix4().makeTranslation(0, 0, lift).multiply(T));
}

function ring() {
  return new THREE.Mesh(new THREE.RingGeometry(0.3, 0.34, 48), new THREE.MeshBasicMaterial({ color: CHOSEN, side: THREE.DoubleSide }));
}

function scenery(scene) {
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 2.2));
  const sun = new THREE.DirectionalLight(0xffffff, 1.6);
  sun.position.set(2, -3, 4);
  scene.add(sun);
  const grid = new THREE.GridHelper(6, 24, 0x8fa3b8, 0xc3cdd8);
  grid.rotation.x = Math.PI / 2;
  scene.add(grid);
  const axes = new THREE.AxesHelper(0.4);
  axes.position.z = 0.002;
  scene.add(axes);
}

// Whether this machine has no graphics processor: then smooth edges, four samples of each pixel, take most of the time of a picture.
function drawnBySoftware() {
  const gl = el("canvas").getContext("webgl2");
  const named = gl?.getExtension("WEBGL_debug_renderer_info");
  const software = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(named ? gl.getParameter(named.UNMASKED_RENDERER_WEBGL) : "");
  gl?.getExtension("WEBGL_lose_context")?.loseContext(); // a browser has room for few
  return software;
}

export class View {
  constructor(element) {
    this.element = element;
    this.canvas = el("canvas", { "aria-label": "the arms in three dimensions; drag to turn, pinch or wheel to come nearer", tabindex: "-1" });
    this.nearest = el("p", { class: "legend nearest", role: "status" });
    element.append(this.canvas, this.nearest);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: !drawnBySoftware(), preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0xeef2f6);
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.05, 40);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => (this.due = true));
    this.controls.addEventListener("start", () => (this.turned = true));
    this.figures = [];
    this.onChoose = () => {};
    this.listen();
    this.due = true;
    this.begun = null; // when a picture was drawn last, until the browser asks for the next one
    this.next = 0;
    scenery(this.scene);
    new ResizeObserver(() => this.resize()).observe(element);
    const draw = (now) => {
      requestAnimationFrame(draw);
      this.pace(now);
      if (this.due && now >= this.next && element.offsetParent !== null) {
        this.draw();
        this.begun = now;
      }
    };
    draw(performance.now());
  }

  // After a picture that took long, as without a graphics processor, rest: what a held button has to say must not wait for pictures.
  pace(now) {
    if (this.begun === null) return;
    const took = now - this.begun;
    this.begun = null;
    this.next = took > SLOW_MS ? now + Math.min(REST * took, MOST_REST_MS) : now;
  }

  setArms(all) {
    for (const figure of this.figures) figure.leave();
    const frames = bases(all);
    this.figures = all.map((facts, k) => new ArmFigure(facts, frames[k]));
    for (const figure of this.figures) this.scene.add(figure.root);
    this.turned = false;
    this.stand();
  }

  // Put the camera where all arms are seen, farther away from a narrow picture; not once somebody has turned it.
  stand() {
    const count = this.figures.length;
    if (!count || this.turned) return;
    const places = this.figures.map(({ root }) => root.position);
    const middle = new THREE.Box3().setFromPoints(places).getCenter(new THREE.Vector3());
    const spread = Math.max(...places.map((place) => place.distanceTo(middle)));
    const height = Math.max(...places.map((place) => place.z));
    const back = Math.max(1, (count > 1 ? 1.3 : 0.9) / this.camera.aspect);
    this.controls.target.set(middle.x + 0.2, middle.y, height - 0.05);
    this.camera.position.set(1.5 * back, -2.2 - 1.125 * spread, 0.8).multiply({ x: 1, y: back, z: back }).add(this.controls.target);
    this.controls.update();
    this.due = true;
  }

  show(k, state, follow = true) {
    if (!this.figures[k] || this.figures[k].looksLike(state)) return;
    this.figures[k].show(state, follow);
    this.due = true;
  }

  // Show the axes of a frame in the base of an arm, null for none.
  showAxes(k, T) {
    const axes = this.figures[k]?.named;
    if (!axes) return;
    axes.visible = T !== null;
    if (T) axes.matrix.copy(T);
    axes.matrixWorldNeedsUpdate = true;
    this.due = true;
  }

  fade(k, old) {
    if (this.figures[k]?.fade(old)) this.due = true;
  }

  choose(chosen) {
    this.figures.forEach((figure, k) => figure.choose(k === chosen, this.figures.length > 1));
    this.due = true;
  }

  // A tap on an arm chooses it; a pointer that was drawn along turns the picture.
  listen() {
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.offsetX, event.offsetY]));
    this.canvas.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) < TAP_PX) this.tap(event.offsetX, event.offsetY);
      down = null;
    });
  }

  tap(x, y) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ray = new THREE.Raycaster();
    ray.params.Line.threshold = 0.01; // m
    ray.setFromCamera(new THREE.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.camera);
    const solids = this.figures.map((figure) => figure.solid[0]);
    const hit = ray.intersectObjects(solids, true)[0]?.object;
    const k = solids.findIndex((solid) => { let found = false; solid.traverse((each) => (found ||= each === hit)); return found; });
    if (hit && k >= 0) this.onChoose(k);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.stand();
    this.due = true;
  }

  draw() {
    this.due = false;
    this.tellFences();
    this.renderer.render(this.scene, this.camera);
  }

  tellFences() {
    for (const figure of this.figures) if (figure.q) figure.fences?.show(figure.q);
    const lines = this.figures.filter((figure) => figure.fences?.told).map((figure) => {
      const whose = this.figures.length > 1 ? `${figure.facts.name}: ` : "";
      return whose + figure.fences.told;
    });
    setText(this.nearest, lines.join(" · "));
    this.nearest.hidden = !lines.length;
  }

  // Where a point of an arm's base frame is on the canvas, as shares of its width and height from the top left.
  project(k, point) {
    this.scene.updateMatrixWorld(true);
    this.camera.updateMatrixWorld(true);
    const at = new THREE.Vector3(...point).applyMatrix4(this.figures[k].root.matrixWorld).project(this.camera);
    return [(at.x + 1) / 2, (1 - at.y) / 2];
  }
}
