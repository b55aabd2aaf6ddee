// Frames of several videos that show the same moment.

import { changeAnchor, saveMarks } from "./actions.js";
import { changed, seek, view } from "./store.js";
import { element } from "./text.js";

let drawn = "";

const words = (frames) => Object.entries(frames).map(([id, frame]) => `${id} ${frame}`).join("  =  ");

export function drawAnchors(state) {
  const stamp = JSON.stringify([state.anchors, [...view.marks], state.videos.length]);
  if (stamp === drawn) return;
  drawn = stamp;
  const focused = document.activeElement?.dataset?.anchor;
  drawPending();
  const rows = state.anchors.map((anchor, n) => row(anchor, n));
  const hint = state.videos.length < 2 ? "There is one video only." : "Where videos show the same moment, mark it in two of them: the alignment follows. Nothing is needed if you have no such moment.";
  document.getElementById("anchor-list").replaceChildren(...(rows.length ? rows : [element("li", { class: "none", text: hint })]));
  if (focused) document.querySelector(`[data-anchor="${focused}"]`)?.focus({ preventScroll: true });
}

function drawPending() {
  const pending = document.getElementById("pending");
  pending.hidden = !view.marks.size;
  if (!view.marks.size) { pending.replaceChildren(); return; }
  const save = element("button", { type: "button", class: "main", id: "save-anchor", text: "Same moment" });
  save.disabled = view.marks.size < 2;
  save.addEventListener("click", saveMarks);
  const cancel = element("button", { type: "button", text: "Cancel" });
  cancel.addEventListener("click", () => { view.marks.clear(); changed(); });
  const text = words(Object.fromEntries(view.marks)) + (view.marks.size < 2 ? "  =  mark another video" : "");
  pending.replaceChildren(element("span", { text }), save, cancel);
}

function row(anchor, n) {
  const go = element("button", { type: "button", class: "go", "data-anchor": `go${n}`, text: `${n + 1}:  ${words(anchor.frames)}` });
  go.title = "Show these frames";
  go.addEventListener("click", () => { for (const [id, frame] of Object.entries(anchor.frames)) seek(id, frame, false); });
  const box = element("input", { type: "checkbox", "data-anchor": `hard${n}` });
  box.checked = anchor.hard;
  box.addEventListener("change", () => changeAnchor(n, box.checked));
  const label = element("label", {}, box, "exactly");
  const remove = element("button", { type: "button", text: "Remove", "aria-label": `Remove anchor ${n + 1}` });
  remove.addEventListener("click", () => changeAnchor(n, null));
  return element("li", {}, go, label, remove);
}
