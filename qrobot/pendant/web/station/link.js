// The connection of this page to the pendant: samples of the arms, what has changed, and what is asked for.
import { setAttribute } from "./dom.js";

const HEAD_BYTES = 24;
const BEAT_MS = 50; // a button that is held is told of so often; see held_press.py
const ALIVE_MS = 1000;
const RETRY_MS = 500;
const QUIET_LOOKS = 5; // of RETRY_MS without a word, which the pendant says each second at least: it does not answer
const ANSWER_MS = 700; // a STOP is read by then
const AGAIN_MS = 10000; // a STOP that was not read is said again for so long
const STALE_MS = 500; // without a sample for so long the picture is old
const KEEP = 2200; // samples, a minute at 28 ms

class Link extends EventTarget {
  constructor() {
    super();
    this.arms = []; // {facts, state, at, history}
    this.words = { modes: {}, codes: {} };
    this.status = null;
    this.page = 0;
    this.chosen = 0; // number of the arm that the page is about
    this.open = false;
    this.press = null; // {arm, number} while a button is held
    this.presses = 0;
    this.quiet = 0; // looks since the pendant was heard of
    this.stops = 0; // said on this connection
    this.unread = null; // {since, at, said}: first and newest of the STOPs that the pendant has not read; said on this connection
    this.connect();
    setInterval(() => (this.quiet += 1) > QUIET_LOOKS && this.lose(), RETRY_MS);
    setInterval(() => this.say({ do: "alive" }), ALIVE_MS);
    setInterval(() => this.beat(), BEAT_MS);
  }

  connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.stops = 0;
      if (this.unread && performance.now() - this.unread.at < AGAIN_MS) this.sayStop();
    };
    socket.onmessage = (event) => {
      this.quiet = 0;
      typeof event.data === "string" ? this.hear(JSON.parse(event.data)) : this.sample(event.data);
    };
    socket.onclose = () => this.lose();
    this.socket = socket;
    this.quiet = 0;
  }

  // The connection is closed, or open and silent, as a tunnel that hangs leaves it: begin anew.
  lose() {
    this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.quiet = 0;
    this.open = false;
    this.press = null;
    this.status = null;
    if (this.unread) this.unread.said = false;
    this.tell("press");
    this.tell("status");
    setTimeout(() => this.connect(), RETRY_MS);
  }

  tell(name) {
    this.dispatchEvent(new Event(name));
  }

  // Say something if there is a connection; whether there is.
  say(message) {
    const open = this.socket.readyState === WebSocket.OPEN;
    if (open) this.socket.send(JSON.stringify(message));
    return open;
  }

  // Say something that may move the arm: when it comes late it does not count.
  order(message) {
    return this.say({ ...message, heard_s: this.arms[message.arm]?.state?.t ?? null });
  }

  hear(message) {
    if (message.page) {
      this.page = message.page;
      this.presses = 0;
      this.words = { modes: message.modes, codes: message.codes };
      this.arms = message.arms.map((facts) => ({ facts, state: null, at: -Infinity, history: [] }));
      this.chosen = Math.max(0, Math.min(this.chosen, this.arms.length - 1));
      this.open = true;
      setAttribute(document.body, "data-no-arms", !this.arms.length);
      this.tell(this.arms.length ? "hello" : "no arms");
    } else {
      this.status = message;
      if (this.unread?.said && message.stops >= this.stops) this.unread = null;
      this.tell("status");
    }
  }

  sample(data) {
    const view = new DataView(data);
    const arm = this.arms[view.getUint8(1)];
    if (!arm) return;
    const n = arm.facts.joints.length;
    const row = (k) => new Float32Array(data, HEAD_BYTES + 4 * n * k, n);
    const state = {
      mode: view.getUint8(2), hand: view.getUint8(3), fault: view.getUint16(4, true), event: view.getUint16(6, true),
      joint: view.getInt16(8, true), override: view.getUint16(10, true) / 1000, flags: view.getUint32(12, true), t: view.getFloat64(16, true),
      q: row(0), setpoint: row(1), v: row(2), tau: row(3),
    };
    if (arm.state && state.t < arm.state.t) arm.history.length = 0; // another servo
    arm.state = state;
    arm.at = performance.now();
    arm.history.push(state);
    if (arm.history.length > KEEP + 200) arm.history.splice(0, 200);
    this.tell("sample");
  }

  get arm() {
    return this.arms[this.chosen];
  }

  get armStatus() {
    return this.status ? this.status.arms[this.chosen] : null;
  }

  // Choose the arm that the page is about; whatever is held is let go.
  choose(k) {
    if (k === this.chosen || !this.arms[k]) return;
    this.release();
    this.chosen = k;
    this.tell("chosen");
  }

  // Whether this page drives the arm that it is about. Each arm has a lease of its own.
  get driving() {
    return this.open && this.armStatus !== null && this.armStatus.driver === this.page;
  }

  // The buttons that move the arm do.
  get ready() {
    return this.driving && this.armStatus.session === "ready" && !this.armStatus.guide;
  }

  // The arm follows a hand while the button for it is held.
  get leading() {
    return this.driving && this.armStatus.session === "ready" && this.armStatus.guide;
  }

  fresh(arm) {
    return this.open && performance.now() - arm.at < STALE_MS;
  }

  modeOf(state) {
    return this.words.modes[state.mode] ?? `MODE ${state.mode}`;
  }

  // ------------------------------------------------------------------------------------------------ what moves the arm

  stop() {
    this.release();
    const at = performance.now();
    this.unread = { since: this.unread?.since ?? at, at, said: false };
    this.sayStop();
    this.tell("stop");
  }

  sayStop() {
    this.unread.said = this.say({ do: "stop" });
    if (this.unread.said) this.stops += 1;
  }

  // A STOP was pressed here, and the pendant is not known to have read it.
  get stopLost() {
    return this.unread !== null && (!this.unread.said || performance.now() - this.unread.since > ANSWER_MS);
  }

  // Keep the lease although another page asks for it.
  keep() {
    this.say({ do: "take", arm: this.chosen });
  }

  // Take the lease of the arm, or ask the page that has it; or give it up.
  drive(more) {
    this.say({ do: more ? "take" : "give", arm: this.chosen });
  }

  hold(target, name, extra) {
    if (!(target === "guide" ? this.leading : this.ready) || !this.fresh(this.arm)) return false;
    this.release();
    this.presses += 1;
    this.press = { arm: this.chosen, number: this.presses };
    this.order({ do: "press", ...this.press, target, name, ...extra });
    this.tell("press");
    return true;
  }

  beat() {
    if (this.press) this.order({ do: "beat", ...this.press });
  }

  release() {
    if (!this.press) return;
    this.press = null;
    this.say({ do: "release" });
    this.tell("press");
  }

  act(name) {
    this.order({ do: "act", arm: this.chosen, name });
  }
}

export const link = new Link();

// However the page loses what is held, the arm is let go. Any key that goes up ends it, for "." goes up as ">" when Shift went down meanwhile;
// and anything else that goes down, for beside Cmd, or in a menu, the key that is held goes up unseen.
const ENDS = ["keyup", "pointerdown", "pointerup", "pointercancel", "lostpointercapture", "pagehide"];
for (const name of ENDS) window.addEventListener(name, () => link.release(), { capture: true });
window.addEventListener("keydown", (event) => event.repeat || link.release(), { capture: true });
window.addEventListener("blur", () => link.release());
document.addEventListener("visibilitychange", () => document.hidden && link.release());
