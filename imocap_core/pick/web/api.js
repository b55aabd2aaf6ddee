// Requests to the server: the state again and again, and changes one after the other.

import { loadOutlines, setState, store } from "./store.js";
import { tell } from "./toast.js";

const BUSY_MS = 300, IDLE_MS = 2000;
let queue = Promise.resolve();
let ended = false, pending = 0, timer = 0;

async function answerOf(promise) {
  const answer = await promise;
  const document = await answer.json();
  if (!answer.ok) throw new Error(document.error ?? `the server answered ${answer.status}`);
  return document;
}

function take(state) {
  const before = store.state;
  setState(state);
  loadOutlines(state).catch(() => {});
  return before;
}

function isBusy(state) {
  return (
    state.detection.state === "running" || (!state.plan && !state.fault) ||
    state.files.some((file) => file.count === undefined && !file.fault) ||
    state.videos.some((video) => video.people.state === "waiting")
  );
}

async function ask() {
  const before = store.state;
  const state = await answerOf(fetch("state", { cache: "no-store" }));
  if (pending) return; // a change is on its way and brings a newer state
  take(state);
  if (before?.revision && state.revision && before.revision !== state.revision) {
    tell("action.yaml was changed by another program. This is its new content.");
  }
  const ran = before?.detection.state === "running";
  if (ran && state.detection.state === "done") tell("People are outlined. Click who performs.");
  if (ran && state.detection.state === "failed") tell(state.detection.text, { bad: true });
}

export async function poll() {
  clearTimeout(timer);
  if (ended) return;
  try {
    if (!document.hidden || !store.state) await ask();
    document.body.classList.remove("alone");
  } catch (error) {
    if (!ended) tell("imocap pick has ended, or does not answer: start it again.", { bad: true });
  }
  timer = setTimeout(poll, store.state && isBusy(store.state) ? BUSY_MS : IDLE_MS);
}

async function send(path, body) {
  pending += 1;
  try {
    const headers = { "Content-Type": "application/json" };
    take(await answerOf(fetch(path, { method: "POST", headers, body: JSON.stringify(body()) })));
    return true;
  } catch (error) {
    tell(error.message, { bad: true });
    return false;
  } finally {
    pending -= 1;
    poll();
  }
}

/** A change, after those before it; whether it was made. `body` is asked when its turn comes. */
function post(path, body) {
  const sent = queue.then(() => send(path, body));
  queue = sent;
  return sent;
}

export async function edit(edits, message) {
  const made = await post("edit", () => ({ revision: store.state.revision ?? "", edits }));
  if (made && message) tell(message, { undo: true });
  return made;
}

export const step = (which) => post("step", () => ({ revision: store.state.revision ?? "", step: which }));
export const detect = () => post("detect", () => ({}));

export async function done() {
  const command = store.state.command;
  ended = await post("done", () => ({}));
  if (!ended) return;
  document.getElementById("end-command").textContent = command;
  for (const part of document.querySelectorAll("#top, main")) part.inert = true;
  document.getElementById("end").hidden = false;
}
