// A video along time: its film, the used span with two grips, the moment, and anchors.

import { use } from "./actions.js";
import { Film, windowOf } from "./film.js";
import { changed, countOf, fileOf, fpsOf, momentOf, seek, shownFrame, spanOf, view, videoOf } from "./store.js";
import { element, seconds, write } from "./text.js";

const COMMIT_MS = 700;

export class Strip {
  constructor(id) {
    this.id = id;
    this.film = new Film();
    this.left = element("div", { class: "shade" });
    this.right = element("div", { class: "shade" });
    this.frame = element("div", { class: "frame" });
    this.head = element("div", { class: "head" });
    this.moment = element("div", { class: "moment", role: "slider", tabindex: 0, "aria-valuemin": 0 });
    this.flags = element("div", { "aria-hidden": "true" });
    this.reading = element("p", { class: "reading" });
    this.first = this.grip("first", "First frame used");
    this.last = this.grip("last", "Last frame used");
    this.node = element("div", { class: "strip" }, this.film.canvas, this.left, this.right, this.frame, this.moment, this.first, this.last, this.head, this.flags, this.reading);
    this.moment.setAttribute("aria-label", `Moment of ${id}`);
    this.listen();
    new ResizeObserver(() => this.film.again()).observe(this.node);
  }

  get video() { return videoOf(this.id); }

