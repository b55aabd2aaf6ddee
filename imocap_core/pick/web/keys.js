// Everything by keyboard.

import { byNumber, chooseNobody, drop, ignoreHere, mark, saveMarks, splitHere, startHere, stopHere } from "./actions.js";
import { step } from "./api.js";
import { changed, countOf, fpsOf, momentOf, seek, selectedVideo, store, view } from "./store.js";
import { play } from "./stage.js";
import { stepOf } from "./strip.js";
import { element } from "./text.js";

const KEYS = [
  ["← →", "one frame back, forward; with Shift ten"],
  ["Page Up, Page Down", "one second"],
  ["↑ ↓", "the video above, below"],
  ["1 … 9", "this person performs"],
  ["0", "the program decides who performs"],
  ["[ and ]", "the used frames start, end here"],
  ["S", "split the video here"],
  ["M", "mark the moment, then the same moment in another video"],
  ["X", "frames that match nothing begin here, then end here"],
  ["Enter", "these marks show the same moment"],
  ["Delete", "drop the video"],
  ["Ctrl+Z, Ctrl+Y", "undo, redo"],
  ["P", "play or pause"],
  ["F", "find people"],
  ["Tab", "every button, grip and person in turn"],
];

export function setUpKeys() {
  const list = document.getElementById("key-list");
  for (const [keys, text] of KEYS) list.append(element("dt", { text: keys }), element("dd", { text }));
  document.getElementById("keys").addEventListener("click", () => document.getElementById("help").showModal());
  document.addEventListener("keydown", (event) => {
    if (!store.state || document.querySelector("dialog[open]")) return;
    if (event.target.closest("input, select, textarea, summary") && !event.ctrlKey) return;
    if (handle(event)) event.preventDefault();
  });
}

function handle(event) {
  const video = selectedVideo();
  if (event.ctrlKey || event.metaKey) {
    const key = event.key.toLowerCase();
    if (key === "z") step(event.shiftKey ? "redo" : "undo");
    else if (key === "y") step("redo");
    return key === "z" || key === "y";
  }
  if (event.altKey || !video) return false;
  const moved = stepOf(event, momentOf(video), [0, countOf(video) - 1], fpsOf(video));
  if (moved !== null) { seek(video.id, moved); return true; }
  if (/^[1-9]$/.test(event.key)) { byNumber(video, Number(event.key)); return true; }
  const onButton = event.target.closest("button, a, .person");
  if (event.key === "Enter" && !onButton && view.marks.size > 1) { saveMarks(); return true; }
  const acts = {
    0: () => chooseNobody(video), "[": () => startHere(), "]": () => stopHere(), s: () => splitHere(), m: () => mark(), p: () => play(), x: () => ignoreHere(),
    Delete: () => drop(), f: () => document.getElementById("find").click(), "?": () => document.getElementById("help").showModal(),
    ArrowUp: () => move(-1), ArrowDown: () => move(1),
  };
  const act = acts[event.key] ?? acts[event.key.toLowerCase()];
  act?.();
  return Boolean(act);
}

function move(by) {
  const ids = store.state.videos.map((video) => video.id);
  const place = Math.max(0, Math.min(ids.length - 1, ids.indexOf(view.selected) + by));
  view.selected = ids[place];
  const card = document.querySelectorAll("#videos .video")[place];
  card?.scrollIntoView({ block: "nearest" });
  if (document.activeElement?.closest("#videos")) card?.querySelector(".moment").focus();
  changed();
}
