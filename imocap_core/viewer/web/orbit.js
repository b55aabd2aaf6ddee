// The eye: it turns about a point, or looks through one of the cameras.

const LOWEST_M = 0.08; // the eye stays above the ground, so that the grid is seen from above
const TOP_RAD = 1.5; // the eye's elevation for a view from above
const WIDE_RAD = 0.62, NARROW_RAD = 0.15; // fields of view; narrow: all who stand in a row from one side

// What is seen by the eye that turns; the canvas gets `density` pixels for each of the page's.
function freeView(canvas, orbit, density) {
  const width = Math.max(1, Math.round(canvas.clientWidth * density));
  const height = Math.max(1, Math.round(canvas.clientHeight * density));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  return { density, width, height, through: -1, matrix: orbit.matrix(width, height), eye: orbit.eye() };
}

class Orbit {
  constructor(canvas, changed) {
    this.target = [0, 0.9, 0]; this.azimuth = 0.5; this.elevation = 0.25; this.distance = 4; this.field = WIDE_RAD;
    this.changed = changed; this.canvas = canvas; this.fingers = new Map();
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      this.fingers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"])
      canvas.addEventListener(end, (e) => this.fingers.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => this.moved(e));
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom(Math.exp(clamp(e.deltaY, -200, 200) * 0.0015));
    }, { passive: false });
  }

  moved(e) {
    const before = this.fingers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    if (this.fingers.size === 2) {
      const other = [...this.fingers].find(([id]) => id !== e.pointerId)[1];
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      this.zoom(apart(before) / apart(now));
      this.pan(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons & 6) this.pan(dx, dy);
    else {
      this.azimuth -= dx * 0.008;
      this.elevation = clamp(this.elevation + dy * 0.008, -0.2, 1.55);
      this.aboveGround();
      this.changed(true);
    }
    this.fingers.set(e.pointerId, now);
  }

  pan(dx, dy) {
    const [right, up] = this.rows(), step = (3.4 * Math.tan(this.field / 2) * this.distance) / this.canvas.clientHeight;
    this.target = add(this.target, add(scaled(right, -dx * step), scaled(up, dy * step)));
    this.aboveGround();
    this.changed(true);
  }

  zoom(factor) {
    this.distance = clamp(this.distance * factor, 0.4, 150);
    this.aboveGround();
    this.changed(true);
  }

  // Turned, moved or zoomed below the ground, the eye rises to just above it.
  aboveGround() {
    this.target[1] = Math.max(this.target[1], LOWEST_M);
    const lowest = Math.asin(clamp((LOWEST_M - this.target[1]) / this.distance, -1, 1));
    this.elevation = Math.max(this.elevation, lowest);
  }

  rows() {
    const [s, c] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    const back = [c * Math.sin(this.azimuth), s, c * Math.cos(this.azimuth)];
    const right = [Math.cos(this.azimuth), 0, -Math.sin(this.azimuth)];
    return [right, cross(back, right), back];
  }

  eye() {
    return add(this.target, scaled(this.rows()[2], this.distance));
  }

  matrix(width, height) {
    const view = viewOf(this.rows(), this.eye());
    return times(perspective(this.field, width / height, 0.05, 300), view);
  }

  // Far enough that all these points lie within the picture.
  fit(points, width, height) {
    const [right, up, back] = this.rows(), half = Math.tan(this.field / 2), wide = half * (width / height);
    this.target = scaled(points.reduce(add, [0, 0, 0]), 1 / points.length);
    for (let round = 0; round < 8; round++) {
      const off = points.map((p) => sub(p, this.target));
      this.distance = Math.max(1, ...off.map((o) =>
        dot(o, back) + Math.max(Math.abs(dot(o, right)) / wide, Math.abs(dot(o, up)) / half)));
      for (const axis of [right, up]) {
        const seen = off.map((o) => dot(o, axis) / (this.distance - dot(o, back)));
        const middle = (Math.max(...seen) + Math.min(...seen)) / 2;
        this.target = add(this.target, scaled(axis, middle * this.distance));
      }
    }
    this.distance *= 1.06;
    this.changed(false);
  }
}
