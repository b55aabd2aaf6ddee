// Putting it together: one state, drawn once a change and once a picture while it plays.

const $ = (id) => document.getElementById(id);

function start() {
  const page = readPage();
  for (const video of page.videos)
    for (const answer of Object.values(video.answers)) answer.rotations = quaternions(answer.local);
  $("name").textContent = page.title;
  $("lead").textContent = page.lead;
  showHelp($("help"));

  let waiting = 0, before = 0, theme = readTheme(), message = "", written = 0;
  const redraw = () => {
    waiting ||= requestAnimationFrame(draw);
  };
  const act = makeActions(page, redraw), state = act.state;
  const detail = new Detail(redraw);
  const orbit = new Orbit($("stage"), (byHand) => {
    if (byHand) state.through = -1;
    redraw();
  });
  const scene = new Scene($("stage"), page, !detail.software);
  const showTools = makeTools($("tools"), $("marks"), act), showChoice = makeChooser(page, act);
  const cards = page.videos.map((video, i) => new Card(video, i, $("cards"), act));
  const pictures = page.videos.map((video) => new Pictures(video, redraw));
  const labels = new Labels($("labels"), page), curves = new Curves(page);

  const dress = () => {
    theme = readTheme();
    scene.dress(theme); labels.dress(theme);
    redraw();
  };
  onThemeChange(dress);

  function view(frames, level) {
    const i = state.through, free = freeView($("stage"), orbit, detail.density(level));
    if (i < 0) return free;
    const { width, height } = free;
    const at = cameraAt(page.videos[i], frames[i]);
    const rows = [at.right, scaled(at.down, -1), scaled(at.ahead, -1)];
    const lens = pinhole(lensAt(page.videos[i], frames[i]), page.videos[i].view, width, height, 0.05, 200);
    return { ...free, matrix: times(lens, viewOf(rows, at.centre)), eye: at.centre, through: i };
  }

  function draw(time) {
    cancelAnimationFrame(waiting);
    waiting = 0;
    if (state.playing) act.advance(before ? (Math.min(time - before, 200) / 1000) * state.speed : 0);
    before = state.playing ? time : 0;
    const level = detail.now(time, state.playing);
    const now = momentsAt(page, state.phase), frames = now.map((n) => (n ? Math.round(n.at) : 0));
    const bitmaps = pictures.map((own, i) => own.at(frames[i]) ?? scene.shown[i]);
    bitmaps.forEach((bitmap, i) => bitmap && bitmap.width && scene.show(i, bitmap));
    const actors = actorsAt(page, scene.meshes, state, now), seen = view(frames, level);
    scene.draw(seen, actors, frames, state, level);
    labels.place(seen, actors, frames, state);
    cards.forEach((card, i) => card.draw(now[i], bitmaps[i]?.width ? bitmaps[i] : null, state));
    seekers[0] = drawLanes($("lanes"), page, state, theme);
    seekers[1] = drawWarps($("warps"), page, state, theme);
    seekers[2] = curves.draw($("curves"), state, theme);
    showTools(state);
    showChoice(state);
    showState();
    if (state.playing) redraw();
    clearTimeout(written);
    if (!state.playing) written = setTimeout(() => writeAddress(state), 300);
  }

  function showState() {
    showTransport(page, state);
    $("help").hidden = !state.help;
    $("scene").classList.toggle("through", state.through >= 0);
    $("ramp").hidden = !state.uncertainty;
    $("legend").textContent = message || page.legend;
  }

  function say(text) {
    message = text; redraw();
    setTimeout(() => { message = ""; redraw(); }, 2500);
  }

  // all: how much of the way from the performers to the cameras is to be seen, 0 to 1.
  act.fit = (all, frontal = false) => {
    state.through = -1;
    orbit.field = state.apart ? NARROW_RAD : WIDE_RAD;
    if (frontal) orbit.azimuth = Math.atan2(-page.right[2], page.right[0]);
    const on = page.videos.map((_, i) => i).filter((i) => state.on[i] && !page.videos[i].excluded);
    const points = on.flatMap((i) => reachOf(page, i).map((p) => add(p, state.offsets[i])));
    if (all && !state.apart)
      for (const i of on) {
        const camera = [...pictureCorners(page.videos[i], 0), page.videos[i].camera.centre];
        points.push(...camera.map((p) => mix(page.middle, p, all)));
      }
    orbit.fit(points.length ? points : [[-1, 0, 0], [1, 2, 0]], $("stage").clientWidth, $("stage").clientHeight);
  };
  act.snapshot = () => {
    detail.still = !state.playing;
    draw(performance.now());
    const said = `${page.title} · ${state.phase.toFixed(2)} s of ${page.reference} · imocap`;
    snapshot($("stage"), said, theme, `${page.title}_${state.phase.toFixed(2)}s.png`);
  };
  act.link = () => copyLink(state).then(say);
  const seekers = [null, null, null];
  for (const [k, id] of ["lanes", "warps", "curves"].entries()) {
    const to = (e) => seekers[k] && act.seek(seekers[k](e.offsetX));
    $(id).addEventListener("pointerdown", (e) => { $(id).setPointerCapture(e.pointerId); to(e); });
    $(id).addEventListener("pointermove", (e) => e.buttons && to(e));
  }
  listenToTransport(page, act);
  listenToKeys({ ...transportKeys(act), ...viewerKeys(act) }, page.videos.length, act);
  addEventListener("hashchange", () => act.go(momentOf(location.hash)));
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
  act.go(momentOf(location.hash));
  act.fit(0);
  dress();
  window.imocap = {
    act, page, orbit, scene, curves, rgb, contrast, readable, theme: () => theme, detail: () => ({ level: detail.level, software: detail.software }),
    pose: (i, name, at) => pose(page.model, page.shapes[page.videos[i].answers[name].shape], page.videos[i].answers[name], at),
  };
}

try {
  start();
} catch (error) {
  $("trouble").hidden = false;
  $("trouble").textContent = error.message;
  console.error(error);
}
