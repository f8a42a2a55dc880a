// The product along the folded chain (see chain.cpp), for one configuration (V = double) or one per lane (V = Vec).
#pragma once

#include "pieper/chain.hpp"
#include "simd/sincos.hpp"

namespace {

using pieper::Axis;
using pieper::Folded;
using pieper::Twist;

// Axes that one configuration may have in the kernels; longer chains run in the plain loop of differential.cpp.
constexpr std::size_t max_axes = 32;

// Up to this angle adding up a group of parallel axes costs no more than rounding; larger angles are reduced first.
constexpr double small_angle = 64.0;

// A frame: the columns x, y, z of its rotation, and its origin.
template <class V>
struct Pose {
  V x[3], y[3], z[3], p[3];
};

// Sines and cosines of the accumulated angle of each axis within its group, and how far each axis slides.
template <class V>
struct JointState {
  V c[max_axes], s[max_axes], slide[max_axes];
};

// q[i] holds axis i of every lane. Angles must be small (see load_joints in kernels.cpp).
inline void states_of_lanes(const Folded& chain, const Vec* q, JointState<Vec>& state) {
  Vec angle = splat(0.0);
  for (std::size_t i = 0; i < chain.count; ++i) {
    const Axis& axis = chain.axes[i];
    if (axis.revolute) {
      angle += q[i] * axis.sign + axis.offset;
    } else {
      state.slide[i] = q[i] * axis.sign;
      angle += axis.offset;
    }
    sincos_reduced(angle, state.s[i], state.c[i]);
    if (axis.twist != Twist::parallel) angle = splat(0.0);
  }
}

// One configuration: the angles of several axes share a vector.
inline void state_of_one(const Folded& chain, const double* q, JointState<double>& state) {
  double angle[max_axes + lanes] = {};
  double sum = 0;
  const std::size_t m = chain.count;
  for (std::size_t i = 0; i < m; ++i) {
    const Axis& axis = chain.axes[i];
    if (axis.revolute) {
      sum += q[i] * axis.sign + axis.offset;
    } else {
      state.slide[i] = q[i] * axis.sign;
      sum += axis.offset;
    }
    angle[i] = sum;
    if (axis.twist != Twist::parallel) sum = 0;
  }
  for (std::size_t i = 0; i < m; i += lanes) {
    Vec s, c;
    sincos_reduced(load(angle + i), s, c);
    double s_out[lanes], c_out[lanes];
    store(s_out, s), store(c_out, c);
    for (std::size_t l = 0; l < lanes && i + l < m; ++l) state.s[i + l] = s_out[l], state.c[i + l] = c_out[l];
  }
}

template <class V>
inline void rotate_about_z(Pose<V>& f, V c, V s) {
  for (int r = 0; r < 3; ++r) {
    const V x = f.x[r];
    f.x[r] = c * x + s * f.y[r];
    f.y[r] = c * f.y[r] - s * x;
  }
}

template <class V>
inline void tilt_about_x(Pose<V>& f, const Axis& axis) {
  switch (axis.twist) {
    case Twist::parallel:
      return;
    case Twist::plus_90:
      for (int r = 0; r < 3; ++r) {
        const V y = f.y[r];
        f.y[r] = f.z[r], f.z[r] = -y;
      }
      return;
    case Twist::minus_90:
      for (int r = 0; r < 3; ++r) {
        const V y = f.y[r];
        f.y[r] = -f.z[r], f.z[r] = y;
      }
      return;
    case Twist::general:
      for (int r = 0; r < 3; ++r) {
        const V y = f.y[r];
        f.y[r] = axis.cos_twist * y + axis.sin_twist * f.z[r];
        f.z[r] = axis.cos_twist * f.z[r] - axis.sin_twist * y;
      }
  }
}

// Walks from base to tip. `at_axis(i, z, p)` is told the direction of axis i and a point on it, both in the base frame.
template <class V, class AtAxis>
inline Pose<V> walk(const Folded& chain, const JointState<V>& state, AtAxis at_axis) {
  Pose<V> f;
  for (int r = 0; r < 3; ++r) {
    f.x[r] = splat_like(V{}, chain.base_rotation[3 * r]);
    f.y[r] = splat_like(V{}, chain.base_rotation[3 * r + 1]);
    f.z[r] = splat_like(V{}, chain.base_rotation[3 * r + 2]);
    f.p[r] = splat_like(V{}, chain.base_position[r]);
  }
  const std::size_t m = chain.count;
  std::size_t i = 0;
  while (i < m) {
    // one group of parallel axes: the path stays in the plane, height adds up
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
      if (axis.x != 0) x += axis.x * state.c[i], y += axis.x * state.s[i], moved = true;
      if (axis.y != 0) x -= axis.y * state.s[i], y += axis.y * state.c[i], moved = true;
      if (axis.z != 0) z += axis.z, moved = true;
      if (!axis.revolute) z += state.slide[i], moved = true;
      if (axis.twist != Twist::parallel || i + 1 == m) break;
    }
    if (moved)
      for (int r = 0; r < 3; ++r) f.p[r] += f.x[r] * x + f.y[r] * y + f.z[r] * z;
    rotate_about_z(f, state.c[i], state.s[i]);
    tilt_about_x(f, chain.axes[i]);
    ++i;
  }
  if (chain.tip_turns) rotate_about_z(f, splat_like(V{}, chain.cos_tip), splat_like(V{}, chain.sin_tip));
  return f;
}

}  // namespace
