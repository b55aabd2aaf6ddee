// The film of a strip: thumbnails with everybody outlined, cuts, and a line for everybody below.

import { declaredPerson, likelyPerson, rowAt } from "./performer.js";
import { addressOf, picture } from "./pictures.js";
import { changed, countOf, fpsOf, peopleOf, sizeOf, view } from "./store.js";
import { colourOf, element } from "./text.js";

const FILM = 76, LANES = 16, WIDEST = 92, LONG = 400; // pixels, pixels, pixels, frames

/** First frame shown and one past the last: of a long file, the span and what is around it. */
export function windowOf(video) {
  const count = countOf(video), span = video.frames;
  if (!span || count <= LONG || view.whole.has(video.id)) return [0, Math.max(1, count)];
  const margin = Math.max(Math.round((span[1] - span[0]) / 2), Math.round(fpsOf(video)));
  return [Math.max(0, span[0] - margin), Math.min(count, span[1] + margin)];
}

export class Film {
  constructor() {
    this.canvas = element("canvas", { "aria-hidden": "true" });
    this.drawn = "";
  }

  /** Paint again although nothing has changed: the size has, or a picture has come. */
  again() { this.drawn = ""; changed(); }

  /** The film and below it a line for everybody who is tracked. */
  paint(video, file, [a, b]) {
    const width = this.canvas.clientWidth, ratio = Math.min(2, devicePixelRatio || 1);
    const everybody = peopleOf(video), declared = declaredPerson(video);
    const stamp = JSON.stringify([width, ratio, a, b, video.people.key, !!everybody, declared?.number, video.file]);
    if (stamp === this.drawn || !width) return;
    this.drawn = stamp;
    this.canvas.width = width * ratio;
    this.canvas.height = (FILM + LANES) * ratio;
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    const [w, h] = sizeOf(video), number = Math.max(1, Math.round(width / Math.min(WIDEST, (FILM * w) / h)));
    const each = width / number;
    for (let i = 0; i < number; i += 1) {
      let frame = Math.min(b - 1, Math.floor(a + ((i + 0.5) * (b - a)) / number));
      if (file && b - a > 2 * number) frame = Math.min(file.count - 1, Math.round(frame / file.step) * file.step);
      this.paintThumb(context, video, frame, i * each, each);
    }
    for (const cut of file?.cuts ?? []) {
      const x = ((cut - a) / (b - a)) * width;
      context.fillStyle = "#000";
      context.fillRect(x - 3, 0, 6, FILM);
      context.fillStyle = "#fff";
      context.fillRect(x - 1, 0, 2, FILM);
    }
    this.paintLanes(context, everybody, declared, [a, b], width);
  }

  /** One frame, cut to the place of its thumbnail around the performer. */
  paintThumb(context, video, frame, left, wide) {
    const everybody = peopleOf(video), declared = declaredPerson(video), [w, h] = sizeOf(video);
    const scale = Math.max(wide / w, FILM / h), middle = scale * middleOf(video, frame);
    const shift = Math.max(wide - w * scale, Math.min(0, wide / 2 - middle));
    const paint = (image) => {
      context.save();
      context.beginPath();
      context.rect(left, 0, wide, FILM);
      context.clip();
      context.translate(left + shift, (FILM - h * scale) / 2);
      context.scale(scale, scale);
      if (image) context.drawImage(image, 0, 0, w, h);
      for (const person of everybody?.people ?? []) {
        const row = rowAt(person, frame, everybody.step);
        if (row === undefined) continue;
        const points = person.outlines[row];
        context.beginPath();
        for (let i = 0; i < points.length; i += 2) context.lineTo(points[i], points[i + 1]);
        context.closePath();
        context.lineWidth = (person === declared ? 4.5 : 3) / scale;
        context.strokeStyle = "#000b";
        context.stroke();
        context.lineWidth = (person === declared ? 2.5 : 1.3) / scale;
        context.strokeStyle = colourOf(person.number);
        context.stroke();
      }
      context.restore();
    };
    if (video.file === null) { paint(null); return; }
    paint(picture(addressOf(video.file, "thumb", frame), () => this.again()));
  }

  paintLanes(context, everybody, declared, [a, b], width) {
    const people = (everybody?.people ?? []).slice(0, 3), high = 4;
    people.forEach((person, n) => {
      context.fillStyle = colourOf(person.number);
      context.globalAlpha = !declared || person === declared ? 1 : 0.45;
      const top = FILM + 2 + n * (high + 1);
      const x = (frame) => ((Math.max(a, Math.min(b, frame)) - a) / (b - a)) * width;
      for (const [first, stop] of runs(person.frames, everybody.step)) {
        if (stop > a && first < b) context.fillRect(x(first), top, x(stop) - x(first), high - 1);
      }
    });
    context.globalAlpha = 1;
  }
}

/** Where the performer is in a frame, across; the middle where nobody is. */
function middleOf(video, frame) {
  const person = declaredPerson(video) ?? likelyPerson(video);
  const row = person ? rowAt(person, frame, peopleOf(video).step) : undefined;
  if (row === undefined) return sizeOf(video)[0] / 2;
  return (person.boxes[row][0] + person.boxes[row][2]) / 2;
}

/** Spans [first, one past last] of frames that follow each other. */
function runs(frames, step) {
  const spans = [];
  for (const frame of frames) {
    const last = spans.at(-1);
    if (last && frame - last[1] < step) last[1] = frame + step;
    else spans.push([frame, frame + step]);
  }
  return spans;
}
