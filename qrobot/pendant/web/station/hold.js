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
  button.addEventListener("blur", end); // for what else ends it see link.js
  button.addEventListener("pointermove", (event) => {
    if (event.buttons !== 1 && button.hasPointerCapture(event.pointerId)) end(); // another button of the mouse went down, or is left
  });
  button.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    begin();
  });
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  link.addEventListener("press", () => link.press === null && delete button.dataset.held);
  const show = () => setAttribute(button, "aria-disabled", String(!may()));
  for (const name of ["hello", "status", "chosen"]) link.addEventListener(name, show);
  show();
  return button;
}
