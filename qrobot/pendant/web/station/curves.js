// How curves of joints are drawn, live and of logs.
import { el } from "./dom.js";

export const COLOURS = ["#1f6fb2", "#d1601f", "#2b8a4a", "#a03a8c", "#7a5c1e", "#3c4a5c"];
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [1, 2]]; // no curve is told from others by colour alone

export function lengthOrAngle(facts) {
  return facts.prismatic.some(Boolean) ? "°, mm" : "°";
}

// Ends of an axis: some room at both sides, and never so near that noise fills the picture.
export function spread(low, high) {
  if (low === null || high === null) return [-1, 1];
  const room = Math.max(0.08 * (high - low), 0.02);
  return [low - room, high + room];
}

export function boxes(entries, changed) {
  const made = entries.map(([key, title, on]) => ({ key, box: el("input", { type: "checkbox", checked: on, onchange: () => changed() }), title }));
  return { elements: made.map(({ box, title }) => el("label", {}, box, ` ${title}`)), chosen: () => made.filter(({ box }) => box.checked).map(({ key }) => key) };
}

export function saveFile(text, name) {
  const anchor = el("a", { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: name });
  anchor.click();
  URL.revokeObjectURL(anchor.href);
}
