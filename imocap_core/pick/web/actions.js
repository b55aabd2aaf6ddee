// What the user can do: each is one step that can be undone.

import { edit } from "./api.js";
import { countOf, fileOf, momentOf, peopleOf, seek, selectedVideo, spanOf, changed, store, view } from "./store.js";
import { declaredPerson, nearestFrame } from "./performer.js";
import { tell } from "./toast.js";

const LEAST_FRAMES = 3;

const declaration = (person, frame) => ({ frame, box: person.boxes[person.index.get(frame)] });

/** Declare a tracked person as the performer, by the box around them in a frame near this one. */
export function choose(video, person) {
  const frame = nearestFrame(person, spanOf(video), momentOf(video));
  if (frame === null) {
    tell(`Person ${person.number} is not in the used frames of ${video.id}.`, { bad: true });
    return;
  }
  seek(video.id, frame);
  const edits = [{ kind: "person", video: video.id, person: declaration(person, frame) }];
  edit(edits, `Person ${person.number} performs in ${video.id}.`);
}

/** Declare whoever is at a point of the picture, where nobody is outlined yet. */
export function choosePoint(video, frame, at) {
  const [first, stop] = spanOf(video);
  if (frame < first || frame >= stop) {
    tell(`Frame ${frame} of ${video.id} is not used: go to a frame that is.`, { bad: true });
    return;
  }
  edit([{ kind: "person", video: video.id, person: { frame, at } }], `The performer of ${video.id} is at this point.`);
}

export function chooseNobody(video) {
  edit([{ kind: "person", video: video.id, person: null }], `The program chooses the performer of ${video.id}.`);
}

/** Use these frames; a performer who is named in a frame outside them is named in one inside. */
export async function use(video, frames) {
  const count = countOf(video);
  const first = Math.max(0, Math.min(Math.round(frames[0]), count - LEAST_FRAMES));
  const stop = Math.min(count, Math.max(Math.round(frames[1]), first + LEAST_FRAMES));
  const edits = [{ kind: "frames", video: video.id, frames: first === 0 && stop === count ? null : [first, stop] }];
  const declared = video.person;
  if (declared?.frame !== undefined && (declared.frame < first || declared.frame >= stop)) {
    const person = declaredPerson(video);
    const frame = person && nearestFrame(person, [first, stop], declared.frame);
    if (person && frame !== null) {
      edits.push({ kind: "person", video: video.id, person: declaration(person, frame) });
    }
  }
  await edit(edits, `${video.id} uses frames ${first} to ${stop - 1}.`);
  if (view.drag?.id === video.id) view.drag = null;
  changed();
}

export function startHere(video = selectedVideo()) {
  const frame = momentOf(video), [, stop] = spanOf(video);
  use(video, [frame, stop > frame + LEAST_FRAMES ? stop : countOf(video)]);
}

export function stopHere(video = selectedVideo()) {
  const frame = momentOf(video), [first] = spanOf(video);
  use(video, [first < frame - 1 ? first : 0, frame + 1]);
}

export function splitHere(video = selectedVideo()) {
  const frame = momentOf(video);
  edit([{ kind: "split", video: video.id, starts: [frame] }], `${video.id} is split at frame ${frame}.`);
}

/** Frames inside the span with which a new shot begins. */
export function cutsInside(video) {
  const [first, stop] = spanOf(video);
  return (fileOf(video)?.cuts ?? []).filter((cut) => cut > first && cut < stop);
}

export function splitShots(video) {
  const starts = cutsInside(video);
  edit([{ kind: "split", video: video.id, starts }], `Each of the ${starts.length + 1} shots of ${video.id} is a video.`);
}

/** Use only the shot that the strip stands in. */
export function useShot(video) {
  const frame = momentOf(video), [first, stop] = spanOf(video);
  const edges = [first, ...cutsInside(video), stop];
  const place = Math.max(1, edges.findIndex((edge, n) => n > 0 && frame < edge));
  use(video, [edges[place - 1], edges[place]]);
}

export function mirror(video, mirrored) {
  const words = mirrored === null ? "may be mirrored: the program decides" : mirrored ? "is mirrored" : "is not mirrored";
  edit([{ kind: "mirrored", video: video.id, mirrored }], `${video.id} ${words}.`);
}

/** Names of performers are of every video or of none: they are saved together. */
export async function namePerformer(video, text) {
  view.names.set(video.id, text.trim());
  const all = Object.fromEntries(store.state.videos.map(({ id, performer }) => [id, view.names.get(id) ?? performer ?? ""]));
  const nameless = Object.keys(all).filter((id) => !all[id]);
  const none = nameless.length === Object.keys(all).length;
  if (nameless.length && !none) {
    tell(`Name who performs in ${nameless.join(", ")} too: every video has a name, or none has.`);
  } else {
    const changes = store.state.videos.some(({ id, performer }) => (performer ?? "") !== all[id]);
    if (changes) await edit([{ kind: "performers", performers: none ? null : all }], none ? "One person performs in all videos." : "Each performer has a body of their own.");
    view.names.clear();
  }
  changed();
}

export function setEvent(event) {
  edit([{ kind: "event", event }], event ? "All videos film one and the same performance." : "The videos show different performances.");
}

/** The first press begins a span that matches nothing, the second ends it. */
export async function ignoreHere(video = selectedVideo()) {
  const frame = momentOf(video), from = view.ignore;
  if (from?.id !== video.id) {
    view.ignore = { id: video.id, frame };
    tell("Now go to the last frame that matches nothing, and press the button again.");
    changed();
    return;
  }
  view.ignore = null;
  const [first, last] = [Math.min(from.frame, frame), Math.max(from.frame, frame)];
  await edit([{ kind: "add_forbidden", video: video.id, frames: [first, last + 1] }], `Frames ${first} to ${last} of ${video.id} match nothing.`);
  changed();
}

export function matchAgain(number) {
  edit([{ kind: "forbidden", number }], "These frames may match again.");
}

export function drop(video = selectedVideo()) {
  edit([{ kind: "drop", video: video.id }], `${video.id} is no longer part of the action. The file stays.`);
}

export function mark(video = selectedVideo()) {
  const frame = momentOf(video);
  if (view.marks.get(video.id) === frame) view.marks.delete(video.id);
  else view.marks.set(video.id, frame);
  if (view.marks.size === 1) tell(`Now go to the same moment in another video, and mark it too.`);
  changed();
}

export async function saveMarks() {
  if (view.marks.size < 2) return;
  const frames = Object.fromEntries(view.marks);
  if (await edit([{ kind: "add_anchor", frames }], "These frames show the same moment.")) view.marks.clear();
  changed();
}

export function changeAnchor(number, hard) {
  edit([{ kind: "anchor", number, hard }], hard === null ? "The anchor is removed." : undefined);
}

/** Where a video has no keypoints, people are to be detected in it. */
export async function askForDetection(state) {
  const blind = state.videos.filter((video) => video.no_keypoints);
  return !blind.length || edit(blind.map(({ id }) => ({ kind: "detect", video: id })));
}

export function byNumber(video, number) {
  const person = peopleOf(video)?.people[number - 1];
  if (person) choose(video, person);
}
