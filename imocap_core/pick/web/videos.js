// A card for every video: its strip, and what is declared of it.

import { cutsInside, drop, mirror, namePerformer, splitShots, useShot } from "./actions.js";
import { declaredPerson, likelyPerson } from "./performer.js";
import { changed, countOf, fileOf, peopleOf, view, videoOf } from "./store.js";
import { windowOf } from "./film.js";
import { Strip } from "./strip.js";
import { element, usedText, write } from "./text.js";

const cards = new Map();
let suggested = "";

export function drawVideos(state) {
  const list = document.getElementById("videos");
  for (const [id, card] of cards) {
    if (!videoOf(id)) { card.node.remove(); cards.delete(id); }
  }
  const names = [...new Set(state.videos.map(({ id, performer }) => view.names.get(id) ?? performer).filter(Boolean))];
  if (names.join() !== suggested) document.getElementById("performers").replaceChildren(...names.map((value) => element("option", { value })));
  suggested = names.join();
  state.videos.forEach((video, n) => {
    if (!cards.has(video.id)) cards.set(video.id, cardOf(video.id));
    const card = cards.get(video.id);
    if (list.children[n] !== card.node) list.insertBefore(card.node, list.children[n] ?? null);
    draw(card, video, state);
  });
}

function cardOf(id) {
  const button = (text, act) => {
    const made = element("button", { type: "button", text });
    made.addEventListener("click", () => act(videoOf(id)));
    return made;
  };
  const name = button(id, () => { view.selected = id; changed(); });
  const select = element("select", { "aria-label": `Mirror image of ${id}` },
    element("option", { value: "null", text: "Mirrored: automatic" }),
    element("option", { value: "true", text: "Mirrored: yes" }),
    element("option", { value: "false", text: "Mirrored: no" }));
  select.addEventListener("change", () => mirror(videoOf(id), JSON.parse(select.value)));
  const performer = element("input", { type: "text", class: "performer", placeholder: "Performer", "aria-label": `Performer's name in ${id}`, list: "performers", autocomplete: "off", spellcheck: "false", maxlength: 60 });
  performer.addEventListener("change", () => namePerformer(videoOf(id), performer.value));
  performer.addEventListener("keydown", (event) => { if (event.key === "Enter") performer.blur(); });
  const card = {
    name, select, performer,
    file: element("span", { class: "file" }),
    used: element("span", { class: "used" }),
    shot: button("Only this shot", useShot),
    shots: button("", splitShots),
    zoom: button("", (video) => { if (!view.whole.delete(video.id)) view.whole.add(video.id); changed(); }),
    drop: button("Drop", drop),
    strip: new Strip(id),
    state: element("p", { class: "state" }),
  };
  card.drop.setAttribute("aria-label", `Drop ${id}`);
  card.node = element("article", { class: "video", "aria-label": `Video ${id}` },
    element("header", {}, element("h3", {}, name), card.file, card.used, performer, select, card.drop),
    card.strip.node, element("footer", {}, card.state, card.zoom, card.shot, card.shots));
  card.node.addEventListener("focusin", () => { if (view.selected !== id) { view.selected = id; changed(); } });
  card.node.addEventListener("pointerdown", () => { if (view.selected !== id) { view.selected = id; changed(); } });
  return card;
}

function draw(card, video, state) {
  card.node.classList.toggle("selected", video.id === view.selected);
  if (video.id === view.selected) card.name.setAttribute("aria-current", "true");
  else card.name.removeAttribute("aria-current");
  write(card.file, fileOf(video)?.name ?? "keypoints only");
  write(card.used, countOf(video) ? usedText(video) : "");
  const cuts = cutsInside(video).length;
  card.shot.hidden = card.shots.hidden = !cuts;
  write(card.shots, `Split into ${cuts + 1} shots`);
  const [a, b] = windowOf(video), whole = a === 0 && b >= countOf(video);
  card.zoom.hidden = whole && !view.whole.has(video.id);
  write(card.zoom, view.whole.has(video.id) ? "Zoom in" : "Whole file");
  if (document.activeElement !== card.select) card.select.value = String(video.mirrored);
  card.performer.hidden = state.videos.length < 2;
  if (document.activeElement !== card.performer) card.performer.value = view.names.get(video.id) ?? video.performer ?? "";
  const [kind, text] = stateOf(video, state);
  card.state.className = `state ${kind}`;
  write(card.state, text);
  card.strip.draw(state);
}

function stateOf(video, state) {
  const file = fileOf(video);
  if (file?.fault) return ["bad", file.fault];
  if (video.people.state === "fault") return ["bad", video.people.fault];
  const declared = declaredPerson(video), likely = likelyPerson(video);
  if (video.person && declared) return ["good", `Performer: person ${declared.number}`];
  if (video.person && peopleOf(video)) return ["bad", "Performer: nobody is where action.yaml says. Choose them again."];
  if (video.person) return ["good", `Performer: named in frame ${video.person.frame ?? ""}`];
  if (likely) return ["", `Performer: the program decides, likely person ${likely.number}`];
  if (video.people.state === "waiting") return ["", "Following everybody …"];
  if (state.detection.state === "running") return ["", "People are being looked for …"];
  return ["", "Performer: the program decides. Nobody is outlined yet."];
}
