// The scene: who is drawn where, in which order.

const LIGHT = unit([0.45, 1, 0.55]);
const GHOST = 0.38, FAINT = 0.13;

// Of every bone its colour and the metres by which its halo lies outside the skin.
function tintsAndSizes({ tints, halo, rows }) {
  return Array.from({ length: rows.length / 12 }, (_, j) => [...(tints?.[j] ?? GREY), halo?.sizes[j] ?? 0]).flat();
}

class Scene {
  constructor(canvas, page, antialias) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias, stencil: true });
    if (!gl) throw new Error("This browser has no WebGL 2, so the scene can't be drawn.");
    Object.assign(this, { gl, canvas, page });
    const bones = page.model.parents.length;
    this.bodies = program(gl, BODY_VERTEX.replaceAll("BONES", String(bones)), BODY_FRAGMENT);
    this.lines = program(gl, LINE_VERTEX, LINE_FRAGMENT);
    this.pictures = program(gl, PICTURE_VERTEX, PICTURE_FRAGMENT);
    this.meshes = page.shapes.map((shape) => bodyMesh(gl, this.bodies, page.model, shape));
    this.textures = page.videos.map(() => pictureTexture(gl));
    this.shown = page.videos.map(() => null);
  }

  // Colours of the surroundings, which are made anew.
  dress(theme) {
    const { gl, page } = this, sky = rgb(theme.sky);
    for (const old of [this.floor, ...(this.paths ?? [])]) if (old) dropLines(gl, old);
    this.sky = sky;
    this.floor = lineSet(gl, this.lines, floor(page.middle, rgb(theme.grid)));
    this.paths = page.videos.map((video) =>
      lineSet(gl, this.lines, path(video, video.answers.final, page.shapes[video.answers.final.shape], sky)));
  }

  // A picture for a video's camera to hold; the same one is not sent twice.
  show(index, bitmap) {
    if (this.shown[index] === bitmap) return;
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[index]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    this.shown[index] = bitmap;
  }

  // actors: [{mesh, rows, joints, color, tints, alpha, offset}]; view: {matrix, eye, width, height,
  // through}; level: how finely, of `LEVELS`.
  draw(view, actors, frames, state, level) {
    const gl = this.gl;
    this.level = level;
    gl.viewport(0, 0, view.width, view.height);
    gl.clearColor(...(view.through < 0 ? this.sky : [0.1, 0.11, 0.125]), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.enable(gl.BLEND);
    if (view.through >= 0) {
      const video = this.page.videos[view.through], frame = frames[view.through];
      this.drawPicture(view.matrix, pictureCorners(video, frame, video.view, 60), view.through, 1);
    } else {
      this.drawLines(view, [this.floor], 1.2);
      if (level.shadows) this.drawShadows(view, actors);
    }
    if (state.skeletons) this.drawSkeletons(view, actors);
    else for (const actor of actors.filter((a) => a.alpha >= 1)) this.drawBody(view, actor);
    if (view.through < 0) this.drawSurroundings(view, actors, frames, state);
    if (state.skeletons) return;
    for (const actor of actors.filter((a) => a.alpha < 1)) this.drawGhost(view, actor);
    for (const actor of actors.filter((a) => a.halo)) this.drawGhost(view, actor, { halo: true, color: [...actor.color, actor.halo.alpha] });
  }

  drawSkeletons(view, actors) {
    const lines = actors.flatMap((a) =>
      skeletonLines(this.page.model.parents, a.joints, a.tints ?? a.joints.map(() => a.color), a.alpha, a.offset));
    const set = lineSet(this.gl, this.lines, lines);
    this.drawLines(view, [set], 5);
    dropLines(this.gl, set);
  }

  drawSurroundings(view, actors, frames, state) {
    const on = this.page.videos.map((_, i) => i).filter((i) => state.on[i] && !this.page.videos[i].excluded);
    if (state.paths)
      for (const i of on) this.drawLines(view, [this.paths[i]], 3.5, state.offsets[i]);
    if (!state.cameras || state.apart) return;
    const clear = on.filter((i) => !covers(view, this.page.videos[i], frames[i], actors));
    for (const i of clear.filter((i) => this.shown[i]))
      this.drawPicture(view.matrix, pictureCorners(this.page.videos[i], frames[i], this.page.videos[i].view), i, 0.92);
    const edges = lineSet(this.gl, this.lines, clear.flatMap((i) => frustum(this.page.videos[i], frames[i])));
    this.drawLines(view, [edges], 2.2);
    dropLines(this.gl, edges);
  }

  drawShadows(view, actors) {
    const gl = this.gl;
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    for (const actor of actors)
      if (actor.alpha >= 1) this.drawBody(view, actor, { flat: LIGHT, lit: false, color: [0.12, 0.15, 0.2, 0.2] });
    gl.disable(gl.STENCIL_TEST);
  }

  // Only the nearest surface shows through: depth first, then the colour once.
  drawGhost(view, actor, how = {}) {
    const gl = this.gl;
    gl.colorMask(false, false, false, false);
    this.drawBody(view, actor, how);
    gl.colorMask(true, true, true, true);
    this.drawBody(view, actor, how);
  }

  drawBody(view, actor, { flat = [0, 0, 0], lit = true, color = null, halo = false } = {}) {
    const faces = lit && !this.level.coarse ? actor.mesh.fine : actor.mesh.coarse;
    const gl = this.gl, at = this.bodies;
    gl.useProgram(at.program);
    gl.uniformMatrix4fv(at.u_view, false, view.matrix);
    gl.uniform4fv(at.u_bones, actor.rows);
    gl.uniform1f(at.u_scale, actor.mesh.scale);
    gl.uniform3fv(at.u_offset, actor.offset);
    gl.uniform3fv(at.u_flat, flat);
    gl.uniform4fv(at.u_color, color ?? [...actor.color, actor.alpha]);
    gl.uniform3fv(at.u_eye, view.eye);
    gl.uniform3fv(at.u_light, LIGHT);
    gl.uniform1i(at.u_lit, lit ? 1 : 0);
    gl.uniform1i(at.u_tinted, lit && actor.tints ? 1 : 0);
    gl.uniform1i(at.u_halo, halo ? 1 : 0);
    if (lit && (actor.tints || halo)) gl.uniform4fv(at.u_tints, tintsAndSizes(actor));
    gl.bindVertexArray(actor.mesh.array);
    gl.drawElements(gl.TRIANGLES, faces.count, gl.UNSIGNED_SHORT, faces.at);
  }

  drawLines(view, sets, width, shift = [0, 0, 0]) {
    const gl = this.gl, at = this.lines;
    gl.useProgram(at.program);
    gl.uniformMatrix4fv(at.u_view, false, view.matrix);
    gl.uniform2f(at.u_size, view.width, view.height);
    gl.uniform1f(at.u_width, width * view.density);
    gl.uniform3fv(at.u_shift, shift);
    for (const set of sets) {
      gl.bindVertexArray(set.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, set.count);
    }
  }

  drawPicture(matrix, corners, index, alpha) {
    const gl = this.gl, at = this.pictures;
    gl.useProgram(at.program);
    gl.bindVertexArray(null);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[index]);
    gl.uniform3fv(at.u_corners, corners.flat());
    gl.uniformMatrix4fv(at.u_view, false, matrix);
    gl.uniform1f(at.u_alpha, alpha);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}
