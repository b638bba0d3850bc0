// Two cursors of the scope: instants that are read off, and what lies between them.
import { COLOURS } from "./curves.js";
import { el, setAttribute } from "./dom.js";

const NAMES = ["A", "B"];

export class Cursors {
  constructor(changed) {
    this.at = [null, null]; // times as in the picture, s
    this.next = null; // which one the next tap places
    this.changed = changed;
    this.buttons = NAMES.map((name, k) => el("button", { id: `cursor-${name}`, "aria-pressed": "false", onclick: () => this.choose(k) }, `Cursor ${name}`));
    this.none = el("button", { id: "cursors-off", onclick: () => this.clear() }, "No cursors");
    this.told = el("table", { class: "registers cursors", id: "cursors", hidden: true });
  }

  get elements() {
    return [...this.buttons, this.none];
  }

  choose(k) {
    this.next = this.next === k ? null : k;
    this.buttons.forEach((button, at) => {
      setAttribute(button, "aria-pressed", String(at === this.next));
      setAttribute(button, "data-on", at === this.next);
    });
  }

  // A tap on a picture at this time; the other cursor is next.
  place(t) {
    if (this.next === null) return;
    this.at[this.next] = t;
    if (this.at.includes(null)) this.choose(1 - this.next);
    this.changed();
  }

  clear() {
    this.at = [null, null];
    if (this.next !== null) this.choose(this.next);
    this.changed();
  }

  drawOn(u, shift) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.font = `bold ${Math.round(12 * devicePixelRatio)}px sans-serif`;
    ctx.textAlign = "left";
    ctx.strokeStyle = ctx.fillStyle = "#17212c";
    this.at.forEach((t, k) => {
      if (t === null) return;
      const x = Math.round(u.valToPos(t - shift, "x", true));
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.setLineDash(k ? [6, 3] : []);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.fillText(NAMES[k], x + 3, bbox.top + bbox.height - 4 * devicePixelRatio);
    });
    ctx.restore();
  }

  // rows: [{title, joint, times, values}], values as they are shown
  show(rows, shift) {
    this.told.hidden = this.at.every((t) => t === null);
    if (this.told.hidden) return;
    const [a, b] = this.at;
    const both = a !== null && b !== null;
    const seconds = (t) => (t === null ? "—" : `${(t - shift).toFixed(5)} s`);
    const cell = (text) => el("td", { class: "number" }, text);
    const made = [el("tr", {}, el("th", {}, both && a !== b ? `B − A is ${(1 / Math.abs(b - a)).toPrecision(4)} Hz` : ""), ...["A", "B", "B − A"].map((name) => el("th", {}, name)))];
    made.push(el("tr", {}, el("th", {}, "time"), cell(seconds(a)), cell(seconds(b)), cell(both ? `${(b - a).toFixed(5)} s` : "—")));
    for (const { title, joint, times, values } of rows) {
      const [va, vb] = [a, b].map((t) => (t === null ? null : values[nearest(times, t)] ?? null));
      const shown = (v) => (v === null ? "—" : v.toPrecision(5));
      made.push(el("tr", {}, el("th", { style: `color:${COLOURS[joint % COLOURS.length]}` }, title), cell(shown(va)), cell(shown(vb)), cell(va !== null && vb !== null ? shown(vb - va) : "—")));
    }
    const text = made.map((row) => row.textContent).join("|");
    if (this.told.dataset.text === text) return;
    this.told.dataset.text = text;
    this.told.replaceChildren(...made);
  }
}

// Index of the time that is nearest to t; times ascend.
export function nearest(times, t) {
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return high > 0 && Math.abs(times[high] - t) < Math.abs(times[low] - t) ? high : low;
}
