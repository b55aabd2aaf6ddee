// The page: drawn again whenever the server's state or the view changes.

import { askForDetection } from "./actions.js";
import { drawAnchors } from "./anchors.js";
import { detect, done, poll, step } from "./api.js";
import { drawIgnored, setUpIgnored } from "./ignored.js";
import { setUpKeys } from "./keys.js";
import { drawPlan, setUpPlan } from "./plan.js";
import { drawStage, setUpStage } from "./stage.js";
import { onChange, store } from "./store.js";
import { write } from "./text.js";
import { hide } from "./toast.js";
import { drawVideos } from "./videos.js";

const get = (id) => document.getElementById(id);

function drawTop(state) {
  write(get("action"), state.action);
  document.title = `${state.action} · imocap pick`;
  write(get("saved"), `Every change is saved in ${state.file}`);
  get("saved").title = state.file;
  get("undo").disabled = !state.can_undo;
  get("redo").disabled = !state.can_redo;
  const waiting = state.videos.some((v) => v.no_keypoints || (v.detect && v.people.state === "none"));
  const running = state.detection.state === "running";
  get("find").disabled = running || !waiting;
  get("find").classList.toggle("main", waiting && !running);
  get("fault").hidden = !state.fault;
  write(get("fault"), state.fault ? `action.yaml cannot be used as it is. Correct it in an editor:\n${state.fault}` : "");
  const failed = state.detection.state === "failed";
  get("progress").hidden = !running && !failed;
  get("progress").classList.toggle("bad", failed);
  get("bar").style.width = `${Math.round(100 * state.detection.share)}%`;
  write(get("progress-text"), running ? `Finding people · ${state.detection.text}` : failed ? `People could not be found: ${state.detection.text}` : "");
}

get("undo").addEventListener("click", () => step("undo"));
get("redo").addEventListener("click", () => step("redo"));
get("toast-undo").addEventListener("click", () => { hide(); step("undo"); });
get("find").addEventListener("click", async () => { if (await askForDetection(store.state)) detect(); });
get("done").addEventListener("click", done);
setUpStage();
setUpPlan();
setUpKeys();
setUpIgnored();
onChange(drawTop);
onChange(drawVideos);
onChange(drawStage);
onChange(drawAnchors);
onChange(drawIgnored);
onChange(drawPlan);
poll();
