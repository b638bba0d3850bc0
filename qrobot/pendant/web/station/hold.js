// A button that moves the arm for as long as it is held, by a finger, a mouse or the key Enter.
import { el, setAttribute } from "./dom.js";
import { link } from "./link.js";

// ask: what is to move, see link.hold; may: whether it can now.
export function holdButton(text, label, ask, may = () => link.ready) {
  const button = el("button", { class: "hold", type: "button", "aria-label": `${label}: hold` }, text);
  const begin = () => {
    const { target, name, ...extra } = ask();
    if (link.hold(target, name, extra)) button.dataset.held = "";
  };
  const end = () => {
    if (!("held" in button.dataset)) return;
    delete button.dataset.held;
    link.release();
  };
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    begin();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(name, end);
  button.addEventListener("keydown", (event) => event.key === "Enter" && !event.repeat && (event.preventDefault(), begin()));
  button.addEventListener("keyup", (event) => event.key === "Enter" && end());
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  link.addEventListener("press", () => link.press === null && delete button.dataset.held);
  const show = () => setAttribute(button, "aria-disabled", String(!may()));
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  show();
  return button;
}
