// A thin layer over WebGL2: programs, buffers, and the three things that are drawn.

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const places = { program: made };
  const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const name = gl.getActiveUniform(made, i).name;
    places[name.replace("[0]", "")] = gl.getUniformLocation(made, name);
  }
  return places;
}

function attribute(gl, made, name, data, size, { kind, normal = false, whole = false, each = 0, stride = 0, at = 0 }) {
  const place = gl.getAttribLocation(made.program, name);
  if (place < 0) return;
  const buffer = data instanceof WebGLBuffer ? data : filled(gl, gl.ARRAY_BUFFER, data);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.enableVertexAttribArray(place);
  if (whole) gl.vertexAttribIPointer(place, size, kind, stride, at);
  else gl.vertexAttribPointer(place, size, kind, normal, stride, at);
  gl.vertexAttribDivisor(place, each);
}

function filled(gl, target, data) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, data, gl.STATIC_DRAW);
  return buffer;
}

// A surface that bones will carry, one for each shape, with fine and with coarse triangles.
function bodyMesh(gl, made, model, shape) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const put = (name, data, size, how) => attribute(gl, made, name, data, size, how);
  put("a_rest", shape.rest, 3, { kind: gl.SHORT, normal: true });
  put("a_normal", normals(shape.rest, model.faces), 3, { kind: gl.FLOAT });
  put("a_bone", model.bones, 4, { kind: gl.UNSIGNED_BYTE, whole: true });
  put("a_weight", model.weights, 4, { kind: gl.UNSIGNED_SHORT, normal: true });
  put("a_shade", model.shades, 1, { kind: gl.UNSIGNED_BYTE, normal: true });
  const coarse = coarseFaces(model, shape), start = model.faces.length;
  const both = new Uint16Array(start + coarse.length);
  both.set(model.faces); both.set(coarse, start);
  filled(gl, gl.ELEMENT_ARRAY_BUFFER, both);
  gl.bindVertexArray(null);
  return {
    array, scale: shape.scale,
    fine: { count: start, at: 0 }, coarse: { count: coarse.length, at: 2 * start },
  };
}

// Lines from a list of [from, to, color]; colors are four numbers from 0 to 1.
function lineSet(gl, made, segments) {
  const data = new Float32Array(segments.flatMap(([from, to, color]) => [...from, ...to, ...color]));
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const buffer = filled(gl, gl.ARRAY_BUFFER, data);
  const how = (at) => ({ kind: gl.FLOAT, each: 1, stride: 40, at });
  attribute(gl, made, "a_from", buffer, 3, how(0));
  attribute(gl, made, "a_to", buffer, 3, how(12));
  attribute(gl, made, "a_color", buffer, 4, how(24));
  gl.bindVertexArray(null);
  return { array, buffer, count: segments.length };
}

function dropLines(gl, lines) {
  gl.deleteVertexArray(lines.array);
  gl.deleteBuffer(lines.buffer);
}

function pictureTexture(gl) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([60, 64, 70, 255]));
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return texture;
}
