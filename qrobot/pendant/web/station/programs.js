// The tab Programs: those of the folder, their sources, started off line, in lock-step or live, and what they print.
import { askOfArm } from "./ask.js";
import { el, setAttribute, setText } from "./dom.js";
import { speedCard } from "./drive.js";
import { link } from "./link.js";
import { Player } from "./player.js";

const LOOK_MS = 300;
const RENEW_MS = 2000;
const MOST_LINES = 2000;
const MANNERS = [["offline", "Off line", "an ideal arm in the computer: nothing moves, the ghost shows what would"], ["lockstep", "In lock-step", "an emulated arm and its servo, in the computer: nothing moves"], ["live", "Live …", "this arm moves"]];
const STATES = { none: "nothing was started", running: "▶ runs", done: "✔ done", failed: "✖ failed", ended: "■ ended" };

export function makePrograms(root) {
  const list = el("div", { class: "program-list", role: "listbox", "aria-label": "programs" });
  const where = el("p", { class: "hint" });
  const source = el("pre", { class: "listing", id: "source", tabindex: "0", "aria-label": "source" });
  const output = el("pre", { class: "listing", id: "output", tabindex: "0", role: "log", "aria-label": "output" });
  const scene = el("section", { class: "card" });
  const part = el("select", { id: "val-program", "aria-label": "program of the file" });
  const speed = el("input", { type: "number", id: "val-speed", min: "1", max: "100", value: "50", "aria-label": "monitor speed, percent" });
  const step = el("input", { type: "checkbox", id: "val-step" });
  const val = el("div", { class: "options", hidden: true }, el("label", {}, "Program ", part), el("label", {}, "Speed % ", speed), el("label", {}, step, " step by step"));
  const buttons = MANNERS.map(([manner, title, hint]) => el("button", { id: `start-${manner}`, title: hint, onclick: () => (manner === "live" ? offer(true) : start(manner)) }, title));
  const sure = el("div", { class: "confirm", hidden: true, role: "alertdialog", "aria-label": "the arm will move" });
  const state = el("span", { class: "chip", id: "program-state" });
  const end = el("button", { id: "program-end", onclick: () => link.say({ do: "program end", arm: link.chosen }) }, "■ End");
  const next = el("button", { id: "program-next", onclick: () => say("NEXT") }, "Next step");
  const go = el("button", { id: "program-go", onclick: () => say("PROCEED") }, "Proceed");
  const interrupt = el("button", { id: "program-interrupt", onclick: () => link.say({ do: "program interrupt", arm: link.chosen }) }, "Interrupt");
  const typed = el("input", { id: "program-line", "aria-label": "line for the program", placeholder: "an answer for the program", maxlength: "200" });
  const answer = el("form", { class: "record" }, typed, el("button", {}, "Send"));
  const told = el("p", { class: "hint", id: "program-told" });
  const trace = el("a", { class: "hint", id: "program-trace", target: "_blank", hidden: true }, "trace of its requests");
  answer.addEventListener("submit", (event) => (event.preventDefault(), say(typed.value), (typed.value = "")));
  root.append(
    el("section", { class: "side" },
      el("div", { class: "card" }, el("h2", {}, "Programs"), where, list),
      el("div", { class: "card" }, el("h2", {}, "Start"), val, el("div", { class: "buttons" }, ...buttons), sure),
      el("div", { class: "card" }, el("h2", {}, "Run"), el("div", { class: "buttons" }, state, end, next, go, interrupt), told, trace, answer),
      speedCard("program-"),
    ),
    el("section", { class: "program-right" }, scene, el("div", { class: "listings" }, el("section", { class: "card" }, el("h2", {}, "Source"), source), el("section", { class: "card" }, el("h2", {}, "Output"), output))),
  );
  const player = new Player(scene);

  let programs = [], chosen = null, shown = { arm: -1, run: -1, next: 0, lines: [], loaded: 0 }, looking = false, listed = -Infinity, asked = [];
  const driven = () => link.arms.map((_, k) => k).filter((k) => link.status?.arms[k].driver === link.page);
  const facts = () => link.armStatus?.program ?? { run: 0, state: "none" };
  const say = (line) => link.order({ do: "program say", arm: link.chosen, line });

  const start = (manner, arm = link.chosen, confirmed = false) => {
    offer(false);
    link.order({ do: "program start", arm, name: chosen.name, manner, execute: part.value || "main", speed: Number(speed.value) || 50, step: chosen.language === "VAL" && step.checked, confirmed, stamp: source.dataset.stamp });
  };

  function offer(on) {
    sure.hidden = !on;
    if (!on) return;
    const arm = link.chosen; // what is confirmed is about this arm, and those that the page drives now
    asked = driven();
    const names = [arm, ...asked.filter((each) => each !== arm && chosen.language !== "recording")].map((each) => link.arms[each].facts.name);
    const who = names.length > 1 ? `${names[0]} will move, and ${names.slice(1).join(" and ")} may` : `${names[0]} will move`;
    sure.replaceChildren(
      el("p", {}, el("b", {}, `⚠ ${who}`), ` as ${chosen.name} says. Is everybody out of ${names.length > 1 ? "their" : "its"} reach, and the emergency stop at hand? ${chosen.language === "recording" ? "The arm goes slowly to where the recording begins. While no page drives, it is paused" : "While no page drives, the program is paused"}, and ended if it moves on all the same.`),
      el("button", { id: "start-sure", onclick: () => start("live", arm, true) }, "Start it now"),
      el("button", { onclick: () => offer(false) }, "Cancel"),
    );
  }

  async function renew() {
    if (!link.open) return;
    try {
      const answered = await askOfArm("programs");
      if (!answered) return;
      setText(where, answered.where ? `in ${answered.where}` : "Start the pendant with --programs FOLDER to have programs here; recordings of an arm led by hand are here anyway.");
      if (JSON.stringify(programs) !== JSON.stringify(answered.programs)) {
        programs = answered.programs;
        list.replaceChildren(...programs.map((each) => el("button", { role: "option", class: "program", "data-name": each.name, onclick: () => choose(each) }, el("span", {}, each.name), el("small", {}, each.language))));
      }
      const now = programs.find((each) => each.name === chosen?.name) ?? programs[0];
      if (now && (now.name !== chosen?.name || now.stamp !== source.dataset.stamp)) await choose(now);
      mark();
    } catch (error) {
      setText(where, String(error.message));
    }
  }

  // Show a program, or the one that is shown as it is after a change.
  async function choose(program) {
    const again = chosen?.name === program.name, executed = part.value;
    chosen = program;
    source.dataset.stamp = ""; // until its text is there
    offer(false);
    val.hidden = program.language !== "VAL";
    part.replaceChildren(...program.parts.map((name) => el("option", {}, name)));
    const wanted = [again && executed, "main"].find((name) => program.parts.includes(name));
    if (wanted) part.value = wanted;
    show();
    const [text, stamp] = await askOfArm("programs/source", { name: program.name }, "text").then((got) => [got, program.stamp], (error) => [error.message, ""]);
    if (text === null || chosen !== program) return;
    source.replaceChildren(...text.split("\n").map((line, k) => el("span", { class: "line", "data-number": k + 1 }, `${line}\n`)));
    source.dataset.stamp = stamp;
    if (!again) source.scrollTop = 0;
    show();
  }

  // What is chosen, and the line that an error is about.
  function mark() {
    for (const each of list.children) setAttribute(each, "aria-selected", String(each.dataset.name === chosen?.name));
    const now = facts(), at = now.name === chosen?.name && now.stamp === source.dataset.stamp ? (now.line ?? stepLine(now)) : null;
    for (const line of source.children) setAttribute(line, "data-marked", Number(line.dataset.number) === at ? (now.line ? "error" : "step") : false);
    const marked = source.querySelector("[data-marked]");
    if (marked && marked.dataset.seen !== String(now.run)) {
      marked.dataset.seen = String(now.run);
      source.scrollTop = Math.max(marked.offsetTop - source.offsetTop - source.clientHeight / 2, 0);
    }
  }

  // The step that a VAL program waits at, as a line of its file.
  function stepLine(now) {
    if (!now.stepping || now.state !== "running") return null;
    const place = shown.lines.map((line) => /at step (\d+) of program (\S+)/.exec(line)).findLast(Boolean);
    if (!place) return null;
    const head = new RegExp(`^\\s*\\.PROGRAM\\s+${place[2].replaceAll(".", "\\.")}\\b`, "i");
    const first = [...source.children].findIndex((line) => head.test(line.textContent));
    return first < 0 ? null : first + 1 + Number(place[1]);
  }

  function forget() {
    const now = facts();
    if (shown.arm !== link.chosen || now.state === "running" || !now.run) player.clear();
    shown = { arm: link.chosen, run: now.run, next: 0, lines: [], loaded: 0 };
    setText(output, "");
    trace.hidden = true;
  }

  async function look() {
    if (root.hidden) listed = -Infinity;
    if (looking || root.hidden || !link.open) return;
    if (performance.now() - listed > RENEW_MS) [listed] = [performance.now(), renew()]; // what was recorded, and edited
    looking = true;
    try {
      const now = facts(), arm = link.chosen;
      if (shown.arm !== arm || shown.run !== now.run) forget();
      const got = await askOfArm("programs/output", { after: shown.next });
      if (!got) return;
      if (got.run === shown.run && got.lines.length) append(got);
      if (now.run && now.state !== "running" && shown.loaded !== now.run) {
        shown.loaded = now.run;
        const found = await askOfArm("programs/setpoints", {}, "arrayBuffer");
        if (!found) return;
        player.load(found);
        if (now.manner !== "live") player.play(true);
        trace.hidden = !got.results.includes("requests");
        trace.href = `/ask/programs/requests?arm=${arm}`;
      }
    } catch {
      // the pendant is away: the bar says so
    } finally {
      looking = false;
    }
  }

  function append(got) {
    const low = output.scrollHeight - output.scrollTop - output.clientHeight < 30;
    if (got.first > shown.next && shown.next) shown.lines.push("… older lines are left out here");
    shown.lines = [...shown.lines, ...got.lines].slice(-MOST_LINES);
    shown.next = got.first + got.lines.length;
    setText(output, `${shown.lines.join("\n")}\n`);
    if (low) output.scrollTop = output.scrollHeight;
    mark();
  }

  const show = () => {
    const now = facts(), runs = now.state === "running", mine = link.driving;
    for (const button of buttons) button.disabled = !mine || runs || !chosen || (button.id === "start-live" && !source.dataset.stamp); // what moves the arm is shown before
    if (!mine || runs || String(asked) !== String(driven())) offer(false);
    end.disabled = !runs;
    next.hidden = go.hidden = interrupt.hidden = !now.stepping;
    next.disabled = go.disabled = !runs || !mine;
    interrupt.disabled = !runs;
    for (const each of answer.elements) each.disabled = !runs || !mine;
    if (runs) trace.hidden = true;
    setText(state, STATES[now.state]);
    setAttribute(state, "data-level", { running: "live", failed: "bad", done: "good" }[now.state] ?? "off");
    const how = { offline: "off line", lockstep: "in lock-step", live: "live" }[now.manner];
    setText(told, now.run ? `${now.name}, ${how}${now.told ? `: ${now.told}` : ""}${now.line ? `; line ${now.line}` : ""}` : mine ? "" : "Only the page that drives starts programs: press Drive from here.");
    mark();
  };
  for (const name of ["hello", "chosen"]) link.addEventListener(name, () => offer(false));
  link.addEventListener("chosen", forget);
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  for (const name of ["hello", "chosen"]) link.addEventListener(name, () => !root.hidden && renew());
  setInterval(look, LOOK_MS);
}
