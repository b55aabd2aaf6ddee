// Vectors are arrays of 3, quaternions [x, y, z, w], 4 x 4 matrices column by column as WebGL's.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const unit = (a) => scaled(a, 1 / Math.max(Math.hypot(...a), 1e-12));
const mix = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// The angle between two vectors in degrees.
const angleOf = (a, b) => (Math.acos(clamp(dot(unit(a), unit(b)), -1, 1)) * 180) / Math.PI;

// The quaternion of an axis-angle vector in radians.
function quatOf(x, y, z) {
  const angle = Math.hypot(x, y, z);
  const s = angle > 1e-8 ? Math.sin(angle / 2) / angle : 0.5;
  return [x * s, y * s, z * s, Math.cos(angle / 2)];
}

// First b, then a.
function quatTimes(a, b) {
  return [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
}

// Between two rotations, the short way; s from 0 to 1.
function slerp(a, b, s) {
  let cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  const sign = cosine < 0 ? -1 : 1;
  cosine *= sign;
  let p = 1 - s, q = s;
  if (cosine < 0.9995) {
    const angle = Math.acos(cosine);
    p = Math.sin((1 - s) * angle) / Math.sin(angle);
    q = Math.sin(s * angle) / Math.sin(angle);
  }
  const mixed = a.map((x, i) => p * x + q * sign * b[i]);
  const length = Math.hypot(...mixed);
  return mixed.map((x) => x / length);
}

// The three rows of a rotation.
function rowsOf([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

const turned = (rows, v) => rows.map((row) => dot(row, v));

function times(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

// Rows of a rotation and a place: x -> rows (x - centre), for an eye that looks along -z.
function viewOf(rows, centre) {
  const [right, up, back] = rows;
  return new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, centre), -dot(up, centre), -dot(back, centre), 1,
  ]);
}

function perspective(fieldRad, aspect, near, far) {
  const f = 1 / Math.tan(fieldRad / 2), out = new Float32Array(16);
  out[0] = f / aspect; out[5] = f; out[11] = -1;
  out[10] = (far + near) / (near - far); out[14] = (2 * far * near) / (near - far);
  return out;
}

// A part [x, y, width, height] of a pinhole camera's picture, as large as it fits into the canvas.
// lens: {fx, fy, cx, cy} in pixels.
function pinhole(lens, [x, y, w, h], width, height, near, far) {
  const s = Math.min(width / w, height / h), out = new Float32Array(16);
  out[0] = (2 * s * lens.fx) / width; out[5] = (2 * s * lens.fy) / height;
  out[8] = (-2 * s * (lens.cx - x - (w - 1) / 2)) / width;
  out[9] = (2 * s * (lens.cy - y - (h - 1) / 2)) / height;
  out[11] = -1;
  out[10] = (far + near) / (near - far); out[14] = (2 * far * near) / (near - far);
  return out;
}

// Where a point lands: {x, y} in pixels of the canvas, or null behind the eye.
function landing(matrix, p, width, height) {
  const at = (r) => matrix[r] * p[0] + matrix[4 + r] * p[1] + matrix[8 + r] * p[2] + matrix[12 + r];
  const w = at(3);
  if (w < 0.01) return null;
  return { x: (0.5 + (0.5 * at(0)) / w) * width, y: (0.5 - (0.5 * at(1)) / w) * height };
}
