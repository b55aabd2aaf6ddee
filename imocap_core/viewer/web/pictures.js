// Source frames: decoded ahead of time, each shown with the frame it is of.

const KEPT = 48, AT_ONCE = 2; // pictures of a video: kept, and decoded at one time

class Pictures {
  constructor(video, ready) {
    this.video = video; this.ready = ready; this.decoded = new Map(); this.busy = new Set(); this.last = null;
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

  // Decode what will be wanted soon.
  ahead(frame) {
    if (this.video.pictures) this.decode(this.number(frame));
  }

  nearest(number) {
    const far = (n) => Math.abs(n - number);
    return [...this.decoded.keys()].reduce((a, b) => (a === null || far(b) <= far(a) ? b : a), null);
  }

  number(frame) {
    const { every, starts } = this.video.pictures;
    return clamp(Math.round(frame / every), 0, starts.length - 2);
  }

  frame(number) {
    return Math.min(number * this.video.pictures.every, this.video.frames.length - 1);
  }

  async decode(number) {
    if (this.decoded.has(number) || this.busy.has(number) || this.busy.size >= AT_ONCE) return;
    const { bytes, starts, kind } = this.video.pictures;
    this.busy.add(number);
    try {
      this.decoded.set(number, await decodedPicture(bytes.subarray(starts[number], starts[number + 1]), kind));
    } catch {
      this.decoded.set(number, await createImageBitmap(new ImageData(1, 1))); // damaged: not tried again
    }
    this.busy.delete(number);
    for (const [key, old] of this.decoded) {
      if (this.decoded.size <= KEPT) break;
      if (key !== number && key !== this.last) this.decoded.delete(key), old.close();
    }
    this.ready();
  }
}

// Where there is an ImageDecoder it is faster: no file is made and read, which waits for a busy page.
async function decodedPicture(bytes, kind) {
  if (!window.ImageDecoder) return createImageBitmap(new Blob([bytes], { type: kind }));
  const decoder = new ImageDecoder({ data: bytes, type: kind });
  try {
    return (await decoder.decode()).image;
  } finally {
    decoder.close();
  }
}
