// Below the scene: the common time axis with every video's confidence, and the warp curves.

const LEFT = 64, RIGHT = 8;

function sized(canvas) {
  const s = Math.min(devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * s), height = Math.round(canvas.clientHeight * s);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.setTransform(s, 0, 0, s, 0, 0);
  pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  pen.textBaseline = "middle";
  return { pen, width: canvas.clientWidth, height: canvas.clientHeight };
}

function niceStep(span, most) {
  const raw = span / most, power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((m) => m * power >= raw);
}

function ticks(first, last, most) {
  const step = niceStep(last - first || 1, most), out = [];
  for (let i = Math.ceil(first / step - 1e-9); i * step <= last + 1e-9; i++) out.push(i * step);
  return out.map((at) => ({ at, text: String(+at.toFixed(3)) }));
}

// A colour for each of 256 confidences, from the empty bar's to the video's own.
function shadesOf(color, empty) {
  return Array.from({ length: 256 }, (_, i) => css(mix(rgb(empty), rgb(color), (0.9 * i) / 255)));
}

// One lane a video: a bar from its first to its last frame, full where the match is sure.
function drawLanes(canvas, page, state, theme) {
  const { pen, width, height } = sized(canvas), axis = page.timeline, bottom = height - 16;
  const x = (s) => LEFT + clamp((s - axis.first) / (axis.last - axis.first || 1), 0, 1) * (width - LEFT - RIGHT);
  pen.textAlign = "center";
  for (const tick of ticks(axis.first, axis.last, width / 80)) {
    pen.fillStyle = theme.line; pen.fillRect(x(tick.at), 0, 1, bottom);
    pen.fillStyle = theme.quiet;
    pen.fillText(`${tick.text} s`, clamp(x(tick.at), LEFT + 8, width - 14), bottom + 9);
  }
  const lane = bottom / page.videos.length, bar = clamp(lane * 0.56, 4, 18);
  const shades = theme.shades ??= page.videos.map((video) => shadesOf(video.color, theme.empty));
  page.videos.forEach((video, i) => {
    const y = lane * (i + 0.5);
    pen.textAlign = "left"; pen.fillStyle = state.on[i] ? inksOf(page, theme)[i] : theme.quiet;
    pen.fillText(video.id, 2, y, LEFT - 8);
    pen.globalAlpha = state.on[i] ? 1 : 0.3;
    pen.fillStyle = theme.empty;
    const n = video.phase.length, found = video.phase[0] <= video.phase[n - 1];
    if (found) pen.fillRect(x(video.phase[0]), y - bar / 2, x(video.phase[n - 1]) - x(video.phase[0]), bar);
    for (let t = 0; found && t + 1 < n; t++) {
      pen.fillStyle = shades[i][video.confidence[t]];
      const from = Math.round(x(video.phase[t])), to = Math.round(x(video.phase[t + 1]));
      if (to > from) pen.fillRect(from, y - bar / 2, to - from, bar);
    }
    for (const span of spansOf(page, i)) hatch(pen, x(span.first), x(span.last), y - bar / 2, bar, theme.doubt);
    pen.globalAlpha = 1;
    if (state.on[i]) contactLines(pen, x, y + bar / 2 + 2, lane - bar, video.contacts, theme);
  });
  loopShade(pen, x, state.loop, 0, bottom, theme);
  cursor(pen, x(state.phase), 0, bottom, theme);
  return (px) => axis.first + ((px - LEFT) / (width - LEFT - RIGHT)) * (axis.last - axis.first);
}

// Under a lane, when the left foot (upper line) and the right one (lower line) rest on the ground.
function contactLines(pen, x, top, room, contacts, theme) {
  if (!contacts || room < 9) return;
  pen.fillStyle = theme.quiet;
  ["left", "right"].forEach((side, row) => {
    for (const [from, to] of contacts[side]) pen.fillRect(x(from), top + 3 * row, Math.max(x(to) - x(from), 1), 1.5);
  });
}

// Every video's own seconds against the common axis; a straight even line is one that keeps pace.
function drawWarps(canvas, page, state, theme) {
  const { pen, width, height } = sized(canvas), axis = page.timeline;
  const left = 34, top = 18, bottom = height - 17, right = width - 6;
  const longest = Math.max(...page.videos.map((v) => v.phase.length / v.fps));
  const x = (s) => left + ((s - axis.first) / (axis.last - axis.first || 1)) * (right - left);
  const y = (s) => bottom - (s / longest) * (bottom - top);
  pen.fillStyle = theme.quiet; pen.textAlign = "left";
  pen.fillText("tempo: seconds of each video against common seconds; thin: poor match", 2, 7, width - 4);
  for (const tick of ticks(0, longest, (bottom - top) / 28)) {
    pen.fillStyle = theme.line; pen.fillRect(left, y(tick.at), right - left, 1);
    pen.fillStyle = theme.quiet; pen.textAlign = "right"; pen.fillText(tick.text, left - 5, y(tick.at));
  }
  pen.textAlign = "center";
  for (const tick of ticks(axis.first, axis.last, (right - left) / 60))
    pen.fillText(tick.text, clamp(x(tick.at), left + 4, right - 8), bottom + 9);
  page.videos.forEach((video, i) => {
    if (!state.on[i]) return;
    pen.strokeStyle = pen.fillStyle = inksOf(page, theme)[i];
    for (let t = 0; t + 1 < video.phase.length; t++) {
      if (!(video.phase[t] <= video.phase[t + 1])) continue;
      pen.lineWidth = 0.5 + (1.8 * video.confidence[t]) / 255;
      pen.beginPath();
      pen.moveTo(x(video.phase[t]), y(t / video.fps));
      pen.lineTo(x(video.phase[t + 1]), y((t + 1) / video.fps));
      pen.stroke();
    }
    const now = frameAt(video.phase, state.phase);
    if (!now || !now.inside) return;
    pen.beginPath(); pen.arc(x(state.phase), y(now.at / video.fps), 4, 0, 7); pen.fill();
  });
  loopShade(pen, x, state.loop, top, bottom, theme);
  cursor(pen, x(state.phase), top, bottom, theme);
  return (px) => axis.first + ((px - left) / (right - left)) * (axis.last - axis.first);
}

function cursor(pen, x, top, bottom, theme) {
  pen.fillStyle = theme.ink;
  pen.fillRect(x - 0.75, top, 1.5, bottom - top);
}

// The span that is played again and again; of one of its ends, a line.
function loopShade(pen, x, loop, top, bottom, theme) {
  pen.fillStyle = theme.accent;
  for (const end of loop) pen.fillRect(x(end) - 0.75, top, 1.5, bottom - top);
  pen.globalAlpha = 0.12;
  if (loop.length === 2) pen.fillRect(x(loop[0]), top, x(loop[1]) - x(loop[0]), bottom - top);
  pen.globalAlpha = 1;
}
