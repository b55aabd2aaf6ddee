// The moment in the page's address: #t=1.25, and #t=1.25&loop=1,2.5 with a loop.

function momentOf(hash) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (text) => (text !== null && text.trim() !== "" ? Number(text) : NaN);
  const loop = (given.get("loop") ?? "").split(",").map(number);
  return {
    phase: number(given.get("t")),
    loop: loop.length === 2 && loop[0] < loop[1] ? loop : null,
  };
}

function hashOf(state) {
  const loop = state.loop.length === 2 ? `&loop=${state.loop.map((s) => s.toFixed(2)).join(",")}` : "";
  return `#t=${state.phase.toFixed(2)}${loop}`;
}

// Put the moment into the address, without a new entry in the browser's history.
function writeAddress(state) {
  const hash = hashOf(state);
  if (location.hash === hash) return;
  try {
    history.replaceState(null, "", hash);
  } catch {
    // a page within a page may not change its address
  }
}

// Copy a link to this moment; where that is not allowed, show it to be copied by hand.
async function copyLink(state) {
  const link = location.href.replace(/#.*$/, "") + hashOf(state);
  try {
    await navigator.clipboard.writeText(link);
    return "link copied";
  } catch {
    writeAddress(state);
    return "the link is in the address bar";
  }
}
