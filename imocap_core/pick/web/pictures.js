// Pictures of frames from the server, the last ones kept.

const MOST = 900;
const memory = new Map(); // address -> Image

export function addressOf(file, kind, frame) { return `pictures/${file}/${kind}/${frame}.jpg`; }

/** A picture that is loaded, or null; then `loaded` is called when it is. */
export function picture(address, loaded) {
  let image = memory.get(address);
  if (image) {
    memory.delete(address);
    memory.set(address, image);
    return image.complete && image.naturalWidth ? image : (loaded && image.addEventListener("load", loaded, { once: true }), null);
  }
  image = new Image();
  if (loaded) image.addEventListener("load", loaded, { once: true });
  image.addEventListener("error", () => memory.delete(address), { once: true });
  image.src = address;
  memory.set(address, image);
  if (memory.size > MOST) memory.delete(memory.keys().next().value);
  return null;
}
