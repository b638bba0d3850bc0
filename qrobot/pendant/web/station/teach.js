// The tab Teach: places by name, recorded here and gone to while a button is held.
import { el } from "./dom.js";
import { holdButton } from "./hold.js";
import { link } from "./link.js";

export function makeTeach(root) {
  const list = el("div", { class: "rows places" });
  const name = el("input", { id: "place-name", "aria-label": "name of the place", placeholder: "name, without spaces", maxlength: "40", pattern: "[^\\s#]+" });
  const record = el("form", { class: "record" }, name, el("button", { id: "record" }, "Record where the arm is"));
  record.addEventListener("submit", (event) => {
    event.preventDefault();
    if (name.value) link.say({ do: "record", arm: link.chosen, name: name.value });
    name.value = "";
  });
  root.append(
    el("section", { class: "card" }, el("h2", {}, "Record"), record, el("p", { class: "hint" }, "Only the page that drives records. Programs read the file by DataBase(path).get(name).")),
    el("section", { class: "card" }, el("h2", {}, "Go to a place"), el("p", { class: "hint" }, "Hold the button: all joints move together, slowly; let go to stop."), list),
  );
  let known = "";
  const show = () => {
    const places = link.armStatus?.places ?? [];
    if (known === places.join("\n")) return;
    known = places.join("\n");
    list.replaceChildren(...places.map((place) => el("div", { class: "row" }, el("span", { class: "middle" }, place), holdButton("Hold to go", `to ${place}`, () => ({ target: "place", name: place, share: 1 })))));
  };
  for (const event of ["status", "chosen"]) link.addEventListener(event, show);
}
