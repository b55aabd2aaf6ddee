// The comparison: bodies on one timeline, an angle's curves, differences in words, measuring.

const MOST = 6; // bodies that are shown at first

const $ = (id) => document.getElementById(id);

// The joint that an angle is at; null where it has none of its own.
const jointOf = (page, angle) => {
  const at = page.model.joints.indexOf(angle.split("_").slice(0, 2).join(" "));
  return at < 0 ? null : at;
};

// The first body along its modes of variation: scores, in standard deviations.
function makeModes(page, shown) {
  const answer = page.videos[0].answers.final, mean = answer.rotations, count = page.model.parents.length;
  const scores = page.modes.map(() => 0);
  const move = () => {
    answer.rotations = mean.map((q, i) => {
      const joint = i % count, at = 3 * (Math.floor(i / count) * BODY_JOINTS + joint);
      if (joint >= BODY_JOINTS) return q;
      return quatTimes(q, quatOf(...[0, 1, 2].map((k) => page.modes.reduce((sum, { turns }, m) => sum + scores[m] * turns[at + k], 0))));
    });
    sliders.forEach((slider, m) => { slider.value = scores[m]; slider.title = `${scores[m].toFixed(1)} standard deviations`; });
    shown();
  };
  const set = (next) => { scores.forEach((_, m) => { scores[m] = next(m); }); move(); };
  const sliders = page.modes.map(({ share }, m) => {
    const label = $("modes").appendChild(document.createElement("label"));
    const slider = Object.assign(document.createElement("input"), { type: "range", min: -3, max: 3, step: 0.1, value: 0 });
    slider.setAttribute("aria-label", `Mode ${m + 1}, standard deviations from the mean`);
    label.append(`${m + 1} · ${Math.round(100 * share)} %`, slider);
    slider.addEventListener("input", () => { scores[m] = Number(slider.value); move(); });
    return slider;
  });
  const normal = () => Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
  const buttons = group($("modes"), [
    ["mean", "The mean motion", () => set(() => 0)],
    ["draw", "A performance as there might be another, at random", () => set(normal)],
  ]);
  $("variation").hidden = !page.modes.length;
  return { set, scores, buttons };
}

