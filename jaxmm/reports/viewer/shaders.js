// Programs of the graphics card. `between` is the lowest and highest z that is drawn [m].

const SURFACE_SHADERS = [
  `#version 300 es
in vec3 place;
in vec4 tint; // with its light
uniform mat4 matrix;
uniform vec4 instead; // drawn instead of the tint where its opacity is above 0
out float height;
flat out vec4 ink;
void main() {
  height = place.z;
  ink = instead.a > 0.0 ? instead : tint;
  gl_Position = matrix * vec4(place, 1.0);
}`,
  `#version 300 es
precision highp float;
in float height;
flat in vec4 ink;
uniform vec2 between;
uniform float hatch; // [pixel] between stripes; 0 for none
out vec4 color;
void main() {
  if (height < between.x || height > between.y) discard;
  if (hatch > 0.0 && fract((gl_FragCoord.x + gl_FragCoord.y) / hatch) < 0.6) discard;
  color = ink;
}`,
];

// Six corners a line, without attributes: a software renderer takes far longer for instances.
const LINE_SHADERS = [
  `#version 300 es
#define LINES_A_ROW 1024
precision highp float;
precision highp usampler2D;
uniform usampler2D lines; // two texels a line: the bits of start, end, tint, and [m] of dash and gap, 0 for a solid one
uniform mat4 matrix;
uniform vec2 size; // [pixel] of the canvas
uniform float width; // [pixel]
uniform vec4 instead;
out vec4 ink;
out float gone; // [m] along the line
out float height;
out float period;
void main() {
  int line = gl_VertexID / 6, corner = gl_VertexID % 6;
  corner = corner < 3 ? corner : corner == 3 ? 2 : corner == 4 ? 1 : 3;
  ivec2 texel = ivec2(2 * (line % LINES_A_ROW), line / LINES_A_ROW);
  uvec4 one = texelFetch(lines, texel, 0), two = texelFetch(lines, texel + ivec2(1, 0), 0);
  vec3 start = uintBitsToFloat(one.xyz), end = vec3(uintBitsToFloat(one.w), uintBitsToFloat(two.xy));
  vec4 tint = vec4(two.zzzz >> uvec4(0, 8, 16, 24) & 255u) / 255.0;
  vec4 p = matrix * vec4(start, 1.0), q = matrix * vec4(end, 1.0);
  // What lies behind the eye has no direction on the screen: cut it off.
  if (p.w < 0.01 && q.w >= 0.01) p = mix(p, q, (0.01 - p.w) / (q.w - p.w));
  if (q.w < 0.01 && p.w >= 0.01) q = mix(q, p, (0.01 - q.w) / (p.w - q.w));
  vec2 along = (q.xy / q.w - p.xy / p.w) * size;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  bool last = (corner & 1) == 1;
  float side = corner < 2 ? -1.0 : 1.0;
  gl_Position = last ? q : p;
  gl_Position.xy += side * width * vec2(-along.y, along.x) / size * gl_Position.w;
  if (p.w < 0.01 && q.w < 0.01) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gone = last ? distance(start, end) : 0.0;
  height = last ? end.z : start.z;
  period = uintBitsToFloat(two.w);
  ink = instead.a > 0.0 ? vec4(instead.rgb, instead.a * tint.a) : tint;
}`,
  `#version 300 es
precision highp float;
in vec4 ink;
in float gone;
in float height;
in float period;
uniform vec2 between;
uniform float fade;
out vec4 color;
void main() {
  if (height < between.x || height > between.y) discard;
  if (period > 0.0 && fract(gone / period) > 0.6) discard;
  color = vec4(ink.rgb, ink.a * fade);
}`,
];

const POINT_SHADERS = [
  `#version 300 es
in vec3 place;
in float probability;
in float evidence;
in float off; // steps off the model
uniform mat4 matrix;
uniform vec2 between;
uniform float diameter; // [pixel] at one metre
uniform vec2 sizes; // least and greatest [pixel]
uniform int mode; // 0 by probability, 1 by evidence, 2 by distance, 3 all alike
uniform vec3 calm;
uniform vec3 hot;
uniform vec3 palette[4];
uniform vec3 offs[4]; // away from the scanner, in place, toward it, and farther off
uniform float scale; // steps that end the scale of distances
uniform vec3 plain;
out vec3 ink;
void main() {
  gl_Position = matrix * vec4(place, 1.0);
  float share = mode == 0 ? probability : mode == 2 ? 1.0 : 0.0;
  gl_PointSize = clamp(diameter / gl_Position.w, sizes.x, sizes.y) * (1.0 + 0.5 * share);
  float part = off / scale;
  vec3 far = abs(part) > 1.0 ? offs[3] : mix(offs[1], offs[part < 0.0 ? 0 : 2], abs(part));
  ink = mode == 0 ? mix(calm, hot, probability) : mode == 1 ? palette[int(evidence)] : mode == 2 ? far : plain;
  if (place.z < between.x || place.z > between.y) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`,
  `#version 300 es
precision highp float;
in vec3 ink;
uniform bool round_;
out vec4 color;
void main() {
  if (round_ && distance(gl_PointCoord, vec2(0.5)) > 0.5) discard;
  color = vec4(ink, 1.0);
}`,
];
