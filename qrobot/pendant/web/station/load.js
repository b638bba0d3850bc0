// What the arm carries, and what follows when it meets something: shown to all, chosen by the page that drives.
import { askOfArm } from "./ask.js";
import { el, setText } from "./dom.js";
import { digits } from "./kinematics.js";
import { link } from "./link.js";

const LOOK_MS = 2000;
const SHARES = [["1", "as its robot file says"], ["0.7", "at 70 % of that"], ["0.5", "at half of that"], ["0.3", "at 30 % of that"]];
const REACTIONS = [["stop", "stop, and hold"], ["comply", "stop, soft for 2 s, then hold"]];
const BACKS = [["0", "stay there"], ["10", "go back 10 mm"], ["20", "go back 20 mm"], ["50", "go back 50 mm"]];

export const back = { mm: 0 }; // of the arm that is taken next

function select(id, label, options) {
  return el("select", { id, "aria-label": label }, ...options.map(([value, text]) => el("option", { value }, text)));
}

function field(id, label, low, high) {
  return el("input", { id, type: "number", min: low, max: high, step: "any", value: "0", "aria-label": label });
}

export function loadCard() {
  const mass = field("load-mass", "mass, kg", "0", "1000");
  const centre = ["x", "y", "z"].map((axis) => field(`load-${axis}`, `centre of mass ${axis} from the flange, mm`, "-1000", "1000"));
  const set = el("button", { id: "load-set", onclick: () => link.say({ do: "load", arm: link.chosen, mass: Number(mass.value), centre_mm: centre.map((each) => Number(each.value)) }) }, "Set the load");
  const carries = el("span", { class: "chip", id: "load-told" }, "load ?");
  const share = select("collision-share", "a collision is told", SHARES);
  const reaction = select("collision-reaction", "after a collision", REACTIONS);
  const choose = el("button", { id: "collision-set", onclick: () => link.say({ do: "collision", arm: link.chosen, share: Number(share.value), reaction: reaction.value }) }, "Choose");
  const told = el("p", { class: "hint", id: "collision-told" });
  const goBack = select("collision-back", "a jogged arm then", BACKS);
  goBack.addEventListener("change", () => (back.mm = Number(goBack.value)));

  const show = () => {
    for (const each of [mass, ...centre, set, share, reaction, choose, goBack]) each.disabled = !link.driving;
  };
  const forget = () => {
    setText(carries, "load ?");
    setText(told, "");
  };
  const look = async () => {
    if (!link.open || carries.offsetParent === null) return;
    try {
      const now = await askOfArm("load");
      if (!now) return;
      const name = REACTIONS.find(([value]) => value === now.reaction)[1];
      setText(carries, now.mass ? `carries ${digits(now.mass, 2)} kg` : "carries nothing");
      setText(told, `Now: ${name}; a collision is told above ${now.thresholds.join(", ")} N m (N) that nobody commanded, joint by joint. A program may choose otherwise; when it ends, the robot file counts.`);
    } catch {
      forget();
    }
  };
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  link.addEventListener("chosen", () => (forget(), look()));
  setInterval(look, LOOK_MS);
  show();
  return el("div", { class: "card load" }, el("h2", {}, "Load and collisions"),
    el("div", { class: "options" }, carries, el("label", {}, "kg ", mass), el("label", {}, "centre mm ", ...centre), set),
    el("div", { class: "options" }, el("label", {}, "Told ", share), el("label", {}, "then ", reaction), choose), told,
    el("div", { class: "options" }, el("label", {}, "An arm that is taken to jog will then ", goBack)),
    el("p", { class: "hint" }, "It goes back once, slowly, the way it came, while the button is still held; then it has to be taken again."));
}