async function start() {
  const page = await readPage();
  for (const video of page.videos) video.answers.final.rotations = quaternions(video.answers.final.local);
  $("name").textContent = page.title;
  $("lead").textContent = page.lead;

  let waiting = 0, theme = readTheme(), message = "", written = 0, seeker = null, view = null, actors = [];
  const redraw = () => {
    waiting ||= requestAnimationFrame(draw);
  };
  const act = makeActions(page, redraw), state = act.state, player = new Player(act);
  Object.assign(state, { lead: 0, faint: GHOST, cameras: false, paths: false, angle: page.findings.find((f) => f.angle)?.angle ?? page.angles[0].name });
  state.on = page.videos.map((_, i) => i < MOST);
  const detail = new Detail(redraw), orbit = new Orbit($("stage"), redraw);
  const scene = new Scene($("stage"), page, !detail.software), labels = new Labels($("labels"), page);

  const dress = () => {
    theme = readTheme();
    scene.dress(theme); labels.dress(theme);
    boxes.forEach((box, i) => { box.parentElement.style.color = inksOf(page, theme)[i]; });
    redraw();
  };
  onThemeChange(dress);

  const then = (change) => (...given) => { change(...given); redraw(); };
  act.angle = then((name) => { state.angle = name; });
  act.fit = (_, frontal = false) => {
    orbit.field = state.apart ? NARROW_RAD : WIDE_RAD;
    if (frontal) orbit.azimuth = Math.atan2(-state.right[2], state.right[0]);
    const on = page.videos.map((_, i) => i).filter((i) => state.on[i]);
    const points = on.flatMap((i) => reachOf(page, i).map((p) => add(p, state.offsets[i])));
    orbit.fit(points.length ? points : [[-1, 0, 0], [1, 2, 0]], $("stage").clientWidth, $("stage").clientHeight);
  };
  act.snapshot = () => {
    detail.still = !state.playing;
    draw(performance.now());
    snapshot($("stage"), `${page.title} · ${state.phase.toFixed(2)} s · imocap`, theme, `${page.title}_${state.phase.toFixed(2)}s.png`);
  };
  act.link = () => copyLink(state, orbit).then((text) => {
    message = text; redraw();
    setTimeout(() => { message = ""; redraw(); }, 2500);
  });

  const places = group($("tools"), [
    ["in one place", "One among the others' ghosts; again for the next (o)", () => act.place("one")],
    ["side by side", "Performers set apart (o)", () => act.place("apart")],
  ]);
  const others = group($("tools"), [
    ["skeletons", "Skeletons instead of bodies (b)", () => act.flip("skeletons")],
    ["closer", "The performers (f)", () => { act.fit(); redraw(); }],
    ["picture", "Save the scene as a picture (p)", () => act.snapshot()],
    ["link", "Copy a link to this moment", () => act.link()],
  ]);
  const boxes = page.videos.map((video, i) => {
    const label = $("bodies").appendChild(document.createElement("label"));
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
    box.style.accentColor = video.color;
    label.append(box, video.id);
    box.addEventListener("change", () => act.toggle(i));
    return box;
  });
  page.model.joints.slice(0, BODY_JOINTS).forEach((name, joint) => $("joint").appendChild(new Option(name, joint)));
  for (const { name, label } of page.angles) $("angle").appendChild(new Option(label, name));
  const findings = page.findings.map((finding) => {
    const button = $("findings").appendChild(document.createElement("li")).appendChild(document.createElement("button"));
    button.textContent = finding.text;
    button.addEventListener("click", () => {
      if (finding.angle) act.angle(finding.angle);
      act.play(false); act.seek(finding.at);
    });
    return button;
  });
  for (const note of page.notes) $("notes").appendChild(document.createElement("p")).textContent = note;
  if (!findings.length) $("findings").textContent = "No angle differs by 5° or more.";

  const modes = makeModes(page, () => { state.on[0] = true; redraw(); });

  function curvesNow() {
    const angle = page.angles.find((a) => a.name === state.angle);
    return angle.curves.map(({ mean, sd }, i) => ({
      phase: page.phase, values: mean, color: inksOf(page, theme)[i],
      low: sd && mean.map((m, t) => m - sd[t]), high: sd && mean.map((m, t) => m + sd[t]),
    })).filter((_, i) => state.on[i]);
  }

  function draw(time) {
    cancelAnimationFrame(waiting);
    waiting = 0;
    const next = player.tick(time);
    const level = detail.now(time, state.playing), now = momentsAt(page, state.phase);
    actors = actorsAt(page, scene.meshes, state, now);
    view = freeView($("stage"), orbit, detail.density(level));
    scene.draw(view, actors, [], state, level);
    labels.place(view, actors, [], state);
    measure.show(state, jointOf(page, state.angle));
    showFrames(now);
    seeker = drawCurves($("curves"), page.timeline, state, curvesNow(), theme, page.angles[0].curves.some((c) => c.sd) ? "degrees; band: ± one standard deviation" : "degrees");
    showState();
    clearTimeout(written);
    if (next !== null) readyAt(pictures, momentsAt(page, next)).then(redraw);
    else written = setTimeout(() => writeAddress(state), 300);
  }

  function showState() {
    showTransport(page, state);
    $("legend").textContent = message || page.legend;
    $("angle").value = state.angle;
    press(places[0], !state.apart); press(places[1], state.apart); press(others[0], state.skeletons);
    boxes.forEach((box, i) => { box.checked = state.on[i]; });
    findings.forEach((button, i) =>
      button.setAttribute("aria-current", String(Math.abs(page.findings[i].at - state.phase) < 1e-4 && (page.findings[i].angle ?? state.angle) === state.angle)));
    $("clear").hidden = !state.chosen.length;
  }

  const measure = new Measure(page, act, () => ({ view, actors }));
  const pictures = page.videos.map((video) => new Pictures(video, () => state.playing || redraw()));
  const frames = page.videos.map((video) => {
    if (!video.pictures) return null;
    const figure = $("frames").appendChild(document.createElement("figure"));
    const canvas = figure.appendChild(document.createElement("canvas"));
    Object.assign(canvas, { width: 320, height: Math.round((320 * video.view[3]) / video.view[2]) });
    return { figure, canvas, caption: figure.appendChild(document.createElement("figcaption")) };
  });
  // Every shown performance's source frame of this moment.
  function showFrames(now) {
    frames.forEach((frame, i) => {
      if (!frame) return;
      frame.figure.hidden = !state.on[i];
      const picture = pictures[i].at(Math.round(now[i]?.at ?? 0));
      if (!picture) return;
      frame.canvas.getContext("2d").drawImage(picture.bitmap, 0, 0, frame.canvas.width, frame.canvas.height);
      frame.canvas.setAttribute("aria-label", `Frame of ${page.videos[i].id}`);
      frame.caption.textContent = `${page.videos[i].id}, frame ${page.videos[i].frames[picture.frame]}`;
    });
  }
  $("clear").addEventListener("click", () => act.measure(null));
  $("add").addEventListener("click", () => {
    const body = Math.max(0, state.on.indexOf(true));
    act.measure({ body, joint: Number($("joint").value) });
  });
  $("angle").addEventListener("change", () => act.angle($("angle").value));
  listenToTransport(page, act);
  const to = (e) => seeker && act.seek(seeker(e.offsetX));
  $("curves").addEventListener("pointerdown", (e) => { $("curves").setPointerCapture(e.pointerId); to(e); });
  $("curves").addEventListener("pointermove", (e) => e.buttons && to(e));
  listenToKeys({
    ...transportKeys(act), o: () => act.place(state.apart ? "one" : "apart"), b: () => act.flip("skeletons"),
    f: () => { act.fit(); redraw(); }, p: () => act.snapshot(), Escape: () => act.measure(null),
  }, page.videos.length, act);
  const goTo = (given) => { choose(given, act, orbit); act.go(given); };
  addEventListener("hashchange", (e) => goTo(momentOf(new URL(e.newURL).hash)));
  new ResizeObserver(redraw).observe($("page"));
  orbit.azimuth = page.azimuth;
  act.seek(page.findings.find((finding) => finding.angle)?.at ?? state.phase);
  // Who lies or reaches forward is seen from the side; a row that would be tiny, in one place.
  const body = page.videos[0].answers.final, at = momentsAt(page, state.phase)[0]?.at ?? 0;
  const joints = pose(page.model, page.shapes[0], body, at).joints, along = (k) => Math.max(...joints.map((p) => p[k])) - Math.min(...joints.map((p) => p[k]));
  if (along(2) > along(0)) act.row([0, 0, -1]);
  act.place(1.4 * $("stage").clientWidth / $("stage").clientHeight > 0.42 * page.videos.length ? "apart" : "one");
  goTo(momentOf(location.hash));
  dress();
  const where = (body, joint) => {
    const actor = actors.find((a) => a.video === body);
    return landing(view.matrix, add(actor.joints[joint], actor.offset), view.width / view.density, view.height / view.density);
  };
  window.imocap = { act, modes, page, orbit, scene, actors: () => actors, where };
}

start().catch((error) => {
  $("trouble").hidden = false;
  $("trouble").textContent = error.message;
  console.error(error);
});
