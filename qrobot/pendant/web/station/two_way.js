// A button with two meanings, of which one gives the arm more than it has: takes it, lets it go on.
import { el } from "./dom.js";

const SETTLED_MS = 1000; // [A] a finger that was under way when the meaning changed has arrived

// act(more): asks for what the button showed when it went down. Returns the button, and show(more, may): what it means now, and whether it can be pressed.
export function twoWayButton(attributes, act) {
  const button = el("button", attributes);
  let means = null, since = -Infinity, down = null;
  button.addEventListener("pointerdown", () => (down = means));
  button.addEventListener("keydown", (event) => {
    if (!event.repeat) down = means;
    else if (event.key === "Enter") event.preventDefault(); // the browser would click once more
  });
  button.addEventListener("click", () => {
    const asked = down ?? means;
    down = null;
    if (!asked || means) act(asked); // what gives more no longer, once the button has another meaning
  });
  const show = (more, may) => {
    if (means !== null && more !== means) since = performance.now();
    means = more;
    button.disabled = !may || (more && performance.now() - since < SETTLED_MS);
  };
  return { button, show };
}
