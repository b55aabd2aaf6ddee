// A body's bones in a frame: forward kinematics, as imocap_core/body does it.

// Bones of a body between frames: rows (joints x 3 x 4) that carry rest points, and the joints.
// model: {parents}; shape: {joints (J x 3) at rest}; answer: {rotations, trans (T x 3)}.
function pose(model, shape, answer, at) {
  const count = model.parents.length, frames = answer.trans.length / 3;
  const first = clamp(Math.floor(at), 0, frames - 1), second = Math.min(first + 1, frames - 1);
  const share = clamp(at - first, 0, 1);
  const rest = (j) => shape.joints.subarray(3 * j, 3 * j + 3);
  const spins = [], joints = [], rows = new Float32Array(12 * count);
  for (let j = 0; j < count; j++) {
    const local = slerp(
      answer.rotations[first * count + j], answer.rotations[second * count + j], share
    );
    const parent = model.parents[j];
    if (parent < 0) {
      spins.push(local);
      joints.push([0, 1, 2].map((i) => {
        const a = answer.trans[3 * first + i], b = answer.trans[3 * second + i];
        return rest(0)[i] + a + share * (b - a);
      }));
    } else {
      spins.push(quatTimes(spins[parent], local));
      const bone = sub(rest(j), rest(parent));
      joints.push(add(joints[parent], turned(rowsOf(spins[parent]), bone)));
    }
    const R = rowsOf(spins[j]), shift = sub(joints[j], turned(R, rest(j)));
    for (let r = 0; r < 3; r++) rows.set([...R[r], shift[r]], 12 * j + 4 * r);
  }
  return { rows, joints };
}

// Normals of the rest surface, three floats a vertex: faces weigh by their area.
function normals(rest, faces) {
  const out = new Float32Array(rest.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
    const u = [0, 1, 2].map((i) => rest[b + i] - rest[a + i]);
    const v = [0, 1, 2].map((i) => rest[c + i] - rest[a + i]);
    const n = cross(u, v);
    for (const vertex of [a, b, c]) for (let i = 0; i < 3; i++) out[vertex + i] += n[i];
  }
  for (let v = 0; v < out.length; v += 3) {
    const length = Math.hypot(out[v], out[v + 1], out[v + 2]) || 1;
    for (let i = 0; i < 3; i++) out[v + i] /= length;
  }
  return out;
}
