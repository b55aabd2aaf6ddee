// Play, step, slider, speed and loop: their controls, keys, and what they show.

// While it plays, the moment of the next draw is chosen one draw early: its pictures are decoded by then.
class Player {
  constructor(act) {
    Object.assign(this, { act, before: 0, promised: 0, owed: 0 });
  }

  // At a draw: go to the moment that was chosen for it. The moment of the next draw; null at rest.
  tick(time) {
    const { act } = this, { playing, speed } = act.state;
    const passed = this.before ? Math.min(time - this.before, 400) / 1000 : 0;
    this.before = playing ? time : 0;
    if (!playing) { this.promised = this.owed = 0; return null; }
    act.advance(this.promised * speed);
    this.owed += passed - this.promised;
    this.promised = clamp(passed + this.owed, 0, 0.4);
    return act.after(this.promised * speed);
  }
}

function showTransport(page, state) {
  const seconds = (s) => s.toFixed(2), loop = state.loop.map(seconds).join(" – ");
  $("play").textContent = state.playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  $("scrub").value = state.phase;
  $("scrub").setAttribute("aria-valuetext", `${seconds(state.phase)} seconds`);
  $("speed").value = String(state.speed);
  $("loop").textContent = ["A–B", `${loop} –`, `${loop} ✕`][state.loop.length];
  $("loop").setAttribute("aria-pressed", String(state.loop.length === 2));
  $("clock").textContent = `${seconds(state.phase)} of ${seconds(page.timeline.last)} s of ${page.reference}`;
}

function listenToTransport(page, act) {
  Object.assign($("scrub"), { min: page.timeline.first, max: page.timeline.last });
  $("scrub").addEventListener("input", () => act.seek(Number($("scrub").value)));
  $("speed").addEventListener("change", () => act.speed(Number($("speed").value)));
  const clicks = { play: () => act.play(), back: () => act.step(-1), forth: () => act.step(1), loop: () => act.loop() };
  for (const [id, does] of Object.entries(clicks)) $(id).addEventListener("click", does);
}

const transportKeys = (act) => ({
  " ": () => act.play(), ArrowLeft: (e) => act.step(e.shiftKey ? -10 : -1),
  ArrowRight: (e) => act.step(e.shiftKey ? 10 : 1), Home: () => act.end(false), End: () => act.end(true),
  "+": () => act.faster(1), "=": () => act.faster(1), "-": () => act.faster(-1), l: () => act.loop(),
});
