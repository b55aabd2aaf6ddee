// Source frames, decoded when they are needed; a few of each video are kept.

const KEPT = 48;

class Pictures {
  constructor(video, ready) {
    this.video = video; this.ready = ready; this.kept = new Map();
  }

  // The picture for a frame, or null while it is being decoded or when there is none.
  at(frame) {
    const own = this.video.pictures;
    if (!own) return null;
    const number = this.number(frame), found = this.kept.get(number);
    if (found === undefined) this.decode(number);
    else this.kept.delete(number), this.kept.set(number, found);
    return found ?? null;
  }

  number(frame) {
    const own = this.video.pictures;
    return clamp(Math.round(frame / own.every), 0, own.starts.length - 2);
  }

  async decode(number) {
    const { bytes, starts, kind } = this.video.pictures;
    this.kept.set(number, null);
    const part = new Blob([bytes.subarray(starts[number], starts[number + 1])], { type: kind });
    try {
      this.kept.set(number, await createImageBitmap(part));
    } catch {
      this.kept.delete(number);
      return;
    }
    for (const [key, old] of this.kept) {
      if (this.kept.size <= KEPT) break;
      if (old && key !== number) this.kept.delete(key), old.close();
    }
    this.ready();
  }
}
