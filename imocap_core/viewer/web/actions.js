// What a user can do, and the state it changes. Everything on the page is drawn from the state.

const GAP_M = 0.3; // between the reaches of performers side by side
const PLACES = ["apart", "one", "all"]; // side by side; one solid among ghosts; all solid in one place

function makeActions(page, redraw) {
  const { first, last, step } = page.timeline, count = page.videos.length;
  const state = {
    phase: page.timeline.shared, playing: false, speed: 1, on: page.videos.map(() => true),
    answer: "final", together: 1, place: "all", apart: false, lead: Math.max(0, page.videos.findIndex((v) => v.id === page.reference)),
    cameras: true, paths: true, follow: false, through: -1, help: false, chosen: [],
    skeletons: false, uncertainty: false, halo: false, loop: [], right: page.right,
    curves: { joints: [], quantity: "height" },
    marks: { detected: false, skeleton: true }, offsets: page.videos.map(() => [0, 0, 0]),
  };
  const then = (change) => (...given) => { change(...given); redraw(); };
  const act = {
    state, page,
    play: then((on = !state.playing) => {
      if (on && state.phase >= last - 1e-6) state.phase = first;
      state.playing = on;
    }),
    // The moment so many seconds on; from the end of the loop, or of all, its beginning.
    after: (seconds) => {
      const [from, to] = state.loop.length === 2 ? state.loop : [first, last];
      const phase = state.phase + seconds;
      return phase > to || phase < from ? from : phase;
    },
    advance: (seconds) => { state.phase = act.after(seconds); },
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
    answer: then((name) => Object.assign(state, { answer: name, together: name === "initial" ? 0 : 1 })),
    // From each video alone (0) to all videos together (1).
    reveal: then((share) => Object.assign(state, { together: share, answer: share < 0.5 ? "initial" : "final" })),
    // Chosen again, "one" goes on to the next performer.
    place: then((name) => {
      if (name === "one" && state.place === "one") state.lead = (state.lead + 1) % count;
      Object.assign(state, { place: name, apart: name === "apart", through: -1 });
      act.row(state.right);
      act.fit(0, state.apart);
    }),
    // Performers side by side stand in a row along this direction.
    row: (right) => {
      state.right = right;
      state.offsets = state.apart ? sideBySide(page, right) : page.videos.map(() => [0, 0, 0]);
    },
    // The joints of which a height, a distance or an angle is shown; a fourth begins anew.
    measure: then((joint) => { state.chosen = joint ? [...(state.chosen.length < 3 ? state.chosen : []), joint] : []; }),
    flip: then((name) => { state[name] = !state[name]; }),
    mark: then((name) => { state.marks[name] = !state.marks[name]; }),
    through: then((i) => {
      state.through = state.through === i || page.videos[i]?.excluded ? -1 : i;
    }),
    next: () => {
      let i = state.through + 1;
      while (page.videos[i]?.excluded) i++;
      act.through(i < count ? i : -1);
    },
    help: then((on = !state.help) => { state.help = on; }),
    fit: () => {}, look: () => {}, snapshot: () => {}, link: () => {},
  };
  return act;
}

// How far each performer is moved so that all stand in a row, each in the middle of their own room.
function sideBySide(page, right) {
  const spans = page.videos.map((_, i) => {
    const along = reachOf(page, i).map((p) => dot(p, right));
    return [along.reduce((a, b) => Math.min(a, b)), along.reduce((a, b) => Math.max(a, b))];
  });
  const room = Math.max(...spans.map(([low, high]) => high - low)) + GAP_M, count = spans.length;
  return spans.map(([low, high], i) => scaled(right, (i - (count - 1) / 2) * room - (low + high) / 2));
}
