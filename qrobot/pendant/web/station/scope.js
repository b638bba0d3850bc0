// The tab Scope: curves of the joints as they come, at the rate of the samples or of every cycle of the servo.
import { ask } from "./ask.js";
import { COLOURS, DASHES, boxes, drawEvents, lengthOrAngle, saveFile, spread } from "./curves.js";
import { el, setAttribute, setText } from "./dom.js";
import { shown } from "./kinematics.js";
import { link } from "./link.js";
import { Cursors } from "./scope_cursors.js";
import { RingPicture, WirePicture } from "./scope_pictures.js";
import { Trigger } from "./scope_trigger.js";

const HEIGHT = 230;
const TITLES = { error: "tracking error", position: "position", setpoint: "setpoint", velocity: "velocity", torque: "torque" };
const LENGTHS = { wire: [5, 10, 20, 60], ring: [0.05, 0.2, 1, 5, 20] };
const CHOSEN = { wire: "10", ring: "1" };
const TYPING = "input, textarea, select, [contenteditable]";
const paceOf = (seconds) => (seconds <= 1 ? 100 : seconds <= 5 ? 250 : 700); // ms between pictures from the ring

export function makeScope(root) {
  const plots = el("div", { class: "plots" });
  const source = el("select", { id: "scope-source", "aria-label": "what is shown", onchange: () => setSource() }, el("option", { value: "wire" }, "samples of 28 ms"), el("option", { value: "ring" }, "every cycle of the servo"));
  const seconds = el("select", { id: "scope-seconds", "aria-label": "length of the picture", onchange: () => goOn() });
  const freeze = el("button", { id: "freeze", "aria-pressed": "false", onclick: () => (frozen ? goOn() : hold()) });
  const whole = el("button", { id: "whole", onclick: () => zoomTo(null) }, "Whole picture");
  const save = el("button", { id: "export", onclick: () => exportCsv() }, "Export CSV");
  const about = el("span", { class: "chip", id: "scope-about" });
  const problem = el("p", { class: "problem", id: "scope-problem", hidden: true });
  const quantities = boxes(Object.entries(TITLES).map(([key, title]) => [key, title, key === "error" || key === "velocity"]), build);
  const cursors = new Cursors(() => draw());
  const trigger = new Trigger((what) => (what === "arm" ? wait() : disarm()));
  let joints = boxes([], build), jointBox = el("fieldset", {}, el("legend", {}, "Joints"));
  root.append(
    el("section", { class: "card scope-options" },
      el("label", {}, "Show ", source), el("label", {}, "Last ", seconds), el("fieldset", {}, el("legend", {}, "Quantities"), ...quantities.elements), jointBox, trigger.element,
      el("div", { class: "buttons" }, freeze, whole, save, ...cursors.elements, about)),
    problem, plots, cursors.told,
  );
  let frozen = false, kept = null, zoom = null, part = null, picture = null, charts = [], due = 0, looking = false, turn = 0;

  const ring = () => source.value === "ring";
  const length = () => Number(seconds.value);
  const shownNow = () => part ?? picture;
  const zero = () => picture?.triggered ?? picture?.end ?? 0; // the time that is called 0 in the picture
  const range = () => (zoom ?? [(picture?.end ?? 0) - length(), picture?.end ?? 1]).map((t) => t - zero());

  function complain(text) {
    problem.hidden = !text;
    setText(problem, text);
  }

  function setSource() {
    seconds.replaceChildren(...LENGTHS[source.value].map((s) => el("option", { value: s }, `${s} s`)));
    seconds.value = CHOSEN[source.value];
    trigger.element.hidden = !ring();
    goOn();
  }

  function goOn() {
    turn += 1;
    [frozen, kept, zoom, part, picture] = [false, null, null, null, null];
    trigger.armed = null;
    trigger.show("");
    complain("");
    showButtons();
    if (!ring() && link.arm) take(fromWire());
  }

  // Freeze what is shown; what came from the ring is kept whole, so that it can be looked at closer.
  async function hold() {
    if (!picture) return;
    frozen = true;
    trigger.armed = null;
    showButtons();
    if (!ring()) return;
    const mine = turn, { begin, end } = picture;
    try {
      const { number } = await (await ask("scope/keep", { arm: link.chosen, begin, end })).json();
      if (mine === turn) kept = number;
      if (mine === turn && zoom) await zoomTo(zoom);
    } catch (error) {
      complain(`It cannot be looked at closer: ${error.message}`);
    }
  }

  async function zoomTo(wanted) {
    [zoom, part] = [wanted, null];
    if (wanted && !frozen) hold();
    else if (wanted && kept !== null) {
      const mine = turn;
      const got = await RingPicture.kept(kept, link.arm.facts.joints.length, ...wanted).catch((error) => complain(error.message));
      if (mine === turn && zoom === wanted && got) part = got;
    }
    showButtons();
    draw();
  }

  // Wait for what comes from now on: what is shown may be of long ago.
  async function wait() {
    [frozen, kept, zoom, part] = [false, null, null, null];
    turn += 1;
    const armed = (trigger.armed = { after: null });
    trigger.show("waits");
    showButtons();
    try {
      armed.after = (await lookNow({})).newest;
    } catch (error) {
      if (trigger.armed === armed) (disarm(), complain(error.message));
    }
  }

  const lookNow = (question) => RingPicture.look(link.chosen, link.arm.facts.joints.length, length(), question);

  function disarm() {
    trigger.armed = null;
    trigger.show("");
  }

  const fromWire = () => {
    const { history } = link.arm;
    const newest = history.at(-1)?.t ?? 0;
    const from = history.findIndex((state) => state.t >= newest - length());
    return new WirePicture(history.slice(Math.max(from, 0)), (state) => link.modeOf(state), (code) => (link.words.codes[code] ?? [`code ${code}`])[0]);
  };

  async function look() {
    if (looking || frozen || root.hidden || !link.arm || !link.open) return;
    if (!ring()) return take(fromWire());
    if (performance.now() < due || trigger.armed?.after === null) return;
    due = performance.now() + paceOf(length());
    looking = true;
    const mine = turn;
    try {
      const got = await lookNow(trigger.armed ? trigger.question : {});
      if (mine === turn && !frozen) (complain(""), hear(got));
    } catch (error) {
      if (mine === turn) complain(error.message);
    } finally {
      looking = false;
    }
  }

  function hear(got) {
    if (!trigger.armed) return take(got);
    if (got.newest < trigger.armed.after) trigger.armed.after = 0; // another servo, which counts anew
    if (got.triggered === null) return trigger.again.checked && picture?.triggered ? undefined : take(got);
    if (!got.whole) return trigger.show("found, and follows it");
    take(got);
    trigger.armed = trigger.again.checked ? { after: got.last } : null;
    trigger.show("triggered");
    if (!trigger.armed) hold();
  }

  function take(got) {
    picture = got;
    draw();
  }

  function showButtons() {
    freeze.setAttribute("aria-pressed", String(frozen));
    setAttribute(freeze, "data-on", frozen);
    setText(freeze, frozen ? "Go on" : "Freeze");
    whole.hidden = zoom === null;
  }

  function newArm() {
    joints = boxes(link.arm.facts.joints.map((name, j) => [j, `${j + 1} ${name.replaceAll("_", " ")}`, true]), build);
    jointBox.replaceChildren(el("legend", {}, "Joints"), ...joints.elements);
    trigger.setArm(link.arm.facts);
    goOn();
    build();
  }

  const unitOf = (facts, key) => (key === "torque" ? (facts.prismatic.some(Boolean) ? "N m, N" : "N m") : `${lengthOrAngle(facts)}${key === "velocity" ? "/s" : ""}`);
  const scaled = (facts, key, j, values) => (key === "torque" ? values : values.map((value) => shown(facts, j, value)));

  function build() {
    charts.forEach((chart) => (chart.plot.destroy(), chart.box.remove()));
    charts = [];
    if (!link.arm || root.hidden) return;
    for (const key of quantities.chosen()) charts.push(makeChart(key, link.arm.facts));
    draw();
  }

  function makeChart(key, facts) {
    const box = el("div", { class: "card plot" });
    plots.append(box);
    const chosen = joints.chosen();
    const series = chosen.map((j) => ({ label: facts.joints[j], stroke: COLOURS[j % COLOURS.length], dash: DASHES[j % DASHES.length], width: 1.6, points: { show: false }, value: (_, v) => (v == null ? "—" : `${v.toPrecision(4)}`) }));
    const plot = new uPlot(
      {
        width: Math.max(box.clientWidth - 8, 300), height: HEIGHT, title: `${TITLES[key]} (${unitOf(facts, key)})`, cursor: { sync: { key: "scope" }, drag: { x: true, setScale: false } },
        scales: { x: { time: false, range }, y: { range: (_, low, high) => spread(low, high) } }, axes: [{ label: "s", labelSize: 18 }, { size: 64 }],
        series: [{ label: "s", value: (_, v) => (v == null ? "—" : v.toFixed(4)) }, ...series],
        hooks: {
          draw: [(u) => (drawEvents(u, picture?.events ?? [], zero()), cursors.drawOn(u, zero()))],
          setSelect: [(u) => {
            if (u.select.width > 4) zoomTo([u.posToVal(u.select.left, "x") + zero(), u.posToVal(u.select.left + u.select.width, "x") + zero()]);
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
        },
      },
      [[], ...series.map(() => [])], box,
    );
    plot.over.addEventListener("click", () => plot.cursor.left >= 0 && cursors.place(plot.posToVal(plot.cursor.left, "x") + zero()));
    return { plot, key, box, joints: chosen };
  }

  function draw() {
    const now = shownNow();
    if (!link.arm || root.hidden || !now) return;
    const { facts } = link.arm, rows = [];
    const times = now.times.map((t) => t - zero());
    for (const { plot, key, joints } of charts) {
      const values = joints.map((j) => scaled(facts, key, j, now.curve(key, j)));
      plot.setData([times, ...values]);
      joints.forEach((j, k) => rows.push({ title: `${TITLES[key]} ${facts.joints[j]} (${unitOf(facts, key)})`, joint: j, times: now.times, values: values[k] }));
    }
    cursors.show(rows, zero());
    setText(about, ring() ? `${now.cycles} cycles${now.exact ? "" : ", smallest and largest of each instant"}` : `${now.times.length} samples`);
  }

  async function exportCsv() {
    const { facts } = link.arm, name = `${facts.name}-scope.csv`;
    if (!picture) return;
    const [begin, end] = zoom ?? [picture.begin, picture.end];
    if (!ring()) return saveFile(csvOf(facts, picture.states.filter(({ t }) => t >= begin && t <= end)), name);
    try {
      if (!frozen) await hold();
      saveFile(await (await ask("scope/csv", { arm: link.chosen, number: kept ?? 0, begin, end })).text(), name);
    } catch (error) {
      complain(error.message);
    }
  }

  window.addEventListener("keydown", (event) => {
    if (root.hidden || event.repeat || event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.(TYPING)) return;
    if (event.key === "f") freeze.click();
    else if (event.key === "a" || event.key === "b") cursors.choose(event.key === "a" ? 0 : 1);
  });
  link.addEventListener("hello", newArm);
  link.addEventListener("chosen", newArm);
  setSource();
  setInterval(look, 80);
  new ResizeObserver(() => {
    if (root.hidden) return;
    if (!charts.length) build();
    charts.forEach(({ plot, box }) => plot.setSize({ width: Math.max(box.clientWidth - 8, 300), height: HEIGHT }));
  }).observe(plots);
}

function csvOf(facts, states) {
  const columns = ["q", "setpoint", "v", "tau"];
  const head = ["t_s", ...columns.flatMap((column) => facts.joints.map((name) => `${column}_${name}`)), "mode", "event"];
  const lines = states.map((s) => [s.t, ...columns.flatMap((column) => [...s[column]]), link.modeOf(s), s.event].join(","));
  return [head.join(","), ...lines].join("\n") + "\n";
}
