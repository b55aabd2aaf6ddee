// One frame, large, with everybody outlined: click who performs.

import { choose, chooseNobody, choosePoint, ignoreHere, splitHere, startHere, stopHere, mark } from "./actions.js";
import { declaredPerson, framesInside, likelyPerson, rowAt } from "./performer.js";
import { addressOf, picture } from "./pictures.js";
import { countOf, fileOf, fpsOf, momentOf, peopleOf, seek, selectedVideo, shownFrame, sizeOf, spanOf, changed, view, videoOf } from "./store.js";
import { colourOf, element, seconds, write } from "./text.js";

const get = (id) => document.getElementById(id);
const svg = (name, attributes = {}) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};
let loading = null, drawn = "";

/** The video under the pointer, or the selected one. */
export const shownVideo = () => (view.preview && videoOf(view.preview.id)) || selectedVideo();

let playing = 0;

/** Play the selected video from its moment, or stop; a frame waits until the one before it is there. */
export function play() {
  const video = selectedVideo();
  if (playing || !video) playing = clearInterval(playing) ?? 0;
  else playing = setInterval(() => {
    const now = selectedVideo(), next = momentOf(now) + 1;
    if (now.id !== video.id || next >= countOf(now)) return play();
    if (!loading) seek(now.id, next);
  }, 1000 / fpsOf(video));
  get("play").textContent = playing ? "❚❚" : "▶";
  get("play").setAttribute("aria-label", playing ? "Pause" : "Play");
}

export function setUpStage() {
  get("play").addEventListener("click", play);
  get("scrub").addEventListener("input", (event) => seek(view.selected, Number(event.target.value)));
  for (const button of document.querySelectorAll("#transport [data-step]")) {
    button.addEventListener("click", () => seek(view.selected, momentOf(selectedVideo()) + Number(button.dataset.step)));
  }
  get("start").addEventListener("click", () => startHere());
  get("stop").addEventListener("click", () => stopHere());
  get("split").addEventListener("click", () => splitHere());
  get("mark").addEventListener("click", () => mark());
  get("ignore").addEventListener("click", () => ignoreHere());
  get("outlines").addEventListener("click", clickedBeside);
}

function clickedBeside(event) {
  const video = shownVideo();
  if (!video || event.target.closest(".person") || peopleOf(video)) return;
  const matrix = get("outlines").getScreenCTM().inverse();
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
  const [width, height] = sizeOf(video);
  if (x >= 0 && y >= 0 && x < width && y < height) choosePoint(video, shownFrame(video), [Math.round(x), Math.round(y)]);
}

export function drawStage(state) {
  const video = shownVideo();
  if (!video) return;
  const frame = shownFrame(video), file = fileOf(video);
  write(get("stage-name"), video.id);
  write(get("stage-time"), `frame ${frame} · ${seconds(video, frame)}`);
  drawFrame(video, frame, file);
  drawOutlines(video, frame);
  write(get("hint"), hintOf(state, video, file));
  const selected = selectedVideo();
  drawTransport(selected, momentOf(selected));
  drawPeople(selected, state);
}

function hintOf(state, video, file) {
  if (file?.fault) return file.fault;
  if (file && file.count === undefined) return "Reading the video …";
  if (video.file === null) return "There is no video file, only keypoints.";
  if (peopleOf(video) || video.person) return "";
  if (state.detection.state === "running" || video.people.state === "waiting") return "People are being looked for. You can click the performer already.";
  return "Click the performer, or press Find people to have everybody outlined.";
}

function drawFrame(video, frame, file) {
  const image = get("frame");
  image.alt = `Frame ${frame} of ${video.id}`;
  if (!file || file.count === undefined) { image.removeAttribute("src"); return; }
  const address = addressOf(video.file, "large", frame);
  if (image.getAttribute("src") === address) return;
  if (picture(address)) { image.src = address; return; }
  const near = Math.round(frame / file.step) * file.step;
  const small = addressOf(video.file, "thumb", Math.min(near, file.count - 1));
  if (picture(small)) image.src = small;
  if (loading) return; // one at a time: a drag over many frames asks for the last one
  loading = address;
  const again = () => { loading = null; changed(); };
  setTimeout(() => { if (loading === address) again(); }, 4000);
  picture(address, again);
}

function drawOutlines(video, frame) {
  const overlay = get("outlines"), [width, height] = sizeOf(video);
  const everybody = peopleOf(video), declared = declaredPerson(video), person = video.person;
  const stamp = JSON.stringify([video.id, frame, video.people.key, !!everybody, person, width]);
  if (stamp === drawn) return;
  drawn = stamp;
  const focused = document.activeElement?.closest?.("#outlines .person")?.dataset.number;
  overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
  overlay.replaceChildren();
  const unit = Math.max(width, height) / 28;
  for (const someone of everybody?.people ?? []) {
    const row = rowAt(someone, frame, everybody.step);
    if (row === undefined) continue;
    overlay.append(outlineOf(video, someone, row, someone === declared, unit));
  }
  if (person?.at && person.frame === frame) overlay.append(cross(person.at, unit));
  if (focused) overlay.querySelector(`.person[data-number="${focused}"]`)?.focus({ preventScroll: true });
}

