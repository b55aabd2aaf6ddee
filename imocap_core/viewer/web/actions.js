// What a user can do, and the state it changes. Everything on the page is drawn from the state.

const APART_M = 1.5;

function makeActions(page, redraw) {
  const { first, last, step } = page.timeline, count = page.videos.length;
  const state = {
    phase: page.timeline.shared, playing: false, speed: 1, on: page.videos.map(() => true),
    answer: "final", apart: false, cameras: true, paths: true, through: -1, help: false,
    skeletons: false, uncertainty: false, loop: [],
    curves: { joints: [page.model.joints.indexOf("right wrist")], quantity: "height" },
    marks: { detected: false, skeleton: true }, offsets: page.videos.map(() => [0, 0, 0]),
  };
  const then = (change) => (...given) => { change(...given); redraw(); };
  const act = {
    state, page,
    play: then((on = !state.playing) => {
      if (on && state.phase >= last - 1e-6) state.phase = first;
      state.playing = on;
    }),
    // Time goes on by so many seconds; from the end of the loop, or of all, to its beginning.
    advance: (seconds) => {
      const [from, to] = state.loop.length === 2 ? state.loop : [first, last];
      state.phase += seconds;
      if (state.phase > to || state.phase < from) state.phase = from;
    },
    // The first time its beginning, then its end, then no loop.
    loop: then(() => {
      const ends = state.loop.length === 2 ? [] : [...state.loop, state.phase].sort((a, b) => a - b);
      state.loop = ends.length === 2 && ends[1] - ends[0] < step / 2 ? [] : ends;
    }),
    // From an address: a phase and a loop, each if it is one.
    go: then(({ phase, loop }) => {
      if (Number.isFinite(phase)) state.phase = clamp(phase, first, last);
      if (loop) state.loop = loop.map((s) => clamp(s, first, last));
      if (Number.isFinite(phase)) state.playing = false;
    }),
    joint: then((j, on) => {
      state.curves.joints = on ? [...state.curves.joints, j] : state.curves.joints.filter((k) => k !== j);
    }),
    quantity: then((name) => { state.curves.quantity = name; }),
    seek: then((phase) => { state.phase = clamp(phase, first, last); }),
    step: then((frames) => {
      state.playing = false;
      state.phase = clamp(state.phase + frames * step, first, last);
    }),
    end: then((late) => { state.phase = late ? last : first; }),
    speed: then((speed) => { state.speed = speed; }),
    faster: then((by) => {
      const speeds = [0.1, 0.25, 0.5, 1, 2], now = speeds.indexOf(state.speed);
      state.speed = speeds[clamp(now + by, 0, speeds.length - 1)];
    }),
    toggle: then((i, on = !state.on[i]) => { state.on[i] = on; }),
    answer: then((name) => { state.answer = name; }),
    apart: then((on) => {
      state.apart = on;
      const width = page.right.map((x) => x * APART_M);
      state.offsets = page.videos.map((_, i) => scaled(width, on ? i - (count - 1) / 2 : 0));
      if (on) state.through = -1;
      act.fit(0, on);
    }),
    flip: then((name) => { state[name] = !state[name]; }),
    mark: then((name) => { state.marks[name] = !state.marks[name]; }),
    through: then((i) => {
      state.through = state.through === i || page.videos[i]?.excluded ? -1 : i;
      if (state.through >= 0 && state.apart) act.apart(false), state.through = i;
    }),
    next: () => {
      let i = state.through + 1;
      while (page.videos[i]?.excluded) i++;
      act.through(i < count ? i : -1);
    },
    help: then(() => { state.help = !state.help; }),
    fit: () => {}, snapshot: () => {}, link: () => {},
  };
  return act;
}
