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

constexpr double twin_ratio = 1e-4;       // second singular value to the largest: two solutions at one angle
constexpr double exact_ratio = 1e-8;      // second singular value: exactly two
constexpr double third_ratio = 1e-5;      // third singular value: more than two
constexpr double same_direction = 1e-10;  // squared sine: both null vectors have the same b
constexpr double clean_ratio =
    1e-6;  // first singular value at a simple root, and how fast it may grow beside one [1/rad]
constexpr double clean_growth = 30;

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

// Two solutions that differ in joint 4 alone among the two: every (s4 b, k4 b) is a null vector of the reduced matrix.
// But (A b) s4^2 + (B b) s4 k4 + (C b) k4^2 = 0, six equations of which one is left.
inline void split_by_joint_4(const double (*S)[9][8], double c, double s, const double* b, double (*out)[6]) {
  double best[3] = {0, 0, 0}, most = -1;
  for (int r = 0; r < 6; ++r) {
    double row[3] = {0, 0, 0};
    for (int a = 0; a < 3; ++a)
      for (int i = 0; i < 3; ++i) {
        const int k = 3 * a + i;
        row[a] += (S[0][k][r] + c * S[1][k][r] + s * S[2][k][r]) * b[i];
      }
    const double size = row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
    if (size <= most) continue;
    most = size;
    for (int a = 0; a < 3; ++a) best[a] = row[a];
  }
  const double inside = best[1] * best[1] - 4 * best[0] * best[2], root = std::sqrt(inside > 0 ? inside : 0);
  const double far = best[1] >= 0 ? -0.5 * (best[1] + root) : -0.5 * (best[1] - root);
  double pairs[2][2] = {{far, best[0]}, {best[2], far}};  // s4, k4
  for (int k = 0; k < 2; ++k) {
    const double norm = std::sqrt(pairs[k][0] * pairs[k][0] + pairs[k][1] * pairs[k][1]);
    const double sine = norm > 0 ? pairs[k][0] / norm : k, cosine = norm > 0 ? pairs[k][1] / norm : 1 - k;
    for (int i = 0; i < 3; ++i) out[k][i] = sine * b[i], out[k][3 + i] = cosine * b[i];
  }
}

// The vectors of a two-dimensional null space that have the form (s4 b, k4 b).
inline void split_null_space(const double (*S)[9][8], double c, double s, const double* w1, const double* w2,
                             double (*out)[6]) {
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
  if (det < same_direction * (g00 + g11) * (g00 + g11)) {
    const int larger_one = g11 > g00;
    double b[3];
    for (int i = 0; i < 3; ++i) b[i] = L[i][larger_one];
    return split_by_joint_4(S, c, s, b, out);
  }
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
    const double sine = (turn_c * x4[k] - turn_s) * size, cosine = (turn_s * x4[k] + turn_c) * size;
    for (int i = 0; i < 3; ++i) out[k][i] = sine * b[i], out[k][3 + i] = cosine * b[i];
  }
}

// Where s4 or k4 is zero (and next to it) the middle blocks of the dialytic vector vanish, and the reduced matrix does not
// know the solution: then A b = 0 or C b = 0. Puts (s4 b, k4 b) for one of them; false when that block has no null vector.
inline bool at_end_of_half_angle(const double (*S)[9][8], double c, double s, bool k4_is_zero, double* w) {
  constexpr double null = 1e-10;  // squared singular value, to the sum of all
  const int first = k4_is_zero ? 0 : 6;
  double block[6][3], N[3][3] = {};
  for (int i = 0; i < 3; ++i)
    for (int r = 0; r < 6; ++r) block[r][i] = S[0][first + i][r] + c * S[1][first + i][r] + s * S[2][first + i][r];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int r = 0; r < 6; ++r) N[i][j] += block[r][i] * block[r][j];
  const double total = N[0][0] + N[1][1] + N[2][2] + 1e-300;
  // the largest column of the adjugate is along the null vector
  double b[3] = {0, 0, 0}, most = 0;
  for (int i = 0; i < 3; ++i) {
    const double *p = N[(i + 1) % 3], *q = N[(i + 2) % 3];
    const double column[3] = {p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]};
    const double square = column[0] * column[0] + column[1] * column[1] + column[2] * column[2];
    if (square <= most) continue;
    most = square;
    for (int k = 0; k < 3; ++k) b[k] = column[k];
  }
  if (!(most > 0)) return false;
  double left = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) left += b[i] * N[i][j] * b[j];
  for (int i = 0; i < 3; ++i) w[k4_is_zero ? i : 3 + i] = b[i] / std::sqrt(most), w[k4_is_zero ? 3 + i : i] = 0;
  return left < null * total * most;
}

