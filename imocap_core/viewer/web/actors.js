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
const WIDEST_M = 0.3; // of a halo
const SKIN_M = 0.14;
const BODY_JOINTS = 22; // those that SMPL and SMPL+H share

// The joint of the body that a joint's uncertainty is read at: fingers have their wrist's.
const ofBody = (model, j) => (j < BODY_JOINTS ? j : ofBody(model, model.parents[j]));

// A colour for every joint by its standard deviation. null: unknown.
function tintsOf(model, video, frame) {
  if (!video.sigma) return null;
  return model.parents.map((_, j) => {
    const mm = video.sigma[24 * frame + ofBody(model, j)];
    return mm === UNKNOWN_MM ? GREY : uncertaintyColor(mm / SURE_TO_MM);
  });
}

// Metres from each joint that is drawn to where it is expected to be, root mean square, counted from the
// pelvis: by the final motion and its standard deviation.
function expectedErrors(model, video, frame, drawn, final) {
  const from = (joints, j) => sub(joints[j], joints[0]);
  return model.parents.map((_, k) => {
    const j = ofBody(model, k), mm = video.sigma ? video.sigma[24 * frame + j] : 0;
    const far = Math.hypot(...sub(from(drawn, j), from(final, j)));
    return Math.min(Math.hypot(far, mm === UNKNOWN_MM ? WIDEST_M : mm / 1000), WIDEST_M);
  });
}

// How much of the halo is to be seen: all where it is switched on, else less with every video that helps.
const haloShare = (state) => (state.halo ? 1 : state.answer === "both" ? 0 : 1 - state.together);

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
      const posed = between ? pose(page.model, shape, blended(video, now[i].at, state.together), 0) : pose(page.model, shape, answer, now[i].at);
      const halo = plain || faint(state, i) || !now[i].inside ? 0 : haloShare(state);
      actors.push({
        ...posed, mesh: meshes[answer.shape], video: i,
        halo: halo > 0 ? { alpha: halo, sizes: expectedErrors(page.model, video, Math.round(now[i].at), posed.joints, finalAt(page, video, now[i].at)) } : null,
        color: plain ? mix(own, [0.45, 0.45, 0.45], 0.75) : own, offset: state.through < 0 ? state.offsets[i] : [0, 0, 0],
        tints: state.uncertainty && name === "final" ? tintsOf(page.model, video, Math.round(now[i].at)) : null,
        alpha: faint(state, i) ? state.faint ?? FAINT : ghost ? GHOST : state.through >= 0 ? 0.82 : 1,
      });
    }
  });
  return actors;
}

const finalAt = (page, { answers: { final } }, at) => pose(page.model, page.shapes[final.shape], final, at).joints;

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
