// The tabs of the page. All exist from the beginning; the one that is shown has the others hidden.
import { el, setAttribute } from "./dom.js";
import { makeBoard } from "./board.js";
import { makeCalibrate } from "./calibrate.js";
import { makeDrive } from "./drive.js";
import { link } from "./link.js";
import { makeLogs } from "./logs.js";
import { makePrograms } from "./programs.js";
import { makeScope } from "./scope.js";
import { makeTeach } from "./teach.js";

const TABS = [["drive", "Drive", makeDrive], ["scope", "Scope", makeScope], ["teach", "Teach", makeTeach], ["programs", "Programs", makePrograms], ["logs", "Logs", makeLogs], ["board", "Board", makeBoard], ["calibrate", "Calibrate, identify", makeCalibrate]];

export function makeTabs(root) {
  const buttons = {}, panes = {};
  const choose = (name) => {
    for (const [each] of TABS) {
      panes[each].hidden = each !== name;
      setAttribute(buttons[each], "aria-selected", String(each === name));
    }
    history.replaceState(null, "", `#${name}`);
  };
  for (const [name, title, make] of TABS) {
    buttons[name] = el("button", { role: "tab", id: `tab-${name}`, onclick: () => choose(name) }, title);
    panes[name] = el("main", { class: `pane pane-${name}`, role: "tabpanel", "aria-labelledby": `tab-${name}` });
    make(panes[name]);
  }
  root.append(el("nav", { class: "tabs", role: "tablist" }, ...Object.values(buttons)), ...Object.values(panes));
  const asked = location.hash.slice(1);
  choose(asked in panes ? asked : "drive");
  link.addEventListener("no arms", () => {
    for (const [each] of TABS) buttons[each].hidden = each !== "logs"; // what is left of a pendant without an arm
    choose("logs");
  });
}
