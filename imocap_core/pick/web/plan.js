// What a run would do now, and the command for it.

import { tell } from "./toast.js";
import { element, write } from "./text.js";

let drawn = "";

export function setUpPlan() {
  document.getElementById("copy").addEventListener("click", async () => {
    const code = document.getElementById("command-text");
    try {
      await navigator.clipboard.writeText(code.textContent);
      tell("Copied.");
    } catch {
      getSelection().selectAllChildren(code);
      tell("Selected: copy it with Ctrl+C.");
    }
  });
}

export function drawPlan(state) {
  write(document.getElementById("command-text"), state.command);
  const stamp = JSON.stringify([state.plan, state.warnings]);
  if (stamp === drawn) return;
  drawn = stamp;
  document.getElementById("warnings").replaceChildren(...state.warnings.map((text) => element("li", { text })));
  write(document.getElementById("plan-text"), planText(state));
  const stages = state.plan?.stages ?? [];
  document.getElementById("stages").hidden = !stages.length;
  document.getElementById("stage-list").replaceChildren(...stages.map(({ stage, state: how, why }) =>
    element("li", {}, element("b", { text: stage }), element("span", { text: how }), element("span", { class: "why", text: why.join("; ") }))));
}

function planText({ plan, videos }) {
  if (!plan) return "Looking at what is cached …";
  if (plan.fault) return plan.fault;
  const waiting = plan.stages.filter(({ state }) => state === "would run");
  if (!waiting.length) return "Nothing: every result is of just these choices.";
  const detected = videos.some(({ detect, people }) => detect && people.state === "none") ? "People would be detected first. " : "";
  const why = waiting[0].why.join("; ");
  const rest = plan.stages.length - waiting.length;
  return `${detected}${waiting.length} of ${plan.stages.length} stages, from ${waiting[0].stage} on: ${why}.${rest ? ` ${rest} are cached.` : ""}`;
}
