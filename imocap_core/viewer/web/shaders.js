// What runs on the graphics card: skinned bodies, lines of a width in pixels, flat pictures.

const BODY_VERTEX = `#version 300 es
in vec3 a_rest; in vec3 a_normal; in uvec4 a_bone; in vec4 a_weight; in float a_shade;
uniform vec4 u_tints[BONES]; uniform bool u_tinted; out vec3 v_tint; // their w: metres to swell by
uniform float u_scale; uniform mat4 u_view; uniform vec3 u_offset; uniform vec3 u_flat;
uniform vec4 u_bones[3 * BONES]; uniform bool u_halo;
out vec3 v_normal; out vec3 v_place; out float v_shade;
void main() {
  vec4 x = vec4(a_rest * u_scale, 1.0);
  vec4 rows[3];
  for (int r = 0; r < 3; r++) {
    rows[r] = vec4(0.0);
    for (int k = 0; k < 4; k++) rows[r] += a_weight[k] * u_bones[3 * int(a_bone[k]) + r];
  }
  vec3 place = vec3(dot(rows[0], x), dot(rows[1], x), dot(rows[2], x)) + u_offset;
  v_normal = vec3(dot(rows[0].xyz, a_normal), dot(rows[1].xyz, a_normal), dot(rows[2].xyz, a_normal));
  v_shade = u_tinted ? 0.85 : a_shade;
  vec4 tint = vec4(0.0);
  if (u_tinted || u_halo) for (int k = 0; k < 4; k++) tint += a_weight[k] * u_tints[int(a_bone[k])];
  v_tint = tint.rgb;
  if (u_halo) place += normalize(v_normal) * tint.w;
  if (u_flat.y > 0.0) place = vec3(place.xz - u_flat.xz / u_flat.y * max(place.y, 0.0), 0.003).xzy;
  v_place = place;
  gl_Position = u_view * vec4(place, 1.0);
}`;

const BODY_FRAGMENT = `#version 300 es
precision highp float;
in vec3 v_normal; in vec3 v_place; in float v_shade; in vec3 v_tint;
uniform vec4 u_color; uniform bool u_tinted; uniform vec3 u_eye; uniform vec3 u_light; uniform bool u_lit; uniform bool u_halo;
out vec4 color;
void main() {
  if (!u_lit) { color = u_color; return; }
  vec3 n = normalize(v_normal), to_eye = normalize(u_eye - v_place);
  if (u_halo) {
    float rim = 1.0 - abs(dot(n, to_eye));
    color = vec4(u_color.rgb, u_color.a * (0.22 + 0.6 * rim * rim));
    return;
  }
  float key = max(dot(n, u_light), 0.0), sky = 0.5 + 0.5 * n.y;
  float fill = max(dot(n, normalize(to_eye + vec3(0.0, 0.2, 0.0))), 0.0);
  float edge = pow(1.0 - max(dot(n, to_eye), 0.0), 3.0);
  vec3 base = pow(u_tinted ? v_tint : u_color.rgb, vec3(2.2)) * v_shade * 1.9;
  vec3 lit = base * (0.22 + 0.2 * sky + 0.52 * key + 0.22 * fill) + vec3(0.07) * edge * sky;
  lit += vec3(0.05) * pow(max(dot(n, normalize(u_light + to_eye)), 0.0), 30.0);
  color = vec4(pow(lit, vec3(1.0 / 2.2)), u_color.a);
}`;

const LINE_VERTEX = `#version 300 es
in vec3 a_from; in vec3 a_to; in vec4 a_color; in float a_offset;
uniform mat4 u_view; uniform vec2 u_size; uniform float u_width; uniform vec3 u_shift;
out vec4 v_color;
void main() {
  vec4 p = u_view * vec4(a_from + u_shift, 1.0), q = u_view * vec4(a_to + u_shift, 1.0);
  float near = 0.02;
  if (p.w < near && q.w < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  if (p.w < near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  if (q.w < near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 along = (q.xy / q.w - p.xy / p.w) * u_size;
  along = length(along) > 1e-5 ? normalize(along) : vec2(1.0, 0.0);
  float side = gl_VertexID % 2 == 0 ? -1.0 : 1.0, end = gl_VertexID < 2 ? -1.0 : 1.0;
  vec2 step = (vec2(-along.y, along.x) * side + along * end * 0.5) * u_width / u_size;
  gl_Position = gl_VertexID < 2 ? p : q;
  gl_Position.xy += step * gl_Position.w;
  v_color = a_color;
}`;

const LINE_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 v_color; out vec4 color;
void main() { color = v_color; }`;

const PICTURE_VERTEX = `#version 300 es
uniform vec3 u_corners[4]; uniform mat4 u_view;
out vec2 v_at;
void main() {
  v_at = vec2(gl_VertexID % 2, gl_VertexID / 2);
  gl_Position = u_view * vec4(u_corners[gl_VertexID], 1.0);
}`;

const PICTURE_FRAGMENT = `#version 300 es
precision mediump float;
in vec2 v_at; uniform sampler2D u_picture; uniform float u_alpha;
out vec4 color;
void main() { color = vec4(texture(u_picture, v_at).rgb, u_alpha); }`;
