// Putting it together: one state, drawn once a change and once a picture while it plays.

const $ = (id) => document.getElementById(id);

async function start() {
  const page = await readPage();
  for (const video of page.videos)
    for (const answer of Object.values(video.answers)) answer.rotations = quaternions(answer.local);
  $("name").textContent = page.title;
  $("lead").textContent = page.lead;
  showHelp($("help"));

  let waiting = 0, theme = readTheme(), message = "", written = 0, view = null, actors = [], pelvis = null;
  const redraw = () => {
    waiting ||= requestAnimationFrame(draw);
  };
  const act = makeActions(page, redraw), state = act.state;
  const detail = new Detail(redraw), player = new Player(act);
  const orbit = new Orbit($("stage"), (byHand) => {
    if (byHand) state.through = -1;
    redraw();
  });
  const scene = new Scene($("stage"), page, !detail.software);
  const showTools = makeTools($("tools"), $("marks"), $("eye"), act), showChoice = makeChooser(page, act);
  makeVerdict(page, act);
  const reveal = $("reveal").querySelector("input");
  reveal.addEventListener("input", () => act.reveal(Number(reveal.value)));
  const cards = page.videos.map((video, i) => new Card(video, i, $("cards"), act));
  const pictures = page.videos.map((video) => new Pictures(video, () => state.playing || redraw()));
  const labels = new Labels($("labels"), page), curves = new Curves(page);
  const measure = new Measure(page, act, () => ({ view, actors }));
  const lead = page.videos.findIndex((video) => video.id === page.reference);
  state.curves.joints = [liveliest(curves.jointsOf(page.videos[lead], "final"))];

  const dress = () => {
    theme = readTheme();
    scene.dress(theme); labels.dress(theme);
    redraw();
  };
  onThemeChange(dress);

  function viewNow(frames, level) {
    const i = state.through, free = freeView($("stage"), orbit, detail.density(level));
    if (i < 0) return free;
    const { width, height } = free;
    const at = cameraAt(page.videos[i], frames[i]);
    const rows = [at.right, scaled(at.down, -1), scaled(at.ahead, -1)];
    const lens = pinhole(lensAt(page.videos[i], frames[i]), page.videos[i].view, width, height, 0.05, 200);
    return { ...free, matrix: times(lens, viewOf(rows, at.centre)), eye: at.centre, through: i };
  }

  // The eye goes as far as the chosen performer's pelvis went since the last draw.
  function follow() {
    const now = state.follow ? actors.find((a) => a.video === state.lead)?.joints[0] : null;
    if (now && pelvis) orbit.target = add(orbit.target, sub(now, pelvis));
    pelvis = now;
  }

  function draw(time) {
    cancelAnimationFrame(waiting);
    waiting = 0;
    const next = player.tick(time), level = detail.now(time, state.playing);
    const now = momentsAt(page, state.phase);
    const shown = pictures.map((own, i) => own.at(now[i] ? Math.round(now[i].at) : 0));
    const frames = now.map((n, i) => shown[i]?.frame ?? (n ? Math.round(n.at) : 0));
    // A picture that is not yet decoded holds its body back: both are of one frame.
    now.forEach((n, i) => {
      const late = shown[i] && Math.abs(frames[i] - n?.at) > (page.videos[i].pictures.every + 1) / 2;
      if (n && (late || state.through === i)) n.at = frames[i];
    });
    shown.forEach((picture, i) => picture && scene.show(i, picture.bitmap));
    actors = actorsAt(page, scene.meshes, state, now);
    follow();
    view = viewNow(frames, level);
    scene.draw(view, actors, frames, state, level);
    labels.place(view, actors, frames, state);
    cards.forEach((card, i) => card.draw(now[i], shown[i], state));
    measure.show(state);
    seekers[0] = drawLanes($("lanes"), page, state, theme);
    seekers[1] = drawWarps($("warps"), page, state, theme);
    seekers[2] = curves.draw($("curves"), state, theme);
    showTools(state);
    showChoice(state);
    showState();
    if (next !== null) readyAt(pictures, momentsAt(page, next)).then(redraw);
    clearTimeout(written);
    if (!state.playing) written = setTimeout(() => writeAddress(state), 300);
  }

  function showState() {
    showTransport(page, state);
    $("help").hidden = !state.help;
    $("film").hidden = state.loop.length !== 2;
    $("scene").classList.toggle("through", state.through >= 0);
    $("ramp").hidden = !state.uncertainty;
    $("reveal").hidden = state.answer === "both";
    reveal.value = state.together;
    $("measured").hidden = !state.chosen.length;
    $("legend").textContent = message || warningAt(page, state) || (haloShare(state) > 0 && !state.skeletons ? "halo: expected error of each part of the body" : page.legend);
  }

  function say(text) {
    message = text; redraw();
    setTimeout(() => { message = ""; redraw(); }, 5000);
  }

  // all: how much of the way from the performers to the cameras is to be seen, 0 to 1.
  act.fit = (all, frontal = false) => {
    state.through = -1;
    orbit.field = state.apart ? NARROW_RAD : WIDE_RAD;
    if (frontal) orbit.azimuth = Math.atan2(-state.right[2], state.right[0]);
    const on = page.videos.map((_, i) => i).filter((i) => state.on[i] && !page.videos[i].excluded);
    const points = on.flatMap((i) => reachOf(page, i).map((p) => add(p, state.offsets[i])));
    if (state.apart) points.push(...points.map((p) => add(p, [0, NAME_M, 0])));
    if (all && !state.apart)
      for (const i of on) {
        const camera = [...pictureCorners(page.videos[i], 0), page.videos[i].camera.centre];
        points.push(...camera.map((p) => mix(page.middle, p, all)));
      }
    orbit.fit(points.length ? points : [[-1, 0, 0], [1, 2, 0]], $("stage").clientWidth, $("stage").clientHeight);
  };
  // From the front or the left of the chosen performer, as they stand now, or from above.
  act.look = (from) => {
    const now = momentsAt(page, state.phase)[state.lead], answer = page.videos[state.lead].answers.final;
    const { front, left } = facingOf(page.model, pose(page.model, page.shapes[answer.shape], answer, now?.at ?? 0).joints);
    const back = from === "side" ? left : front;
    orbit.azimuth = Math.atan2(back[0], back[2]);
    orbit.elevation = from === "top" ? TOP_RAD : 0.12;
    act.row([back[2], 0, -back[0]]);
    act.fit(0);
  };
  act.snapshot = () => {
    detail.still = !state.playing;
    draw(performance.now());
    const said = `${page.title} · ${state.phase.toFixed(2)} s of ${page.reference} · imocap`;
    snapshot($("stage"), said, theme, `${page.title}_${state.phase.toFixed(2)}s.png`);
  };
  act.film = () => copied(`imocap video ${page.title} --from ${state.loop[0].toFixed(2)} --to ${state.loop[1].toFixed(2)}`).then(say);
  act.link = () => copyLink(state, orbit).then(say);
  const seekers = [null, null, null];
  for (const [k, id] of ["lanes", "warps", "curves"].entries()) {
    const to = (e) => seekers[k] && act.seek(seekers[k](e.offsetX));
    $(id).addEventListener("pointerdown", (e) => { $(id).setPointerCapture(e.pointerId); to(e); });
    $(id).addEventListener("pointermove", (e) => e.buttons && to(e));
  }
  listenToTransport(page, act);
  $("film").addEventListener("click", () => act.film());
  listenToKeys({ ...transportKeys(act), ...viewerKeys(act) }, page.videos.length, act);
  const goTo = (given) => { choose(given, act, orbit); act.go(given); };
  addEventListener("hashchange", (e) => goTo(momentOf(new URL(e.newURL).hash)));
  const arrange = () => {
    const stacked = matchMedia("(max-width: 760px), (max-height: 500px)").matches;
    const room = [$("side").clientWidth - 20, stacked ? innerHeight : $("side").clientHeight - 48];
    const best = columnsFor(page.videos, ...room);
    $("cards").style.gridTemplateColumns = `repeat(${best.columns}, minmax(0, 1fr))`;
    $("cards").style.setProperty("--tall", `${Math.max(90, Math.floor(best.tall))}px`);
    redraw();
  };
  new ResizeObserver(arrange).observe($("page"));
  orbit.azimuth = page.azimuth;
  act.place(placeFor(page.videos.length, $("stage").clientWidth / $("stage").clientHeight));
  goTo(momentOf(location.hash));
  dress();
  window.imocap = {
    act, page, orbit, scene, curves, pictures, rgb, contrast, readable, theme: () => theme,
    detail: () => ({ level: detail.level, software: detail.software }), shown: () => cards.map((card) => card.shown), actors: () => actors,
    pose: (i, name, at) => pose(page.model, page.shapes[page.videos[i].answers[name].shape], page.videos[i].answers[name], at),
  };
}

start().catch((error) => {
  $("trouble").hidden = false;
  $("trouble").textContent = error.message;
  console.error(error);
});