  grip(side, label) {
    const grip = element("button", { type: "button", class: `grip ${side}`, role: "slider", "aria-label": `${label} of ${this.id}` });
    grip.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      grip.setPointerCapture(event.pointerId);
      this.held = side;
      view.selected = this.id;
      view.drag = { id: this.id, frames: [...spanOf(this.video)] };
      this.offset = event.clientX - this.xOf(this.edge(side));
    });
    grip.addEventListener("pointermove", (event) => this.held === side && this.dragTo(side, this.frameAt(event.clientX - this.offset)));
    grip.addEventListener("pointerup", () => this.release());
    grip.addEventListener("pointercancel", () => { this.held = null; view.drag = null; changed(); });
    grip.addEventListener("keydown", (event) => this.nudge(event, side));
    return grip;
  }

  listen() {
    const seekTo = (event) => seek(this.id, this.frameAt(event.clientX));
    this.moment.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      this.scrubbing = true;
      if (event.pointerType === "mouse") this.moment.setPointerCapture(event.pointerId);
      seekTo(event);
    });
    this.moment.addEventListener("pointermove", (event) => {
      if (this.scrubbing) seekTo(event);
      else if (event.pointerType === "mouse" && !view.drag && countOf(this.video)) {
        view.preview = { id: this.id, frame: this.frameAt(event.clientX) };
        changed();
      }
    });
    for (const kind of ["pointerup", "pointercancel"]) this.moment.addEventListener(kind, () => { this.scrubbing = false; });
    this.moment.addEventListener("pointerleave", () => { view.preview = null; changed(); });
    this.moment.addEventListener("keydown", (event) => {
      const moved = stepOf(event, momentOf(this.video), [0, countOf(this.video) - 1], fpsOf(this.video));
      if (moved === null) return;
      event.preventDefault();
      event.stopPropagation();
      seek(this.id, moved);
    });
  }

  edge(side) { const span = spanOf(this.video); return side === "first" ? span[0] : span[1]; }

  xOf(frame) {
    const [a, b] = windowOf(this.video), box = this.node.getBoundingClientRect();
    return box.left + ((frame - a) / (b - a)) * box.width;
  }

  frameAt(x) {
    const [a, b] = windowOf(this.video), box = this.node.getBoundingClientRect();
    const frame = a + ((x - box.left) / box.width) * (b - a);
    return Math.max(a, Math.min(this.held ? b : b - 1, this.held ? Math.round(frame) : Math.floor(frame)));
  }

  dragTo(side, frame) {
    const [first, stop] = view.drag?.id === this.id ? view.drag.frames : spanOf(this.video);
    const frames = side === "first" ? [Math.max(0, Math.min(frame, stop - 3)), stop] : [first, Math.min(countOf(this.video), Math.max(frame, first + 3))];
    view.drag = { id: this.id, frames };
    view.moments.set(this.id, side === "first" ? frames[0] : frames[1] - 1);
    changed();
  }

  release() {
    this.held = null;
    if (view.drag?.id !== this.id) return;
    const [first, stop] = view.drag.frames, before = this.video.frames ?? [0, countOf(this.video)];
    if (first === before[0] && stop === before[1]) { view.drag = null; changed(); return; }
    use(this.video, [first, stop]);
  }

  nudge(event, side) {
    const moved = stepOf(event, this.edge(side), [0, countOf(this.video)], fpsOf(this.video));
    if (moved === null) return;
    event.preventDefault();
    event.stopPropagation();
    view.selected = this.id;
    this.dragTo(side, moved);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.release(), COMMIT_MS);
  }

  draw(state) {
    const video = this.video, file = fileOf(video), count = countOf(video);
    const ready = count > 0 && !file?.fault;
    write(this.reading, ready ? "" : file?.fault ? "cannot be read" : `reading, ${Math.round(100 * (file?.share ?? 0))} %`);
    for (const node of [this.left, this.right, this.frame, this.head, this.first, this.last, this.flags]) node.hidden = !ready;
    if (!ready) return;
    const [a, b] = windowOf(video), [first, stop] = spanOf(video), frame = shownFrame(video);
    const place = (f) => `${(100 * Math.max(0, Math.min(1, (f - a) / (b - a)))).toFixed(3)}%`;
    this.left.style.left = "0"; this.left.style.width = place(first);
    this.right.style.left = place(stop); this.right.style.right = "0";
    this.frame.style.left = place(first); this.frame.style.right = `${(100 * Math.max(0, Math.min(1, (b - stop) / (b - a)))).toFixed(3)}%`;
    this.first.style.left = place(first);
    this.last.style.left = place(stop);
    this.head.style.left = place(frame + 0.5);
    this.head.classList.toggle("preview", view.preview?.id === this.id);
    slider(this.moment, video, frame, [0, count - 1]);
    slider(this.first, video, first, [0, stop - 3]);
    slider(this.last, video, stop - 1, [first + 2, count - 1]);
    this.drawFlags(state, [first, stop], place);
    this.film.paint(video, file, [a, b]);
  }

  drawFlags(state, [first, stop], place) {
    const flags = state.anchors.map((anchor, n) => [anchor.frames[this.id], String(n + 1), ""]);
    if (view.marks.has(this.id)) flags.push([view.marks.get(this.id), "+", " open"]);
    const ignored = state.forbidden.filter(({ video }) => video === this.id).map(({ frames }) => frames);
    if (view.ignore?.id === this.id) ignored.push([view.ignore.frame, view.ignore.frame + 1]);
    const stamp = JSON.stringify([flags, ignored, first, stop, windowOf(this.video)]);
    if (stamp === this.flagged) return;
    this.flagged = stamp;
    this.flags.replaceChildren(...flags.filter(([frame]) => frame !== undefined).map(([frame, text, kind]) => {
      const flag = element("span", { class: `flag${kind}${frame < first || frame >= stop ? " outside" : ""}`, text });
      flag.style.left = place(frame + 0.5);
      return flag;
    }), ...ignored.map(([from, to]) => {
      const span = element("span", { class: "ignored" });
      span.style.left = place(from); span.style.right = `calc(100% - ${place(to)})`;
      return span;
    }));
  }

}

function slider(node, video, frame, [least, most]) {
  node.setAttribute("aria-valuemin", least);
  node.setAttribute("aria-valuemax", most);
  node.setAttribute("aria-valuenow", frame);
  node.setAttribute("aria-valuetext", `frame ${frame}, ${seconds(video, frame)}`);
}

/** Where a key moves a slider to; null for other keys. */
export function stepOf(event, value, [least, most], fps) {
  if (event.ctrlKey || event.metaKey || event.altKey) return null;
  const one = event.shiftKey ? 10 : 1;
  const steps = { ArrowLeft: -one, ArrowRight: one, PageDown: -Math.round(fps), PageUp: Math.round(fps) };
  if (event.key === "Home") return least;
  if (event.key === "End") return most;
  return event.key in steps ? Math.max(least, Math.min(most, value + steps[event.key])) : null;
}
