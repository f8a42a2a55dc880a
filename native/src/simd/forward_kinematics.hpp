// The product along the folded chain (see chain.cpp), for one configuration (V = double) or one per lane (V = Vec).
//
// It is taken from the tip to the base: a step then multiplies from the left by Rz Trans Rx, which mixes two rows and adds
// constants, fewer operations than the same step from the other side. Only Jacobians walk from the base (jacobian.hpp),
// because they need every axis in base coordinates.
#pragma once

#include "pieper/chain.hpp"
#include "simd/sincos.hpp"

namespace {

using pieper::Axis;
using pieper::Folded;
using pieper::Reach;
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

// Cosine and sine of the accumulated angle of an axis within its group, and how far the axis slides if it does.
template <class V>
struct AxisState {
  V c, s, slide;
};

template <class V>
struct JointState {
  AxisState<V> axes[max_axes];
  AxisState<V>& operator[](std::size_t i) { return axes[i]; }
  const AxisState<V>& operator[](std::size_t i) const { return axes[i]; }
};

// q[i] holds axis i of every lane. Angles must be small (see load_joints in kernels.cpp).
PIEPER_INLINE void states_of_lanes(const Folded& chain, std::size_t n, const Vec* q, JointState<Vec>& state) {
  Vec angle = splat(0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const Axis& axis = chain.axes[i];
    angle = q[i] * axis.turn + (angle + axis.offset);
    if (!axis.revolute) state[i].slide = q[i] * axis.sign;
    sincos_reduced(angle, state[i].s, state[i].c);
    if (axis.twist != Twist::parallel) angle = splat(0.0);
  }
}

// One configuration: the angles of several axes share a vector.
PIEPER_INLINE void state_of_one(const Folded& chain, const double* q, JointState<double>& state) {
  double angle[max_axes + lanes] = {};
  double sum = 0;
  const std::size_t m = chain.count;
  for (std::size_t i = 0; i < m; ++i) {
    const Axis& axis = chain.axes[i];
    sum = q[i] * axis.turn + (sum + axis.offset);
    if (!axis.revolute) state[i].slide = q[i] * axis.sign;
    angle[i] = sum;
    if (axis.twist != Twist::parallel) sum = 0;
  }
  for (std::size_t i = 0; i < m; i += lanes) {
    Vec s, c;
    sincos_reduced(load(angle + i), s, c);
    double s_out[lanes], c_out[lanes];
    store(s_out, s), store(c_out, c);
    for (std::size_t l = 0; l < lanes && i + l < m; ++l) state[i + l].s = s_out[l], state[i + l].c = c_out[l];
  }
}

// One column of the 3x4 matrix. Named members stay in registers where an array would go through memory.
template <class V>
struct Column {
  V x, y, z;
};

// A column of Rz Trans(x, y, 0) Rx f, with the cosine and sine of the turn about z, but for the translation. Signs are
// written out for each kind of twist, so that they become part of a fused multiply-add.
template <class V>
PIEPER_INLINE void step_square(Column<V>& f, V c, V s) {
  const V x = f.x, y = f.y, z = f.z;
  f.x = c * x + s * z;
  f.y = s * x - c * z;
  f.z = y;
}

template <class V>
PIEPER_INLINE void step_tilted(Column<V>& f, double cos_twist, double sin_twist, V c, V s) {
  const V x = f.x, across = cos_twist * f.y - sin_twist * f.z;
  f.z = sin_twist * f.y + cos_twist * f.z;
  f.x = c * x - s * across;
  f.y = s * x + c * across;
}

template <class V>
PIEPER_INLINE void add_reach(Column<V>& p, const Axis& axis, V c, V s) {
  if (axis.reach == Reach::none) return;
  p.x += axis.x * c, p.y += axis.x * s;
  if (axis.reach == Reach::both) p.x -= axis.y * s, p.y += axis.y * c;
}

// A constant column, turned about z.
template <class V>
PIEPER_INLINE Column<V> turned(const double* rotation, int k, V c, V s) {
  const double x = rotation[k], y = rotation[3 + k], z = rotation[6 + k];
  return {c * x - s * y, s * x + c * y, splat_like(V{}, z)};
}

template <class V>
PIEPER_INLINE void turn(Column<V>& f, const double* b) {
  const V x = f.x, y = f.y, z = f.z;
  f.x = b[0] * x + b[1] * y + b[2] * z;
  f.y = b[3] * x + b[4] * y + b[5] * z;
  f.z = b[6] * x + b[7] * y + b[8] * z;
}

// Base to tip.
template <class V>
PIEPER_INLINE Pose<V> tip_pose(const Folded& chain, const JointState<V>& state) {
  std::size_t i = chain.count - 1;
  V c = state[i].c, s = state[i].s;
  const V zero{}, one = splat_like(V{}, 1.0);
  Column<V> x{c, s, zero}, y{-s, c, zero}, z{zero, zero, one}, p{zero, zero, zero};
  if (chain.tip_turned) {
    x = turned(chain.tip_rotation, 0, c, s);
    y = turned(chain.tip_rotation, 1, c, s);
    z = turned(chain.tip_rotation, 2, c, s);
  }
  for (;;) {
    // a group of parallel axes: the path stays in the plane across them, and height adds up
    add_reach(p, chain.axes[i], c, s);
    p.z += chain.axes[i].z;
    if (!chain.axes[i].revolute) p.z += state[i].slide;
    while (i > 0 && chain.axes[i - 1].twist == Twist::parallel) {
      --i;
      add_reach(p, chain.axes[i], state[i].c, state[i].s);
      if (!chain.axes[i].revolute) p.z += state[i].slide;
    }
    if (i-- == 0) break;
    const Axis& axis = chain.axes[i];
    c = state[i].c, s = state[i].s;
    if (axis.twist == Twist::square) {
      step_square(x, c, s), step_square(y, c, s), step_square(z, c, s), step_square(p, c, s);
    } else {
      const double ca = axis.cos_twist, sa = axis.sin_twist;
      step_tilted(x, ca, sa, c, s), step_tilted(y, ca, sa, c, s);
      step_tilted(z, ca, sa, c, s), step_tilted(p, ca, sa, c, s);
    }
  }
  if (chain.base_turned) {
    const double* b = chain.base_rotation;
    turn(x, b), turn(y, b), turn(z, b), turn(p, b);
  }
  const double* base = chain.base_position;
  return {{x.x, x.y, x.z}, {y.x, y.y, y.z}, {z.x, z.y, z.z}, {p.x + base[0], p.y + base[1], p.z + base[2]}};
}

}  // namespace
