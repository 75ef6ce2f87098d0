// The shaders: projection of Gaussians by the rasterizer's own formulas, their quads, and what is laid over the background.

const HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D; precision highp usampler2D;
`;

/** Modes of drawing, as the shaders number them. */
export const MODES = { color: 0, depth: 1, count: 2, centers: 3, alike: 4, coverage: 5 };

const PROJECT = `
uniform sampler2D splats; uniform usampler2D harmonics, flags;
uniform int degree, harmonicTexels, wide, mode;
uniform mat3 A; uniform vec3 t, eye; uniform vec4 K; uniform vec2 size;
uniform vec2 range; uniform bool antialiased;
const float BLUR = 0.3;

ivec2 at(int k) { return ivec2(k % wide, k / wide); }

// Three coefficients as one color; numbers lie as halfs, two to a word.
vec3 coefficient(int base, int k) {
  float c[3];
  for (int j = 0; j < 3; j++) {
    int o = 3 * k + j;
    uint word = texelFetch(harmonics, at(base + o / 8), 0)[(o % 8) / 2];
    vec2 pair = unpackHalf2x16(word);
    c[j] = (o & 1) == 0 ? pair.x : pair.y;
  }
  return vec3(c[0], c[1], c[2]);
}

vec3 radiance(int i, vec3 d) {
  int base = i * harmonicTexels;
  vec3 sum = 0.28209479177387814 * coefficient(base, 0);
  if (degree >= 1) {
    float x = d.x, y = d.y, z = d.z;
    sum += 0.4886025119029199 * (z * coefficient(base, 2) - y * coefficient(base, 1) - x * coefficient(base, 3));
    if (degree >= 2) {
      float xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
      sum += 1.0925484305920792 * (xy * coefficient(base, 4) - yz * coefficient(base, 5) - xz * coefficient(base, 7));
      sum += 0.31539156525252005 * (zz + zz - xx - yy) * coefficient(base, 6) + 0.5462742152960396 * (xx - yy) * coefficient(base, 8);
      if (degree >= 3) {
        float four = 4.0 * zz - xx - yy;
        sum += -0.5900435899266435 * (y * (3.0 * xx - yy) * coefficient(base, 9) + x * (xx - 3.0 * yy) * coefficient(base, 15));
        sum += -0.4570457994644658 * four * (y * coefficient(base, 11) + x * coefficient(base, 13));
        sum += 2.890611442640554 * xy * z * coefficient(base, 10) + 1.445305721320277 * z * (xx - yy) * coefficient(base, 14);
        sum += 0.3731763325901154 * z * (2.0 * zz - 3.0 * (xx + yy)) * coefficient(base, 12);
        if (degree >= 4) {
          float seven = 7.0 * zz;
          sum += 2.5033429417967046 * xy * (xx - yy) * coefficient(base, 16);
          sum += -1.7701307697799304 * (yz * (3.0 * xx - yy) * coefficient(base, 17) + xz * (xx - 3.0 * yy) * coefficient(base, 23));
          sum += 0.9461746957575601 * xy * (seven - 1.0) * coefficient(base, 18);
          sum += -0.6690465435572892 * (seven - 3.0) * (yz * coefficient(base, 19) + xz * coefficient(base, 21));
          sum += 0.10578554691520431 * (zz * (35.0 * zz - 30.0) + 3.0) * coefficient(base, 20);
          sum += 0.47308734787878004 * (xx - yy) * (seven - 1.0) * coefficient(base, 22);
          sum += 0.6258357354491761 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)) * coefficient(base, 24);
        }
      }
    }
  }
  return max(sum + 0.5, 0.0);
}

// Center, covariance (xx, xy, yy) and its determinant, color and opacity of Gaussian i in the image; false where it is not drawn.
bool project(int i, out vec2 center, out vec4 cov, out vec4 color) {
  uint flag = texelFetch(flags, at(i), 0).x;
  if ((flag & 6u) != 0u) return false;
  vec4 mean = texelFetch(splats, at(3 * i), 0), q = texelFetch(splats, at(3 * i + 1), 0);
  vec3 scale = texelFetch(splats, at(3 * i + 2), 0).xyz;
  vec3 p = A * mean.xyz + t;
  if (!(p.z >= range.x && p.z <= range.y)) return false;
  vec2 ray = p.xy / p.z;
  center = K.xy * ray + K.zw;
  // Beyond the frustum, widened by 30 % of half its size, the Jacobian is that at its border.
  vec2 bent = clamp(ray, -(K.zw + 0.15 * size) / K.xy, (size - K.zw + 0.15 * size) / K.xy);
  float w = q.x, x = q.y, y = q.z, z = q.w;
  mat3 R = mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
                2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
                2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
  mat3 rows = transpose(A);
  vec2 k = K.xy / p.z;
  vec3 m1 = (k.x * (rows[0] - bent.x * rows[2])) * R * scale;
  vec3 m2 = (k.y * (rows[1] - bent.y * rows[2])) * R * scale;
  float n1 = dot(m1, m1), n2 = dot(m2, m2);
  vec3 normal = cross(m1, m2);
  float sharp = dot(normal, normal), blurred = sharp + BLUR * (n1 + n2) + BLUR * BLUR;
  if (!(blurred > 0.0)) return false;
  float opacity = mean.w;
  if (antialiased) opacity *= sqrt(max(sharp / blurred, 0.005 * 0.005));
  if (!(opacity >= 1.0 / 255.0)) return false;
  // The determinant from a cross product: as a difference it would lose its digits where a Gaussian is thin.
  cov = vec4(n1 + BLUR, dot(m1, m2), n2 + BLUR, blurred);
  vec3 rgb = mode == 1 ? vec3(p.z) : mode == 4 ? vec3(float(flag >> 8) / 255.0) : radiance(i, normalize(mean.xyz - eye));
  if (mode == 3) { cov = vec4(0.6, 0.0, 0.6, 0.36); opacity = 1.0; }
  if ((flag & 1u) != 0u && mode != 1 && mode != 4) rgb = mix(rgb, vec3(1.0, 0.45, 0.0), 0.7);
  color = vec4(rgb, opacity);
  return true;
}
`;

// A quad along the axes of the outline at which alpha is 1/255.
const QUAD = `
  float reach = 2.0 * log(255.0 * color.w), middle = 0.5 * (cov.x + cov.z);
  float apart = length(vec2(0.5 * (cov.x - cov.z), cov.y)), large = middle + apart, small = cov.w / large;
  vec2 along = abs(cov.y) > 1e-12 * middle ? normalize(vec2(cov.y, large - cov.x)) : (cov.x >= cov.z ? vec2(1, 0) : vec2(0, 1));
  offset = corner.x * sqrt(reach * large) * along + corner.y * sqrt(reach * small) * vec2(-along.y, along.x);
  factor = vec3(sqrt(cov.z / cov.w), -cov.y / sqrt(cov.z * cov.w), inversesqrt(cov.z));
  vec2 place = (center + offset) / size * 2.0 - 1.0;
  gl_Position = vec4(place.x, -place.y, 0, 1);
