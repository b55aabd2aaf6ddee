// What the server says (state) and what this page looks at (view); listeners redraw after either.

export const store = { state: null };
export const view = {
  selected: null, // id of a video
  moments: new Map(), // id -> frame
  preview: null, // {id, frame} under the pointer
  drag: null, // {id, frames} while a span is dragged
  marks: new Map(), // id -> frame of an anchor that is not saved yet
  names: new Map(), // id -> performer that is typed and not saved yet
  ignore: null, // {id, frame}: where a span that matches nothing begins
  whole: new Set(), // ids of videos whose strip shows the whole file
};

const listeners = [];
let asked = false;

export function onChange(listener) { listeners.push(listener); }

export function changed() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    if (store.state) for (const listener of listeners) listener(store.state, view);
  });
}

export function setState(state) {
  store.state = state;
  const ids = state.videos.map((video) => video.id);
  if (!ids.includes(view.selected)) view.selected = ids[0] ?? null;
  for (const id of view.names.keys()) if (!ids.includes(id)) view.names.delete(id);
  if (view.ignore && !ids.includes(view.ignore.id)) view.ignore = null;
  for (const id of view.marks.keys()) if (!ids.includes(id)) view.marks.delete(id);
  changed();
}

export const videoOf = (id) => store.state.videos.find((video) => video.id === id);
export const selectedVideo = () => videoOf(view.selected);

export function fileOf(video) {
  return video.file === null ? null : store.state.files[video.file];
}

/** Frames of a video's file; 0 while they are not counted. */
export function countOf(video) {
  const file = fileOf(video);
  if (file) return file.count ?? 0;
  const people = outlines.get(video.people.key);
  return people ? people.frames[1] : (video.frames ? video.frames[1] : 0);
}

export const fpsOf = (video) => fileOf(video)?.fps ?? video.fps ?? 30;
export const sizeOf = (video) => fileOf(video)?.size ?? video.size ?? [640, 360];

/** First frame used and one past the last, as it is dragged at the moment. */
export function spanOf(video) {
  if (view.drag?.id === video.id) return view.drag.frames;
  return video.frames ?? [0, countOf(video)];
}

/** The frame that a video's strip stands at. */
export function momentOf(video) {
  const last = Math.max(0, countOf(video) - 1);
  const span = spanOf(video);
  const frame = view.moments.get(video.id) ?? Math.floor((span[0] + span[1]) / 2);
  return Math.max(0, Math.min(last, frame));
}

export function shownFrame(video) {
  return view.preview?.id === video.id ? view.preview.frame : momentOf(video);
}

export function seek(id, frame, select = true) {
  const last = Math.max(0, countOf(videoOf(id)) - 1);
  view.moments.set(id, Math.max(0, Math.min(last, Math.round(frame))));
  view.preview = null;
  if (select) view.selected = id;
  changed();
}

export const outlines = new Map(); // key -> everybody tracked in a video, as the server sends it

export async function loadOutlines(state) {
  for (const { people } of state.videos) {
    if (people.state !== "ready" || outlines.has(people.key)) continue;
    outlines.set(people.key, null);
    const answer = await fetch(`people/${people.key}`);
    if (!answer.ok) { outlines.delete(people.key); continue; }
    const document = await answer.json();
    for (const person of document.people) person.index = new Map(person.frames.map((f, i) => [f, i]));
    outlines.set(people.key, document);
    changed();
  }
}

export function peopleOf(video) {
  return (video.people.state === "ready" && outlines.get(video.people.key)) || null;
}
