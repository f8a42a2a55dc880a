// Fourteen numbers of a line with a point on it, in which rotations about z and rigid motions act linearly.
//
// For direction l and point p: l, p, p.p, p.l, m = p x l, h = (p.p) l - 2 (p.l) p. After two joint rotations each is
// trigonometric of degree 1 in both angles (Raghavan and Roth 1990), after a slide quadratic in its displacement. Internal
// linkage: see lanes.hpp.
#pragma once

namespace {

// Places of the numbers; the last is the 1 that translations multiply.
enum { at_l = 0, at_p = 3, at_pp = 6, at_pl = 7, at_m = 8, at_h = 11, at_one = 14, line_size = 15 };

// The six that rotations about z leave alone, and the four pairs that they turn.
constexpr int z_places[6] = {2, 5, 6, 7, 10, 13};
constexpr int pair_places[4] = {0, 3, 8, 11};

// The six that slides along z leave alone, and the eight that they change.
constexpr int still_places[6] = {0, 1, 2, 3, 4, 10};
constexpr int slid_places[8] = {5, 6, 7, 8, 9, 11, 12, 13};

// Generic turns of the angles 4 and 5, so that no ordinary pose has a half angle of 0 or 90 degrees; slides are shifted.
constexpr double turn_4 = 0.618, turn_5 = -1.118;
constexpr double turn_4_cosine = 0.8150388984525244, turn_4_sine = 0.5794062426392174;
constexpr double turn_5_cosine = 0.4374817745963293, turn_5_sine = -0.8992272776645771;

inline void cross_product(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

inline double dot_product(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// The z axis and origin of the frame K (3x4).
inline void line_of_frame(const double* K, double* v) {
  double l[3], p[3];
  for (int r = 0; r < 3; ++r) l[r] = K[4 * r + 2], p[r] = K[4 * r + 3];
  const double pp = dot_product(p, p), pl = dot_product(p, l);
  for (int r = 0; r < 3; ++r) v[at_l + r] = l[r], v[at_p + r] = p[r], v[at_h + r] = pp * l[r] - 2 * pl * p[r];
  v[at_pp] = pp, v[at_pl] = pl;
  cross_product(p, l, v + at_m);
  v[at_one] = 1;
}

// The numbers of the moved line, from numbers or coefficients of them: linear in v.
inline void move_line(const double* K, const double* v, double* out) {
  double Rl[3], Rp[3], Rm[3], Rh[3], tl[3], tm[3];
  const double t[3] = {K[3], K[7], K[11]};
  for (int r = 0; r < 3; ++r) {
    Rl[r] = dot_product(K + 4 * r, v + at_l), Rp[r] = dot_product(K + 4 * r, v + at_p);
    Rm[r] = dot_product(K + 4 * r, v + at_m), Rh[r] = dot_product(K + 4 * r, v + at_h);
  }
  const double tt = dot_product(t, t), tRl = dot_product(t, Rl);
  cross_product(t, Rl, tl), cross_product(t, Rm, tm);
  const double along = 2 * (v[at_pl] + tRl);
  for (int r = 0; r < 3; ++r) {
    out[at_l + r] = Rl[r];
    out[at_p + r] = Rp[r] + v[at_one] * t[r];
    out[at_m + r] = Rm[r] + tl[r];
    out[at_h + r] = Rh[r] - 2 * tm[r] + tt * Rl[r] - along * t[r];
  }
  out[at_pp] = v[at_pp] + 2 * dot_product(t, Rp) + v[at_one] * tt;
  out[at_pl] = v[at_pl] + tRl;
  out[at_one] = v[at_one];
}

// Rz(sign angle) on v as constant + cos(angle) with_cosine + sin(angle) with_sine.
inline void turn_line(const double* v, double sign, double* constant, double* with_cosine, double* with_sine) {
  for (int k = 0; k < line_size; ++k) constant[k] = v[k], with_cosine[k] = with_sine[k] = 0;
  for (int k : pair_places) {
    constant[k] = constant[k + 1] = 0;
    with_cosine[k] = v[k], with_cosine[k + 1] = v[k + 1];
    with_sine[k] = -sign * v[k + 1], with_sine[k + 1] = sign * v[k];
  }
}

// Tz(sign d) on v as constant + d linear + d^2 quadratic.
inline void slide_line(const double* v, double sign, double* constant, double* linear, double* quadratic) {
  for (int k = 0; k < line_size; ++k) constant[k] = v[k], linear[k] = quadratic[k] = 0;
  linear[at_p + 2] = sign * v[at_one];
  linear[at_pp] = 2 * sign * v[at_p + 2], quadratic[at_pp] = v[at_one];
  linear[at_pl] = sign * v[at_l + 2];
  linear[at_m] = -sign * v[at_l + 1], linear[at_m + 1] = sign * v[at_l];
  linear[at_h] = 2 * sign * v[at_m + 1], linear[at_h + 1] = -2 * sign * v[at_m];
  linear[at_h + 2] = -2 * sign * v[at_pl];
  quadratic[at_h] = v[at_l], quadratic[at_h + 1] = v[at_l + 1], quadratic[at_h + 2] = -v[at_l + 2];
}

}  // namespace
