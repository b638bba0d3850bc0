// What the picture of the scope waits for.
import { el, setAttribute, setText } from "./dom.js";
import { shown } from "./kinematics.js";
import { QUANTITIES } from "./scope_pictures.js";

const NONE = "";
const TITLES = { error: "tracking error", event: "any fault, or another mode" };
const SHARES = [["0.1", "early"], ["0.5", "in the middle"], ["0.9", "late"]];

function select(id, label, options) {
  return el("select", { id, "aria-label": label }, ...options.map(([value, text]) => el("option", { value }, text)));
}

export class Trigger {
  constructor(changed) {
    this.armed = null; // {after}: number of the cycle from which on it counts, null while that is asked for
    this.quantity = select("trigger", "trigger", [[NONE, "no trigger"], ["event", TITLES.event], ...QUANTITIES.map((name) => [name, TITLES[name] ?? name])]);
    this.joint = select("trigger-joint", "joint of the trigger", []);
    this.edge = select("trigger-edge", "edge", [["true", "rises to"], ["false", "falls to"]]);
    this.level = el("input", { id: "trigger-level", type: "number", step: "any", value: "0", "aria-label": "level of the trigger" });
    this.unit = el("span", {});
    this.place = select("trigger-place", "place of the trigger in the picture", SHARES);
    this.again = el("input", { type: "checkbox", id: "trigger-again" });
    this.arm = el("button", { id: "trigger-arm", onclick: () => changed(this.armed ? "disarm" : "arm") });
    this.told = el("span", { class: "chip", id: "trigger-told" });
    this.level.addEventListener("change", () => changed("disarm"));
    for (const each of [this.quantity, this.joint, this.edge, this.place]) each.addEventListener("change", () => changed("disarm"));
    this.fields = [this.joint, this.edge, this.level, this.unit];
    this.element = el("fieldset", { id: "trigger-fields" }, el("legend", {}, "Trigger"), this.quantity, ...this.fields, this.place, el("label", {}, this.again, " again and again"), this.arm, this.told);
    this.show("");
  }

  setArm(facts) {
    this.facts = facts;
    this.joint.replaceChildren(...facts.joints.map((name, j) => el("option", { value: j }, `${j + 1} ${name.replaceAll("_", " ")}`)));
    this.show("");
  }

  get wanted() {
    return this.quantity.value !== NONE;
  }

  get before() {
    return Number(this.place.value);
  }

  // Parameters of the question, SI units.
  get question() {
    const joint = Number(this.joint.value), torque = this.quantity.value === "torque";
    const level = Number(this.level.value) / (torque ? 1 : shown(this.facts, joint, 1));
    return { trigger: this.quantity.value, joint, rising: this.edge.value, level: String(level), after: this.armed.after, before: this.before };
  }

  show(told) {
    const quantity = this.quantity.value;
    for (const each of this.fields) each.hidden = !QUANTITIES.includes(quantity);
    for (const each of [this.place, this.again.parentElement, this.arm]) each && (each.hidden = !this.wanted);
    const slides = this.facts?.prismatic[Number(this.joint.value)];
    const length = slides ? "mm" : "°";
    setText(this.unit, quantity === "torque" ? (slides ? "N" : "N m") : quantity === "velocity" ? `${length}/s` : length);
    setText(this.arm, this.armed ? "Wait no longer" : "Wait for it");
    setAttribute(this.arm, "data-on", Boolean(this.armed));
    this.told.hidden = !told;
    setText(this.told, told);
    setAttribute(this.told, "data-level", this.armed ? "live" : "off");
  }
}
