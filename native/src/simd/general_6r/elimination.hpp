// Eliminates the joints 1, 2 and 6 of a loop for one target: six equations S(t3) in the half angles of joints 4 and 5.
//
// The loop Rz1 K1 Rz2 K2 Rz3 K3 Rz4 K4 Rz5 K5 Rz6 K6 = 1, applied to the z axis of the last frame (which Rz6 keeps):
//   K2 Rz3 v(t4, t5) = Rz(-t2) K1^-1 Rz(-t1) K6^-1 (z axis).
// On the right the six z numbers are z0 + A0 cos t1 + A1 sin t1, and the four pairs, as complex numbers,
// e^{-i t2} (al + be cos t1 + ga sin t1). Four real rows annihilate A0 and A1, one complex row annihilates al, be, ga.
// A slide in place of joint 1 puts (d1, d1^2) in place of (cos t1, sin t1). A slide in place of joint 2 leaves six other
// numbers alone, with four rows again; two rows annihilate d2 and d2^2 in the eight that it changes.
#pragma once

#include <cmath>

#include "pieper/general_6r.hpp"
#include "simd/general_6r/lane_math.hpp"
#include "simd/general_6r/left_line.hpp"

namespace {

// The equations of one target and what is kept for the way back.
struct Equations {
  alignas(64) double S[3][9][8];  // constant, cos t3, sin t3; column; row (six, padded)
  double K1_inverse[12], K2[12], K6_inverse[12];
  double z0[6], pseudo_inverse[2][6];  // of the numbers that joint 2 leaves alone
  double pairs[3][4][2];               // al, be, ga
  double before_slide[3];              // where joint 2 slides: p_z before it, on (1, cos t1, sin t1)
};

inline void invert_motion(const double* K, double* out) {
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out[4 * r + c] = K[4 * c + r];
    out[4 * r + 3] = -(K[r] * K[3] + K[4 + r] * K[7] + K[8 + r] * K[11]);
  }
}

inline void copy_motion(const double* K, double* out) {
  for (int k = 0; k < 12; ++k) out[k] = K[k];
}

// The reflection I - factor v v^T that takes x (from place `first` on) to a multiple of a unit vector; returns that.
inline double reflector(const double* x, int first, double* v, double& factor) {
  double square = 1e-300;
  for (int i = 0; i < 6; ++i) v[i] = i < first ? 0 : x[i], square += v[i] * v[i];
  const double alpha = x[first] < 0 ? std::sqrt(square) : -std::sqrt(square);
  v[first] -= alpha;
  factor = -1 / (alpha * v[first]);
  return alpha;
}

inline double dot_six(const double* a, const double* b) {
  double sum = 0;
  for (int i = 0; i < 6; ++i) sum += a[i] * b[i];
  return sum;
}

// The two rows on the fourteen numbers for a slide in place of joint 2; `f` are the numbers before the slide: constant and
// with cos t1 and sin t1.
inline void rows_past_slide(const double (*f)[line_size], const double (*pseudo_inverse)[6], double (*out)[line_size]) {
  // what d2 and d2^2 are multiplied by in the eight numbers, constant and with cos t1 and sin t1
  double columns[6][8], reflections[6][8], factors[6];
  for (int j = 0; j < 3; ++j) {
    double same[line_size], linear[line_size], quadratic[line_size];
    slide_line(f[j], -1, same, linear, quadratic);
    for (int k = 0; k < 8; ++k)
      columns[2 * j][k] = linear[slid_places[k]], columns[2 * j + 1][k] = quadratic[slid_places[k]];
  }
  for (int j = 0; j < 6; ++j) {
    double* v = reflections[j];
    double square = 1e-300;
    for (int i = 0; i < 8; ++i) v[i] = i < j ? 0 : columns[j][i], square += v[i] * v[i];
    const double alpha = v[j] < 0 ? std::sqrt(square) : -std::sqrt(square);
    v[j] -= alpha;
    factors[j] = -1 / (alpha * v[j]);
    for (int k = j + 1; k < 6; ++k) {
      double part = 0;
      for (int i = j; i < 8; ++i) part += v[i] * columns[k][i];
      part *= factors[j];
      for (int i = j; i < 8; ++i) columns[k][i] -= part * v[i];
    }
  }
  for (int r = 0; r < 2; ++r) {
    double row[8] = {};
    row[6 + r] = 1;
    for (int j = 5; j >= 0; --j) {
      double part = 0;
      for (int i = j; i < 8; ++i) part += reflections[j][i] * row[i];
      part *= factors[j];
      for (int i = j; i < 8; ++i) row[i] -= part * reflections[j][i];
    }
    // what is left of cos t1 and sin t1 goes against the numbers that joint 2 leaves alone
    double with[3] = {0, 0, 0}, square = 1;
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 8; ++k) with[j] += row[k] * f[j][slid_places[k]];
    double still[6];
    for (int k = 0; k < 6; ++k) {
      still[k] = -(with[1] * pseudo_inverse[0][k] + with[2] * pseudo_inverse[1][k]);
      with[0] += still[k] * f[0][still_places[k]], square += still[k] * still[k];
    }
    const double scale = 1 / std::sqrt(square);
    for (int k = 0; k < 8; ++k) out[r][slid_places[k]] = scale * row[k];
    for (int k = 0; k < 6; ++k) out[r][still_places[k]] = scale * still[k];
    out[r][at_one] = -scale * with[0];
  }
}

