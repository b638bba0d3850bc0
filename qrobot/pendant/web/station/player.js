// Setpoints of a program, played in a view of their own: the ghost runs, and the arm stands where it is.
import { el, setText } from "./dom.js";
import { tip } from "./kinematics.js";
import { link } from "./link.js";
import { readSetpoints } from "./setpoints.js";
import { View } from "./view3d.js";

const WAY = 1000; // points of the line that the tool goes
const OPACITY = 0.35;

export class Player {
  constructor(root) {
    this.scene = el("section", { class: "scene small" });
    this.at = el("input", { type: "range", min: "0", max: "0", value: "0", "aria-label": "time of the ghost", id: "ghost-time", disabled: true });
    this.told = el("output", { class: "number", id: "ghost-told" }, "no setpoints yet");
    this.button = el("button", { id: "ghost-play", disabled: true, onclick: () => this.play(!this.playing) }, "▶ Play");
    root.append(this.scene, el("div", { class: "player" }, this.button, this.at, this.told));
    this.at.addEventListener("input", () => (this.play(false), this.seek(Number(this.at.value) * this.period)));
    this.samples = 0;
    this.playing = false;
    this.facts = null;
    new ResizeObserver(() => this.scene.clientWidth && this.show()).observe(this.scene);
    link.addEventListener("sample", () => this.scene.offsetParent !== null && this.show());
  }

  // The arm that the page is about; without setpoints the ghost is its own setpoint.
  show() {
    const arm = link.arm;
    if (!arm) return;
    this.view ??= new View(this.scene);
    if (this.facts !== arm.facts) {
      this.facts = arm.facts;
      this.view.setArms([arm.facts]);
      this.view.figures[0].root.traverse((part) => part.material?.wireframe && (part.material.opacity = OPACITY));
      this.drawWay();
    }
    const figure = this.view.figures[0];
    if (arm.state) figure.reveal();
    if (arm.state) figure.pose(figure.solid, arm.state.q);
    if (!this.samples && arm.state) figure.pose(figure.ghost, arm.state.setpoint);
    this.view.due = true;
  }

  load(buffer) {
    Object.assign(this, readSetpoints(buffer));
    this.at.max = String(Math.max(this.samples - 1, 0));
    this.at.disabled = this.button.disabled = !this.samples;
    this.show();
    this.drawWay();
    this.seek(0);
    if (!this.samples) setText(this.told, "no setpoints");
  }

  clear() {
    this.play(false);
    if (this.view) this.load(new ArrayBuffer(0));
  }

  drawWay() {
    if (!this.view || !this.facts) return;
    const figure = this.view.figures[0];
    figure.clearTrail();
    if (this.joints !== this.facts.joints.length) return;
    const stride = Math.max(Math.ceil(this.samples / WAY), 1);
    for (let k = 0; k < this.samples; k += stride) figure.extend(tip(this.facts, this.sample(k)));
  }

  seek(t) {
    if (!this.samples || !this.view || this.joints !== this.facts.joints.length) return;
    const k = Math.min(Math.max(Math.round(t / this.period), 0), this.samples - 1);
    const figure = this.view.figures[0];
    figure.ghost[0].visible = true; // also while nothing is heard of the arm
    figure.pose(figure.ghost, this.sample(k));
    this.at.value = String(k);
    setText(this.told, `${(k * this.period).toFixed(1)} of ${((this.samples - 1) * this.period).toFixed(1)} s`);
    this.view.due = true;
  }

  play(on) {
    this.playing = on && this.samples > 0;
    setText(this.button, this.playing ? "‖ Halt" : "▶ Play");
    if (!this.playing) return;
    const end = (this.samples - 1) * this.period;
    const first = Number(this.at.value) >= this.samples - 1 ? 0 : Number(this.at.value) * this.period;
    const began = performance.now();
    const step = () => {
      if (!this.playing) return;
      const t = first + (performance.now() - began) / 1000;
      this.seek(t);
      if (t >= end) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}
