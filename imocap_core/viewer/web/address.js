// The moment in the page's address: #t=1.25&loop=1,2.5; a copied link also has the view and what is shown.

const CHOICES = ["answer", "place", "lead", "through"], SWITCHES = ["skeletons", "uncertainty", "halo", "cameras", "paths", "follow"];

function momentOf(hash) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const numbers = (name) => (given.get(name) || "x").split(",").map((text) => (text.trim() ? Number(text) : NaN));
  const loop = numbers("loop"), eye = numbers("eye");
  return {
    phase: numbers("t")[0],
    loop: loop.length === 2 && loop[0] < loop[1] ? loop : null,
    eye: eye.length === 8 && eye.every(Number.isFinite) ? eye : null,
    shown: given.get("shown")?.split(",") ?? null,
    hidden: numbers("hidden"),
    choices: Object.fromEntries(CHOICES.filter((name) => given.has(name)).map((name) => [name, given.get(name)])),
  };
}

function hashOf(state, orbit = null) {
  const loop = state.loop.length === 2 ? `&loop=${state.loop.map((s) => s.toFixed(2)).join(",")}` : "";
  const moment = `#t=${state.phase.toFixed(2)}${loop}`;
  if (!orbit) return moment;
  const eye = [state.right[0], state.right[2], orbit.azimuth, orbit.elevation, orbit.distance, ...orbit.target].map((x) => x.toFixed(3)).join(",");
  const hidden = state.on.flatMap((on, i) => (on ? [] : [i])).join(",");
  const choices = CHOICES.map((name) => `&${name}=${state[name]}`).join("");
  return `${moment}&eye=${eye}&shown=${SWITCHES.filter((name) => state[name]).join(",")}${hidden && `&hidden=${hidden}`}${choices}`;
}

// What an address chooses, as far as it is a choice here; the eye last, as a place moves it.
function choose({ eye, shown, hidden, choices }, act, orbit) {
  const { state, page } = act, whole = (text) => clamp(Math.round(Number(text)) || 0, -1, page.videos.length - 1);
  if (shown) for (const name of SWITCHES) state[name] = shown.includes(name);
  if (shown) state.on = page.videos.map((_, i) => !hidden.includes(i));
  if (["final", "initial", "both"].includes(choices.answer)) act.answer(choices.answer);
  if (choices.lead) state.lead = Math.max(0, whole(choices.lead));
  if (PLACES.includes(choices.place)) state.place = "", act.place(choices.place);
  if (choices.through) state.through = page.videos[whole(choices.through)]?.excluded ? -1 : whole(choices.through);
  if (!eye) return;
  act.row([eye[0], 0, eye[1]]);
  [, , orbit.azimuth, orbit.elevation, orbit.distance, ...orbit.target] = eye;
}

// Put the moment into the address, without a new entry in the browser's history.
function writeAddress(state) {
  const hash = hashOf(state);
  if (location.hash === hash || location.hash.startsWith(`${hash}&eye`)) return;
  try {
    history.replaceState(null, "", hash);
  } catch {
    // a page within a page may not change its address
  }
}

// Copy a command; what is said about it: the command, where it has to be copied by hand.
async function copied(command) {
  try {
    await navigator.clipboard.writeText(command);
    return `copied: ${command}`;
  } catch {
    return command;
  }
}

// Copy a link to what is seen; where that is not allowed, show it to be copied by hand.
async function copyLink(state, orbit) {
  const link = location.href.replace(/#.*$/, "") + hashOf(state, orbit);
  try {
    await navigator.clipboard.writeText(link);
    return "link copied";
  } catch {
    location.hash = hashOf(state, orbit);
    return "the link is in the address bar";
  }
}
