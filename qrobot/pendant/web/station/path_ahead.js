// The path that a program's tool goes, as a run that moved no arm has found it: the part ahead of the arm, as dots.
import { THREE } from "nicegui-scene";
import { ask } from "./ask.js";
import { tip } from "./kinematics.js";
import { link } from "./link.js";
import { readSetpoints } from "./setpoints.js";

const COLOUR = 0xb35c00, DOT_PX = 5, SPACING = 0.02; // m between dots
const STEP = 2e-3; // rad or m: setpoints closer together than this are one point of the path
const NEAR = 0.1; // rad or m of a joint: farther off, the arm is not on its path

export class PathAhead {
  constructor(facts) {
    this.facts = facts;
    this.dots = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ color: COLOUR, size: DOT_PX, sizeAttenuation: false }));
    this.dots.frustumCulled = false;
    this.forget();
  }

  forget() {
    this.q = [];
    this.at = 0;
    this.places = []; // of each dot: its point of the path
    this.dots.visible = false;
  }

  // How many points of it are ahead.
  get points() {
    return this.dots.visible ? this.q.length - this.at : 0;
  }

  load({ samples, joints, sample }) {
    this.forget();
    if (joints !== this.facts.joints.length) return;
    for (let k = 0; k < samples; k++) if (!this.q.length || distance(sample(k), this.q.at(-1)) > STEP || k === samples - 1) this.q.push(sample(k));
    const points = [];
    let gone = SPACING, before = null;
    this.q.forEach((q, k) => {
      const point = tip(this.facts, q);
      gone += before ? point.distanceTo(before) : 0;
      before = point;
      if (gone < SPACING) return;
      gone = 0;
      points.push(point);
      this.places.push(k);
    });
    this.dots.geometry.dispose();
    this.dots.geometry = new THREE.BufferGeometry().setFromPoints(points);
    this.dots.visible = this.q.length > 1;
  }

  // Look for the setpoint on the path, never back: the first point near it, and on while the next one is nearer. So a
  // path that returns is not cut short. What lies behind the setpoint is drawn no longer.
  follow(setpoint) {
    let found = this.at;
    while (found < this.q.length && distance(setpoint, this.q[found]) > NEAR) found += 1;
    while (found + 1 < this.q.length && distance(setpoint, this.q[found + 1]) <= distance(setpoint, this.q[found])) found += 1;
    if (found === this.at || found === this.q.length) return false;
    this.at = found;
    const behind = this.places.findIndex((place) => place > this.at);
    this.dots.geometry.setDrawRange(behind < 0 ? this.places.length : behind, Infinity);
    return true;
  }
}

function distance(one, other) {
  let most = 0;
  for (let j = 0; j < one.length; j++) most = Math.max(most, Math.abs(one[j] - other[j]));
  return most;
}

// Keep the paths of a view's arms: loaded when a run has found one, followed while its program moves the arm.
export function showPathsAhead(view) {
  const shown = []; // per arm: {path, run} as the status told them
  const renew = () => {
    (link.status?.arms ?? []).forEach(async ({ program }, k) => {
      const figure = view.figures[k], path = program?.path ?? 0, run = program?.run ?? 0;
      if (!figure || (shown[k]?.figure === figure && shown[k].path === path && shown[k].run === run)) return;
      const mine = (shown[k] = { figure, path, run, moves: program.manner === "live" });
      figure.ahead.forget();
      view.due = true;
      if (!path) return;
      const found = await ask("programs/path", { arm: k }).then((got) => got.arrayBuffer(), () => null);
      if (!found || shown[k] !== mine) return;
      figure.ahead.load(readSetpoints(found));
      view.due = true;
    });
  };
  link.addEventListener("status", renew); // follows each hello
  link.addEventListener("sample", () => {
    shown.forEach(({ figure, moves }, k) => {
      const state = link.arms[k]?.state;
      if (moves && state && figure.ahead.follow(state.setpoint)) view.due = true;
    });
  });
}
