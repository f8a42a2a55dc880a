// The errors of a target's rows, and the Jacobian of those rows, for one configuration per lane.
#pragma once

#include "pieper/numeric_ik.hpp"
#include "simd/jacobian.hpp"

namespace {

using pieper::RotationTarget;
using pieper::SearchSpace;
using pieper::TargetRows;

// The target in the form that the lanes use.
struct Goal {
  double R[9], p[3];
  double position_axes[9], rotation_axes[9];  // columns are the axes that the rows are taken along, in the base frame
  bool turn_position, turn_rotation;          // false where they are the base axes
  double weights[6];
  double direction[3], tool_axis[3];  // RotationTarget::axis
  RotationTarget rotation;
  bool part_of_rotation;  // some but not all components of the rotation vector
};

struct Errors {
  Vec rows[6];               // weighted
  Vec position2, rotation2;  // squared, not weighted
  Vec cost;                  // half the squared length of `rows`
};

using Columns = Vec[max_axes][6];

inline Goal goal_of(const double* target, const TargetRows& rows) {
  Goal goal{};
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) goal.R[3 * r + c] = target[4 * r + c];
    goal.p[r] = target[4 * r + 3];
    goal.weights[r] = rows.weights[r], goal.weights[r + 3] = rows.weights[r + 3];
  }
  goal.rotation = rows.rotation;
  goal.turn_position = rows.position_in_tool;
  goal.turn_rotation = rows.rotation_in_tool;
  for (int k = 0; k < 9; ++k) goal.position_axes[k] = goal.rotation_axes[k] = goal.R[k];
  if (rows.rotation == RotationTarget::free) goal.weights[3] = goal.weights[4] = goal.weights[5] = 0;
  if (rows.rotation == RotationTarget::axis) {
    double* d = goal.direction;
    for (int r = 0; r < 3; ++r) {
      goal.tool_axis[r] = rows.axis[r];
      d[r] = goal.R[3 * r] * rows.axis[0] + goal.R[3 * r + 1] * rows.axis[1] + goal.R[3 * r + 2] * rows.axis[2];
    }
    // two directions across it, so that turning about it has no row
    const int least = d[0] * d[0] < 0.3 ? 0 : d[1] * d[1] < 0.5 ? 1 : 2;
    double x[3] = {-d[0] * d[least], -d[1] * d[least], -d[2] * d[least]};
    x[least] += 1;
    const double size = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    for (double& number : x) number /= size;
    double y[3];
    cross(d, x, y);
    for (int r = 0; r < 3; ++r) goal.rotation_axes[3 * r] = x[r], goal.rotation_axes[3 * r + 1] = y[r];
    goal.turn_rotation = true;
    goal.weights[4] = goal.weights[3], goal.weights[5] = 0;
  }
  goal.part_of_rotation =
      rows.rotation == RotationTarget::full && (goal.weights[3] == 0 || goal.weights[4] == 0 || goal.weights[5] == 0);
  return goal;
}