function outlineOf(video, person, row, chosen, unit) {
  const points = person.outlines[row], box = person.boxes[row];
  const pairs = points.map((value, i) => (i % 2 ? value : ` ${value}`)).join(",").replaceAll(", ", " ");
  const group = svg("g", { class: chosen ? "person chosen" : "person", tabindex: 0, role: "button", "data-number": person.number });
  group.setAttribute("aria-label", `Person ${person.number}${chosen ? ", performs" : ""}`);
  group.setAttribute("aria-pressed", String(chosen));
  group.style.setProperty("--colour", colourOf(person.number));
  const label = svg("text", { x: (box[0] + box[2]) / 2, y: Math.max(unit, box[1] - unit * 0.9), "font-size": unit, "stroke-width": unit / 6 });
  label.textContent = chosen ? `${person.number} performs` : person.number;
  group.append(svg("polygon", { class: "case", points: pairs }), svg("polygon", { class: "body", points: pairs }), label);
  const act = () => choose(video, person);
  group.addEventListener("click", act);
  group.addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") { event.preventDefault(); act(); }
  });
  return group;
}

function cross([x, y], unit) {
  const group = svg("g");
  group.append(svg("circle", { class: "place", cx: x, cy: y, r: unit }), svg("circle", { class: "place", cx: x, cy: y, r: unit / 8 }));
  return group;
}

function drawTransport(video, frame) {
  const scrub = get("scrub"), count = countOf(video), [first, stop] = spanOf(video);
  scrub.max = Math.max(0, count - 1);
  scrub.value = frame;
  scrub.setAttribute("aria-valuetext", `frame ${frame}, ${seconds(video, frame)}`);
  for (const id of ["start", "stop", "split", "mark", "ignore", "scrub"]) get(id).disabled = !count;
  get("split").disabled = !count || frame <= first || frame >= stop;
  write(get("mark"), view.marks.get(video.id) === frame ? "Unmark" : "Mark");
  write(get("ignore"), view.ignore?.id === video.id ? "To here" : "Ignore");
}

// ---- everybody as buttons: for the keyboard, and for people who are small in the picture

let chips = "";

function drawPeople(video, state) {
  const everybody = peopleOf(video), declared = declaredPerson(video);
  const likely = video.person ? null : likelyPerson(video);
  const share = (person) => framesInside(person, spanOf(video)).length * (everybody?.step ?? 1);
  const stamp = JSON.stringify([video.id, video.people, video.person, !!everybody, spanOf(video), state.detection.state, likely?.number]);
  if (stamp === chips) return;
  chips = stamp;
  const focused = document.activeElement?.dataset?.chip;
  const list = get("people");
  list.replaceChildren();
  for (const person of everybody?.people ?? []) {
    const percent = Math.round((100 * share(person)) / Math.max(1, spanOf(video)[1] - spanOf(video)[0]));
    const note = `in ${Math.min(100, percent)} % of the frames`;
    const chip = element("button", { type: "button", class: "chip", "data-chip": person.number, "aria-pressed": person === declared },
      face(video, person), element("span", {}, element("b", { text: `Person ${person.number}` }), element("small", { text: person === likely ? `${note}, likely` : note })));
    chip.style.setProperty("--colour", colourOf(person.number));
    chip.addEventListener("click", () => choose(video, person));
    list.append(chip);
  }
  const nobody = element("button", { type: "button", class: "chip plain", "data-chip": "0", "aria-pressed": video.person === null },
    element("span", {}, element("b", { text: "The program decides" }), element("small", { text: likely ? `likely person ${likely.number}, unless the other videos disagree` : "presence, size and motion" })));
  nobody.addEventListener("click", () => chooseNobody(video));
  list.append(nobody);
  if (!everybody && video.people.state === "none" && state.detection.state !== "running") {
    const find = element("button", { type: "button", "data-chip": "find", text: "Find people" });
    find.addEventListener("click", () => get("find").click());
    list.append(find);
  }
  if (focused) list.querySelector(`[data-chip="${focused}"]`)?.focus({ preventScroll: true });
}

/** The person's picture in the middle of their track. */
function face(video, person) {
  const canvas = element("canvas", { width: 72, height: 88, "aria-hidden": "true" });
  if (video.file === null) return canvas;
  const row = Math.floor(person.frames.length / 2), [x0, y0, x1, y1] = person.boxes[row];
  const address = addressOf(video.file, "large", person.frames[row]);
  const paint = () => {
    const image = picture(address);
    if (!image) return;
    const scale = image.naturalWidth / sizeOf(video)[0];
    const high = Math.max((y1 - y0) * 1.15, (x1 - x0) * 1.4), wide = (high * 72) / 88;
    const [w, h] = sizeOf(video), inside = (from, length, all) => Math.max(0, Math.min(from, all - length));
    const left = inside((x0 + x1 - wide) / 2, wide, w), top = inside((y0 + y1 - high) / 2, high, h);
    canvas.getContext("2d").drawImage(image, left * scale, top * scale, wide * scale, high * scale, 0, 0, 72, 88);
  };
  if (picture(address, paint)) paint();
  return canvas;
}
