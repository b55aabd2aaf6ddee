// What is declared of the timing beside same moments: one event, and frames that match nothing.

import { matchAgain, setEvent } from "./actions.js";
import { seek } from "./store.js";
import { element } from "./text.js";

const get = (id) => document.getElementById(id);
let drawn = "";

export function setUpIgnored() {
  get("event").addEventListener("change", (event) => setEvent(event.target.checked));
}

export function drawIgnored(state) {
  get("event").checked = state.event;
  get("event-line").hidden = state.videos.length < 2 && !state.event;
  const stamp = JSON.stringify(state.forbidden);
  if (stamp === drawn) return;
  drawn = stamp;
  get("ignored").hidden = !state.forbidden.length;
  get("ignored-list").replaceChildren(...state.forbidden.map(row));
}

function row({ video, frames: [first, stop] }, n) {
  const go = element("button", { type: "button", class: "go", text: `${video}:  frames ${first}–${stop - 1}` });
  go.title = "Show the first of them";
  go.addEventListener("click", () => seek(video, first));
  const remove = element("button", { type: "button", text: "Remove", "aria-label": `Let frames ${first} to ${stop - 1} of ${video} match again` });
  remove.addEventListener("click", () => matchAgain(n));
  return element("li", {}, go, remove);
}
