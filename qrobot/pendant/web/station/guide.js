// Leading the arm by hand: a button that is held while it follows, places that are kept on the way, and the recording.
import { el, setAttribute, setText } from "./dom.js";
import { holdButton } from "./hold.js";
import { link } from "./link.js";
import { twoWayButton } from "./two_way.js";

const SMOOTH = [["0", "as it was"], ["1", "within 1 mm"], ["3", "within 3 mm"], ["10", "within 10 mm"]];

export function guideCard() {
  const say = (message) => link.say({ arm: link.chosen, ...message });
  const { button: take, show: showTake } = twoWayButton({ id: "guide-take" }, (on) => link.order({ do: "command", arm: link.chosen, on, guide: true }));
  const lead = holdButton("Hold to lead", "lead the arm by hand", () => ({ target: "guide", name: "hand" }), () => link.leading);
  lead.id = "guide-hold";
  const keepPlace = el("button", { id: "guide-place", onclick: () => say({ do: "record", name: freeName() }) });
  const smooth = el("select", { id: "guide-smooth", "aria-label": "smoothing of the recording" }, ...SMOOTH.map(([value, text]) => el("option", { value }, text)));
  smooth.value = "3";
  const write = el("button", { id: "guide-write", onclick: () => say({ do: "led", keep: true, smooth_mm: Number(smooth.value) }) }, "Write the recording");
  const forget = el("button", { id: "guide-forget", onclick: () => say({ do: "led", keep: false }) }, "Forget it");
  const told = el("p", { class: "hint", id: "guide-told" });
  const taken = () => link.armStatus?.guide && link.armStatus.session !== "no";

  // P1, P2 and so on, as `qrobot guide` names them.
  function freeName() {
    const places = link.armStatus?.places ?? [];
    let number = 1;
    while (places.includes(`P${number}`)) number += 1;
    return `P${number}`;
  }

  const show = () => {
    const status = link.armStatus, state = link.arm && link.fresh(link.arm) ? link.arm.state : null;
    const session = status?.session ?? "no", led = status?.led ?? [], writes = status?.writes;
    const idle = link.driving && session === "no";
    const takes = session === "no" && state && ["HOLDING", "OFF"].includes(link.modeOf(state));
    showTake(!taken(), link.driving && state && (taken() || takes));
    setText(take, !taken() ? "Take it to lead" : session === "ready" ? "Let go of the arm" : "taking …");
    setAttribute(take, "data-on", taken() && session === "ready");
    keepPlace.disabled = !link.driving || !state;
    setText(keepPlace, `Keep this place as ${freeName()}`);
    write.disabled = forget.disabled = !idle || !led.length || writes;
    setText(write, writes ? "writing …" : "Write the recording");
    const seconds = led.reduce((sum, each) => sum + each, 0).toFixed(1);
    const recorded = led.length ? `Recorded: ${led.length} ${led.length === 1 ? "press" : "presses"}, ${seconds} s. ${session === "no" ? "" : "Let go of the arm to write it."}` : "";
    setText(told, link.leading ? `Hold the button with one hand and lead with the other one: it carries its weight, and is slower than 250 mm/s. ${recorded}` : recorded);
    told.hidden = !told.textContent;
  };
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  setInterval(show, 200);
  return el("div", { class: "card" }, el("h2", {}, "Lead by hand"), el("div", { class: "buttons" }, take, lead, keepPlace), told, el("div", { class: "buttons" }, smooth, write, forget));
}
