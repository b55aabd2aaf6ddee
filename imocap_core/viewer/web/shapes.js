// Lines of the scene as lists of [from, to, color]; colors are four numbers from 0 to 1.

const PLANE_M = 0.5; // how far before its camera a picture hangs
const PATH_PIECES = 80, PATH_M = 0.004; // above the ground: through the body it would look like a tail

// The lens of a video's camera in a frame, in pixels: a zoom scales its focal length.
function lensAt(video, frame) {
  const { fx, fy, cx, cy, zoom } = video.camera, z = zoom[Math.min(frame, zoom.length - 1)];
  return { fx: fx * z, fy: fy * z, cx, cy };
}

// The axes of a video's camera in a frame, as columns right, down, ahead, and its centre.
function cameraAt(video, frame) {
  const all = video.camera.axes, start = 9 * Math.min(frame, all.length / 9 - 1);
  const axis = (c) => [0, 1, 2].map((r) => all[start + 3 * r + c]);
  const places = video.camera.centres, at = 3 * frame;
  const centre = places ? [places[at], places[at + 1], places[at + 2]] : video.camera.centre;
  return { right: axis(0), down: axis(1), ahead: axis(2), centre };
}

// Corners in space of a part [x, y, width, height] of a video's picture, else of all of it:
// top left, top right, bottom left, bottom right.
function pictureCorners(video, frame, part = [0, 0, ...video.size], depth = PLANE_M) {
  const lens = lensAt(video, frame), at = cameraAt(video, frame);
  const [x0, y0, x1, y1] = [part[0] - 0.5, part[1] - 0.5, part[0] + part[2] - 0.5, part[1] + part[3] - 0.5];
  return [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].map(([x, y]) => {
    const sideways = scaled(at.right, (depth * (x - lens.cx)) / lens.fx);
    const down = scaled(at.down, (depth * (y - lens.cy)) / lens.fy);
    return add(at.centre, add(add(sideways, down), scaled(at.ahead, depth)));
  });
}

function frustum(video, frame) {
  const [a, b, c, d] = pictureCorners(video, frame), centre = cameraAt(video, frame).centre;
  const color = [...rgb(video.color), 1];
  const edges = [[a, b], [b, d], [d, c], [c, a], ...[a, b, c, d].map((p) => [centre, p])];
  return edges.map(([from, to]) => [from, to, color]);
}

// Whether a camera stands before a performer in this view: it and its picture would cover them.
function covers(view, video, frame, actors) {
  const spot = (p) => landing(view.matrix, p, 1, 1), far = (p) => Math.hypot(...sub(p, view.eye));
  const { centre } = cameraAt(video, frame);
  const own = [centre, ...pictureCorners(video, frame)].map(spot);
  if (own.some((p) => !p)) return true;
  return actors.some((actor) => {
    const body = actor.joints.map((p) => spot(add(p, actor.offset))).filter(Boolean);
    const apart = (axis) => Math.min(...own.map((p) => p[axis])) > Math.max(...body.map((p) => p[axis]))
      || Math.max(...own.map((p) => p[axis])) < Math.min(...body.map((p) => p[axis]));
    return body.length && far(centre) < far(add(actor.joints[0], actor.offset)) && !apart("x") && !apart("y");
  });
}

// The way of the pelvis: pale (the sky's colour) at the beginning, full in the end.
function path(video, answer, shape, sky) {
  const color = rgb(video.color), count = answer.trans.length / 3, out = [];
  const step = Math.ceil(count / PATH_PIECES);
  const place = (t) => [answer.trans[3 * t] + shape.joints[0], PATH_M, answer.trans[3 * t + 2] + shape.joints[2]];
  for (let t = 0; t + 1 < count; t += step) {
    const share = 0.25 + (0.75 * t) / count;
    out.push([place(t), place(Math.min(t + step, count - 1)), [...mix(sky, color, share), 1]]);
  }
  return out;
}

// The ground: a line every half metre, fading away from the middle.
function floor(middle, ink) {
  const out = [], reach = 4.5, [x0, z0] = [Math.round(middle[0]), Math.round(middle[2])];
  for (let i = -2 * reach; i <= 2 * reach; i++)
    for (let k = -2 * reach; k < 2 * reach; k += 2) {
      const far = Math.hypot(i / 2, (k + 1) / 2) / reach;
      if (far > 1) continue;
      const color = [...ink, (i % 2 ? 0.35 : 0.8) * (1 - far * far)];
      out.push([[x0 + i / 2, 0, z0 + k / 2], [x0 + i / 2, 0, z0 + k / 2 + 1], color]);
      out.push([[x0 + k / 2, 0, z0 + i / 2], [x0 + k / 2 + 1, 0, z0 + i / 2], color]);
    }
  return out;
}
