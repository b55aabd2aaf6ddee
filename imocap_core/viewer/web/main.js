// Putting it together: one state, drawn once a change and once a picture while it plays.

const $ = (id) => document.getElementById(id);

function start() {
  const page = readPage();
  for (const video of page.videos)
    for (const answer of Object.values(video.answers)) answer.rotations = quaternions(answer.local);
  $("name").textContent = page.title;
  $("lead").textContent = page.lead;
  $("legend").textContent = page.legend;
  showHelp($("help"));

  let waiting = false, before = 0;
  const redraw = () => {
    if (!waiting) waiting = true, requestAnimationFrame(draw);
  };
  const act = makeActions(page, redraw), state = act.state;
  const orbit = new Orbit($("stage"), (byHand) => {
    if (byHand) state.through = -1;
    redraw();
  });
  const scene = new Scene($("stage"), page);
  const showTools = makeTools($("tools"), $("marks"), act);
  const cards = page.videos.map((video, i) => new Card(video, i, $("cards"), act));
  const pictures = page.videos.map((video) => new Pictures(video, redraw));
  const labels = page.videos.map((video) => ["", "camera"].map((kind) => {
    const made = $("labels").appendChild(document.createElement("span"));
    made.className = kind; made.textContent = video.id;
    made.style[kind ? "color" : "background"] = video.color;
    return made;
  }));

  // Where every video is at this moment.
  const moments = () => page.videos.map((video) => {
    const now = video.excluded ? null : frameAt(video.phase, state.phase);
    return now && { ...now, confidence: video.confidence[Math.round(now.at)] / 255 };
  });

  function actorsAt(now) {
    const actors = [];
    page.videos.forEach((video, i) => {
      if (!state.on[i] || !now[i] || (state.through >= 0 && state.through !== i)) return;
      for (const name of ["final", "initial"]) {
        if (state.answer !== name && state.answer !== "both") continue;
        const answer = video.answers[name], shape = page.shapes[answer.shape];
        const ghost = (state.answer === "both" && name === "initial") || !now[i].inside;
        const own = rgb(video.color), plain = state.answer === "both" && name === "initial";
        actors.push({
          ...pose(page.model, shape, answer, now[i].at), mesh: scene.meshes[answer.shape], video: i,
          color: plain ? mix(own, [0.45, 0.45, 0.45], 0.75) : own, offset: state.offsets[i],
          alpha: ghost ? GHOST : state.through >= 0 ? 0.82 : 1,
        });
      }
    });
    return actors;
  }

  function view(frames) {
    const canvas = $("stage"), density = Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * density));
    const height = Math.max(1, Math.round(canvas.clientHeight * density));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const i = state.through, free = { density, width, height, through: -1 };
    if (i < 0) return { ...free, matrix: orbit.matrix(width, height), eye: orbit.eye() };
    const at = cameraAt(page.videos[i], frames[i]);
    const rows = [at.right, scaled(at.down, -1), scaled(at.ahead, -1)];
    const lens = pinhole(lensAt(page.videos[i], frames[i]), page.videos[i].view, width, height, 0.05, 200);
    const matrix = times(lens, viewOf(rows, at.centre));
    return { ...free, matrix, eye: at.centre, through: i };
  }

  function placeLabels(seen, actors, frames) {
    page.videos.forEach((video, i) => {
      const actor = actors.find((a) => a.video === i);
      const head = actor && seen.through < 0 && state.apart ? add(add(actor.joints[page.model.head], actor.offset), [0, 0.32, 0]) : null;
      const wanted = state.cameras && state.on[i] && !video.excluded && !state.apart && seen.through < 0;
      const corner = wanted ? mix(...pictureCorners(video, frames[i]).slice(0, 2), 0.5) : null;
      [head, corner].forEach((place, k) => {
        const at = place && landing(seen.matrix, place, seen.width / seen.density, seen.height / seen.density);
        labels[i][k].hidden = !at;
        if (at) labels[i][k].style.transform = `translate(${at.x}px, ${at.y - 4}px) translate(-50%, -100%)`;
      });
    });
  }

  function draw(time) {
    waiting = false;
    if (state.playing) {
      const passed = before ? Math.min(time - before, 200) / 1000 : 0;
      state.phase += passed * state.speed;
      if (state.phase > page.timeline.last) state.phase = page.timeline.first;
    }
    before = state.playing ? time : 0;
    const now = moments(), frames = now.map((n) => (n ? Math.round(n.at) : 0));
    const bitmaps = pictures.map((own, i) => own.at(frames[i]) ?? scene.shown[i]);
    bitmaps.forEach((bitmap, i) => bitmap && bitmap.width && scene.show(i, bitmap));
    const actors = actorsAt(now), seen = view(frames);
    scene.draw(seen, actors, frames, state);
    placeLabels(seen, actors, frames);
    cards.forEach((card, i) => card.draw(now[i], bitmaps[i]?.width ? bitmaps[i] : null, state));
    seekers[0] = drawLanes($("lanes"), page, state);
    seekers[1] = drawWarps($("warps"), page, state);
    showTools(state);
    $("play").textContent = state.playing ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    $("scrub").value = state.phase;
    $("speed").value = String(state.speed);
    $("help").hidden = !state.help;
    $("scene").classList.toggle("through", state.through >= 0);
    $("clock").textContent = `${state.phase.toFixed(2)} of ${page.timeline.last.toFixed(2)} s of ${page.reference}`;
    if (state.playing) redraw();
  }

  // all: how much of the way from the performers to the cameras is to be seen, 0 to 1.
  act.fit = (all, frontal = false) => {
    state.through = -1;
    if (frontal) orbit.azimuth = Math.atan2(-page.right[2], page.right[0]);
    const on = page.videos.map((_, i) => i).filter((i) => state.on[i] && !page.videos[i].excluded);
    const points = on.flatMap((i) => page.bounds[i].map((p) => add(p, state.offsets[i])));
    if (all && !state.apart)
      for (const i of on) {
        const camera = [...pictureCorners(page.videos[i], 0), page.videos[i].camera.centre];
        points.push(...camera.map((p) => mix(page.middle, p, all)));
      }
    orbit.fit(points.length ? points : [[-1, 0, 0], [1, 2, 0]], $("stage").clientWidth, $("stage").clientHeight);
  };
  const seekers = [null, null];
  for (const [k, id] of ["lanes", "warps"].entries()) {
    const to = (e) => seekers[k] && act.seek(seekers[k](e.offsetX));
    $(id).addEventListener("pointerdown", (e) => { $(id).setPointerCapture(e.pointerId); to(e); });
    $(id).addEventListener("pointermove", (e) => e.buttons && to(e));
  }
  Object.assign($("scrub"), { min: page.timeline.first, max: page.timeline.last });
  $("scrub").addEventListener("input", () => act.seek(Number($("scrub").value)));
  $("speed").addEventListener("change", () => act.speed(Number($("speed").value)));
  $("play").addEventListener("click", () => act.play());
  $("back").addEventListener("click", () => act.step(-1));
  $("forth").addEventListener("click", () => act.step(1));
  listenToKeys(act, page.videos.length);
  const arrange = () => {
    const stacked = matchMedia("(max-width: 760px)").matches;
    const room = [$("side").clientWidth - 20, stacked ? innerHeight : $("side").clientHeight - 48];
    const best = columnsFor(page.videos, ...room);
    $("cards").style.gridTemplateColumns = `repeat(${best.columns}, minmax(0, 1fr))`;
    $("cards").style.setProperty("--tall", `${Math.max(90, Math.floor(best.tall))}px`);
    redraw();
  };
  new ResizeObserver(arrange).observe($("page"));
  orbit.azimuth = page.azimuth;
  act.fit(1);
  window.imocap = { act, page, orbit, pose: (i, name, at) => pose(page.model, page.shapes[page.videos[i].answers[name].shape], page.videos[i].answers[name], at) };
  redraw();
}

try {
  start();
} catch (error) {
  $("trouble").hidden = false;
  $("trouble").textContent = error.message;
  console.error(error);
}
