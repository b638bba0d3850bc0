// The tab Drive: the arms, their joints and tool with a button each way, power, hand.
import { el, setAttribute, setText } from "./dom.js";
import { guideCard } from "./guide.js";
import { holdButton } from "./hold.js";
import { JogCard } from "./jog_card.js";
import { digits, lastFrame, place, shown, tip, unit } from "./kinematics.js";
import { link } from "./link.js";
import { back, loadCard } from "./load.js";
import { showPathsAhead } from "./path_ahead.js";
import { twoWayButton } from "./two_way.js";
import { View } from "./view3d.js";

const AXES = [["dx", "X", "mm"], ["dy", "Y", "mm"], ["dz", "Z", "mm"], ["rx", "about x", "°"], ["ry", "about y", "°"], ["rz", "about z", "°"]];
const SHOWN = [0, 1, 2, 5, 4, 3]; // of x y z roll pitch yaw (about z, y, x), in the order of AXES
const AXIS_KEYS = { x: 0, y: 1, z: 2, u: 3, v: 4, w: 5 };
const TYPING = "input, textarea, select, [contenteditable]";
const PAUSED = 64, PATH_WAITS = 1024; // of the flags
const ANSWER_MS = 1000; // [A] in which the arm shows that it goes on
const MAY_POWER = ["OFF"], MAY_CLEAR = ["FAULT"];

export function makeDrive(root) {
  const scene = el("section", { class: "scene", id: "scene" });
  const side = el("section", { class: "side" });
  root.append(scene, side);
  const view = new View(scene);
  scene.append(el("p", { class: "legend" }, "solid: measured · orange mesh: setpoint · green line: way of the tool · dots: path ahead, found off line · glass: keep out · cage: stay in"));
  link.view = view;
  showPathsAhead(view);
  view.onChoose = (k) => link.choose(k);

  const jog = new JogCard((T) => link.arms.forEach((_, k) => view.showAxes(k, k === link.chosen ? T : null)));
  const joints = el("div", { class: "rows" });
  const tool = el("div", { class: "rows axes" });
  side.append(
    powerCard(),
    speedCard(),
    jog.element,
    el("div", { class: "card" }, el("h2", {}, "Joints"), joints),
    el("div", { class: "card" }, el("h2", {}, "Last link, in the base"), tool),
    guideCard(),
    loadCard(),
    el("p", { class: "hint" }, "Keys as in qrobot jog: 1 2 … choose a joint, x y z u v w an axis, b t n axes of base, last link, next place; hold . or , to move. Esc or Space stops."),
  );

  let rows = [], cells = [], picked = 0;
  const askJoint = (j, way) => {
    const inUnits = link.arm.facts.prismatic[j] ? jog.length / 1000 : (jog.length * Math.PI) / 180;
    return { target: "joint", name: String(j + 1), way, step: inUnits, ...jog.how };
  };
  const askAxis = (a, way) => ({ target: "axis", name: AXES[a][0], way, step: jog.length, ...jog.along, ...jog.how });
  const askPicked = (way) => (picked < rows.length ? askJoint(picked, way) : askAxis(picked - rows.length, way));
  const pick = (k) => {
    picked = k;
    [...rows, ...cells].forEach((row, at) => setAttribute(row.row, "data-picked", at === k));
  };

  const build = () => {
    view.choose(link.chosen);
    const facts = link.arm.facts;
    rows = facts.joints.map((name, j) => jointRow(facts, name, j, askJoint));
    cells = AXES.map(([, title, axisUnit], a) => axisRow(title, axisUnit, a, askAxis));
    joints.replaceChildren(...rows.map((row) => row.row));
    tool.replaceChildren(...cells.map((row) => row.row));
    pick(0);
  };

  setInterval(() => link.arms.forEach((arm, k) => view.fade(k, link.arms.length > 1 && !link.fresh(arm))), 200);

  let due = false;
  link.addEventListener("hello", () => {
    view.setArms(link.arms.map((arm) => arm.facts));
    build();
  });
  link.addEventListener("chosen", build);
  link.addEventListener("sample", () => {
    link.arms.forEach((arm, k) => {
      if (arm.state && arm.drawn !== arm.state) view.show(k, (arm.drawn = arm.state));
    });
    if (due || root.hidden) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      const state = link.arm?.state;
      if (!state || !rows.length) return;
      rows.forEach((row) => row.show(state));
      const pose = place(lastFrame(link.arm.facts, state.q));
      cells.forEach((cell, a) => cell.show(pose[SHOWN[a]]));
    });
  });

  window.addEventListener("keydown", (event) => {
    if (root.hidden || event.repeat || event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.(TYPING)) return;
    if (event.key === "." || event.key === ",") {
      const { target, name, ...extra } = askPicked(event.key === "." ? 1 : -1);
      link.hold(target, name, extra);
    } else if (event.key in AXIS_KEYS) pick(rows.length + AXIS_KEYS[event.key]);
    else if ("btn".includes(event.key)) jog.choose(event.key);
    else if (Number(event.key) >= 1 && Number(event.key) <= rows.length) pick(Number(event.key) - 1);
  });
  link.tipOnScreen = (k = 0) => view.project(k, tip(link.arms[k].facts, link.arms[k].state.q).toArray());
}

