// Source frames: a small video each, decoded ahead of time, each picture shown with the frame it is of.

const KEPT = 48, AT_ONCE = 3, LATE_MS = 1000; // pictures of a video: kept, decoded at one time, waited for

class Pictures {
  constructor(video, ready) {
    Object.assign(this, { video, ready, decoded: new Map(), busy: new Set(), last: null });
    if (video.pictures) this.stream = openStream(video.pictures);
  }

  // The decoded picture nearest to a frame: {bitmap, frame}, the frame being the picture's. Null
  // before the first is decoded, or without pictures. The frame's own picture is decoded if it is missing.
  at(frame) {
    if (!this.video.pictures) return null;
    const number = this.number(frame), bitmap = this.decoded.get(number);
    if (bitmap) this.last = number, this.decoded.delete(number), this.decoded.set(number, bitmap);
    else this.decode(number), this.last = this.nearest(number);
    return this.last === null ? null : { bitmap: this.decoded.get(this.last), frame: this.frame(this.last) };
  }

  // Decode what will be wanted soon; ends when it is there.
  async ahead(frame) {
    if (this.video.pictures) await this.decode(this.number(frame));
  }

  nearest(number) {
    const far = (n) => Math.abs(n - number);
    return [...this.decoded.keys()].reduce((a, b) => (a === null || far(b) <= far(a) ? b : a), null);
  }

  number(frame) {
    const { every, keys } = this.video.pictures;
    return clamp(Math.round(frame / every), 0, keys.length - 1);
  }

  frame(number) {
    return Math.min(number * this.video.pictures.every, this.video.frames.length - 1);
  }

  async decode(number) {
    if (this.decoded.has(number) || this.busy.has(number) || this.busy.size >= AT_ONCE) return;
    this.busy.add(number);
    const asked = this.stream;
    try {
      this.decoded.set(number, await (await asked).picture(number));
    } catch {
      if (asked === this.stream && this.refused) return; // neither can: it stays busy, and is not asked again
      if (asked === this.stream) this.refused = true, this.stream = openElement(this.video.pictures);
    }
    this.busy.delete(number);
    for (const [key, old] of this.decoded) {
      if (this.decoded.size <= KEPT) break;
      if (key !== number && key !== this.last) this.decoded.delete(key), old.close();
    }
    this.ready();
  }
}

// Ends when the pictures of a moment are decoded, or after a while: decoders deliver while nothing is drawn.
const readyAt = (pictures, now) => Promise.race([
  Promise.all(now.map((n, i) => n && pictures[i].ahead(Math.round(n.at)))),
  new Promise((done) => setTimeout(done, LATE_MS)),
]);

// A stream gives the picture of a number as an ImageBitmap: from a decoder, or an element where there is none.
async function openStream(pictures) {
  const [codedWidth, codedHeight] = pictures.size;
  const config = { codec: "vp09.00.31.08", codedWidth, codedHeight, optimizeForLatency: true, hardwareAcceleration: "prefer-software" };
  const can = window.VideoDecoder && (await VideoDecoder.isConfigSupported(config)).supported;
  return can ? new PacketStream(pictures, config) : openElement(pictures);
}

class PacketStream {
  constructor(pictures, config) {
    Object.assign(this, { pictures, next: 0, waiting: new Map() });
    const fail = (error) => { for (const [, refuse] of this.waiting.values()) refuse(error); };
    this.decoder = new VideoDecoder({ output: (frame) => this.give(frame), error: fail });
    this.decoder.configure(config);
  }

  // What lies between is decoded and dropped: from the last picture, or a key picture where that is nearer.
  picture(number) {
    const { packets, keys, bytes } = this.pictures, key = keys.lastIndexOf(1, number);
    let n = this.next > key && this.next <= number ? this.next : key;
    this.next = number + 1;
    return new Promise((resolve, reject) => {
      this.waiting.set(number, [resolve, reject]);
      for (; n <= number; n++) {
        const data = bytes.subarray(packets[2 * n], packets[2 * n] + packets[2 * n + 1]);
        this.decoder.decode(new EncodedVideoChunk({ type: keys[n] ? "key" : "delta", timestamp: n, data }));
      }
    });
  }

  give(frame) {
    const asked = this.waiting.get(frame.timestamp);
    this.waiting.delete(frame.timestamp);
    if (asked) asked[0](frame);
    else frame.close();
  }
}

// The same from a <video>, one seek after another: the middle of a picture's time is that picture.
function openElement({ bytes, rate }) {
  const film = Object.assign(document.createElement("video"), { muted: true, playsInline: true });
  film.src = URL.createObjectURL(new Blob([bytes], { type: "video/webm" }));
  const once = (name) => new Promise((resolve, reject) => {
    film.addEventListener(name, resolve, { once: true });
    film.addEventListener("error", reject, { once: true });
  });
  let turn = once("loadeddata");
  const picture = (number) => turn = turn.catch(() => {}).then(async () => {
    const there = once("seeked");
    film.currentTime = (number + 0.5) / rate;
    await there;
    return createImageBitmap(film);
  });
  return { picture };
}
