// The tab Logs: those of the deployment, one of them or two side by side, in three dimensions and as curves.
import { ask } from "./ask.js";
import { MARKS, boxes, saveFile } from "./curves.js";
import { el, setAttribute, setText } from "./dom.js";
import { LogCharts } from "./log_charts.js";
import { OpenLog } from "./open_log.js";
import { View } from "./view3d.js";

const LOOK_MS = 1500, READING_MS = 400;
const RATES = [["0.1", "a tenth"], ["0.5", "half"], ["1", "as it was"], ["4", "4 times"], ["20", "20 times"]];
const KINDS = { incident: "▲ incident", run: "run" };
const TYPING = "input:not([type=checkbox]):not([type=range]), textarea, select";

export function makeLogs(root) {
  const list = el("div", { class: "program-list", role: "listbox", "aria-label": "logs" });
  const where = el("p", { class: "hint" });
  const problem = el("p", { class: "problem", role: "alert", id: "log-problem", hidden: true });
  const about = el("p", { class: "hint", id: "log-about" });
  const events = el("div", { class: "program-list", role: "listbox", "aria-label": "events", id: "log-events" });
  const compared = el("select", { id: "log-other", "aria-label": "log to compare with" });
  const align = [0, 1].map((k) => el("select", { id: `log-align-${k}`, "aria-label": `instant of ${"AB"[k]} that is laid on that of the other`, onchange: () => laid() }));
  const scene = el("section", { class: "card replay-scene" });
  const legend = el("p", { class: "legend" });
  const play = el("button", { id: "log-play", "aria-keyshortcuts": "p", onclick: () => setPlaying(!playing) }, "▶ Play");
  const rate = el("select", { "aria-label": "speed of the replay" }, ...RATES.map(([value, text]) => el("option", { value }, text)));
  rate.value = "1";
  const slider = el("input", { type: "range", id: "log-instant", min: "0", max: "1", step: "any", "aria-label": "instant shown, s" });
  const instant = el("output", { class: "number", id: "log-time" });
  const nearer = el("button", { onclick: () => zoom(0.5), "aria-label": "shorter window" }, "+");
  const farther = el("button", { onclick: () => zoom(2), "aria-label": "longer window" }, "−");
  const all = el("button", { id: "log-whole", onclick: () => show(0, A.status.end) }, "Whole log");
  const save = el("button", { id: "log-export", onclick: () => exportCsv() }, "Export window (CSV)");
  const quantities = boxes(["error", "position", "setpoint", "velocity", "torque"].map((key) => [key, key, key === "error" || key === "position"]), () => build());
  const jointBox = el("fieldset", {});
  const plots = el("div", { class: "plots" });
  root.append(
    el("section", { class: "side" },
      el("div", { class: "card" }, el("h2", {}, "Logs"), el("div", { class: "buttons" }, el("button", { id: "log-list", onclick: () => lookAtList() }, "Look again")), where, list),
      el("div", { class: "card" }, el("h2", {}, "Compare"), el("div", { class: "options" }, el("label", {}, "B: ", compared), el("label", {}, "lay A's ", align[0]), el("label", {}, "on B's ", align[1]))),
      el("div", { class: "card" }, el("h2", {}, "Events"), events),
    ),
    el("section", { class: "program-right" }, problem, about, scene,
      el("div", { class: "card transport" }, play, rate, slider, instant, farther, nearer, all, save),
      el("div", { class: "card scope-options" }, el("fieldset", {}, el("legend", {}, "Quantities"), ...quantities.elements), jointBox),
      plots),
  );
  scene.append(legend);
  const charts = new LogCharts(plots, (begin, end) => show(begin, end), (t) => point(t));
  let view = null, A = null, B = null, shift = 0, joints = null, window_ = [0, 1], now = 0, playing = false, loads = 0, listed = false, known = "";

  const complain = (text) => {
    problem.hidden = !text;
    setText(problem, `✖ ${text}`);
  };
  const tried = async (does) => {
    try {
      const done = await does();
      return done === undefined ? true : done;
    } catch (error) {
      complain(error.message);
      setPlaying(false);
      return false;
    }
  };

  const lookAtList = () => tried(async () => {
    setText(where, "looking …");
    const told = await (await ask("logs")).json();
    setText(where, told.where.length ? told.where.join(", ") : "the log that was asked for");
    list.replaceChildren(...told.logs.map((log) => el("button", { role: "option", class: "entry", "data-name": log.name, title: log.name, onclick: () => open(log.name) },
      el("b", {}, log.title), el("span", {}, `${KINDS[log.kind]} · ${new Date(1000 * log.written).toLocaleString()} · ${size(log.bytes)} · ${log.seconds === null ? "not ended" : `${log.seconds.toFixed(1)} s`}`))));
    if (!told.logs.length) list.replaceChildren(el("p", { class: "hint" }, "No log yet: `qrobot up` and `qrobot log record` make them."));
    compared.replaceChildren(el("option", { value: "" }, "no other log"), ...told.logs.map((log) => el("option", { value: log.name }, log.title)));
    if (!listed && told.asked) open(told.asked);
    listed = true;
  });

  const open = (name) => tried(async () => {
    setPlaying(false);
    complain("");
    A = await OpenLog.open(name);
    root.dataset.open = "";
    B = null;
    shift = 0;
    compared.value = "";
    mark();
    joints = boxes(A.facts.joint_names.map((joint, j) => [j, `${j + 1} ${joint.replaceAll("_", " ")}`, true]), () => build());
    jointBox.replaceChildren(el("legend", {}, "Joints"), ...joints.elements);
    stage();
    now = 0;
    known = "";
    news();
    build();
    await show(0, Math.max(A.status.end, 0.01));
  });
  const compare = (name) => tried(async () => {
    complain("");
    B = name ? await OpenLog.open(name) : null;
    shift = 0;
    known = "";
    stage();
    news();
    build();
    await show(...window_);
  });
  compared.addEventListener("change", () => A && compare(compared.value));

  function laid() {
    const at = (select) => Number(select.value);
    shift = B ? at(align[1]) - at(align[0]) : 0;
    build();
    show(...window_);
  }

  function stage() {
    const drawn = [A, B].filter((log) => log?.facts.arm);
    if (!view && drawn.length) view = new View(scene);
    if (view) view.canvas.hidden = !drawn.length;
    if (drawn.length) view.setArms(drawn.map((log) => log.facts.arm));
    setText(legend, A.facts.arm ? `solid: measured · orange mesh: setpoint${B ? " · left A, right B" : ""}` : A.facts.why);
  }

  // What has been read by now.
  function news() {
    const { status, facts } = A;
    const parts = [`${facts.robot}, ${facts.rate_hz.toFixed(0)} Hz, law ${facts.law}, ${facts.clock}`, `${status.end.toFixed(3)} s`];
    if (status.share < 1) parts.push(`being read: ${(100 * status.share).toFixed(0)} %`);
    else if (!status.whole) parts.push("⚠ its writer did not end it: what was written is here");
    if (status.damaged) parts.push(`⚠ ${status.damaged} damaged place${status.damaged > 1 ? "s" : ""} left out`);
    setText(about, `${A.title}: ${parts.join(" · ")}${facts.incidents.map((line) => ` · ▲ ${line}`).join("")}`);
    slider.max = String(status.end);
    const text = JSON.stringify([status.events, B?.status.events]);
    if (text === known) return;
    known = text;
    const entry = (log, letter, less) => (event) => el("button", { role: "option", class: "entry", onclick: () => jump(event.t - less()) },
      el("b", {}, `${letter}${MARKS[event.kind] ?? "●"} ${event.t.toFixed(3)} s`), el("span", {}, event.text));
    events.replaceChildren(...status.events.map(entry(A, B ? "A " : "", () => 0)), ...(B ? B.status.events.map(entry(B, "B ", () => shift)) : []));
    if (status.more) events.append(el("p", { class: "hint" }, `and ${status.more} more: qrobot log events`));
    for (const [k, log] of [A, B].entries()) {
      const kept = align[k].value;
      align[k].replaceChildren(el("option", { value: "0" }, "start"), ...(log ? log.status.events.map((event) => el("option", { value: String(event.t) }, `${event.t.toFixed(3)} s ${event.short}`)) : []));
      align[k].value = [...align[k].options].some((option) => option.value === kept) ? kept : "0";
      align[k].disabled = !B;
    }
  }

  function mark() {
    for (const entry of list.querySelectorAll(".entry")) setAttribute(entry, "aria-selected", String(entry.dataset.name === A?.name));
  }

  function build() {
    if (!A) return;
    charts.build([{ log: A, shift: 0, letter: B ? "A" : "" }, ...(B ? [{ log: B, shift, letter: "B" }] : [])], quantities.chosen(), joints.chosen());
    charts.draw(...window_, now);
  }

  const show = (begin, end) => tried(async () => {
    const load = ++loads;
    window_ = [Math.max(begin, 0), Math.max(end, begin + 0.001)];
    await Promise.all([A.load(...window_), B?.load(window_[0] + shift, window_[1] + shift)]);
    if (load !== loads) return;
    charts.draw(...window_, now);
    point(now);
  });

  function zoom(factor) {
    if (!A) return;
    const width = Math.min((window_[1] - window_[0]) * factor, A.status.end);
    const begin = Math.min(Math.max(now - width / 2, 0), Math.max(A.status.end - width, 0));
    show(begin, begin + width);
  }

  function point(t) {
    if (!A) return;
    now = Math.min(Math.max(t, 0), A.status.end);
    slider.value = String(now);
    setText(instant, `${now.toFixed(3)} s`);
    charts.point(now);
    [A, B].filter((log) => log?.facts.arm).forEach((log, k) => {
      const q = log.at(now + (log === B ? shift : 0), "position");
      if (q) view.show(k, { q, setpoint: log.at(now + (log === B ? shift : 0), "setpoint") }, false);
    });
  }

  // To an instant, with the window around it when it is not in it.
  function jump(t) {
    point(t);
    const width = window_[1] - window_[0];
    if (now < window_[0] || now > window_[1]) show(Math.max(now - width / 2, 0), Math.max(now - width / 2, 0) + width);
  }

  function setPlaying(on) {
    if (playing === (on && A !== null)) return;
    playing = on && A !== null;
    setText(play, playing ? "‖ Pause" : "▶ Play");
    if (playing && now >= A.status.end) jump(0);
    let before = performance.now();
    const step = (time) => {
      if (!playing) return;
      const t = now + (Math.max(time - before, 0) / 1000) * Number(rate.value);
      before = time;
      jump(t);
      if (t >= A.status.end) setPlaying(false);
      else requestAnimationFrame(step);
    };
    if (playing) requestAnimationFrame(step);
  }

  const exportCsv = () => A && tried(async () => {
    complain("");
    const text = await (await ask("logs/csv", { name: A.name, begin: window_[0], end: window_[1] })).text();
    saveFile(text, A.title.replace(/\.mcap$/, ".csv"));
  });

  slider.addEventListener("input", () => (setPlaying(false), jump(Number(slider.value))));
  window.addEventListener("keydown", (event) => {
    if (root.hidden || !A || event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.(TYPING)) return;
    const step = (window_[1] - window_[0]) / 200, times = A.status.events.map((each) => each.t);
    if (event.key === "p") setPlaying(!playing);
    else if (event.key === "n") jump(times.find((t) => t > now + 1e-6) ?? now);
    else if (event.key === "N") jump(times.findLast((t) => t < now - 1e-6) ?? now);
    else if (event.key === "[") zoom(2);
    else if (event.key === "]") zoom(0.5);
    else if ((event.key === "ArrowLeft" || event.key === "ArrowRight") && event.target !== slider) jump(now + (event.key === "ArrowRight" ? step : -step));
  });
  const look = async () => {
    if (!root.hidden && !listed) await lookAtList();
    if (!root.hidden && A) {
      const [a, b] = [A, B], ends = [a.status.end, b?.status.end], whole = window_[0] === 0 && window_[1] >= ends[0];
      if (await tried(() => Promise.all([a.look(), b?.look()]))) news();
      const same = a === A && b === B; // none was opened meanwhile
      if (same && whole && a.status.end > ends[0]) await show(0, a.status.end);
      else if (same && b?.status.end > ends[1]) await show(...window_);
    }
    setTimeout(look, [A, B].some((log) => log?.status.share < 1) ? READING_MS : LOOK_MS);
  };
  setTimeout(look, 0);
  new MutationObserver(() => !root.hidden && !listed && lookAtList()).observe(root, { attributeFilter: ["hidden"] });
}

function size(bytes) {
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
