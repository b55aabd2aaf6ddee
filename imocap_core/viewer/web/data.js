// The data of the page: a header in JSON, and one block of bytes, deflated, that its entries
// point into.

const KINDS = {
  f4: Float32Array, i2: Int16Array, u2: Uint16Array, u1: Uint8Array, i4: Int32Array, u4: Uint32Array,
};

async function readPage() {
  const text = document.getElementById("blob").textContent;
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  const header = JSON.parse(document.getElementById("header").textContent);
  document.getElementById("blob").textContent = "";
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return resolved(header, await new Response(inflated).arrayBuffer());
}

// The same value with every {"$": kind, at, count} replaced by its typed array.
function resolved(value, buffer) {
  if (Array.isArray(value)) return value.map((v) => resolved(v, buffer));
  if (value === null || typeof value !== "object") return value;
  if ("$" in value) return new KINDS[value.$](buffer, value.at, value.count);
  return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, resolved(v, buffer)]));
}

// Local rotations of every frame as quaternions, from axis-angle (frames x joints x 3).
function quaternions(local) {
  const found = new Array(local.length / 3);
  for (let i = 0; i < found.length; i++)
    found[i] = quatOf(local[3 * i], local[3 * i + 1], local[3 * i + 2]);
  return found;
}

// A frame, whole or between two, of a rising list of phases: {at, inside}; null without phases.
function frameAt(phase, moment) {
  const last = phase.length - 1;
  if (!(phase[0] <= phase[last])) return null;
  if (moment < phase[0]) return { at: 0, inside: moment > phase[0] - 1e-3 };
  if (moment > phase[last]) return { at: last, inside: moment < phase[last] + 1e-3 };
  let low = 0, high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (phase[middle] <= moment) low = middle;
    else high = middle;
  }
  const step = phase[high] - phase[low];
  return { at: low + (step > 1e-9 ? (moment - phase[low]) / step : 0), inside: true };
}
