// Buttons and keys.

const HELP = [
  ["space", "play or pause"], ["← →", "one frame; with shift ten"], ["home, end", "to the ends"],
  ["+ −", "speed"], ["1 … 9", "show or hide a video"], ["i", "all videos together, each alone, or both"],
  ["o", "side by side, one among ghosts, or all in one place"], ["c", "look through the next camera"],
  ["f, a", "see the performers; see the cameras too"], ["k, s", "keypoints; skeleton over the frames"],
  ["b; u, h", "bodies or skeletons; uncertainty as colour, as a halo"], ["l", "loop: its beginning, its end, none"],
  ["click a joint", "its height; two: distance; three: angle"], ["p", "save the scene as a picture"],
  ["drag, wheel", "turn, zoom; with shift move"], ["esc", "close, clear, back to the free eye"],
];

function group(parent, buttons) {
  const box = parent.appendChild(document.createElement("div"));
  box.className = "group";
  return buttons.map(([text, title, act]) => {
    const button = box.appendChild(document.createElement("button"));
    Object.assign(button, { textContent: text, title, type: "button" });
    button.addEventListener("click", act);
    return button;
  });
}

const press = (button, on) => button.setAttribute("aria-pressed", String(Boolean(on)));

// The buttons over the scene; returns a function that shows the state on them.
function makeTools(parent, beside, over, act) {
  const answers = ["final", "initial", "both"], several = act.page.videos.length > 1;
  const shown = group(parent, [
    ["all together", "The motion that all videos together show (i)", () => act.answer("final")],
    ["each alone", "What each video alone says (i)", () => act.answer("initial")],
    ["both", "Each video alone as a ghost (i)", () => act.answer("both")],
  ]);
  const places = group(parent, [
    ["side by side", "Performers beside each other (o)", () => act.place("apart")],
    ["one", "One performer among the others' ghosts; again for the next (o)", () => act.place("one")],
    ["all", "All performers in one place (o)", () => act.place("all")],
  ]);
  places[0].parentElement.hidden = !several;
  const views = group(over, [
    ["front", "From the front", () => act.look("front")],
    ["side", "From the performer's left", () => act.look("side")],
    ["top", "From above", () => act.look("top")],
    ["follow", "The eye goes with the performer", () => act.flip("follow")],
    ["all cameras", "Performers and cameras (a)", () => act.fit(1)],
    ["closer", "The performers alone (f)", () => act.fit(0)],
  ]);
  const extras = group(parent, [
    ["cameras", "Cameras with their pictures", () => act.flip("cameras")],
    ["paths", "The way of the pelvis over the ground, pale at the start", () => act.flip("paths")],
    ["skeletons", "Skeletons instead of bodies (b)", () => act.flip("skeletons")],
    ["uncertainty", "Coloured by the standard deviation of each joint (u)", () => act.flip("uncertainty")],
    ["halo", "As far around the body as it may be wrong (h)", () => act.flip("halo")],
  ]);
  extras[3].disabled = extras[4].disabled = !act.page.videos.some((video) => video.sigma);
  const marks = group(beside, [
    ["keypoints", "Detected keypoints over the frames (k)", () => act.mark("detected")],
    ["skeleton", "The motion's skeleton over the frames (s)", () => act.mark("skeleton")],
  ]);
  const others = group(parent, [
    ["picture", "Save the scene as a picture (p)", () => act.snapshot()],
    ["link", "Copy a link to this moment", () => act.link()],
    ["keys", "All keys (?)", () => act.help()],
  ]);
  others[2].className = "of-keys";
  return (state) => {
    shown.forEach((button, i) => press(button, state.answer === answers[i]));
    places.forEach((button, i) => press(button, state.place === PLACES[i]));
    press(views[3], state.follow);
    press(extras[0], state.cameras); press(extras[1], state.paths);
    press(extras[2], state.skeletons); press(extras[3], state.uncertainty); press(extras[4], state.halo);
    press(marks[0], state.marks.detected); press(marks[1], state.marks.skeleton);
    press(others[2], state.help);
  };
}

function viewerKeys(act) {
  const { state } = act, answers = { final: "initial", initial: "both", both: "final" };
  return {
    i: () => act.answer(answers[state.answer]), c: () => act.next(), f: () => act.fit(0), a: () => act.fit(1),
    o: () => act.place(PLACES[(PLACES.indexOf(state.place) + 1) % PLACES.length]),
    b: () => act.flip("skeletons"), u: () => act.flip("uncertainty"), h: () => act.flip("halo"), p: () => act.snapshot(),
    k: () => act.mark("detected"), s: () => act.mark("skeleton"), "?": () => act.help(),
    Escape: () => {
      if (state.help) act.help(false);
      else if (state.chosen.length) act.measure(null);
      else act.through(-1);
    },
  };
}

// keys: what each does; a digit shows or hides one of so many videos.
function listenToKeys(keys, videos, act) {
  // After a click with the mouse the keys are the page's again, not the button's.
  addEventListener("click", (e) => e.detail && document.activeElement.blur());
  addEventListener("change", () => document.activeElement.blur());
  addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === "SELECT") return;
    if (e.key === " " && e.target.matches("button, summary, input[type=checkbox]")) return;
    const digit = Number(e.key);
    if (e.key !== " " && digit >= 1 && digit <= videos) act.toggle(digit - 1);
    else if (keys[e.key]) keys[e.key](e);
    else return;
    e.preventDefault();
  });
}

function showHelp(box) {
  for (const [key, what] of HELP) {
    box.appendChild(document.createElement("b")).textContent = key;
    box.appendChild(document.createElement("span")).textContent = what;
  }
}
