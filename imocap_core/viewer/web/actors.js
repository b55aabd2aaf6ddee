// The bodies of a moment: where every video is, and what is drawn of it.

// Where every video is at a moment: {at, inside, confidence}; null without a place.
function momentsAt(page, phase) {
  return page.videos.map((video) => {
    const now = video.excluded ? null : frameAt(video.phase, phase);
    return now && { ...now, confidence: video.confidence[Math.round(now.at)] / 255 };
  });
}

const SURE_TO_MM = 100; // the last colour of uncertainty
const UNKNOWN_MM = 65535, GREY = [0.55, 0.55, 0.55]; // a deviation that is not known, and its colour
const SKIN_M = 0.14;
const BODY_JOINTS = 22; // those that SMPL and SMPL+H share

// A colour for every joint by its standard deviation; fingers have their wrist's. null: unknown.
function tintsOf(model, video, frame) {
  if (!video.sigma) return null;
  const own = (j) => (j < BODY_JOINTS ? j : own(model.parents[j]));
  return model.parents.map((_, j) => {
    const mm = video.sigma[24 * frame + own(j)];
    return mm === UNKNOWN_MM ? GREY : uncertaintyColor(mm / SURE_TO_MM);
  });
}

// Places that a performer reaches: the joints in some frames, and as far around them as skin is.
function reachOf(page, i) {
  const answer = page.videos[i].answers.final, frames = answer.trans.length / 3;
  const step = Math.max(1, Math.floor(frames / 24)), out = [];
  for (let t = 0; t < frames; t += step)
    for (const p of pose(page.model, page.shapes[answer.shape], answer, t).joints)
      out.push(...[-1, 1].flatMap((s) => [0, 1, 2].map((k) => p.map((x, i) => x + (i === k ? s * SKIN_M : 0)))));
  return out;
}

// One pose on the way from what a video shows alone to what all show together, as an answer of one frame.
function blended(video, at, share) {
  const { initial, final } = video.answers, t = Math.round(at), count = final.rotations.length / (final.trans.length / 3);
  const row = (answer) => answer.rotations.slice(t * count, (t + 1) * count), then = row(final);
  return {
    rotations: row(initial).map((q, j) => slerp(q, then[j], share)),
    trans: mix([...initial.trans.subarray(3 * t, 3 * t + 3)], final.trans.subarray(3 * t, 3 * t + 3), share),
  };
}

// Whether a performer is shown only as a hint beside the chosen one.
const faint = (state, i) => state.place === "one" && state.through < 0 && i !== state.lead;

// How performers are first shown: side by side where a row of so many fits, else one among ghosts.
const placeFor = (count, aspect) => (count === 1 ? "all" : aspect > 0.42 * count ? "apart" : "one");

function actorsAt(page, meshes, state, now) {
  const actors = [];
  page.videos.forEach((video, i) => {
    if (!state.on[i] || !now[i] || (state.through >= 0 && state.through !== i)) return;
    for (const name of ["final", "initial"]) {
      if (state.answer !== name && state.answer !== "both") continue;
      const answer = video.answers[name], shape = page.shapes[answer.shape];
      const own = rgb(video.color), between = state.answer !== "both" && state.together > 0 && state.together < 1;
      const plain = state.answer === "both" && name === "initial", ghost = plain || !now[i].inside;
      actors.push({
        ...(between ? pose(page.model, shape, blended(video, now[i].at, state.together), 0) : pose(page.model, shape, answer, now[i].at)), mesh: meshes[answer.shape], video: i,
        color: plain ? mix(own, [0.45, 0.45, 0.45], 0.75) : own, offset: state.through < 0 ? state.offsets[i] : [0, 0, 0],
        tints: state.uncertainty && name === "final" ? tintsOf(page.model, video, Math.round(now[i].at)) : null,
        alpha: faint(state, i) ? FAINT : ghost ? GHOST : state.through >= 0 ? 0.82 : 1,
      });
    }
  });
  return actors;
}

// Where a performer's front and left are at a moment, level: unit vectors {front, left}.
function facingOf(model, joints) {
  const hip = (side) => joints[model.joints.indexOf(`${side} hip`)];
  const across = sub(hip("left"), hip("right")), left = unit([across[0], 0, across[2]]);
  return { left, front: cross(left, [0, 1, 0]) };
}

// The joint whose height changes most in a list of poses.
function liveliest(joints) {
  const range = (j) => {
    const heights = joints.map((pose) => pose[j][1]);
    return heights.reduce((a, b) => Math.max(a, b)) - heights.reduce((a, b) => Math.min(a, b));
  };
  return Array.from({ length: BODY_JOINTS }, (_, j) => j).reduce((a, b) => (range(b) > range(a) ? b : a));
}
