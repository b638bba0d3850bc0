// What is always in reach: STOP, who drives, how the arm is, and what is wrong with it.
import { el, setAttribute, setText } from "./dom.js";
import { link } from "./link.js";
import { twoWayButton } from "./two_way.js";

const POWERED = 1, CALIBRATED = 2, ESTOP_OK = 4, PATH_WAITS = 1024; // of the flags
const TYPING = "input:not([type=checkbox]):not([type=range]):not([type=number]), textarea, [contenteditable]";

// In a field with something in it a blank is one; an empty field may have kept the focus of what was sent.
const takesBlank = (field) => field.matches?.(TYPING) && (field.value ?? field.textContent) !== "";

function watchKeys() {
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape" && event.key !== " ") return;
      if (event.key === " " && takesBlank(event.target)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (!event.repeat) link.stop();
    },
    { capture: true },
  );
}

export function makeBar(root) {
  watchKeys();
  const arms = el("div", { class: "arms", role: "group", "aria-label": "arm", hidden: true });
  const mode = el("span", { class: "chip", id: "mode" });
  const power = el("span", { class: "chip", id: "power" });
  const data = el("span", { class: "chip", id: "data" });
  const { button: drive, show: showDrive } = twoWayButton({ id: "drive" }, (more) => link.drive(more));
  const keep = el("button", { id: "keep", hidden: true, onclick: () => link.keep() }, "Keep driving");
  const stop = el("button", { class: "stop", id: "stop", "aria-keyshortcuts": "Escape Space" }, "STOP", el("small", {}, "Esc · Space"));
  stop.addEventListener("pointerdown", () => link.stop());
  stop.addEventListener("click", (event) => event.detail === 0 && link.stop()); // by the keyboard
  const fault = el("div", { class: "fault", role: "alert", id: "fault", hidden: true });
  const said = el("span", {});
  const notice = el("div", { class: "notice", role: "status", id: "notice", hidden: true }, said, el("button", { class: "dismiss", "aria-label": "take this line away", onclick: () => tell("") }, "×"));
  const brand = el("strong", { class: "brand" }, "QRobot");
  const own = el("span", { class: "own" });
  const who = el("span", {});
  const driver = el("span", { class: "chip", id: "driver" }, who, own);
  root.append(
    el("header", { class: "bar" }, brand, arms, mode, power, data, el("span", { class: "gap" }), driver, drive, keep, stop),
    fault, notice,
  );

  new ResizeObserver(() => document.documentElement.style.setProperty("--bar", `${root.offsetHeight}px`)).observe(root);

  let seen = [], heard = 0, buttons = []; // notices of each arm, and those for this page alone
  let unsure = [], looked = []; // of each arm {unsure, unsures} as told last, and how many of them somebody has taken away here
  const tell = (text) => {
    notice.hidden = !text;
    setText(said, `ℹ ${text}`);
  };
  const show = () => {
    const arm = link.arm, status = link.armStatus;
    const others = !link.open ? "—" : link.driving ? "✔ you drive" : status?.driver ? `page ${status.driver} drives` : "nobody drives";
    setText(who, link.open ? others : "no pendant");
    setText(own, link.open ? ` · you are page ${link.page}` : "");
    const asks = status?.asker ?? 0, asked = asks === link.page;
    setText(drive, link.driving ? (asks ? `Give up to page ${asks}` : "Give up driving") : asked ? "asked …" : status?.driver ? `Ask page ${status.driver}` : "Drive from here");
    showDrive(!link.driving, link.open && (link.driving || !asks));
    keep.hidden = !(link.driving && asks);
    setAttribute(drive, "data-on", link.driving);
    if (link.status) unsure = link.status.arms; // the pendant may be lost meanwhile
    showArm(arm, status);
    showArms();
    link.status?.arms.forEach(({ notices, notice }, k) => {
      if (seen[k] !== undefined && notices !== seen[k]) tell(link.arms.length > 1 ? `${link.arms[k].facts.name}: ${notice}` : notice);
      seen[k] = notices;
    });
    if (link.status && link.status.notices !== heard) {
      if (link.status.notices) tell(link.status.notice);
      heard = link.status.notices;
    }
  };

  // One button for each arm: which one the page is about, who drives it, and whether something is wrong with it.
  const showArms = () => {
    buttons.forEach((button, k) => {
      const arm = link.arms[k], fresh = link.fresh(arm), holder = link.status?.arms[k].driver;
      const wrong = !fresh ? "○ " : arm.state.fault ? "✖ " : "";
      const who = !link.open ? "" : holder === link.page ? "you drive" : holder ? `page ${holder} drives` : "free";
      setText(button.firstChild, `${wrong}${arm.facts.name}`);
      setText(button.lastChild, who);
      setAttribute(button, "aria-pressed", String(k === link.chosen));
      setAttribute(button, "data-level", !fresh ? "off" : arm.state.fault ? "bad" : "good");
    });
  };

  const showArm = (arm, status) => {
    const fresh = arm && link.fresh(arm);
    const state = arm?.state;
    setAttribute(document.body, "data-stale", !fresh);
    setAttribute(document.body, "data-all-stale", !link.arms.some((each) => link.fresh(each)));
    setText(data, fresh ? "● live" : "○ no data");
    setAttribute(data, "data-level", fresh ? "good" : "bad");
    setText(mode, fresh ? link.modeOf(state) : "unknown");
    setAttribute(mode, "data-level", fresh ? levelOf(link.modeOf(state)) : "off");
    setText(power, !fresh ? "power ?" : state.flags & POWERED ? "⚡ power on" : "power off");
    setAttribute(power, "data-level", fresh && state.flags & POWERED ? "live" : "off");
    showFault(fresh ? state : null, arm, status);
  };

  const showFault = (state, arm, status) => {
    const lines = [];
    if (link.stopLost) lines.push(["✖ STOP HAS NOT REACHED THE PENDANT", "Press the emergency stop. Once the page is connected again, press STOP until this line goes away."]);
    const doubts = doubted();
    lines.push(...doubts);
    if (!link.open) lines.push(["✖ The pendant does not answer", "Is `qrobot pendant` still running? This page connects again by itself; if it was started anew, open the address that it prints."]);
    else if (status?.problem) lines.push(["✖ No arm", status.problem]);
    else if (state) {
      const code = state.fault || state.event, waits = Boolean(state.flags & PATH_WAITS);
      if (code) {
        const [name, what, remedy] = link.words.codes[code] ?? [`code ${code}`, "unknown to this version", "see the documentation"];
        const joint = state.joint >= 0 ? `joint ${state.joint + 1} (${arm.facts.joints[state.joint]}): ` : "";
        lines.push([`${state.fault ? "✖ FAULT" : "⚠ Last event"} ${name}`, `${joint}${what}.${waits ? "" : ` What to do: ${remedy.replaceAll("`", "")}.`}`]);
      }
      if (waits) lines.push(["⚠ A program waits beside its path", "Put right what stopped it, look that nothing is between the arm and its path, then press Go back to the path on the tab Drive; a program in VAL goes on by PROCEED where it was started."]);
      if (!(state.flags & ESTOP_OK) && link.words.codes[state.fault]?.[0] !== "ESTOP") lines.push(["✖ Emergency stop", "It is pressed."]);
      if (!(state.flags & CALIBRATED)) lines.push(["⚠ Not calibrated", "Positions are not true: calibrate the arm before it moves."]);
    }
    setAttribute(fault, "data-level", state && !state.fault && !link.stopLost && !doubts.length ? "warn" : "bad");
    fault.hidden = lines.length === 0;
    const text = JSON.stringify(lines);
    if (fault.dataset.text !== text) {
      fault.dataset.text = text;
      fault.replaceChildren(...lines.map(([head, rest, k]) => el("p", {}, el("b", {}, head), " ", rest, k === undefined ? "" : awayButton(k))));
    }
  };

  // Every arm, also one that the page is not about, of which nobody knows whether it has stopped.
  const doubted = () => {
    const name = (k) => (link.arms.length > 1 ? `${link.arms[k].facts.name}: ` : "");
    const open = unsure.map((each, k) => [each, k]).filter(([each, k]) => each.unsure && link.arms[k] && each.unsures !== looked[k]);
    return open.map(([each, k]) => [`✖ ${name(k)}${each.unsure}`, "This line stays until the servo has answered a STOP or Power off.", k]);
  };
  const awayButton = (k) => el("button", { class: "dismiss", "aria-label": "take this line away: I have looked at the arm", onclick: () => { looked[k] = unsure[k].unsures; show(); } }, "×");

  link.addEventListener("hello", () => {
    seen = [];
    unsure = [];
    looked = [];
    heard = 0;
    buttons = link.arms.map((arm, k) => el("button", { class: "arm", "data-arm": k, onclick: () => link.choose(k) }, el("span", {}, arm.facts.name), el("small", {}, "")));
    arms.replaceChildren(...buttons);
    arms.hidden = link.arms.length < 2;
    setText(brand, link.arms.length === 1 ? link.arms[0].facts.name : "QRobot");
    show();
  });
  for (const name of ["status", "chosen", "stop"]) link.addEventListener(name, show);
  setInterval(show, 100);
}

function levelOf(mode) {
  if (mode === "FAULT") return "bad";
  if (mode === "TRACKING" || mode === "STOPPING" || mode === "CALIBRATING") return "live";
  return mode === "HOLDING" ? "good" : "off";
}
