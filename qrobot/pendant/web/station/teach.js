// The tab Teach: places by name, recorded here, edited by their numbers, and gone to while a button is held.
import { el } from "./dom.js";
import { holdButton } from "./hold.js";
import { link } from "./link.js";

const NUMBERS = [["x", "mm"], ["y", "mm"], ["z", "mm"], ["roll", "°"], ["pitch", "°"], ["yaw", "°"]];
const PAUSE_MS = 500;
const NAME = { maxlength: "40", pattern: "[^\\s#]+", required: true };

export function makeTeach(root) {
  const list = el("div", { class: "rows places" });
  const name = el("input", { id: "place-name", "aria-label": "name of the place", placeholder: "name, without spaces", ...NAME });
  const press = el("button", { id: "record" });
  const record = el("form", { class: "record" }, name, press);
  const RECORD = "Record where the arm is";
  const begin = () => ((press.textContent = RECORD), delete press.dataset.over);
  let asked = 0; // ms: the second click of a double one, and Enter that is held down, answer nothing
  record.addEventListener("submit", (event) => {
    event.preventDefault();
    const given = name.value;
    const there = Object.hasOwn(link.armStatus?.taught ?? {}, given);
    if (there && (press.dataset.over !== given || performance.now() - asked < PAUSE_MS)) { // or it would be lost
      if (press.dataset.over !== given) asked = performance.now();
      press.dataset.over = given;
      press.textContent = `Really record over ${given}`;
      return;
    }
    link.say({ do: "record", arm: link.chosen, name: given });
    name.value = "";
    begin();
  });
  name.addEventListener("input", begin);
  begin();
  root.append(
    el("section", { class: "card" }, el("h2", {}, "Record"), record, el("p", { class: "hint" }, "Only the page that drives records and edits. Programs read the file by DataBase(path).get(name).")),
    el("section", { class: "card" }, el("h2", {}, "Places"), el("p", { class: "hint" }, "Hold Go: all joints move together, slowly; let go to stop."), list),
  );
  let known = "", edited = "", open = { of: "", form: null }; // the editor, and which numbers of which arm it began with
  const show = () => {
    if (!link.armStatus) return; // a short loss of the connection takes nothing away
    const { places, taught } = link.armStatus;
    const now = JSON.stringify([link.chosen, places, taught, edited]);
    if (known === now) return;
    known = now;
    const of = JSON.stringify([link.chosen, edited, taught[edited]]);
    if (open.of !== of) open = { of, form: taught[edited] ? editor(edited, taught[edited]) : null };
    fill(places.flatMap((place) => row(place, taught[place])), open.form);
  };
  // Show these rows; `kept`, one of them, stays where it is, with what is being typed into it.
  const fill = (rows, kept) => {
    for (const each of [...list.children]) if (each !== kept) each.remove();
    if (kept?.parentNode !== list) return list.append(...rows);
    kept.before(...rows.slice(0, rows.indexOf(kept)));
    kept.after(...rows.slice(rows.indexOf(kept) + 1));
  };
  const edit = (place) => ((edited = place), show());

  function row(place, numbers) {
    const goes = holdButton("Go", `to ${place}`, () => ({ target: "place", name: place, share: 1 }));
    const told = numbers ? numbers.map((number) => number.toFixed(1)).join("  ") : "pose of the robot";
    const line = el("div", { class: "row" }, el("span", { class: "middle" }, place, el("small", { class: "numbers" }, told)), numbers ? el("button", { class: "edit", "aria-label": `edit ${place}`, onclick: () => edit(edited === place ? "" : place) }, "Edit") : null, goes);
    return numbers && edited === place ? [line, open.form] : [line];
  }

  function editor(place, numbers) {
    const arm = link.chosen; // whose place it is
    const ask = (message) => {
      if (!link.open) return; // it would be lost, and what was typed with it
      link.say({ arm, ...message });
      edit("");
    };
    const title = el("input", { "aria-label": "name", value: place, ...NAME });
    const cells = numbers.map((number, k) => el("input", { type: "number", step: "any", required: true, value: String(number), "aria-label": `${NUMBERS[k][0]}, ${NUMBERS[k][1]}` }));
    const remove = el("button", { type: "button", onclick: () => (remove.dataset.on === undefined ? ((remove.dataset.on = ""), (remove.textContent = "Really delete")) : ask({ do: "remove", name: place })) }, "Delete");
    const form = el("form", { class: "place-editor" }, el("label", {}, "name ", title), ...cells.map((cell, k) => el("label", {}, `${NUMBERS[k].join(", ")} `, cell)), el("div", { class: "buttons" }, el("button", {}, "Save"), el("button", { type: "button", onclick: () => edit("") }, "Cancel"), remove));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      ask({ do: "place", name: title.value, numbers: cells.map((cell) => Number(cell.value)), instead: place });
    });
    return form;
  }

  link.addEventListener("status", show);
  link.addEventListener("chosen", () => (edit(""), begin()));
}
