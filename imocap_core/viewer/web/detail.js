// How finely the scene is drawn: as finely as this machine can while something moves.

const LEVELS = [
  { coarse: false, shadows: true, density: 2 },
  { coarse: true, shadows: true, density: 1 },
  { coarse: true, shadows: false, density: 0.75 },
];
const SLOW_MS = 80, TRIALS = 5, REST_MS = 500;

// Whether WebGL is computed by the processor here.
function drawnBySoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const known = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = known ? String(gl.getParameter(known.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

class Detail {
  // rested: called when nothing has moved for a while after pictures of less detail.
  constructor(rested) {
    this.software = drawnBySoftware();
    this.level = this.software ? 1 : 0;
    this.rested = rested; this.before = 0; this.slow = 0; this.timer = 0; this.still = false;
  }

  // The level of this picture, drawn at `time`; the rested picture is drawn in full.
  now(time, playing) {
    const passed = time - this.before;
    this.before = time;
    if (playing && passed < 5000) this.judge(passed);
    const full = this.still && !playing;
    this.still = false;
    clearTimeout(this.timer);
    if (!full && !playing && this.level)
      this.timer = setTimeout(() => { this.still = true; this.rested(); }, REST_MS);
    return full ? LEVELS[0] : LEVELS[this.level];
  }

  // Pixels for each of the page's; without antialiasing a full picture has more of them.
  density(level) {
    const screen = level.coarse || !this.software ? devicePixelRatio || 1 : 2;
    return Math.min(screen, level.density);
  }

  judge(passed) {
    this.slow = passed > SLOW_MS ? this.slow + 1 : Math.max(0, this.slow - 1);
    if (this.slow < TRIALS || this.level === LEVELS.length - 1) return;
    this.level += 1; this.slow = 0;
  }
}
