// The geometric subproblems that closed forms are made of, one per lane.
//
// Names after Paden and Kahan (Paden, Kinematics and Control of Robot Manipulators, 1986) as Elias and Wen number them
// (IK-Geo, arXiv 2211.05737): 1 turns a point onto a point, 2 two points onto each other about two axes, 3 a point to a
// distance, 4 a point to a height. What differs here is how they are computed: every quantity that vanishes at a
// singularity is formed as a product of small factors and never as a difference of large squares, so that the answers
// stay exact to rounding there:
//   the part of a vector across an axis is taken first, and its length second;
//   the sine of an angle of a triangle is Heron's product of four sums of its sides.
// Where no exact answer exists the nearest one is returned (least squares), and the caller measures what is left.
#pragma once

#include <cmath>

#include "pieper/closed_form.hpp"
#include "simd/arctangent.hpp"

namespace {

PIEPER_INLINE Vec root(Vec value) {
#if PIEPER_LANES == 8
  return reinterpret_cast<Vec>(_mm512_maskz_sqrt_pd(0xff, reinterpret_cast<__m512d>(value)));
#elif PIEPER_LANES == 4
  return reinterpret_cast<Vec>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(value)));
#elif PIEPER_LANES == 2
  return Vec{__builtin_sqrt(value[0]), __builtin_sqrt(value[1])};
#else
  return std::sqrt(value);
#endif
}

PIEPER_INLINE Vec widen(Vec square, Vec least) { return select(square > least, square, least); }
PIEPER_INLINE Vec not_negative(Vec value) { return select(value > 0.0, value, splat(0.0)); }

using pieper::HeightFrame;

