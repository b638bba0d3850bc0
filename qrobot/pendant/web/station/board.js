// The tab Board: registers and bits as they are, live; panel and faults of an emulated board.
import { askOfArm } from "./ask.js";
import { el, setAttribute, setText } from "./dom.js";
import { link } from "./link.js";

const LOOK_MS = 200;
const GROUPS = [["Encoders", /^ENC_/], ["Analogue", /^(DAC|ADC)/], ["Words", /^(STATUS|DISCRETE)/]];

export function makeBoard(root) {
  const problem = el("p", { class: "hint", id: "board-problem", role: "status" });
  const facts = el("p", { class: "hint", id: "board-facts" });
  const tables = el("div", { class: "board-tables" });
  const bits = el("div", { class: "board-bits" });
  const modules = el("section", { class: "card" }, el("h2", {}, "Remote modules"));
  const moduleList = el("div");
  modules.append(moduleList);
  const counters = el("dl", { class: "counters" });
  const real = el("p", { class: "hint", id: "board-real", hidden: true }, "This board is a real one: it is shown, and nothing is forced or broken in it from here.");
  const work = el("div", { class: "board-work", id: "board-work", hidden: true });
  root.append(
    problem,
    el("section", { class: "card" }, el("h2", {}, "Registers"), facts, tables),
    el("section", { class: "card" }, el("h2", {}, "Bits"), bits),
    modules,
    el("section", { class: "card" }, el("h2", {}, "Counters since the board began"), counters),
    el("section", { class: "card wide" }, el("h2", {}, "Panel and faults of the emulated board"), real, work),
  );
  const panel = makePanel(work);
  const cells = new Map();
  let known = "", kinds = null, busy = false, arm = -1;

  // Rows are made once, and their texts changed.
  function build(board) {
    const now = JSON.stringify([board.registers.map((row) => row.name), board.bits.map((bit) => [bit.register, bit.bit])]);
    if (known === now) return;
    known = now;
    cells.clear();
    tables.replaceChildren(...GROUPS.map(([title, which]) => {
      const rows = board.registers.filter((row) => which.test(row.name)).map((row) => {
        const word = el("td", { class: "number" }), told = el("td", { class: "number" });
        cells.set(row.name, [word, told]);
        return el("tr", {}, el("th", { scope: "row" }, row.name.replace("_", " ")), el("td", {}, hex(row.offset, 2)), word, told);
      });
      return el("table", { class: "registers" }, el("caption", {}, title), el("tbody", {}, ...rows));
    }));
    bits.replaceChildren(...["STATUS", "DISCRETE"].filter((register) => board.bits.some((bit) => bit.register === register)).map((register) => el("div", {}, el("h3", {}, register), ...board.bits.filter((bit) => bit.register === register).map((bit) => {
      const lamp = el("span", { class: "lamp" }), row = el("div", { class: "bit" }, lamp, el("span", {}, bit.name), el("small", {}, String(bit.bit)));
      cells.set(`${register}.${bit.bit}`, [row, lamp]);
      return row;
    }))));
  }

  function show(board) {
    build(board);
    setText(facts, `revision ${board.revision}, image ${board.count}, every ${board.period_ms} ms, ${board.t_s.toFixed(2)} s`);
    for (const row of board.registers) {
      const [word, told] = cells.get(row.name);
      setText(word, row.word === null ? "—" : hex(row.word, 4));
      setText(told, row.told);
    }
    for (const bit of board.bits) {
      const [row, lamp] = cells.get(`${bit.register}.${bit.bit}`);
      setAttribute(row, "data-on", bit.on);
      setText(lamp, bit.on ? "1" : "0");
    }
    const told = JSON.stringify(board.modules);
    if (moduleList.dataset.told !== told) {
      moduleList.dataset.told = told;
      moduleList.replaceChildren(...board.modules.map((module) => el("div", {}, el("h3", {}, module.name), ...module.lines.map((line) => el("p", { class: "module-line" }, line)))));
    }
    modules.hidden = !board.modules.length;
    const counted = JSON.stringify(board.counters);
    if (counters.dataset.told !== counted) {
      counters.dataset.told = counted;
      counters.replaceChildren(...Object.entries(board.counters).flatMap(([name, value]) => [el("dt", {}, name), el("dd", { class: "number" }, String(Math.round(value)))]));
    }
    panel.show(board.faults);
  }

  // What is shown is of one arm.
  function forget() {
    [arm, kinds, known] = [link.chosen, null, ""];
    cells.clear();
    for (const each of [tables, bits, moduleList, counters]) {
      each.replaceChildren();
      delete each.dataset.told;
    }
    for (const each of [facts, problem]) setText(each, "");
    for (const each of [modules, problem, real, work]) each.hidden = true;
    panel.forget();
  }

  async function look() {
    panel.enable();
    if (busy || root.hidden || document.hidden || !link.open) return;
    busy = true;
    try {
      if (arm !== link.chosen) forget();
      const seen = await askOfArm("board", { kinds: !kinds?.length });
      if (!seen) return;
      real.hidden = seen.emulated;
      work.hidden = !seen.emulated;
      if (seen.kinds) panel.choose((kinds = seen.kinds), link.arm.facts.joints.length);
      setText(problem, seen.problem);
      problem.hidden = !seen.problem;
      setAttribute(root, "data-old", !seen.board);
      if (seen.board) show(seen.board);
    } catch (error) {
      setText(problem, error.message);
      problem.hidden = false;
    } finally {
      busy = false;
    }
  }
  link.addEventListener("chosen", forget);
  setInterval(look, LOOK_MS);
}

