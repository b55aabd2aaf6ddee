// A coarser triangulation of a surface for slow machines: the vertices of a cell become one of them.

const CELL_M = 0.05;

// Triangles among the same vertices. Vertices of one cell and one bone share the first of them, so
// that what touches at rest (fingers, thighs) stays apart.
function coarseFaces(model, shape) {
  const cell = (v, i) => Math.floor(((shape.rest[3 * v + i] / 32767) * shape.scale) / CELL_M);
  const first = new Map(), count = shape.rest.length / 3, chosen = new Uint16Array(count);
  for (let v = 0; v < count; v++) {
    const key = `${cell(v, 0)} ${cell(v, 1)} ${cell(v, 2)} ${model.bones[4 * v]}`;
    if (!first.has(key)) first.set(key, v);
    chosen[v] = first.get(key);
  }
  const out = [];
  for (let f = 0; f < model.faces.length; f += 3) {
    const [a, b, c] = [0, 1, 2].map((i) => chosen[model.faces[f + i]]);
    if (a !== b && b !== c && c !== a) out.push(a, b, c);
  }
  return new Uint16Array(out);
}