// What the null spaces tell about the candidates.
struct Shared {
  // A third null vector: three or more solutions have the same angle, and two vectors cannot be told from three.
  bool third[RootFinder::most_candidates] = {};
  double third_size[RootFinder::most_candidates];  // singular value, to the largest
  // The candidate that stands for this one.
  unsigned char same_as[RootFinder::most_candidates];
};

// Null vectors of some candidates (by their numbers), and starts for them; `exact` marks those with two that
// are as good as exact.
inline unsigned find_some_null_vectors(const Equations& equations, const Candidate* candidates,
                                       const unsigned char* numbers, std::size_t count, Starts& starts, Shared& shared,
                                       bool* exact) {
  unsigned flags = 0;
  for (std::size_t first = 0; first < count; first += lanes) {
    const std::size_t some = count - first < lanes ? count - first : lanes;
    Vec angle = splat(0.0), s, c;
    for (std::size_t l = 0; l < lanes; ++l) lane(angle, l) = candidates[numbers[first + (l < some ? l : 0)]].angle;
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
      const unsigned third = lane_bits(valid & (iteration.sigma[2] < third_ratio * largest));
      for (std::size_t l = 0; l < some; ++l) {
        shared.third[numbers[first + l]] = third >> l & 1;
        shared.third_size[numbers[first + l]] = lane(iteration.sigma[2], l) / lane(largest, l);
      }
    }
    for (std::size_t l = 0; l < some; ++l) {
      const std::size_t number = numbers[first + l];
      const Candidate& candidate = candidates[number];
      const double s1 = lane(iteration.sigma[0], l), s2 = lane(iteration.sigma[1], l), top = lane(largest, l);
      if (candidate.simple && !candidate.resampled && s1 > (clean_ratio + clean_growth * candidate.error) * top) {
        bool explained = false;
        for (bool k4_is_zero : {true, false}) {
          double at_end[6];
          if (!at_end_of_half_angle(equations.S, lane(c, l), lane(s, l), k4_is_zero, at_end)) continue;
          explained = true;
          starts.add(lane(c, l), lane(s, l), at_end, number);
        }
        if (!explained) flags |= pieper::flag_unclean;
      }
      double w[2][6];
      for (int i = 0; i < 6; ++i) w[0][i] = lane(iteration.w[0][i], l), w[1][i] = lane(iteration.w[1][i], l);
      const double cl = lane(c, l), sl = lane(s, l);
      exact[number] = s2 < exact_ratio * top;
      if (s2 < twin_ratio * top) {
        flags |= pieper::flag_twins | (exact[number] ? 0u : unsigned{pieper::flag_near_twins});
        double split[2][6];
        split_null_space(equations.S, cl, sl, w[0], w[1], split);
        starts.add(cl, sl, split[0], number), starts.add(cl, sl, split[1], number);
        if (s2 < 1e-9 * top || s1 > 0.01 * s2) continue;
      }
      starts.add(cl, sl, w[0], number);
    }
  }
  return flags;
}

// Starts for every candidate; returns the flags. Double candidates go first: simple ones right beside one that has exactly
// two null vectors are its two halves, parted by rounding, and have nothing to add.
inline unsigned find_null_vectors(const Equations& equations, const Candidate* candidates, std::size_t count,
                                  Starts& starts, Shared& shared) {
  constexpr double same_double = 1e-8, half_of_double = 2e-5;  // rad
  constexpr std::size_t most = RootFinder::most_candidates;
  unsigned char doubles[most + 8], simple[most + 8];
  bool exact[most] = {};
  std::size_t double_count = 0, simple_count = 0;
  for (std::size_t i = 0; i < count; ++i) {
    shared.same_as[i] = static_cast<unsigned char>(i);
    if (candidates[i].simple) continue;
    bool known = false;
    for (std::size_t k = 0; k < double_count && !known; ++k)
      known = std::fabs(candidates[doubles[k]].angle - candidates[i].angle) < same_double;
    if (!known) doubles[double_count++] = static_cast<unsigned char>(i);
  }
  unsigned flags = find_some_null_vectors(equations, candidates, doubles, double_count, starts, shared, exact);
  for (std::size_t i = 0; i < count; ++i) {
    if (!candidates[i].simple) continue;
    for (std::size_t k = 0; k < double_count; ++k)
      if (exact[doubles[k]] && std::fabs(candidates[doubles[k]].angle - candidates[i].angle) < half_of_double)
        shared.same_as[i] = doubles[k];
    if (shared.same_as[i] == i) simple[simple_count++] = static_cast<unsigned char>(i);
  }
  flags |= find_some_null_vectors(equations, candidates, simple, simple_count, starts, shared, exact);
  if (starts.overflow) flags |= pieper::flag_overflow;
  return flags;
}

}  // namespace
