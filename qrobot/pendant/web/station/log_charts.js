// Curves of one or two logs below each other, with events, a line at the instant shown, and a window that is drawn with the mouse.
import { el } from "./dom.js";
import { shown } from "./kinematics.js";
import { COLOURS, DASHES, drawEvents, lengthOrAngle, spread } from "./curves.js";

const HEIGHT = 190;

export class LogCharts {
  constructor(root, onWindow, onInstant) {
    Object.assign(this, { root, onWindow, onInstant, charts: [] });
    new ResizeObserver(() => this.charts.forEach(({ plot, box }) => box.clientWidth && plot.setSize({ width: box.clientWidth - 8, height: HEIGHT }))).observe(root);
  }

  // logs: [{log, shift, letter}]; a time of the page is that of the log less its shift.
  build(logs, quantities, joints) {
    this.charts.forEach(({ plot, box }) => (plot.destroy(), box.remove()));
    this.charts = [];
    for (const quantity of quantities) for (const entry of logs) this.charts.push(this.chart(entry, quantity, joints));
  }

  chart(entry, quantity, joints) {
    const { facts } = entry.log;
    const unit = quantity === "torque" ? (facts.prismatic.some(Boolean) ? "N m, N" : "N m") : `${lengthOrAngle(facts)}${quantity === "velocity" ? "/s" : ""}`;
    const box = el("div", { class: "card plot" });
    this.root.append(box);
    const series = joints.filter((j) => j < entry.log.n).map((j) => ({ label: facts.joint_names[j], stroke: COLOURS[j % COLOURS.length], dash: DASHES[j % DASHES.length], width: 1.5, points: { show: false }, value: (_, v) => (v == null ? "—" : v.toPrecision(4)) }));
    const head = document.createElement("div");
    const plot = new uPlot(
      {
        width: Math.max(box.clientWidth - 8, 300), height: HEIGHT, title: `${entry.letter ? `${entry.letter}: ` : ""}${quantity} (${unit})`,
        cursor: { sync: { key: "log" }, drag: { x: true, setScale: false } },
        scales: { x: { time: false, range: () => this.window ?? [0, 1] }, y: { range: (_, low, high) => spread(low, high) } },
        axes: [{ label: "s", labelSize: 18 }, { size: 64 }],
        series: [{ label: "s", value: (_, v) => (v == null ? "—" : v.toFixed(4)) }, ...series],
        hooks: {
          draw: [(u) => drawEvents(u, entry.log.status.events, entry.shift)],
          setSelect: [(u) => {
            if (u.select.width > 4) this.onWindow(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
        },
      },
      [[], ...series.map(() => [])], box,
    );
    head.className = "playhead";
    plot.over.append(head);
    plot.over.addEventListener("click", () => plot.cursor.left >= 0 && this.onInstant(plot.posToVal(plot.cursor.left, "x")));
    return { plot, box, head, entry, quantity, joints: joints.filter((j) => j < entry.log.n) };
  }

  draw(begin, end, instant) {
    this.window = [begin, end];
    for (const { plot, entry, quantity, joints } of this.charts) {
      if (!entry.log.curves) continue;
      const scale = (j) => (quantity === "torque" ? (v) => v : (v) => shown(entry.log.facts, j, v));
      plot.setData([entry.log.times(entry.shift), ...joints.map((j) => entry.log.curve(quantity, j, scale(j)))]);
    }
    this.point(instant);
  }

  point(instant) {
    for (const { plot, head } of this.charts) head.style.left = `${plot.valToPos(instant, "x")}px`;
  }
}