// `G` is the pose that the arm has to take in its own frames (3x4).
inline void eliminate_outer_joints(const LoopForm& form, const double* G, Equations& out) {
  copy_motion(form.K1_inverse, out.K1_inverse), copy_motion(form.K2, out.K2),
      copy_motion(form.K6_inverse, out.K6_inverse);
  double G_inverse[12];
  invert_motion(G, G_inverse);
  // forwards the loop ends with X = G^-1, backwards with its inverse
  const double *X = form.reversed ? G : G_inverse, *X_inverse = form.reversed ? G_inverse : G;
  if (form.target_in == 1) copy_motion(X_inverse, out.K1_inverse);
  if (form.target_in == 2) copy_motion(X, out.K2);
  if (form.target_in == 6) copy_motion(X_inverse, out.K6_inverse);

  double line[line_size], turned[3][line_size], f[3][line_size];
  line_of_frame(out.K6_inverse, line);
  (form.slide == 1 ? slide_line : turn_line)(line, -1, turned[0], turned[1], turned[2]);
  for (int k = 0; k < 3; ++k) move_line(out.K1_inverse, turned[k], f[k]);

  double A[2][6];
  const int* alone = form.slide == 2 ? still_places : z_places;
  for (int k = 0; k < 6; ++k) out.z0[k] = f[0][alone[k]], A[0][k] = f[1][alone[k]], A[1][k] = f[2][alone[k]];
  for (int j = 0; j < 3; ++j)
    for (int k = 0; k < 4; ++k)
      out.pairs[j][k][0] = f[j][pair_places[k]], out.pairs[j][k][1] = f[j][pair_places[k] + 1];

  // QR of [A0 A1]: rows of Q^T are rows of reflection 2 times reflection 1
  double v1[6], v2[6], factor1, factor2;
  const double r00 = reflector(A[0], 0, v1, factor1);
  const double along = factor1 * dot_six(v1, A[1]);
  for (int i = 0; i < 6; ++i) A[1][i] -= along * v1[i];
  const double r01 = A[1][0], r11 = reflector(A[1], 1, v2, factor2);
  double rows[6][6];
  for (int r = 0; r < 6; ++r) {
    for (int i = 0; i < 6; ++i) rows[r][i] = (r == i ? 1.0 : 0.0) - factor2 * v2[r] * v2[i];
    const double part = factor1 * dot_six(rows[r], v1);
    for (int i = 0; i < 6; ++i) rows[r][i] -= part * v1[i];
  }
  for (int i = 0; i < 6; ++i) {
    out.pseudo_inverse[1][i] = rows[1][i] / r11;
    out.pseudo_inverse[0][i] = (rows[0][i] - r01 * out.pseudo_inverse[1][i]) / r00;
  }

  // the six rows on the numbers of the line, one per lane, and their constant terms
  alignas(64) double n[line_size][8] = {};
  for (int r = 0; r < 4; ++r) {
    for (int k = 0; k < 6; ++k) n[alone[k]][r] = rows[r + 2][k];
    n[at_one][r] = -dot_six(rows[r + 2], out.z0);
  }
  if (form.slide == 2) {
    double two[2][line_size];
    rows_past_slide(f, out.pseudo_inverse, two);
    for (int r = 0; r < 2; ++r)
      for (int k = 0; k < line_size; ++k) n[k][4 + r] = two[r][k];
    for (int j = 0; j < 3; ++j) out.before_slide[j] = f[j][at_p + 2];
  } else {
    // the complex row: cofactors of the 4x3 matrix (al be ga)
    double nu[4][2];
    const auto &al = out.pairs[0], &be = out.pairs[1], &ga = out.pairs[2];
    double w[4][4][2];  // minors of be and ga
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) {
        w[i][j][0] = be[i][0] * ga[j][0] - be[i][1] * ga[j][1] - be[j][0] * ga[i][0] + be[j][1] * ga[i][1];
        w[i][j][1] = be[i][0] * ga[j][1] + be[i][1] * ga[j][0] - be[j][0] * ga[i][1] - be[j][1] * ga[i][0];
      }
    double square = 1e-300;
    for (int n = 0; n < 4; ++n) {
      const int i = n == 0 ? 1 : 0, j = n <= 1 ? 2 : 1, k = n == 3 ? 2 : 3;
      const double *a = al[i], *b = al[j], *c = al[k], *wa = w[j][k], *wb = w[i][k], *wc = w[i][j];
      const double re = a[0] * wa[0] - a[1] * wa[1] - b[0] * wb[0] + b[1] * wb[1] + c[0] * wc[0] - c[1] * wc[1];
      const double im = a[0] * wa[1] + a[1] * wa[0] - b[0] * wb[1] - b[1] * wb[0] + c[0] * wc[1] + c[1] * wc[0];
      nu[n][0] = n % 2 ? -re : re, nu[n][1] = n % 2 ? -im : im;
      square += re * re + im * im;
    }
    const double norm = 1 / std::sqrt(square);
    for (auto& number : nu) number[0] *= norm, number[1] *= norm;
    for (int k = 0; k < 4; ++k) {
      n[pair_places[k]][4] = nu[k][0], n[pair_places[k] + 1][4] = -nu[k][1];
      n[pair_places[k]][5] = nu[k][1], n[pair_places[k] + 1][5] = nu[k][0];
    }
  }

  for (std::size_t first = 0; first < 6; first += lanes) {
    Vec in[line_size], back[line_size];
    for (int k = 0; k < line_size; ++k) in[k] = load(n[k] + first);
    // pulled back through K2, the transpose of move_line
    const double* K = out.K2;
    const double t[3] = {K[3], K[7], K[11]};
    const double tt = dot_product(t, t);
    const auto with_t = [&](const Vec* a) { return a[0] * t[0] + a[1] * t[1] + a[2] * t[2]; };
    const auto cross_t = [&](const Vec* a, Vec* c) {
      c[0] = a[1] * t[2] - a[2] * t[1], c[1] = a[2] * t[0] - a[0] * t[2], c[2] = a[0] * t[1] - a[1] * t[0];
    };
    Vec mt[3], ht[3], l[3], p[3], m[3];
    cross_t(in + at_m, mt), cross_t(in + at_h, ht);
    const Vec h_along = with_t(in + at_h);
    for (int r = 0; r < 3; ++r) {
      l[r] = in[at_l + r] + (in[at_pl] - 2.0 * h_along) * t[r] + mt[r] + tt * in[at_h + r];
      p[r] = in[at_p + r] + 2.0 * in[at_pp] * t[r];
      m[r] = in[at_m + r] - 2.0 * ht[r];
    }
    const auto turned_back = [&](const Vec* a, Vec* b) {
      for (int c = 0; c < 3; ++c) b[c] = K[c] * a[0] + K[4 + c] * a[1] + K[8 + c] * a[2];
    };
    turned_back(l, back + at_l), turned_back(p, back + at_p), turned_back(m, back + at_m);
    turned_back(in + at_h, back + at_h);
    back[at_pp] = in[at_pp], back[at_pl] = in[at_pl] - 2.0 * h_along;
    back[at_one] = in[at_one] + with_t(in + at_p) + tt * in[at_pp];

    for (int c = 0; c < 9; ++c) {
      Vec constant = form.one[c] * back[at_one];
      for (int k : z_places) constant += back[k] * form.left[k][c];
      Vec cosine = splat(0.0), sine = splat(0.0);
      for (int k : pair_places) {
        cosine += back[k] * form.left[k][c] + back[k + 1] * form.left[k + 1][c];
        sine += back[k + 1] * form.left[k][c] - back[k] * form.left[k + 1][c];
      }
      store(out.S[0][c] + first, constant), store(out.S[1][c] + first, cosine), store(out.S[2][c] + first, sine);
    }
  }
}

}  // namespace