`;

/** Quads of a batch. */
export const BATCH = 128;

const quads = (fetch, uniforms) => `${HEAD}${uniforms}
uniform highp usampler2D order; uniform int total, orderWide;
flat out vec4 color; flat out vec3 factor; out vec2 offset;
void main() {
  int k = gl_InstanceID * ${BATCH} + gl_VertexID / 4, c = gl_VertexID % 4;
  vec2 corner = vec2((c & 1) == 0 ? -1.0 : 1.0, c < 2 ? -1.0 : 1.0);
  gl_Position = vec4(0, 0, 2, 1); offset = vec2(0); factor = vec3(0); color = vec4(0);
  if (k >= total) return;
  int i = int(texelFetch(order, ivec2(k % orderWide, k / orderWide), 0).x);
  vec2 center; vec4 cov;
  ${fetch}
  ${QUAD}
}`;

const FULL = `${HEAD}in vec2 corner; void main() { gl_Position = vec4(corner, 0, 1); }`;

/** Projects a Gaussian in each fragment, into three textures. */
export const projection = [FULL, `${HEAD}${PROJECT}
uniform int count;
layout(location = 0) out vec4 center_; layout(location = 1) out vec4 cov_; layout(location = 2) out vec4 color_;
void main() {
  int i = int(gl_FragCoord.y) * wide + int(gl_FragCoord.x);
  center_ = cov_ = color_ = vec4(0);
  vec2 center; vec4 cov, color;
  if (i >= count || !project(i, center, cov, color)) return;
  center_ = vec4(center, 0, 0); cov_ = cov; color_ = color;
}`];

const BLEND = `${HEAD}
flat in vec4 color; flat in vec3 factor; in vec2 offset; uniform float alphaMax; uniform int mode; out vec4 blended;
void main() {
  float u = factor.x * offset.x + factor.y * offset.y, v = factor.z * offset.y;
  float alpha = min(alphaMax, color.w * exp(-0.5 * (u * u + v * v)));
  if (alpha < 1.0 / 255.0) discard;
  blended = mode == 2 ? vec4(1) : vec4(color.rgb * alpha, alpha);
}`;

/** Quads of Gaussians that were projected. */
export const splatting = [quads(
  "ivec2 at = ivec2(i % wide, i / wide); color = texelFetch(colors, at, 0); if (color.w == 0.0) return; center = texelFetch(centers, at, 0).xy; cov = texelFetch(covs, at, 0);",
  "uniform sampler2D centers, covs, colors; uniform int wide; uniform vec2 size;",
), BLEND];

/** Quads that project their Gaussian themselves, for devices without textures of floats to draw into. */
export const splattingAtOnce = [quads("if (!project(i, center, cov, color)) { color = vec4(0); return; }", PROJECT), BLEND];

/** Lays the picture over the background; depth and counts become false colors. */
export const over = [FULL, `${HEAD}
uniform sampler2D picture; uniform vec3 background; uniform int mode; uniform vec2 depths; uniform float exposure; out vec4 shown;
vec3 falseColor(float x) {
  vec3 stops[5] = vec3[5](vec3(0.267, 0.005, 0.329), vec3(0.229, 0.322, 0.546), vec3(0.128, 0.567, 0.551), vec3(0.369, 0.789, 0.383), vec3(0.993, 0.906, 0.144));
  float place = clamp(x, 0.0, 1.0) * 4.0; int i = min(int(place), 3);
  return mix(stops[i], stops[i + 1], place - float(i));
}
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
void main() {
  vec4 c = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
  vec3 rgb = c.rgb + (1.0 - c.a) * background;
  if (mode == 1) rgb = c.a < 0.05 ? background : mix(background, falseColor(1.0 - (c.r / c.a - depths.x) / (depths.y - depths.x)), min(1.0, 2.0 * c.a));
  if (mode == 4) rgb = c.a < 0.05 ? background : mix(background, falseColor(c.r / c.a), min(1.0, 2.0 * c.a));
  if (mode == 2) rgb = falseColor(log2(1.0 + c.r) / 9.0);
  if (mode == 5) rgb = falseColor(c.a);
  if (mode == 0 && exposure != 0.0) rgb = encoded(clamp(linear(clamp(rgb, 0.0, 1.0)) * exp2(exposure), 0.0, 1.0));
  shown = vec4(clamp(rgb, 0.0, 1.0), 1);
}`];