inline Vec dot(const Vec* a, const Vec* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// v = A^T v for a matrix of plain numbers
inline void along(const double* A, Vec* v) {
  const Vec a = v[0], b = v[1], c = v[2];
  for (int r = 0; r < 3; ++r) v[r] = A[r] * a + A[3 + r] * b + A[6 + r] * c;
}

// angle / sin(angle) from the cosine, as 2 atan(t) / t with t = tan(angle / 4); the polynomial for the arc tangent is
// Abramowitz and Stegun, 4.4.49, with its first coefficient set to 1 so that small angles are exact.
inline Vec angle_over_sine(Vec cosine) {
  const Vec half = square_root(larger(0.5 + 0.5 * cosine, splat(1e-30)));  // cos(angle / 2)
  const Vec x = (1.0 - half) / (1.0 + half);
  Vec p = splat(0.0028662257);
  p = p * x - 0.0161657367;
  p = p * x + 0.0429096138;
  p = p * x - 0.0752896400;
  p = p * x + 0.1065626393;
  p = p * x - 0.1420889944;
  p = p * x + 0.1999355085;
  p = p * x - 0.3333314528;
  p = p * x + 1.0;
  return 2.0 * p / (half * (1.0 + half));
}

constexpr double half_turn = 3.141592653589793;

// The rotation vector where the tip is half a turn away from the target and cross products vanish. R_target R^T is
// 2 n n^T - I then, so each column of its sum with I is along the axis n. Where only the direction of a tool axis counts, n
// is any vector across it; one askew to the axes of the arm finds joints that turn about it.
inline void half_turn_vector(const Goal& goal, const Pose<Vec>& tip, Vec* n) {
  if (goal.rotation == RotationTarget::axis) {
    for (int r = 0; r < 3; ++r)
      n[r] = splat(half_turn * (0.8 * goal.rotation_axes[3 * r] + 0.6 * goal.rotation_axes[3 * r + 1]));
    return;
  }
  Vec largest = splat(0.0);
  for (int c = 0; c < 3; ++c) {
    Vec column[3];
    for (int r = 0; r < 3; ++r)
      column[r] =
          goal.R[3 * r] * tip.x[c] + goal.R[3 * r + 1] * tip.y[c] + goal.R[3 * r + 2] * tip.z[c] + (r == c ? 1.0 : 0.0);
    const Vec scale = half_turn / square_root(larger(dot(column, column), splat(1e-30)));
    const IntVec longer = column[c] > largest;  // twice the square of component c of n
    largest = select(longer, column[c], largest);
    for (int r = 0; r < 3; ++r) n[r] = select(longer, scale * column[r], n[r]);
  }
}

inline void rotation_error(const Goal& goal, const Pose<Vec>& tip, Vec* e) {
  Vec cosine = splat(0.0);
  for (int r = 0; r < 3; ++r) e[r] = splat(0.0);
  if (goal.rotation == RotationTarget::axis) {
    Vec a[3], d[3];
    for (int r = 0; r < 3; ++r) {
      a[r] = tip.x[r] * goal.tool_axis[0] + tip.y[r] * goal.tool_axis[1] + tip.z[r] * goal.tool_axis[2];
      d[r] = splat(goal.direction[r]);
    }
    cross(a, d, e);
    cosine = dot(a, d);
  } else {
    // R_target R^T = sum of t_k r_k^T over the columns; its antisymmetric part is half the sum of r_k x t_k
    const Vec* columns[3] = {tip.x, tip.y, tip.z};
    for (int k = 0; k < 3; ++k) {
      const Vec* a = columns[k];
      const double t[3] = {goal.R[k], goal.R[3 + k], goal.R[6 + k]};
      e[0] += 0.5 * (a[1] * t[2] - a[2] * t[1]);
      e[1] += 0.5 * (a[2] * t[0] - a[0] * t[2]);
      e[2] += 0.5 * (a[0] * t[1] - a[1] * t[0]);
      cosine += 0.5 * (a[0] * t[0] + a[1] * t[1] + a[2] * t[2]);
    }
    cosine -= 0.5;
  }
  const Vec scale = angle_over_sine(cosine);
  for (int r = 0; r < 3; ++r) e[r] *= scale;
  const IntVec opposite = (cosine < -1.0 + 1e-9) & (dot(e, e) < 1e-12);
  if (!any(opposite)) return;
  Vec n[3] = {e[0], e[1], e[2]};
  half_turn_vector(goal, tip, n);
  for (int r = 0; r < 3; ++r) e[r] = select(opposite, n[r], e[r]);
}

// Derivative of the rotation vector by a turn of the tip: the inverse right Jacobian of SO(3),
// I + [e]/2 + (1 - x cot x) / |e|^2 [e]^2 with x = |e| / 2; its last coefficient as a series.
inline void differentiate_rotation(const Vec* e, Vec* w) {
  const Vec square = dot(e, e);
  Vec c = splat(1.0 / 47900160);
  c = c * square + 1.0 / 1209600;
  c = c * square + 1.0 / 30240;
  c = c * square + 1.0 / 720;
  c = c * square + 1.0 / 12;
  Vec once[3], twice[3];
  cross(e, w, once);
  cross(e, once, twice);
  for (int r = 0; r < 3; ++r) w[r] += 0.5 * once[r] + c * twice[r];
}

// Errors of every lane, and the columns of the Jacobian of the rows.
inline Errors evaluate(const Folded& chain, const SearchSpace& space, const Goal& goal, const Vec* q,
                       Columns& columns) {
  const std::size_t m = chain.count, n = space.joints;
  Vec moved[max_axes];
  const Vec* angles = q;
  if (space.coupling) {
    for (std::size_t i = 0; i < m; ++i) {
      moved[i] = splat(0.0);
      for (std::size_t k = 0; k < n; ++k) moved[i] += space.coupling[i * n + k] * q[k];
    }
    angles = moved;
  }
  JointState<Vec> state;
  states_of_lanes(chain, chain.count, angles, state);
  Axes<Vec> axes;
  const Pose<Vec> tip = walk_with_axes(chain, state, axes);

  Errors errors;
  Vec position[3], rotation[3];
  for (int r = 0; r < 3; ++r) position[r] = goal.p[r] - tip.p[r], rotation[r] = splat(0.0);
  if (goal.rotation != RotationTarget::free) rotation_error(goal, tip, rotation);
  Vec whole[3] = {rotation[0], rotation[1], rotation[2]};
  if (goal.turn_position) along(goal.position_axes, position);
  if (goal.turn_rotation) along(goal.rotation_axes, rotation);
  errors.position2 = errors.rotation2 = errors.cost = splat(0.0);
  for (int r = 0; r < 3; ++r) {
    if (goal.weights[r] != 0) errors.position2 += position[r] * position[r];
    if (goal.weights[r + 3] != 0) errors.rotation2 += rotation[r] * rotation[r];
    errors.rows[r] = goal.weights[r] * position[r], errors.rows[r + 3] = goal.weights[r + 3] * rotation[r];
  }
  for (int r = 0; r < 6; ++r) errors.cost += 0.5 * errors.rows[r] * errors.rows[r];

  if (space.coupling)
    for (std::size_t k = 0; k < n; ++k)
      for (int r = 0; r < 6; ++r) columns[k][r] = splat(0.0);
  for (std::size_t i = 0; i < m; ++i) {
    Vec six[6];
    column(chain, tip, axes, i, pieper::JacobianKind::geometric, six);
    if (goal.part_of_rotation) differentiate_rotation(whole, six + 3);
    if (goal.turn_position) along(goal.position_axes, six);
    if (goal.turn_rotation) along(goal.rotation_axes, six + 3);
    for (int r = 0; r < 6; ++r) six[r] *= goal.weights[r];
    if (space.coupling) {
      for (std::size_t k = 0; k < n; ++k) {
        const double factor = space.coupling[i * n + k];
        if (factor != 0)
          for (int r = 0; r < 6; ++r) columns[k][r] += factor * six[r];
      }
    } else {
      for (int r = 0; r < 6; ++r) columns[i][r] = six[r];
    }
  }
  return errors;
}

}  // namespace
