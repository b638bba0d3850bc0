// A log at the pendant, read by windows: never the whole file in the page.
import { ask } from "./ask.js";

const INSTANTS = 700; // of a window; the pictures are hardly wider

export class OpenLog {
  static async open(name) {
    const facts = await (await ask("logs/begin", { name })).json();
    const log = new OpenLog(name, facts);
    await log.look();
    return log;
  }

  constructor(name, facts) {
    this.name = name;
    this.title = name.split("/").at(-1);
    this.facts = facts;
    this.n = facts.joint_names.length;
    this.status = { share: 0, end: 0, events: [], damaged: 0, whole: true, more: 0 };
    this.curves = null; // {t, low, high, first}: column k * n + j is quantity k of joint j
  }

  // How much of it has been read by now, and what happened in it.
  async look() {
    this.status = await (await ask("logs/facts", { name: this.name })).json();
  }

  async load(begin, end) {
    const data = await (await ask("logs/curves", { name: this.name, begin, end, points: INSTANTS })).arrayBuffer();
    const columns = this.facts.quantities.length * this.n;
    const m = data.byteLength / (8 + 12 * columns);
    const block = (k) => new Float32Array(data, 8 * m + 4 * columns * m * k, columns * m);
    this.curves = { t: new Float64Array(data, 0, m), low: block(0), high: block(1), first: block(2), columns };
  }

  // Number of the newest instant not after t, -1 when nothing is loaded.
  indexAt(t) {
    if (!this.curves || !this.curves.t.length) return -1;
    const { t: times } = this.curves;
    let low = 0, high = times.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle;
      else high = middle;
    }
    return low;
  }

  // One quantity of all joints at t, SI units.
  at(t, quantity) {
    const i = this.indexAt(t);
    if (i < 0) return null;
    const from = i * this.curves.columns + this.facts.quantities.indexOf(quantity) * this.n;
    return this.curves.first.subarray(from, from + this.n);
  }

  // Times and values of one curve for uPlot: smallest and largest of each instant one after the other.
  curve(quantity, j, scale) {
    const { t, low, high, columns } = this.curves;
    const column = this.facts.quantities.indexOf(quantity) * this.n + j;
    const values = new Float64Array(2 * t.length);
    for (let i = 0; i < t.length; i++) {
      values[2 * i] = scale(low[i * columns + column]);
      values[2 * i + 1] = scale(high[i * columns + column]);
    }
    return values;
  }

  times(shift) {
    const made = new Float64Array(2 * this.curves.t.length);
    this.curves.t.forEach((t, i) => (made[2 * i] = made[2 * i + 1] = t - shift));
    return made;
  }
}
