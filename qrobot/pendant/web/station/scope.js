// The tab Scope: curves of the joints as they come, at the rate of the samples.
import { COLOURS, DASHES, boxes, lengthOrAngle, saveFile, spread } from "./curves.js";
import { el, setText } from "./dom.js";
import { link } from "./link.js";
import { shown, unit } from "./kinematics.js";

const REFRESH_MS = 80;
const QUANTITIES = {
  error: ["tracking error", (f, s, j) => shown(f, j, s.setpoint[j] - s.q[j]), (f) => lengthOrAngle(f)],
  position: ["position", (f, s, j) => shown(f, j, s.q[j]), (f) => lengthOrAngle(f)],
  setpoint: ["setpoint", (f, s, j) => shown(f, j, s.setpoint[j]), (f) => lengthOrAngle(f)],
  velocity: ["velocity", (f, s, j) => shown(f, j, s.v[j]), (f) => `${lengthOrAngle(f)}/s`],
  torque: ["torque", (f, s, j) => s.tau[j], (f) => (f.prismatic.some(Boolean) ? "N m, N" : "N m")],
};

export function makeScope(root) {
  const plots = el("div", { class: "plots" });
  const seconds = el("select", { "aria-label": "length of the picture" }, ...[5, 10, 20, 60].map((s) => el("option", { value: s }, `${s} s`)));
  seconds.value = "10";
  const freeze = el("button", { id: "freeze", "aria-pressed": "false", onclick: () => setFrozen(frozen === null) }, "Freeze");
  const save = el("button", { id: "export", onclick: () => exportCsv(frozen ?? cut()) }, "Export CSV");
  const quantities = boxes(Object.entries(QUANTITIES).map(([key, [title]]) => [key, title, key === "error" || key === "velocity"]), build);
  let joints = boxes([], build), jointBox = el("fieldset", {}, el("legend", {}, "Joints"));
  root.append(
    el("section", { class: "card scope-options" }, el("fieldset", {}, el("legend", {}, "Quantities"), ...quantities.elements), jointBox, el("label", {}, "Last ", seconds), freeze, save),
    plots,
  );
  let frozen = null, charts = [];

  const cut = () => {
    const { history } = link.arm;
    const newest = history.at(-1)?.t ?? 0;
    const from = history.findIndex((state) => state.t >= newest - Number(seconds.value));
    return history.slice(Math.max(from, 0));
  };

  function setFrozen(on) {
    frozen = on ? cut() : null;
    freeze.setAttribute("aria-pressed", String(on));
    setText(freeze, on ? "Go on" : "Freeze");
    draw();
  }

  function newArm() {
    joints = boxes(link.arm.facts.joints.map((name, j) => [j, `${j + 1} ${name.replaceAll("_", " ")}`, true]), build);
    jointBox.replaceChildren(el("legend", {}, "Joints"), ...joints.elements);
    frozen = null;
    build();
  }

  function build() {
    charts.forEach((chart) => chart.plot.destroy());
    charts = [];
    if (!link.arm || root.hidden) return;
    const { facts } = link.arm;
    for (const key of quantities.chosen()) {
      const [title, , unitOf] = QUANTITIES[key];
      const box = el("div", { class: "card plot" });
      plots.append(box);
      const series = joints.chosen().map((j) => ({ label: facts.joints[j], stroke: COLOURS[j % COLOURS.length], dash: DASHES[j % DASHES.length], width: 1.6, value: (_, v) => (v == null ? "—" : `${v.toPrecision(4)}`) }));
      const plot = new uPlot(
        {
          width: box.clientWidth - 8, height: 230, title: `${title} (${unitOf(facts)})`, cursor: { sync: { key: "scope" } },
          scales: { x: { time: false }, y: { range: (_, low, high) => spread(low, high) } }, axes: [{ label: "s", labelSize: 18 }, { size: 64 }], series: [{ label: "s", value: (_, v) => (v == null ? "—" : v.toFixed(3)) }, ...series],
        },
        [[], ...series.map(() => [])], box,
      );
      charts.push({ plot: { destroy: () => (plot.destroy(), box.remove()) }, key, chart: plot, box });
    }
    draw();
  }

  function draw() {
    if (!link.arm || root.hidden) return;
    const states = frozen ?? cut(), { facts } = link.arm;
    const newest = states.at(-1)?.t ?? 0;
    const t = states.map((state) => state.t - newest);
    for (const { chart, key } of charts) {
      chart.setData([t, ...joints.chosen().map((j) => states.map((state) => QUANTITIES[key][1](facts, state, j)))]);
    }
  }

  link.addEventListener("hello", newArm);
  link.addEventListener("chosen", newArm);
  setInterval(() => frozen === null && draw(), REFRESH_MS);
  new ResizeObserver(() => {
    if (root.hidden) return;
    if (!charts.length) build();
    charts.forEach(({ chart, box }) => chart.setSize({ width: box.clientWidth - 8, height: 230 }));
  }).observe(plots);
}

function exportCsv(states) {
  const { facts } = link.arm;
  const columns = ["q", "setpoint", "v", "tau"];
  const head = ["t_s", ...columns.flatMap((column) => facts.joints.map((name) => `${column}_${name}`)), "mode", "event"];
  const lines = states.map((s) => [s.t, ...columns.flatMap((column) => [...s[column]]), link.modeOf(s), s.event].join(","));
  saveFile([head.join(","), ...lines].join("\n") + "\n", `${facts.name}-scope.csv`);
}
