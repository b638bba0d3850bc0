// The tab Calibrate, identify: their steps one after the other, with progress and results.
import { askOfArm } from "./ask.js";
import { el, setAttribute, setText } from "./dom.js";
import { link } from "./link.js";

const LOOK_MS = 300;
const MOST_LINES = 2000;
const STATES = { none: "nothing was started", running: "▶ runs", done: "✔ done", failed: "✖ failed", ended: "■ ended" };
const NAMES = { calibrate: "calibration", plan: "plan", "record lockstep": "recording in lock-step", "record live": "recording of this arm", fit: "fit" };

export function makeCalibrate(root) {
  const indexes = el("input", { type: "number", id: "indexes", min: "3", max: "14", value: "5", "aria-label": "index pulses of each joint" });
  const slow = el("input", { type: "checkbox", id: "identify-slow" });
  const sure = el("div", { class: "confirm", hidden: true, role: "alertdialog" });
  const button = (id, title, act) => el("button", { id, onclick: act }, title);
  const start = (step, arm = link.chosen, confirmed = false) => {
    link.order({ do: "procedure start", arm, step, indexes: Math.round(Number(indexes.value)) || 5, slow: slow.checked, confirmed });
  };
  const close = () => (sure.hidden = true);
  const offer = (words, act) => {
    const arm = link.chosen; // what is confirmed is about this arm and no other
    sure.hidden = false;
    sure.replaceChildren(el("p", {}, el("b", {}, `⚠ ${link.arms[arm].facts.name}: `), words), el("button", { id: "procedure-sure", onclick: () => (close(), act(arm)) }, "Do it now"), el("button", { onclick: close }, "Cancel"));
    sure.scrollIntoView({ block: "nearest" });
  };
  const calibrate = button("calibrate", "Calibrate …", () => offer("every joint creeps over a few index pulses, one after the other, up to a turn of its motor and more. Then the counters on the board are loaded. Keep clear of the arm.", (arm) => start("calibrate", arm, true)));
  const plan = button("identify-plan", "1 Plan", () => start("plan"));
  const lockstep = button("identify-lockstep", "2 Record in lock-step", () => start("record lockstep"));
  const live = button("identify-live", "2 Record this arm …", () => offer("it moves through most of its range for some minutes. Keep clear of it.", (arm) => start("record live", arm, true)));
  const fit = button("identify-fit", "3 Fit", () => start("fit"));
  const keep = button("identify-keep", "4 Keep the model …", () => offer("the model is written to the folder of logs, beside those that are there. The servo uses it once the deployment file names it.", (arm) => link.say({ do: "procedure keep", arm, confirmed: true })));
  const state = el("span", { class: "chip", id: "procedure-state" });
  const end = button("procedure-end", "■ Cancel it", () => link.say({ do: "procedure end", arm: link.chosen }));
  const bar = el("progress", { id: "procedure-progress", max: "1", value: "0", "aria-label": "progress" });
  const told = el("p", { class: "hint", id: "procedure-told" });
  const output = el("pre", { class: "listing", id: "procedure-output", tabindex: "0", role: "log", "aria-label": "output" });
  const hint = (text) => el("p", { class: "hint" }, text);
  root.append(
    el("section", { class: "side" },
      el("div", { class: "card" }, el("h2", {}, "Calibrate"), hint("Finds the true counters by potentiometers and index pulses. A calibration that cannot be certain is refused. Arm power is left as it was."), el("div", { class: "options" }, el("label", {}, "Index pulses ", indexes), calibrate)),
      el("div", { class: "card" }, el("h2", {}, "Identify"), hint("What the arm weighs, how it rubs and how strong its motors are. Plan shows what it would do; Fit finds the numbers with their uncertainty, and how well they predict motion that was held back."), el("div", { class: "options" }, el("label", {}, slow, " near standstill too")), el("div", { class: "steps" }, plan, lockstep, live, fit, keep)),
      sure,
      el("div", { class: "card" }, el("h2", {}, "Progress"), el("div", { class: "buttons" }, state, end), bar, told),
    ),
    el("section", { class: "card" }, el("h2", {}, "Results"), output),
  );

  let shown = { arm: -1, run: -1, next: 0, lines: [] }, looking = false;
  const facts = () => link.armStatus?.procedure ?? { run: 0, state: "none" };

  function forget() {
    shown = { arm: link.chosen, run: facts().run, next: 0, lines: [] };
    setText(output, "");
  }

  async function look() {
    if (looking || root.hidden || !link.open) return;
    looking = true;
    try {
      const now = facts();
      if (shown.arm !== link.chosen || shown.run !== now.run) forget();
      const got = await askOfArm("procedure", { after: shown.next });
      if (!got) return;
      if (got.run === shown.run && got.lines.length) {
        shown.lines = [...shown.lines, ...got.lines].slice(-MOST_LINES);
        shown.next = got.first + got.lines.length;
        setText(output, `${shown.lines.join("\n")}\n`);
        output.scrollTop = now.state === "running" ? output.scrollHeight : 0;
      }
      progress(now);
    } catch {
      // the pendant is away: the bar says so
    } finally {
      looking = false;
    }
  }

  // Lines of the command say how far it is: "3 of 30: ...".
  function progress(now) {
    const found = shown.lines.map((line) => /^(\d+) of (\d+): (.*)/.exec(line)).findLast(Boolean);
    bar.hidden = now.state !== "running";
    if (found) bar.value = Number(found[1]) / Number(found[2]);
    else bar.removeAttribute("value");
    const where = found && now.state === "running" ? `: ${found[0]}` : now.told ? `: ${now.told}` : "";
    setText(told, now.run ? `${NAMES[now.step] ?? now.step}${where}${now.kept ? `; the model is ${now.kept}` : ""}` : link.driving ? "" : "Only the page that drives begins a step: press Drive from here.");
  }

  const show = () => {
    const now = facts(), may = link.driving && now.state !== "running";
    if (!may) close();
    for (const each of [calibrate, plan, lockstep, live]) each.disabled = !may;
    fit.disabled = !may || !now.recorded;
    keep.disabled = !may || !now.fitted;
    end.disabled = now.state !== "running";
    setText(state, STATES[now.state]);
    setAttribute(state, "data-level", { running: "live", failed: "bad", done: "good" }[now.state] ?? "off");
    progress(now);
  };
  for (const name of ["hello", "chosen"]) link.addEventListener(name, close);
  link.addEventListener("chosen", forget);
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  setInterval(look, LOOK_MS);
}
