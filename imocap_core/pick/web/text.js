// Numbers and names in words.

import { countOf, fpsOf, spanOf } from "./store.js";

export const COLOURS = ["#ffd23f", "#4cc9f0", "#ff8fb8", "#7ae582", "#c9a8ff", "#ffa05c"];
export const colourOf = (number) => COLOURS[(number - 1) % COLOURS.length];

export function seconds(video, frame) {
  const time = frame / fpsOf(video);
  const minutes = Math.floor(time / 60);
  return minutes ? `${minutes}:${(time - 60 * minutes).toFixed(2).padStart(5, "0")}` : `${time.toFixed(2)} s`;
}

export function usedText(video) {
  const [first, stop] = spanOf(video);
  const all = first === 0 && stop === countOf(video);
  const frames = all ? `all ${stop - first} frames` : `frames ${first}–${stop - 1} of ${countOf(video)}`;
  return `${frames} · ${((stop - first) / fpsOf(video)).toFixed(1)} s`;
}

/** An element with a class, a text and children. */
export function element(name, { text, ...attributes } = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  made.append(...children);
  return made;
}

/** Set a text only where it differs, so that nothing is read out twice. */
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
