// Null vectors of the reduced matrix at the candidate angles: one for a simple solution, two where solutions share the
// angle.
#pragma once

#include "simd/general_6r/trigonometric_roots.hpp"

namespace {

// Where the way back to the joints begins: cos t3, sin t3 and w = (s4 b, k4 b) with b = (s5^2, sqrt2 s5 k5, k5^2).
struct Starts {
  static constexpr std::size_t width = 8;
  alignas(64) double rows[(pieper::most_starts + 8) * width];
  unsigned char candidate[pieper::most_starts + 8];
  std::size_t count = 0;
  bool overflow = false;

  void add(double c, double s, const double* w, std::size_t from) {
    if (count == pieper::most_starts) {
      overflow = true;
      return;
    }
    double* row = rows + count * width;
    row[0] = c, row[1] = s;
    for (int i = 0; i < 6; ++i) row[2 + i] = w[i];
    candidate[count++] = static_cast<unsigned char>(from);
  }
};

constexpr double twin_ratio = 1e-4;   // second singular value to the largest: two solutions at one angle
constexpr double third_ratio = 1e-5;  // third singular value: more than two
constexpr double clean_ratio = 1e-6;  // first singular value at a simple root

PIEPER_INLINE Vec dot6(const Vec* a, const Vec* b) {
  Vec sum = a[0] * b[0];
  for (int i = 1; i < 6; ++i) sum += a[i] * b[i];
  return sum;
}

PIEPER_INLINE void project_out(const Vec* unit, Vec* x) {
  const Vec part = dot6(unit, x);
  for (int i = 0; i < 6; ++i) x[i] -= part * unit[i];
}

PIEPER_INLINE Vec normalise6(Vec* x) {
  const Vec norm = square_root(dot6(x, x) + 1e-300), inverse = 1.0 / norm;
  for (int i = 0; i < 6; ++i) x[i] *= inverse;
  return norm;
}

// Inverse iteration on R^T R without the singular vectors that are known: right ones w, left ones u.
struct InverseIteration {
  Vec R[6][6], inverse_diagonal[6];
  Vec w[3][6], u[3][6];
  Vec sigma[3];

  void find(int k) {
    constexpr double generic[3][6] = {{0.61, -0.43, 0.37, 0.52, -0.29, 0.33},
                                      {-0.31, 0.59, 0.47, -0.23, 0.41, 0.57},
                                      {0.53, 0.27, -0.49, 0.39, 0.63, -0.21}};
    Vec x[6], y[6];
    for (int i = 0; i < 6; ++i) x[i] = splat(generic[k][i]);
    for (int j = 0; j < k; ++j) project_out(w[j], x);
    normalise6(x);
    Vec growth = splat(1.0);
    for (int step = 0; step < 2; ++step) {
      for (int i = 0; i < 6; ++i) {
        y[i] = x[i];
        for (int j = 0; j < i; ++j) y[i] -= R[j][i] * y[j];
        y[i] *= inverse_diagonal[i];
      }
      for (int j = 0; j < k; ++j) project_out(u[j], y);
      growth = normalise6(y);
      for (int i = 5; i >= 0; --i) {
        x[i] = y[i];
        for (int j = i + 1; j < 6; ++j) x[i] -= R[i][j] * x[j];
        x[i] *= inverse_diagonal[i];
      }
      for (int j = 0; j < k; ++j) project_out(w[j], x);
      growth *= normalise6(x);
    }
    for (int i = 0; i < 6; ++i) w[k][i] = x[i], u[k][i] = y[i];
    sigma[k] = 1.0 / square_root(growth);
  }
};

// The vectors of a two-dimensional null space that have the form (s4 b, k4 b).
inline int split_null_space(const double* w1, const double* w2, double (*out)[6]) {
  // turned by a fixed angle, so that k4 is not zero by accident
  constexpr double turn_c = 0.8253356149096783, turn_s = 0.5646424733950354;
  double U[3][2], L[3][2];
  for (int i = 0; i < 3; ++i) {
    const double* w[2] = {w1, w2};
    for (int j = 0; j < 2; ++j) {
      U[i][j] = turn_c * w[j][i] + turn_s * w[j][3 + i];
      L[i][j] = -turn_s * w[j][i] + turn_c * w[j][3 + i];
    }
  }
  double g00 = 0, g01 = 0, g11 = 0, h[2][2] = {};
  for (int i = 0; i < 3; ++i) {
    g00 += L[i][0] * L[i][0], g01 += L[i][0] * L[i][1], g11 += L[i][1] * L[i][1];
    for (int a = 0; a < 2; ++a)
      for (int b = 0; b < 2; ++b) h[a][b] += L[i][a] * U[i][b];
  }
  const double det = g00 * g11 - g01 * g01 + 1e-300;
  double E[2][2];
  for (int b = 0; b < 2; ++b) {
    E[0][b] = (g11 * h[0][b] - g01 * h[1][b]) / det;
    E[1][b] = (g00 * h[1][b] - g01 * h[0][b]) / det;
  }
  const double mean = 0.5 * (E[0][0] + E[1][1]), half = 0.5 * (E[0][0] - E[1][1]);
  const double off = std::fabs(half) + std::fabs(E[0][1]) + std::fabs(E[1][0]);
  double x4[2], z[2][2];
  if (off < 1e-3 * (1 + std::fabs(mean))) {
    // joint 4 is common (spherical wrists): b1^2 = 2 b0 b2 on the span
    double b[3][2];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 2; ++j) b[i][j] = L[i][j] + mean * U[i][j];
    const double qa = b[1][0] * b[1][0] - 2 * b[0][0] * b[2][0];
    const double qb = b[1][0] * b[1][1] - b[0][0] * b[2][1] - b[0][1] * b[2][0];
    const double qc = b[1][1] * b[1][1] - 2 * b[0][1] * b[2][1];
    const double inside = qb * qb - qa * qc, root = std::sqrt(inside > 0 ? inside : 0);
    // z0^2 qa + 2 z0 z1 qb + z1^2 qc = 0
    const double far = qb >= 0 ? -(qb + root) : -(qb - root);
    z[0][0] = far, z[0][1] = qa, z[1][0] = qc, z[1][1] = far;
    x4[0] = x4[1] = mean;
    if (!(std::fabs(far) + std::fabs(qa) > 0)) z[0][0] = 1, z[0][1] = 0;
    if (!(std::fabs(far) + std::fabs(qc) > 0)) z[1][0] = 0, z[1][1] = 1;
  } else {
    const double inside = half * half + E[0][1] * E[1][0], root = std::sqrt(inside > 0 ? inside : 0);
    for (int k = 0; k < 2; ++k) {
      const double d = k == 0 ? root : -root;
      x4[k] = mean + d;
      // (E - x4) z = 0, from the larger row
      const double r0[2] = {half - d, E[0][1]}, r1[2] = {E[1][0], -half - d};
      const bool first = std::fabs(r0[0]) + std::fabs(r0[1]) > std::fabs(r1[0]) + std::fabs(r1[1]);
      const double* r = first ? r0 : r1;
      z[k][0] = -r[1], z[k][1] = r[0];
    }
  }
  for (int k = 0; k < 2; ++k) {
    double b[3], norm = 1e-300;
    for (int i = 0; i < 3; ++i) {
      b[i] = (L[i][0] + x4[k] * U[i][0]) * z[k][0] + (L[i][1] + x4[k] * U[i][1]) * z[k][1];
      norm += b[i] * b[i];
    }
    // s' / k' = x4 in the turned frame; turned back
    const double size = 1 / std::sqrt((1 + x4[k] * x4[k]) * norm);
    const double s = (turn_c * x4[k] - turn_s) * size, c = (turn_s * x4[k] + turn_c) * size;
    for (int i = 0; i < 3; ++i) out[k][i] = s * b[i], out[k][3 + i] = c * b[i];
  }
  return 2;
}