function jointRow(facts, name, j, ask) {
  const fill = el("span", { class: "needle" });
  const ghost = el("span", { class: "needle ghost" });
  const number = el("output", { class: "number" });
  const low = shown(facts, j, facts.q_min[j]), high = shown(facts, j, facts.q_max[j]);
  const bar = el("div", { class: "track", role: "meter", "aria-label": `joint ${j + 1} ${name}`, "aria-valuemin": low.toFixed(0), "aria-valuemax": high.toFixed(0) }, ghost, fill);
  const warn = el("span", { class: "warn" });
  const row = el(
    "div", { class: "row" },
    holdButton("−", `joint ${j + 1} ${name} backwards`, () => ask(j, -1)),
    el("div", { class: "middle" }, el("div", { class: "names" }, el("span", {}, `${j + 1} ${name.replaceAll("_", " ")}`), warn, number), el("div", { class: "ends" }, el("i", {}, low.toFixed(0)), bar, el("i", {}, high.toFixed(0)))),
    holdButton("+", `joint ${j + 1} ${name} forwards`, () => ask(j, 1)),
  );
  const share = (value) => Math.min(Math.max((value - facts.q_min[j]) / (facts.q_max[j] - facts.q_min[j]), 0), 1);
  const show = (state) => {
    const at = share(state.q[j]);
    fill.style.left = `${100 * at}%`;
    ghost.style.left = `${100 * share(state.setpoint[j])}%`;
    setText(number, `${digits(shown(facts, j, state.q[j]), facts.prismatic[j] ? 1 : 2)} ${unit(facts, j)}`);
    setAttribute(bar, "aria-valuenow", shown(facts, j, state.q[j]).toFixed(0));
    setText(warn, at < 0.03 || at > 0.97 ? "⚠ near its end" : "");
  };
  return { row, show };
}

function axisRow(title, axisUnit, a, ask) {
  const number = el("output", { class: "number" });
  const row = el(
    "div", { class: "row" },
    holdButton("−", `${title} backwards`, () => ask(a, -1)),
    el("div", { class: "middle names" }, el("span", {}, title), number),
    holdButton("+", `${title} forwards`, () => ask(a, 1)),
  );
  return { row, show: (value) => setText(number, `${digits(value, 1)} ${axisUnit}`) };
}

