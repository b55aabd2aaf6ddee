// Which tracked person action.yaml declares as the performer, and which the program would take.

import { peopleOf, spanOf } from "./store.js";

const MAX_DISTANCE = 0.5; // as in imocap_core/people/performer.py

function distance(box, { at, box: other }) {
  if (other) {
    const w = Math.max(0, Math.min(box[2], other[2]) - Math.max(box[0], other[0]));
    const h = Math.max(0, Math.min(box[3], other[3]) - Math.max(box[1], other[1]));
    const area = (b) => (b[2] - b[0]) * (b[3] - b[1]);
    return MAX_DISTANCE - (0.5 * w * h) / Math.max(area(box) + area(other) - w * h, 1e-9);
  }
  const dx = Math.max(box[0] - at[0], at[0] - box[2], 0), dy = Math.max(box[1] - at[1], at[1] - box[3], 0);
  const middle = Math.hypot(at[0] - (box[0] + box[2]) / 2, at[1] - (box[1] + box[3]) / 2);
  return (Math.hypot(dx, dy) + 0.1 * middle) / Math.max(1, Math.hypot(box[2] - box[0], box[3] - box[1]));
}

/** Index of a person at a frame, or at the nearest one where outlines are of every few frames. */
export function rowAt(person, frame, step) {
  for (let d = 0; d < Math.max(1, step); d += 1) {
    const row = person.index.get(frame - d) ?? person.index.get(frame + d);
    if (row !== undefined) return row;
  }
  return undefined;
}

export function declaredPerson(video) {
  const everybody = peopleOf(video), declared = video.person;
  if (!everybody || !declared) return null;
  if (declared.track) return everybody.people.find((p) => p.number === declared.track) ?? null;
  let best = null, least = MAX_DISTANCE;
  for (const person of everybody.people) {
    const row = rowAt(person, declared.frame, everybody.step);
    if (row === undefined) continue;
    const far = distance(person.boxes[row], declared);
    if (far < least) [best, least] = [person, far];
  }
  return best;
}

export function framesInside(person, [first, stop]) {
  return person.frames.filter((frame) => frame >= first && frame < stop);
}

/** Whoever scores best among those in the used frames: the other videos may overrule it. */
export function likelyPerson(video) {
  const everybody = peopleOf(video);
  if (!everybody) return null;
  const span = spanOf(video);
  const scored = everybody.people.map((person) => {
    const inside = framesInside(person, span).length;
    return [person.score * (inside / person.frames.length), person];
  });
  scored.sort((a, b) => b[0] - a[0]);
  return scored.length && scored[0][0] > 0 ? scored[0][1] : null;
}

/** The frame of a person inside a span that is nearest to some frame. */
export function nearestFrame(person, span, frame) {
  let best = null;
  for (const candidate of framesInside(person, span)) {
    if (best === null || Math.abs(candidate - frame) < Math.abs(best - frame)) best = candidate;
  }
  return best;
}