// Starts for every candidate; returns the flags.
inline unsigned find_null_vectors(const Equations& equations, const Candidate* candidates, std::size_t count,
                                  Starts& starts) {
  unsigned flags = 0;
  for (std::size_t first = 0; first < count; first += lanes) {
    const std::size_t some = count - first < lanes ? count - first : lanes;
    Vec angle = splat(0.0), s, c;
    for (std::size_t l = 0; l < lanes; ++l) lane(angle, l) = candidates[first + (l < some ? l : 0)].angle;
    sincos_reduced(angle, s, c);
    InverseIteration iteration;
    reduced_matrix(equations.S, c, s, iteration.R);
    Vec largest = splat(1e-300);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) largest += iteration.R[i][j] * iteration.R[i][j];
    largest = square_root(largest);
    Vec diagonal[6];
    triangularise<true>(iteration.R, diagonal);
    for (int i = 0; i < 6; ++i) {
      const Vec least = 1e-18 * largest;
      const Vec d = select(magnitude(diagonal[i]) < least, with_sign(least, diagonal[i]), diagonal[i]);
      iteration.inverse_diagonal[i] = 1.0 / d;
    }
    iteration.find(0);
    iteration.find(1);
    const IntVec valid = first_lanes(some);
    if (any(valid & (iteration.sigma[1] < third_ratio * largest))) {
      iteration.find(2);
      if (any(valid & (iteration.sigma[2] < third_ratio * largest))) flags |= pieper::flag_third;
    }
    for (std::size_t l = 0; l < some; ++l) {
      const Candidate& candidate = candidates[first + l];
      const double s1 = lane(iteration.sigma[0], l), s2 = lane(iteration.sigma[1], l), top = lane(largest, l);
      if (candidate.simple && !candidate.resampled && s1 > clean_ratio * top) flags |= pieper::flag_unclean;
      double w[2][6];
      for (int i = 0; i < 6; ++i) w[0][i] = lane(iteration.w[0][i], l), w[1][i] = lane(iteration.w[1][i], l);
      const double cl = lane(c, l), sl = lane(s, l);
      if (s2 < twin_ratio * top) {
        flags |= pieper::flag_twins;
        double split[2][6];
        split_null_space(w[0], w[1], split);
        starts.add(cl, sl, split[0], first + l), starts.add(cl, sl, split[1], first + l);
        if (s2 < 1e-9 * top || s1 > 0.01 * s2) continue;
      }
      starts.add(cl, sl, w[0], first + l);
    }
  }
  if (starts.overflow) flags |= pieper::flag_overflow;
  return flags;
}

}  // namespace