// Motions of any program: their speed override, and standing still on the path.
export function speedCard(prefix = "") {
  const slider = el("input", { type: "range", id: `${prefix}override`, min: "0", max: "100", step: "5", value: "100", "aria-label": "speed override, percent" });
  const told = el("output", { class: "number", id: `${prefix}override-told` });
  const { button: pause, show: showPause } = twoWayButton({ id: `${prefix}pause` }, (more) => press(more));
  const flag = (bit) => Boolean((link.arm?.state?.flags ?? 0) & bit);
  const paused = () => flag(PAUSED), waits = () => flag(PATH_WAITS);
  let asked = -Infinity, resumed = -Infinity;
  const press = (more) => {
    if (more) resumed = performance.now();
    link.act(more ? "resume" : "pause");
    show();
  };
  slider.addEventListener("input", () => (asked = performance.now()));
  slider.addEventListener("change", () => {
    asked = performance.now();
    link.order({ do: "override", arm: link.chosen, factor: Number(slider.value) / 100 });
  });
  const show = () => {
    const state = link.arm && link.fresh(link.arm) ? link.arm.state : null;
    slider.disabled = !link.driving || !state;
    const more = Boolean(state) && (paused() || waits()); // of an arm that is not heard of every page may ask for a pause
    const answered = performance.now() - resumed > ANSWER_MS;
    showPause(more, link.open && (!more || (answered && link.driving)));
    setText(pause, !more ? "‖ Pause motions" : waits() ? "▶ Go back to the path" : "▶ Go on");
    setAttribute(pause, "data-on", more);
    setText(told, state ? `${Math.round(100 * state.override)} %` : "?");
    const moved = performance.now() - asked <= 1000 || slider.matches(":active"); // also by a finger that rests on it
    if (state && !moved) slider.value = String(Math.round(100 * state.override));
  };
  setInterval(show, 100);
  return el("div", { class: "card buttons" }, el("label", { class: "override" }, "Speed override", slider), told, pause);
}

function powerCard() {
  const on = el("button", { id: "power-on", onclick: () => link.act("power on") }, "⚡ Power on");
  const off = el("button", { id: "power-off", onclick: () => link.act("power off") }, "Power off");
  const clear = el("button", { id: "clear", onclick: () => link.act("clear") }, "Clear fault");
  const { button: take, show: showTake } = twoWayButton({ id: "take" }, (on) => link.order({ do: "command", arm: link.chosen, on, back_mm: back.mm }));
  const open = el("button", { "aria-label": "open hand", onclick: () => link.order({ do: "hand", arm: link.chosen, opened: true }) }, "Open");
  const close = el("button", { "aria-label": "close hand", onclick: () => link.order({ do: "hand", arm: link.chosen, opened: false }) }, "Close");
  const hand = el("span", { class: "chip" });
  const show = () => {
    const state = link.arm && link.fresh(link.arm) ? link.arm.state : null;
    const mode = state ? link.modeOf(state) : "";
    const session = link.armStatus?.session ?? "no";
    on.disabled = !link.driving || session !== "no" || !MAY_POWER.includes(mode);
    off.disabled = !link.open; // also while nothing is heard of the arm, and while it is about to be powered
    clear.disabled = !link.driving || !MAY_CLEAR.includes(mode);
    const free = session === "no";
    const others = free && Boolean(link.armStatus?.commanded); // a program has it
    const led = link.armStatus?.guide && !free; // see guide.js
    showTake(free, link.driving && state && !others && !led && (!free || mode === "HOLDING" || mode === "OFF"));
    setText(take, led ? "led by hand" : others ? "a program has it" : { no: "Take the arm", opening: "taking …", ready: "Let go of the arm" }[session]);
    setAttribute(take, "data-on", link.ready);
    open.disabled = close.disabled = !link.ready;
    setText(hand, state ? `hand ${["relaxed", "open", "closed"][state.hand] ?? "?"}` : "hand ?");
  };
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  setInterval(show, 100);
  show();
  return el("div", { class: "card buttons" }, on, off, clear, take, hand, open, close);
}
