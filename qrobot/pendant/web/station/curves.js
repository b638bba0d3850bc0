// How curves of joints are drawn, live and of logs.
import { el } from "./dom.js";

export const COLOURS = ["#1f6fb2", "#d1601f", "#2b8a4a", "#a03a8c", "#7a5c1e", "#3c4a5c"];
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [1, 2]]; // no curve is told from others by colour alone

export const MARKS = { fault: "▲", mode: "●", law: "◆", gains: "◇" }; // no event is told from others by colour alone

// What happened, as lines with words in a picture of uPlot: a time of the picture is that of the event less the shift.
export function drawEvents(u, events, shift) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.font = `${Math.round(11 * devicePixelRatio)}px sans-serif`;
  ctx.textAlign = "left";
  ctx.setLineDash([3, 4]);
  let clear = -Infinity; // where the newest word ends
  for (const event of events) {
    const x = Math.round(u.valToPos(event.t - shift, "x", true));
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    ctx.strokeStyle = ctx.fillStyle = event.kind === "fault" ? "#b3261e" : "#5a6877";
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    if (x < clear) continue;
    const word = `${MARKS[event.kind] ?? "●"} ${event.short}`;
    ctx.fillText(word, x + 3, bbox.top + 12 * devicePixelRatio);
    clear = x + ctx.measureText(word).width + 8;
  }
  ctx.restore();
}

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
