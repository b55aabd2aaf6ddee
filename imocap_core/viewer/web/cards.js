// Beside the scene: every video's source frame at this moment, with what was found in it.

class Card {
  constructor(video, index, parent, actions) {
    Object.assign(this, { video, index });
    const make = (tag, into, set = {}) => Object.assign(into.appendChild(document.createElement(tag)), set);
    this.root = make("article", parent, { className: "card" });
    this.root.style.setProperty("--own", video.color);
    const head = make("header", this.root), label = make("label", head);
    this.box = make("input", label, { type: "checkbox", checked: true, title: `Show or hide (${index + 1})` });
    make("span", label, { textContent: video.id });
    make("small", head, { textContent: video.role });
    this.canvas = make("canvas", this.root, { title: "Look through this camera", tabIndex: 0 });
    this.canvas.setAttribute("role", "button");
    this.canvas.addEventListener("keydown", (e) => e.key === "Enter" && actions.through(index));
    const foot = make("footer", this.root);
    this.frame = make("span", foot);
    this.match = make("span", foot);
    this.box.addEventListener("change", () => actions.toggle(index));
    this.canvas.addEventListener("click", () => actions.through(index));
  }

  // now: {at, inside, confidence} or null; picture: {bitmap, frame} or null, over which the marks of its own
  // frame are drawn; state: which marks.
  draw(now, picture, state) {
    const { video, canvas } = this, [x0, y0, w, h] = video.view;
    const width = Math.min(640, Math.round(canvas.clientWidth * devicePixelRatio) || 300);
    const height = Math.round((width * h) / w);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d"), s = width / w;
    const put = (x, y) => [(x + 0.5 - x0) * s, (y + 0.5 - y0) * s]; // pixels of the video
    this.root.classList.toggle("off", !state.on[this.index]);
    this.root.classList.toggle("through", state.through === this.index);
    this.box.checked = state.on[this.index];
    if (picture) pen.drawImage(picture.bitmap, 0, 0, width, height);
    else if (!video.pictures) { pen.fillStyle = "#2a2e34"; pen.fillRect(0, 0, width, height); }
    if (!now) {
      this.frame.textContent = "not synchronised"; this.match.textContent = "";
      this.canvas.setAttribute("aria-label", `${video.id}, not synchronised`);
      return;
    }
    const t = this.shown = picture?.frame ?? Math.round(now.at);
    if (picture || !video.pictures) {
      if (state.marks.detected || !video.pictures) dots(pen, video.detected, t, put);
      for (const name of ["initial", "final"])
        if (state.marks.skeleton && (state.answer === name || state.answer === "both"))
          bones(pen, video.projected[name], t, put, name === "final" ? video.color : "#ffffff");
    }
    if (!now.inside) { pen.fillStyle = "#14171ab0"; pen.fillRect(0, 0, width, height); }
    this.frame.textContent = `frame ${video.frames[t]}`;
    this.canvas.setAttribute("aria-label", `Frame ${video.frames[t]} of ${video.id}: look through its camera`);
    this.match.textContent = !now.inside ? (now.at > 0 ? "after the clip" : "before the clip") : now.confidence > 0 ? `match ${Math.round(100 * now.confidence)} %` : "no match";
  }
}

// Detected keypoints, the surer the fuller. points: {xy (T x K x 2, tenths of a pixel), sure (T x K)}.
function dots(pen, points, t, put) {
  const count = points.count, radius = Math.max(1.6, 0.006 * pen.canvas.width);
  for (let k = t * count; k < (t + 1) * count; k++) {
    if (!points.sure[k]) continue;
    pen.fillStyle = `rgba(255, 224, 92, ${0.35 + (0.65 * points.sure[k]) / 255})`;
    pen.beginPath();
    pen.arc(...put(points.xy[2 * k] / points.unit, points.xy[2 * k + 1] / points.unit), radius, 0, 7);
    pen.fill();
  }
}

function bones(pen, points, t, put, color) {
  const at = (j) => put(...[0, 1].map((i) => points.xy[2 * (t * points.count + j) + i] / points.unit));
  for (const [width, ink] of [[3.4, "#00000066"], [1.7, color]]) {
    pen.strokeStyle = ink; pen.lineWidth = (width * Math.max(pen.canvas.width, 240)) / 320;
    pen.lineCap = "round";
    pen.beginPath();
    points.parents.forEach((parent, j) => {
      if (parent < 0) return;
      pen.moveTo(...at(parent)); pen.lineTo(...at(j));
    });
    pen.stroke();
  }
}

// How many columns show the largest pictures in this room, and how tall these may be.
function columnsFor(videos, width, height) {
  const others = 66; // of a card's height: its head, foot and the gap to the next
  const aspect = Math.max(...videos.map((v) => v.view[3] / v.view[2]));
  const choices = videos.map((_, i) => {
    const columns = i + 1, each = (width - 10 * i) / columns;
    const tall = Math.min(each * aspect, height / Math.ceil(videos.length / columns) - others);
    return { columns, tall };
  }).filter(({ columns }) => columns === 1 || width / columns > 125);
  return choices.reduce((a, b) => (b.tall > a.tall ? b : a));
}
