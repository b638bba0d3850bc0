// How the buttons of the tab Drive move the arm: how fast, how far, along whose axes; and why they do not.
import { el, setAttribute, setText } from "./dom.js";
import { frameOf } from "./kinematics.js";
import { link } from "./link.js";

const SHARES = [["0.1", "slowest"], ["0.25", "slow"], ["0.5", "half"], ["1", "normal"], ["2", "fast"], ["4", "fastest"]];
const STEPS = [["0", "while held"], ["0.1", "0.1 mm or °"], ["1", "1 mm or °"], ["10", "10 mm or °"]];
const FIXED = [["base", "axes of the base"], ["tool", "axes of the last link"]];
const PLACE = "at ";
const PAUSED = 64, PATH_WAITS = 1024; // of the flags

function select(id, label, options, chosen) {
  const made = el("select", { id, "aria-label": label }, ...options.map(option));
  made.value = chosen;
  return made;
}

function option([value, text]) {
  return el("option", { value }, text);
}

export class JogCard {
  // onAxes: called with the frame (Matrix4) whose axes were chosen, null for those of the base or the last link.
  constructor(onAxes) {
    this.speed = select("jog-speed", "speed of the jog", SHARES, "0.5");
    this.step = select("jog-step", "length of a jog", STEPS, "0");
    this.axes = select("jog-axes", "axes of the jog", FIXED, "base");
    this.told = el("p", { class: "hint", id: "jog-told" });
    const labels = [["Speed ", this.speed], ["Step ", this.step], ["Along ", this.axes]].map((each) => el("label", {}, ...each));
    this.element = el("div", { class: "card" }, el("div", { class: "options" }, ...labels), this.told);
    this.onAxes = onAxes;
    this.known = "";
    this.taught = {};
    this.axes.addEventListener("change", () => this.show());
    for (const name of ["status", "chosen"]) link.addEventListener(name, () => this.renew());
    setInterval(() => setText(this.told, this.reason()), 200);
  }

  get length() {
    return Number(this.step.value);
  }

  // Of a press, see held_press.py.
  get how() {
    return { share: Number(this.speed.value) };
  }

  get along() {
    return { in_base: this.axes.value === "base", frame: this.place };
  }

  // Name of the place whose axes are chosen, "" for none.
  get place() {
    return this.axes.value.startsWith(PLACE) ? this.axes.value.slice(PLACE.length) : "";
  }

  // Choose the axes of the base, of the last link, or of the next place.
  choose(key) {
    const places = [...this.axes.options].slice(FIXED.length).map((each) => each.value);
    const next = key === "n" ? places[(places.indexOf(this.axes.value) + 1) % places.length] : key === "b" ? "base" : "tool";
    if (next !== undefined) this.axes.value = next;
    this.show();
  }

  // The places that were taught may have changed; one that has gone is chosen no longer.
  renew() {
    if (!link.armStatus) return; // a short loss of the connection takes no choice away
    const { taught } = link.armStatus;
    const now = JSON.stringify([link.chosen, taught]);
    if (now === this.known) return;
    this.known = now;
    this.taught = taught;
    const chosen = this.axes.value;
    this.axes.replaceChildren(...[...FIXED, ...Object.keys(taught).map((name) => [PLACE + name, `axes of ${name}`])].map(option));
    this.axes.value = chosen;
    if (this.axes.value !== chosen) {
      link.release();
      this.axes.value = "base";
    }
    this.show();
  }

  show() {
    const numbers = this.taught[this.place];
    setAttribute(this.axes, "data-on", Boolean(numbers));
    this.onAxes(numbers ? frameOf(numbers) : null);
  }

  // What has to be done before a button moves the arm, or that it does.
  reason() {
    const state = link.arm && link.fresh(link.arm) ? link.arm.state : null, status = link.armStatus;
    if (!state || !status) return "Nothing is heard of the arm: no button moves it.";
    if (!link.driving) return status.driver ? `Page ${status.driver} drives this arm: no button here moves it.` : "To move the arm: press Drive from here, then Take the arm.";
    if (state.flags & PATH_WAITS) return "A program waits: Go back to the path, or end it.";
    if (status.session === "opening") return "The arm is being taken …";
    if (status.session === "ready" && status.guide) return "The arm is led by hand: let go of it to jog.";
    if (status.session === "ready" && state.flags & PAUSED) return "Motions are paused: press Go on.";
    if (status.session === "ready") return state.override ? "Hold − or + to move; let go to stop." : "The speed override is 0 %: no button moves the arm.";
    if (link.modeOf(state) === "FAULT") return "To move the arm: put right what is told above, then Clear fault.";
    return status.commanded ? "A program commands the arm: no button moves it." : "To move the arm: press Take the arm.";
  }
}
