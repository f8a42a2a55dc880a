// Columns of the Jacobian from the axes met on the walk (Siciliano et al., Robotics, 2009, eq. 3.30):
// a revolute axis z through p gives (z x (tip - p), z), a prismatic one (z, 0).
#pragma once

#include "simd/forward_kinematics.hpp"

namespace {

template <class V>
struct Axes {
  V z[max_axes][3], p[max_axes][3];
};

template <class V>
PIEPER_INLINE void turn_about_z(Pose<V>& f, V c, V s) {
  for (int r = 0; r < 3; ++r) {
    const V x = f.x[r];
    f.x[r] = c * x + s * f.y[r];
    f.y[r] = c * f.y[r] - s * x;
  }
}

template <class V>
PIEPER_INLINE void tilt_about_x(Pose<V>& f, const Axis& axis) {
  for (int r = 0; r < 3; ++r) {
    const V y = f.y[r];
    if (axis.twist == Twist::square) {
      f.y[r] = f.z[r], f.z[r] = -y;
    } else {
      f.y[r] = axis.cos_twist * y + axis.sin_twist * f.z[r];
      f.z[r] = axis.cos_twist * f.z[r] - axis.sin_twist * y;
    }
  }
}

// Walks from the first axis, whose frame is `f`, to the tip. `at_axis(i, z, p)` is told the direction of axis i and a point on it, both
// in the frame in which `f` is given.
template <class V, class AtAxis>
PIEPER_INLINE Pose<V> walk_from(Pose<V> f, const Folded& chain, const JointState<V>& state, AtAxis at_axis) {
  for (std::size_t i = 0; i < chain.count; ++i) {
    // one group of parallel axes: the path stays in the plane across them, height adds up
    V x{}, y{}, z{};
    bool moved = false;
    for (;; ++i) {
      const Axis& axis = chain.axes[i];
      if (moved) {
        V p[3];
        for (int r = 0; r < 3; ++r) p[r] = f.p[r] + f.x[r] * x + f.y[r] * y + f.z[r] * z;
        at_axis(i, f.z, p);
      } else {
        at_axis(i, f.z, f.p);
      }
      if (axis.x != 0) x += axis.x * state[i].c, y += axis.x * state[i].s, moved = true;
      if (axis.y != 0) x -= axis.y * state[i].s, y += axis.y * state[i].c, moved = true;
      if (axis.z != 0) z += axis.z, moved = true;
      if (!axis.revolute) z += state[i].slide, moved = true;
      if (axis.twist != Twist::parallel || i + 1 == chain.count) break;
    }
    if (moved)
      for (int r = 0; r < 3; ++r) f.p[r] += f.x[r] * x + f.y[r] * y + f.z[r] * z;
    turn_about_z(f, state[i].c, state[i].s);
    if (i + 1 < chain.count) tilt_about_x(f, chain.axes[i]);
  }
  if (chain.tip_turned) {
    const double* t = chain.tip_rotation;
    for (int r = 0; r < 3; ++r) {
      const V x = f.x[r], y = f.y[r], z = f.z[r];
      f.x[r] = t[0] * x + t[3] * y + t[6] * z;
      f.y[r] = t[1] * x + t[4] * y + t[7] * z;
      f.z[r] = t[2] * x + t[5] * y + t[8] * z;
    }
  }
  return f;
}

// The same from the base, in the base frame.
template <class V, class AtAxis>
PIEPER_INLINE Pose<V> walk(const Folded& chain, const JointState<V>& state, AtAxis at_axis) {
  Pose<V> f;
  for (int r = 0; r < 3; ++r) {
    f.x[r] = splat_like(V{}, chain.base_rotation[3 * r]);
    f.y[r] = splat_like(V{}, chain.base_rotation[3 * r + 1]);
    f.z[r] = splat_like(V{}, chain.base_rotation[3 * r + 2]);
    f.p[r] = splat_like(V{}, chain.base_position[r]);
  }
  return walk_from(f, chain, state, at_axis);
}

template <class V>
inline Pose<V> walk_with_axes(const Folded& chain, const JointState<V>& state, Axes<V>& axes) {
  return walk(chain, state, [&](std::size_t i, const V* z, const V* p) {
    for (int r = 0; r < 3; ++r) axes.z[i][r] = z[r], axes.p[i][r] = p[r];
  });
}

template <class V>
PIEPER_INLINE void cross(const V* a, const V* b, V* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

// Column of axis i: linear part, then angular.
template <class V>
PIEPER_INLINE void column(const Folded& chain, const Pose<V>& tip, const Axes<V>& axes, std::size_t i,
                          pieper::JacobianKind kind, V* out) {
  const Axis& axis = chain.axes[i];
  V z[3];
  for (int r = 0; r < 3; ++r) z[r] = axis.sign * axes.z[i][r];
  V linear[3], angular[3];
  if (axis.revolute) {
    V arm[3];
    for (int r = 0; r < 3; ++r) {
      arm[r] = kind == pieper::JacobianKind::space ? -axes.p[i][r] : tip.p[r] - axes.p[i][r];
      angular[r] = z[r];
    }
    cross(z, arm, linear);
  } else {
    for (int r = 0; r < 3; ++r) linear[r] = z[r], angular[r] = V{};
  }
  if (kind == pieper::JacobianKind::body) {
    const V* columns[3] = {tip.x, tip.y, tip.z};
    for (int r = 0; r < 3; ++r) {
      const V* e = columns[r];
      out[r] = e[0] * linear[0] + e[1] * linear[1] + e[2] * linear[2];
      out[r + 3] = e[0] * angular[0] + e[1] * angular[1] + e[2] * angular[2];
    }
  } else {
    for (int r = 0; r < 3; ++r) out[r] = linear[r], out[r + 3] = angular[r];
  }
}

// Yoshikawa's measure sqrt(det(J J^T)) (1985, eq. 12) as the product of the lengths that Gram-Schmidt leaves; forming
// J J^T would lose half of the digits near a singularity. With fewer than six axes, sqrt(det(J^T J)).
template <class V>
inline V manipulability(const V* jacobian /* 6 x m */, std::size_t m) {
  constexpr std::size_t six = 6;
  const bool wide = m >= six;
  const std::size_t count = wide ? six : m, length = wide ? m : six;
  V rows[six][max_axes];
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < length; ++k) rows[i][k] = wide ? jacobian[i * m + k] : jacobian[k * m + i];
  V product = splat_like(V{}, 1.0);
  for (std::size_t i = 0; i < count; ++i) {
    V square = V{};
    for (std::size_t k = 0; k < length; ++k) square += rows[i][k] * rows[i][k];
    product *= square;
    const V scale = 1.0 / (square + 1e-300);
    for (std::size_t j = i + 1; j < count; ++j) {
      V along = V{};
      for (std::size_t k = 0; k < length; ++k) along += rows[i][k] * rows[j][k];
      along *= scale;
      for (std::size_t k = 0; k < length; ++k) rows[j][k] -= along * rows[i][k];
    }
  }
  return product;  // its square root is taken by the caller
}

}  // namespace
