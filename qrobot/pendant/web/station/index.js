// The parts of the page by name.
import { makeBar } from "./bar.js";
import { makeTabs } from "./tabs.js";
import { link } from "./link.js";

const PARTS = { bar: makeBar, tabs: makeTabs };

export function mount(kind, element) {
  PARTS[kind](element);
}

window.pendant = link; // for tests, and for who looks with the browser's tools