struct Point {
  Vec x, y, z;
};
PIEPER_INLINE Point operator+(const Point& a, const Point& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
PIEPER_INLINE Point operator-(const Point& a, const Point& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
PIEPER_INLINE Point operator+(const Point& a, const double* b) { return {a.x + b[0], a.y + b[1], a.z + b[2]}; }
PIEPER_INLINE Point operator-(const Point& a, const double* b) { return {a.x - b[0], a.y - b[1], a.z - b[2]}; }
PIEPER_INLINE Point operator*(Vec s, const Point& a) { return {s * a.x, s * a.y, s * a.z}; }
PIEPER_INLINE Point scaled(Vec s, const double* a) { return {s * a[0], s * a[1], s * a[2]}; }
PIEPER_INLINE Vec dot(const Point& a, const Point& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
PIEPER_INLINE Vec dot(const double* a, const Point& b) { return a[0] * b.x + a[1] * b.y + a[2] * b.z; }
PIEPER_INLINE Point cross(const double* a, const Point& b) {
  return {a[1] * b.z - a[2] * b.y, a[2] * b.x - a[0] * b.z, a[0] * b.y - a[1] * b.x};
}
PIEPER_INLINE Point point_of(const double* a) { return {splat(a[0]), splat(a[1]), splat(a[2])}; }
PIEPER_INLINE Point across(const double* axis, const Point& a) { return a - scaled(dot(axis, a), axis); }

// A turn by its cosine and sine.
struct Turn {
  Vec c, s;
};

// Rodrigues' formula; `axis` is a unit vector through the origin.
PIEPER_INLINE Point turned(const double* axis, const Turn& t, const Point& a) {
  return t.c * a + t.s * cross(axis, a) + scaled((1.0 - t.c) * dot(axis, a), axis);
}
PIEPER_INLINE Point turned_back(const double* axis, const Turn& t, const Point& a) {
  return turned(axis, {t.c, -t.s}, a);
}
// The same about an axis through `through`.
PIEPER_INLINE Point turned(const double* axis, const double* through, const Turn& t, const Point& a) {
  return turned(axis, t, a - through) + through;
}
PIEPER_INLINE Point turned_back(const double* axis, const double* through, const Turn& t, const Point& a) {
  return turned_back(axis, t, a - through) + through;
}

// (c, s) brought to length one; no turn where both vanish.
PIEPER_INLINE Turn unit_turn(Vec c, Vec s) {
  const Vec length = root(c * c + s * s);
  const IntVec free = !(length > 0.0);
  const Vec scale = 1.0 / select(free, splat(1.0), length);
  return {select(free, splat(1.0), c * scale), s * scale};
}

// Subproblem 1: the turn about `axis` that takes `from` nearest to `to`.
PIEPER_INLINE Turn turn_onto(const double* axis, const Point& from, const Point& to) {
  const Point a = across(axis, from), b = across(axis, to);
  return unit_turn(dot(a, b), dot(cross(axis, a), b));
}

// A stage beside a fold, where two answers meet: they are `near` in the lanes where they may be one. An arm that is
// solved as an ideal one `widens` the gap to what the difference between the arms can open: Newton's method then starts
// on both sides of the fold.
struct Fold {
  double widened, within;
  IntVec near{};
};

// Subproblem 4, as a vector: of the vectors that z0 reaches by turning about the axis, one with other . z = height. Two
// answers, by sign. Written z = (axis . z0) axis + a e + b f; with the part of z0 across the axis taken first, b is
// exact to rounding even where z0 lies along the axis.
PIEPER_INLINE Point at_height(const HeightFrame& frame, const Point& z0, Vec height, Vec sign, Fold& fold) {
  const Vec along = dot(frame.axis, z0);
  const Point out = across(frame.axis, z0);
  const Vec square = dot(out, out), radius = root(square);
  Vec a = (height - frame.cosine * along) * frame.inverse_sine;
  Vec b2 = (radius - a) * (radius + a);
  a = select(a > radius, radius, select(a < -radius, -radius, a));
  fold.near = magnitude(b2) <= fold.within * dot(z0, z0);
  b2 = widen(not_negative(b2), fold.widened * square);
  return scaled(along, frame.axis) + scaled(a, frame.e) + scaled(sign * root(b2), frame.f);
}

// Subproblem 2: the vector z = R2 x = R1^T y, for axes 1 and 2 that meet. Both x and y are as long as z, and
// either gives its third component: the one that lies nearer to its own axis gives it exactly. `first` is the frame of
// axis 1 against axis 2.
PIEPER_INLINE Point between(const HeightFrame& first, const double* axis2, const Point& x, const Point& y, Vec sign,
                            Fold& fold) {
  const Vec along1 = dot(first.axis, y), along2 = dot(axis2, x);
  const Point out1 = across(first.axis, y), out2 = across(axis2, x);
  const Vec square1 = dot(out1, out1), square2 = dot(out2, out2);
  const IntVec use1 = square1 < square2;
  const Vec a1 = (along2 - first.cosine * along1) * first.inverse_sine;
  const Vec a2 = (along1 - first.cosine * along2) * first.inverse_sine;
  const Vec square = select(use1, square1, square2), radius = root(square);
  const Vec a = magnitude(select(use1, a1, a2));
  Vec b2 = (radius - a) * (radius + a);
  fold.near = magnitude(b2) <= fold.within * dot(y, y);
  b2 = widen(not_negative(b2), fold.widened * square);
  const Vec radius1 = root(square1);
  const Vec held = select(a1 > radius1, radius1, select(a1 < -radius1, -radius1, a1));
  return scaled(along1, first.axis) + scaled(held, first.e) + scaled(sign * root(b2), first.f);
}

// Subproblem 3 in the plane across `axis`: the turn that brings the end of arm `far` (length l, at home) to the
// distance `reach` from the start of arm `near_arm` (length b), which ends on the axis. Both arms lie across the axis.
PIEPER_INLINE Turn bent(const double* axis, const Point& near_arm, const Point& far, Vec b, Vec l, Vec reach, Vec sign,
                        Fold& fold) {
  // b . R far = b l cos(angle): A cos q + B sin q = C with A^2 + B^2 = (b l)^2
  const Vec A = dot(near_arm, far), B = dot(near_arm, cross(axis, far));
  const Vec least = magnitude(b - l), most = b + l;
  const Vec short_of = most - reach, beyond = reach - least;
  const Vec product = short_of * (most + reach) * beyond * (reach + least);
  const Vec size = b * l;
  // at the ends of the range C is +-(b l), which also serves those out of reach
  Vec C = 0.5 * ((reach - b) * (reach + b) - l * l);
  C = select(short_of < 0.0, size, select(beyond < 0.0, -size, C));
  const Vec D2 = 0.25 * product, square = size * size;
  // beside a fold, or so near to the start that the turn of the whole arm is what rounding makes of it
  fold.near = (magnitude(D2) <= fold.within * square) | (reach * reach <= fold.within * most * most);
  const Vec D = sign * root(widen(not_negative(D2), fold.widened * square));
  return unit_turn(A * C - B * D, B * C + A * D);
}

}  // namespace
