// What an answer is worth: Yoshikawa's measure and singular values of its Jacobian, and its distance from the limits.
#pragma once

#include "simd/jacobian.hpp"
#include "simd/target_rows.hpp"

namespace {

// Distance of the joint nearest to one of its limits, of joints as they are given: endless ones are infinitely far.
PIEPER_INLINE Vec margin_of(const double* limits, std::size_t n, const Vec* joints) {
  Vec margin = smaller(joints[0] - limits[0], limits[1] - joints[0]);
  for (std::size_t i = 1; i < n; ++i)
    margin = smaller(margin, smaller(joints[i] - limits[2 * i], limits[2 * i + 1] - joints[i]));
  return margin;
}

inline bool six_turn(const Folded& chain) {
  if (chain.count != 6) return false;
  for (std::size_t i = 0; i < 6; ++i)
    if (!chain.axes[i].revolute) return false;
  return true;
}

// Yoshikawa's measure of six axes that turn: |det J|. It depends neither on the first and the last joint nor on the frame, and
// moving the point whose velocity is meant adds rows to rows. So axis 0 is the z axis of the frame in which all is written, and the point
// lies on axis 5. Adding the row of z to those of x and y, (z x (p_5 - p), z) becomes what is below, column 0 becomes (0, 0, 0, 0, 0, 1), and
// a determinant of five rows is left, taken by minors (Laplace). Rounding is some 1e-15 of the product of the columns' lengths, not of the
// measure: see score_some() for how the best is told all the same.
PIEPER_INLINE Vec six_axis_manipulability(const Folded& chain, const Vec* joints) {
  JointState<Vec> state;
  state[0] = {splat(1.0), splat(0.0), splat(0.0)};
  state[5] = state[0];
  Vec angle = splat(0.0);
  for (std::size_t i = 1; i < 5; ++i) {
    const Axis& axis = chain.axes[i];
    angle = joints[i] * axis.turn + (angle + axis.offset);
    sincos_reduced(angle, state[i].s, state[i].c);
    if (axis.twist != Twist::parallel) angle = splat(0.0);
  }
  const Vec zero = splat(0.0), one = splat(1.0);
  Vec z[6][3], p[6][3];
  walk_from<Vec>({{one, zero, zero}, {zero, one, zero}, {zero, zero, one}, {zero, zero, zero}}, chain, state,
                 [&](std::size_t i, const Vec* direction, const Vec* point) {
                   for (int r = 0; r < 3; ++r) z[i][r] = direction[r], p[i][r] = point[r];
                 });
  Vec x[5], y[5], u[5], v[5], w[5];  // rows of what is left, by axis: x and y of the direction, and the velocity
  for (int j = 0; j < 4; ++j) {
    const Vec *d = z[j + 1], *at = p[j + 1];
    const Vec a[3] = {p[5][0] - at[0], p[5][1] - at[1], p[5][2] - at[2]};
    x[j] = d[0], y[j] = d[1];
    u[j] = d[1] * a[2] + d[2] * at[1];
    v[j] = -(d[2] * at[0] + d[0] * a[2]);
    w[j] = d[0] * a[1] - d[1] * a[0];
  }
  x[4] = z[5][0], y[4] = z[5][1];
  u[4] = z[5][2] * p[5][1], v[4] = -(z[5][2] * p[5][0]);  // and no w: the point is on this axis
  const auto turning = [&](int i, int j) { return x[i] * y[j] - x[j] * y[i]; };
  const auto plane = [&](int i, int j) { return u[i] * v[j] - u[j] * v[i]; };
  const Vec m01 = plane(0, 1), m02 = plane(0, 2), m03 = plane(0, 3), m04 = plane(0, 4), m12 = plane(1, 2),
            m13 = plane(1, 3), m14 = plane(1, 4), m23 = plane(2, 3), m24 = plane(2, 4), m34 = plane(3, 4);
  Vec sum = turning(3, 4) * (w[0] * m12 - w[1] * m02 + w[2] * m01);
  sum -= turning(2, 4) * (w[0] * m13 - w[1] * m03 + w[3] * m01);
  sum += turning(1, 4) * (w[0] * m23 - w[2] * m03 + w[3] * m02);
  sum -= turning(0, 4) * (w[1] * m23 - w[2] * m13 + w[3] * m12);
  sum += turning(2, 3) * (w[0] * m14 - w[1] * m04);
  sum -= turning(1, 3) * (w[0] * m24 - w[2] * m04);
  sum += turning(0, 3) * (w[1] * m24 - w[2] * m14);
  sum += turning(1, 2) * (w[0] * m34 - w[3] * m04);
  sum -= turning(0, 2) * (w[1] * m34 - w[3] * m14);
  sum += turning(0, 1) * (w[2] * m34 - w[3] * m24);
  return magnitude(sum);
}

// Singular values of a matrix by one-sided Jacobi rotations (Hestenes 1958; Golub, Van Loan, section 8.6.3): of `count` vectors of some
// length, turned in pairs until each is square to all others, they are the lengths. A lane that is through is not touched again, so that it
// holds the same whatever its neighbours need.
constexpr int most_sweeps = 15;
constexpr double square_enough = 1e-15;  // cosine of the angle between two vectors, as small as rounding lets it become

PIEPER_INLINE Vec dot(const Vec* a, const Vec* b, std::size_t length) {
  Vec sum = a[0] * b[0];
  for (std::size_t k = 1; k < length; ++k) sum += a[k] * b[k];
  return sum;
}

inline void singular_values_of(Vec (*vectors)[max_axes], std::size_t count, std::size_t length, Vec& product,
                               Vec& smallest) {
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    bool turned = false;
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t j = i + 1; j < count; ++j) {
        Vec *a = vectors[i], *b = vectors[j];
        const Vec aa = dot(a, a, length), bb = dot(b, b, length), ab = dot(a, b, length);
        const IntVec askew = ab * ab > square_enough * square_enough * aa * bb;
        if (!any(askew)) continue;
        turned = true;
        const Vec zeta = (bb - aa) / select(askew, 2.0 * ab, splat(1.0)), far = magnitude(zeta);
        const Vec small = 1.0 / (far + square_root(1.0 + far * far)), t = select(zeta < 0.0, -small, small);
        const Vec c = select(askew, 1.0 / square_root(1.0 + t * t), splat(1.0)), s = select(askew, c * t, splat(0.0));
        for (std::size_t k = 0; k < length; ++k) {
          const Vec before = a[k];
          a[k] = c * before - s * b[k];
          b[k] = s * before + c * b[k];
        }
      }
    if (!turned) break;
  }
  product = splat(1.0);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec value = square_root(dot(vectors[i], vectors[i], length));
    product *= value;
    smallest = i == 0 ? value : smaller(smallest, value);
  }
}

}  // namespace
