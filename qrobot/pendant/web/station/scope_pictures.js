// What the scope shows: a stretch of time of one arm, from the samples of this page or from every cycle of its servo.
import { ask } from "./ask.js";

const INSTANTS = 1400; // of a picture; a narrower part of one that is kept is asked for again
export const QUANTITIES = ["error", "position", "setpoint", "velocity", "torque"];
const OF_SAMPLE = {
  error: (s, j) => s.setpoint[j] - s.q[j], position: (s, j) => s.q[j], setpoint: (s, j) => s.setpoint[j], velocity: (s, j) => s.v[j], torque: (s, j) => s.tau[j],
};

// Samples as they came over the wire. SI units; times are seconds on the servo's clock, as in a RingPicture.
export class WirePicture {
  constructor(states, modeOf, codeOf) {
    this.states = states;
    this.begin = states[0]?.t ?? 0;
    this.end = states.at(-1)?.t ?? 0;
    this.times = states.map((state) => state.t);
    this.events = [];
    for (let k = 1; k < states.length; k++) {
      const [before, now] = [states[k - 1], states[k]];
      if (now.event && now.event !== before.event) this.events.push({ t: now.t, kind: "fault", short: codeOf(now.event) });
      if (now.mode !== before.mode) this.events.push({ t: now.t, kind: "mode", short: modeOf(now) });
    }
  }

  curve(quantity, j) {
    return this.states.map((state) => OF_SAMPLE[quantity](state, j));
  }
}

// Cycles from the telemetry ring; where they are more than INSTANTS the smallest and largest of each instant.
export class RingPicture {
  static async look(arm, n, seconds, trigger = {}) {
    return RingPicture.from(await ask("scope/look", { arm, seconds, points: INSTANTS, ...trigger }), n);
  }

  static async kept(number, n, begin, end) {
    return RingPicture.from(await ask("scope/kept", { number, begin, end, points: INSTANTS }), n);
  }

  static async from(answer, n) {
    const data = await answer.arrayBuffer();
    const head = new DataView(data).getUint32(0, true);
    const told = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, head)));
    return new RingPicture(told, data.slice(4 + head), n);
  }

  constructor(told, data, n) {
    Object.assign(this, told); // begin, end, cycles, events, and of a look newest, triggered, whole, rate_hz
    this.n = n;
    this.columns = QUANTITIES.length * n;
    const m = data.byteLength / (8 + 12 * this.columns);
    const block = (k) => new Float32Array(data, 8 * m + 4 * this.columns * m * k, this.columns * m);
    Object.assign(this, { t: new Float64Array(data, 0, m), low: block(0), high: block(1) });
    this.exact = m === this.cycles;
    this.times = this.exact ? [...this.t] : [...this.t].flatMap((t) => [t, t]);
  }

  curve(quantity, j) {
    const column = QUANTITIES.indexOf(quantity) * this.n + j;
    const values = [];
    for (let i = 0; i < this.t.length; i++) {
      values.push(this.low[i * this.columns + column]);
      if (!this.exact) values.push(this.high[i * this.columns + column]);
    }
    return values;
  }
}