// What an operator beside the board would do, and what may break.
function makePanel(root) {
  const say = (what, line) => link.say({ do: `board ${what}`, arm: link.chosen, ...(line === undefined ? {} : { line }) });
  const inputs = Array.from({ length: 5 }, (_, k) => el("label", {}, el("input", { type: "checkbox", id: `force-input-${k + 1}`, onchange: (event) => say("force", `input:${k + 1} ${event.target.checked ? "on" : "off"}`) }), ` ${k + 1}`));
  const channel = el("select", { "aria-label": "channel" }, ...Array.from({ length: 8 }, (_, k) => el("option", { value: k }, `channel ${k}`)));
  const volt = el("input", { type: "number", min: "-10", max: "10", step: "0.1", value: "0", "aria-label": "volts" });
  const joint = el("select", { "aria-label": "joint" });
  const push = el("input", { type: "number", min: "-1000", max: "1000", step: "5", value: "20", "aria-label": "newton metres" });
  const kind = el("select", { id: "fault-kind", "aria-label": "what breaks" });
  const broken = el("select", { "aria-label": "whose joint" });
  const amount = el("input", { type: "number", step: "any", "aria-label": "how much" });
  const seconds = el("input", { type: "number", id: "fault-seconds", min: "0", step: "0.1", value: "1", "aria-label": "for how many seconds, 0 for good" });
  const inject = el("button", { id: "inject" }, "Let it break");
  const list = el("ul", { class: "faults", id: "faults" });
  let kinds = [];
  const breaking = el("form", { class: "options" }, kind, broken, el("label", {}, amount, el("span", { class: "unit" })), el("label", {}, "for ", seconds, " s"), inject, el("button", { type: "button", id: "repair", onclick: () => say("repair") }, "Repair everything"));
  const picked = () => kinds[kind.selectedIndex];
  const pick = () => {
    const row = picked();
    if (!row) return;
    broken.hidden = !row.per_joint;
    amount.parentElement.hidden = row.default === null;
    amount.value = row.default ?? "";
    Object.assign(amount, { min: row.low, max: row.high });
    setText(breaking.querySelector(".unit"), ` ${row.unit}`);
    seconds.parentElement.hidden = row.once;
  };
  kind.addEventListener("change", pick);
  breaking.addEventListener("submit", (event) => {
    event.preventDefault();
    const row = picked();
    const lasts = row.once || !Number(seconds.value) ? "" : ` +${Number(seconds.value)}s`;
    say("inject", `${row.component}${row.per_joint ? `:${broken.value}` : ""} ${row.name}${row.default === null ? "" : ` ${Number(amount.value)}`}${lasts}`);
  });
  const fields = el("fieldset", { class: "board-fields", id: "board-fields" },
    el("div", { class: "options" }, el("button", { type: "button", id: "force-estop", onclick: () => say("force", "estop on") }, "Press the emergency stop"), el("button", { type: "button", onclick: () => say("force", "estop off") }, "Release it"), el("button", { type: "button", onclick: () => say("force", "power press") }, "Press ARM POWER")),
    el("div", { class: "options" }, "Inputs", ...inputs),
    el("div", { class: "options" }, channel, el("label", {}, volt, " V"), el("button", { type: "button", onclick: () => say("force", `analog:${channel.value} ${Number(volt.value)}`) }, "Force")),
    el("div", { class: "options" }, joint, el("label", {}, push, " N m (N)"), el("button", { type: "button", onclick: () => say("force", `push:${joint.value} ${Number(push.value)}`) }, "Push"), el("button", { type: "button", onclick: () => say("force", `push:${joint.value} 0`) }, "Let go")),
    el("div", { class: "options" }, el("button", { type: "button", onclick: () => (inputs.forEach((each) => (each.firstChild.checked = false)), say("force", "clear")) }, "Take all of this back")),
    breaking,
  );
  root.append(fields, list);
  return {
    forget: () => {
      for (const each of inputs) each.firstChild.checked = false;
      list.replaceChildren();
      delete list.dataset.told;
    },
    enable: () => (fields.disabled = !link.driving),
    choose: (all, joints) => {
      kinds = all;
      kind.replaceChildren(...all.map((row) => el("option", {}, `${row.component}: ${row.name} (it ${row.what})`)));
      for (const each of [joint, broken]) each.replaceChildren(...Array.from({ length: joints }, (_, j) => el("option", { value: j + 1 }, `joint ${j + 1}`)));
      pick();
    },
    show: (faults) => {
      const told = JSON.stringify(faults);
      if (list.dataset.told === told) return;
      list.dataset.told = told;
      list.replaceChildren(...(faults.length ? faults.map((each) => el("li", {}, el("b", {}, each.fault), ` ${each.over ? "over" : each.steps ? "active" : "waiting"}; active in ${each.steps} steps, it acted in ${each.acted}`)) : [el("li", { class: "hint" }, "nothing is broken")]));
    },
  };
}

function hex(value, digits) {
  return `0x${value.toString(16).padStart(digits, "0")}`;
}
