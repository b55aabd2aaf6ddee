// Curves of chosen joints over the common time, one colour a video, one dash a joint.

const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3]];
const QUANTITIES = {
  height: { label: "height (m)", digits: 2, of: (places) => places.map((p) => p[1]) },
  speed: { label: "speed (m/s)", digits: 2, of: (places, seconds) => speeds(places, seconds) },
  bend: { label: "bend (degrees, 0: straight)", digits: 0, of: (places, _, from, to) => places.map((p, t) => angleOf(sub(p, from[t]), sub(to[t], p))) },
};

// Speed in m/s by central differences; seconds: of each place.
function speeds(places, seconds) {
  const last = places.length - 1;
  return places.map((_, t) => {
    const [a, b] = [Math.max(t - 1, 0), Math.min(t + 1, last)];
    return Math.hypot(...sub(places[b], places[a])) / Math.max(seconds[b] - seconds[a], 1e-6);
  });
}

// Places of a joint in every frame of a video's answer; joints: of every frame.
function courseOf(model, joints, seconds, joint, quantity) {
  const places = joints.map((all) => all[joint]);
  const child = model.parents.findIndex((parent, j) => parent === joint && j > joint);
  const parent = model.parents[joint];
  if (quantity === "bend" && (parent < 0 || child < 0)) return null;
  const of = (j) => joints.map((all) => all[Math.max(j, 0)]);
  return QUANTITIES[quantity].of(places, seconds, of(parent), of(child));
}

class Curves {
  constructor(page) {
    this.page = page; this.known = new Map(); this.joints = new Map();
  }

  // Joints of every frame of a video, computed when they are first wanted.
  jointsOf(video, answer) {
    const key = `${this.page.videos.indexOf(video)} ${answer}`;
    if (!this.joints.has(key)) {
      const own = video.answers[answer], shape = this.page.shapes[own.shape];
      const count = own.trans.length / 3;
      this.joints.set(key, Array.from({ length: count }, (_, t) => pose(this.page.model, shape, own, t).joints));
    }
    return this.joints.get(key);
  }

  course(i, answer, joint, quantity) {
    const key = [i, answer, joint, quantity].join(" ");
    if (!this.known.has(key)) {
      const video = this.page.videos[i], joints = this.jointsOf(video, answer);
      const seconds = joints.map((_, t) => t / video.fps);
      this.known.set(key, courseOf(this.page.model, joints, seconds, joint, quantity));
    }
    return this.known.get(key);
  }

  // All curves wanted by the state: [{phase, values, color, dash}].
  wanted(state, theme) {
    const answer = state.answer === "initial" ? "initial" : "final";
    return this.page.videos.flatMap((video, i) => state.on[i] && !video.excluded
      ? state.curves.joints.map((joint, k) => ({
        phase: video.phase, color: inksOf(this.page, theme)[i], dash: DASHES[k % DASHES.length],
        values: this.course(i, answer, joint, state.curves.quantity),
      })).filter((curve) => curve.values)
      : []);
  }

  draw(canvas, state, theme) {
    const { label, digits } = QUANTITIES[state.curves.quantity];
    return drawCurves(canvas, this.page.timeline, state, this.wanted(state, theme), theme, label, digits);
  }
}

// Curves over the axis, with the cursor; returns what a place on the canvas is in seconds.
// curves: [{phase, values, color, dash, low, high}]; low, high: of a band, or absent.
function drawCurves(canvas, axis, state, curves, theme, label, digits = 0) {
  const { pen, width, height } = sized(canvas), plot = { left: LEFT, right: width - RIGHT, top: 16, bottom: height - 5 };
  const all = curves.flatMap((c) => [c.values, c.low, c.high].filter(Boolean).flatMap((v) => Array.from(v))).filter(Number.isFinite);
  const [least, most] = all.length ? [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))] : [0, 1];
  const room = 0.04 * (most - least) || 0.5;
  const x = (s) => plot.left + ((s - axis.first) / (axis.last - axis.first || 1)) * (plot.right - plot.left);
  const y = (v) => plot.bottom - ((v - least + room) / (most - least + 2 * room)) * (plot.bottom - plot.top);
  pen.fillStyle = theme.quiet; pen.textAlign = "left";
  pen.fillText(label, 2, 7, width - 4);
  for (const tick of ticks(least, most, Math.max(5, (plot.bottom - plot.top) / 26))) {
    pen.fillStyle = theme.line; pen.fillRect(plot.left, y(tick.at), plot.right - plot.left, 1);
    pen.fillStyle = theme.quiet; pen.textAlign = "right"; pen.fillText(tick.text, plot.left - 5, y(tick.at));
  }
  for (const curve of curves) {
    pen.strokeStyle = pen.fillStyle = curve.color;
    if (curve.low) band(pen, curve, x, y);
    pen.setLineDash(curve.dash ?? []); pen.lineWidth = 1.6;
    pen.beginPath();
    curve.values.forEach((v, t) => (Number.isFinite(v) ? pen.lineTo(x(curve.phase[t]), y(v)) : 0));
    pen.stroke(); pen.setLineDash([]);
  }
  loopShade(pen, x, state.loop ?? [], plot.top, plot.bottom, theme);
  cursor(pen, x(state.phase), plot.top, plot.bottom, theme);
  valuesHere(pen, curves, state.phase, x, y, plot, theme, digits);
  return (px) => axis.first + ((px - plot.left) / (plot.right - plot.left)) * (axis.last - axis.first);
}

function band(pen, curve, x, y) {
  pen.globalAlpha = 0.18;
  pen.beginPath();
  const finite = Array.from(curve.low.keys()).filter((t) => Number.isFinite(curve.low[t]) && Number.isFinite(curve.high[t]));
  for (const t of finite) pen.lineTo(x(curve.phase[t]), y(curve.high[t]));
  for (const t of finite.reverse()) pen.lineTo(x(curve.phase[t]), y(curve.low[t]));
  pen.fill();
  pen.globalAlpha = 1;
}

// The value of a curve at a moment, null where it has none.
function valueAt(curve, phase) {
  const now = frameAt(curve.phase, phase);
  if (!now?.inside) return null;
  const low = Math.floor(now.at), [a, b] = [curve.values[low], curve.values[Math.min(low + 1, curve.values.length - 1)]];
  const value = a + (now.at - low) * (b - a);
  return Number.isFinite(value) ? value : null;
}

// A dot on every curve at the cursor and its value beside it, one below the other where they crowd.
function valuesHere(pen, curves, phase, x, y, plot, theme, digits) {
  const here = curves.map((curve) => ({ color: curve.color, value: valueAt(curve, phase) })).filter((c) => c.value !== null);
  const rows = here.map((c) => ({ ...c, dot: y(c.value), at: y(c.value) })).sort((a, b) => a.at - b.at);
  rows.forEach((row, i) => { if (i) row.at = Math.max(row.at, rows[i - 1].at + 12); });
  const over = rows.length ? Math.max(0, rows.at(-1).at - (plot.bottom - 6)) : 0;
  const left = x(phase) > plot.right - 60;
  pen.textAlign = left ? "right" : "left";
  for (const row of rows) {
    pen.fillStyle = row.color;
    pen.beginPath(); pen.arc(x(phase), row.dot, 3.5, 0, 7); pen.fill();
    const text = row.value.toFixed(digits), place = [x(phase) + (left ? -8 : 8), row.at - over];
    pen.lineWidth = 4; pen.strokeStyle = theme.paper; pen.lineJoin = "round";
    pen.strokeText(text, ...place); pen.fillText(text, ...place);
  }
}
