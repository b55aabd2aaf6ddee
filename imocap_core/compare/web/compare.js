// The comparison: bodies on one timeline, an angle's curves, differences in words, measuring.

const MOST = 6; // bodies that are shown at first

const $ = (id) => document.getElementById(id);

function start() {
  const page = readPage();
  for (const video of page.videos) video.answers.final.rotations = quaternions(video.answers.final.local);
  $("name").textContent = page.title;
  $("lead").textContent = page.lead;

  let waiting = 0, theme = readTheme(), message = "", written = 0, seeker = null, view = null, actors = [];
  const redraw = () => {
    waiting ||= requestAnimationFrame(draw);
  };
  const act = makeActions(page, redraw), state = act.state, player = new Player(act);
  Object.assign(state, { cameras: false, paths: false, angle: page.findings.find((f) => f.angle)?.angle ?? page.angles[0].name });
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
    if (frontal) orbit.azimuth = 0;
    const on = page.videos.map((_, i) => i).filter((i) => state.on[i]);
    const points = on.flatMap((i) => reachOf(page, i).map((p) => add(p, state.offsets[i])));
    orbit.fit(points.length ? points : [[-1, 0, 0], [1, 2, 0]], $("stage").clientWidth, $("stage").clientHeight);
  };
  act.snapshot = () => {
    detail.still = !state.playing;
    draw(performance.now());
    snapshot($("stage"), `${page.title} · ${state.phase.toFixed(2)} s · imocap`, theme, `${page.title}_${state.phase.toFixed(2)}s.png`);
  };
  act.link = () => copyLink(state).then((text) => {
    message = text; redraw();
    setTimeout(() => { message = ""; redraw(); }, 2500);
  });

  const places = group($("tools"), [
    ["in one place", "One over the other (o)", () => act.place("all")],
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
  if (!findings.length) $("findings").textContent = "No angle differs by 5° or more.";

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
    player.tick(time);
    const level = detail.now(time, state.playing), now = momentsAt(page, state.phase);
    actors = actorsAt(page, scene.meshes, state, now);
    view = freeView($("stage"), orbit, detail.density(level));
    scene.draw(view, actors, [], state, level);
    labels.place(view, actors, [], state);
    measure.show(state);
    seeker = drawCurves($("curves"), page.timeline, state, curvesNow(), theme, "degrees; band: ± one standard deviation");
    showState();
    clearTimeout(written);
    if (state.playing) redraw();
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
    ...transportKeys(act), o: () => act.place(state.apart ? "all" : "apart"), b: () => act.flip("skeletons"),
    f: () => { act.fit(); redraw(); }, p: () => act.snapshot(), Escape: () => act.measure(null),
  }, page.videos.length, act);
  addEventListener("hashchange", () => act.go(momentOf(location.hash)));
  new ResizeObserver(redraw).observe($("page"));
  orbit.azimuth = page.azimuth;
  act.go(momentOf(location.hash));
  if (page.videos.length > 2) act.place("apart");
  else act.fit();
  dress();
  const where = (body, joint) => landing(view.matrix, actors.find((a) => a.video === body).joints[joint], view.width / view.density, view.height / view.density);
  window.imocap = { act, page, orbit, scene, actors: () => actors, where };
}

try {
  start();
} catch (error) {
  $("trouble").hidden = false;
  $("trouble").textContent = error.message;
  console.error(error);
}
