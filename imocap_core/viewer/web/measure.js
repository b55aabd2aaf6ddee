// Distances and angles between joints that were clicked: one joint its height, two their distance,
// three the angle at the second. Used by the viewer and by the comparison.

const NEAR_PX = 26;

// The joint of a drawn body nearest to a place on the canvas: {body, joint}, or null.
function jointAt(actors, view, x, y) {
  let best = null, least = NEAR_PX;
  for (const actor of actors)
    actor.joints.slice(0, BODY_JOINTS).forEach((p, joint) => {
      const at = landing(view.matrix, add(p, actor.offset), view.width / view.density, view.height / view.density);
      const far = at ? Math.hypot(at.x - x, at.y - y) : Infinity;
      if (far < least) least = far, best = { body: actor.video, joint };
    });
  return best;
}

// What is measured, in words. chosen: joints; names: of bodies; placeOf({body, joint}).
function measured(chosen, bodies, joints, placeOf) {
  if (!chosen.length) return "Click (or add) one joint for its height, two for their distance, three for an angle.";
  const alike = chosen.every((c) => c.body === chosen[0].body);
  const name = (c) => (alike ? joints[c.joint] : `${bodies[c.body].name}'s ${joints[c.joint]}`);
  const value = (places) => [
    (p) => `${(100 * p[0][1]).toFixed(1)} cm`,
    (p) => `${(100 * Math.hypot(...sub(p[1], p[0]))).toFixed(1)} cm`,
    (p) => `${angleOf(sub(p[0], p[1]), sub(p[2], p[1])).toFixed(0)}°`,
  ][places.length - 1](places);
  const what = [
    () => `height of ${name(chosen[0])}`,
    () => `from ${name(chosen[0])} to ${name(chosen[1])}`,
    () => `angle at ${name(chosen[1])}, to ${name(chosen[0])} and ${name(chosen[2])}`,
  ][chosen.length - 1]();
  if (!alike) return `${what}\n${value(chosen.map(placeOf))}`;
  // The same of every body that is shown.
  const each = bodies.filter((b) => b.shown).map((b) => [b.name, chosen.map((c) => placeOf({ body: b.index, joint: c.joint }))]);
  return [what, ...each.filter(([, p]) => p.every(Boolean)).map(([who, p]) => `${who}: ${value(p)}`)].join("\n");
}

// Marks over the scene: a ring on every joint, lines between them.
function drawMarks(svg, chosen, actors, view, ringed = []) {
  const placeOf = (c) => {
    const actor = actors.find((a) => a.video === c.body);
    return actor && landing(view.matrix, add(actor.joints[c.joint], actor.offset), view.width / view.density, view.height / view.density);
  };
  const places = chosen.map(placeOf);
  const line = (a, b) => (a && b ? `<line x1="${a.x}" y1="${a.y}" x2="${b.x}" y2="${b.y}"/>` : "");
  const ring = (p, kind = "") => (p ? `<circle ${kind} cx="${p.x}" cy="${p.y}" r="6"/>` : "");
  svg.innerHTML = places.map((p, i) => (i ? line(places[i - 1], p) : "")).join("")
    + places.map((p) => ring(p)).join("") + ringed.map((c) => ring(placeOf(c), 'class="ringed"')).join("");
}

// Listens for clicks on joints and shows what is chosen: marks over the scene, and `#measured`.
class Measure {
  // drawn: gives {view, actors} of the last draw.
  constructor(page, act, drawn) {
    Object.assign(this, { page, drawn });
    let pressed = null;
    const stage = $("stage"), at = (e) => drawn().view && drawn().view.through < 0 && jointAt(drawn().actors, drawn().view, e.offsetX, e.offsetY);
    stage.addEventListener("pointerdown", (e) => { pressed = [e.clientX, e.clientY]; });
    stage.addEventListener("pointerup", (e) => {
      const moved = pressed ? Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) : Infinity;
      const joint = moved < 5 ? at(e) : null;
      if (joint) act.measure(joint);
    });
    stage.addEventListener("pointermove", (e) => {
      const joint = e.buttons ? null : at(e);
      $("hover").hidden = !joint;
      if (!joint) return;
      $("hover").textContent = `${page.videos[joint.body].id}: ${page.model.joints[joint.joint]}`;
      $("hover").style.transform = `translate(${e.offsetX + 12}px, ${e.offsetY - 26}px)`;
    });
  }

  // marked: a joint that is ringed on every body, or null.
  show(state, marked = null) {
    const { view, actors } = this.drawn(), { videos, model } = this.page;
    const bodies = videos.map((video, index) => ({ name: video.id, index, shown: actors.some((a) => a.video === index) }));
    const placeOf = ({ body, joint }) => actors.find((a) => a.video === body)?.joints[joint];
    $("measured").textContent = measured(state.chosen.filter(placeOf), bodies, model.joints, placeOf);
    if (view.through >= 0) return drawMarks($("rings"), [], actors, view);
    const ringed = marked === null ? [] : actors.map((actor) => ({ body: actor.video, joint: marked }));
    drawMarks($("rings"), state.chosen, actors, view, ringed);
  }
}
