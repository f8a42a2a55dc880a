// Closed forms, all branches of a pose at once: one branch per lane, so that one pose alone costs no more than one of
// many.
//
// With G = T M^-1 the arm reads G = e1 e2 ... e6, e_i the turn about axis i as it lies at home. Every stage finds one
// or two turns by a subproblem, and the stages after it work with the turn that was found, not with the exact one: what
// a stage lost to rounding beside a singularity, the next ones make up for. docs/derivations/closed_forms.md derives
// them.
#pragma once

#include "pieper/closed_form.hpp"
#include "simd/numeric_ik.hpp"
#include "simd/quartic.hpp"
#include "simd/subproblems.hpp"

namespace {

using pieper::ClosedForm;
using pieper::ClosedFormFamily;
using pieper::ClosedFormOptions;
using pieper::ClosedFormResults;
using pieper::FirstThree;

constexpr std::size_t branches = pieper::closed_form_branches;
static_assert(branches % lanes == 0);
constexpr std::size_t parts = branches / lanes;

// Signs of branch b: those of the first stage, of the elbow and of the wrist.
alignas(64) constexpr double branch_signs[3][branches] = {
    {1, 1, 1, 1, -1, -1, -1, -1}, {1, 1, -1, -1, 1, 1, -1, -1}, {1, -1, 1, -1, 1, -1, 1, -1}};

struct Signs {
  Vec front, elbow, wrist;
};

// G = T M^-1, or its inverse for an arm that is read backwards: rows of [R p].
struct Displacement {
  double m[12];
};

PIEPER_INLINE Displacement displacement(const ClosedForm& form, const double* T) {
  const double* U = form.undo_home;
  Displacement G, I;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c)
      G.m[4 * r + c] =
          T[4 * r] * U[c] + T[4 * r + 1] * U[4 + c] + T[4 * r + 2] * U[8 + c] + (c == 3 ? T[4 * r + 3] : 0.0);
  if (!form.reversed) return G;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) I.m[4 * r + c] = G.m[4 * c + r];
    I.m[4 * r + 3] = -(G.m[r] * G.m[3] + G.m[4 + r] * G.m[7] + G.m[8 + r] * G.m[11]);
  }
  return I;
}

PIEPER_INLINE Point turned(const Displacement& G, const Point& a) {
  const double* m = G.m;
  return {m[0] * a.x + m[1] * a.y + m[2] * a.z, m[4] * a.x + m[5] * a.y + m[6] * a.z,
          m[8] * a.x + m[9] * a.y + m[10] * a.z};
}
PIEPER_INLINE Point turned_back(const Displacement& G, const Point& a) {
  const double* m = G.m;
  return {m[0] * a.x + m[4] * a.y + m[8] * a.z, m[1] * a.x + m[5] * a.y + m[9] * a.z,
          m[2] * a.x + m[6] * a.y + m[10] * a.z};
}
PIEPER_INLINE Point moved(const Displacement& G, const Point& a) {
  return turned(G, a) + Point{splat(G.m[3]), splat(G.m[7]), splat(G.m[11])};
}

// Within this of a fold (square of a sine) answers are looked at as possibly one; of an ideal arm, as possibly lost.
PIEPER_INLINE Fold fold_of(const ClosedForm& f) {
  constexpr double square = 1e-12, margin = 400;
  return {f.widened, f.widened > 0 ? margin * f.widened : square};
}

PIEPER_INLINE Vec length(const Point& a) { return root(dot(a, a)); }

// The elbow of the arm: all of its lengths are constant.
PIEPER_INLINE Turn bent(const ClosedForm& form, const double* axis, Vec reach, Vec sign, Fold& fold) {
  return bent(axis, point_of(form.near_arm), point_of(form.far_arm), splat(form.near_length), splat(form.far_length),
              reach, sign, fold);
}

// Turns 1, 2, 3 that bring the wrist centre to `goal`.
template <FirstThree first_three>
PIEPER_INLINE void place_wrist(const ClosedForm& f, const Point& goal, const Signs& signs, Turn* turn, IntVec& near) {
  const double *w1 = f.axis[0], *w2 = f.axis[1], *w3 = f.axis[2];
  const double *o1 = f.point[0], *o2 = f.point[1], *o3 = f.point[2];
  const Point c = point_of(f.meet);
  Fold fold = fold_of(f), other = fold_of(f);
  [[maybe_unused]] constexpr double nothing = 1e-6;
  if constexpr (first_three == FirstThree::parallel_23) {
    // axes 2 and 3 cannot change the height along them: that fixes axis 1; then a triangle in the plane across them
    const Point v = goal - o1;
    const Point z = at_height(f.front, v, splat(f.height), signs.front, fold);
    turn[0] = turn_onto(w1, z, v);
    const Point u = turned_back(w1, turn[0], v) + o1 - o2;
    turn[2] = bent(f, w3, length(across(w2, u)), signs.elbow, other);
    turn[1] = turn_onto(w2, turned(w3, o3, turn[2], c) - o2, u);
  } else if constexpr (first_three == FirstThree::parallel_12) {
    // the height along axes 1 and 2 fixes axis 3
    const Point far = c - o3;
    const Point z = at_height(f.front, far, dot(w1, goal - o3), signs.front, fold);
    turn[2] = turn_onto(w3, far, z);
    const Point x = turned(w3, turn[2], far) + o3, u = goal - o1;
    const Point arm = across(w2, x - o2);
    turn[1] = bent(w2, point_of(f.near_arm), arm, splat(f.near_length), length(arm), length(across(w1, u)), signs.elbow,
                   other);
    turn[0] = turn_onto(w1, turned(w2, o2, turn[1], x) - o1, u);
  } else if constexpr (first_three == FirstThree::intersecting_12) {
    // axes 1 and 2 cannot change the distance from where they meet: that fixes axis 3
    const double* at = f.corner;
    const Point y = goal - at;
    const Vec distance = length(y), along = splat(f.offset);
    const Vec reach = root(not_negative((distance - along) * (distance + along)));
    turn[2] = bent(f, w3, reach, signs.elbow, other);
    const Point x = turned(w3, o3, turn[2], c) - at;
    const Point z = between(f.shoulder, w2, x, y, signs.front, fold);
    near = near | (distance <= splat(nothing * f.scale));  // axes 1 and 2 do not move the wrist
    turn[1] = turn_onto(w2, x, z);
    turn[0] = turn_onto(w1, turned(w2, turn[1], x), y);
  } else {
    // axes 2 and 3 cannot change the distance from where they meet: that fixes axis 1, which turns the goal backwards
    const double* at = f.corner;
    const Point v = goal - o1, arm = across(w1, v);
    const Vec along = dot(w1, v) + dot(w1, point_of(o1) - at), distance = splat(f.height);
    const Vec reach = root(not_negative((distance - along) * (distance + along)));
    const Turn back = bent(w1, point_of(f.near_arm), arm, splat(f.near_length), length(arm), reach, signs.elbow, other);
    turn[0] = {back.c, -back.s};
    const Point y = turned_back(w1, turn[0], v) + o1 - at, x = c - at;
    const Point z = between(f.shoulder, w3, x, y, signs.front, fold);
    turn[2] = turn_onto(w3, x, z);
    turn[1] = turn_onto(w2, turned(w3, turn[2], x), y);
  }
  near = near | fold.near | other.near;
}

// Roots of a quartic, one for each pair of branches.
struct Roots {
  double c[branches], s[branches];
  bool close;
};

PIEPER_INLINE Roots spread(const ClosedForm& f, const Wave& wave) {
  double c[4], s[4];
  Roots roots;
  roots.close = real_roots(wave, std::sqrt(fold_of(f).within), c, s);
  for (std::size_t b = 0; b < branches; ++b) roots.c[b] = c[b / 2], roots.s[b] = s[b / 2];
  return roots;
}

inline double dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline void cross3(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}
// direction . R(axis, angle) a = l0 + l1 cos + l2 sin
inline Linear swept(const double* direction, const double* axis, const double* a) {
  double across_axis[3];
  cross3(axis, a, across_axis);
  const double held = dot3(direction, axis) * dot3(axis, a);
  return {{held, dot3(direction, a) - held, dot3(direction, across_axis)}};
}

// Pieper's quartic (1968) for any first three axes. With x = e3 c seen from the foot of the common normal on axis 2, of
// length a and at the angle whose sine is t, turns 1 and 2 leave
//   a (c2 Y + s2 X) = B = (|p - foot 1|^2 - |x|^2 - a^2) / 2,    t (s2 Y - c2 X) = A = w1 . (p - foot 1) - (w1 . w2)(w2
//   . x),
// so that t^2 B^2 + a^2 A^2 = a^2 t^2 (|x|^2 - (w2 . x)^2), a wave of two periods in q3.
struct PieperQuartic {
  Linear A, B;
};

inline PieperQuartic pieper_sides(const ClosedForm& f, const double* goal, Linear& along, Linear& square) {
  const double *w1 = f.axis[0], *w2 = f.axis[1], *w3 = f.axis[2], *o3 = f.point[2];
  double arm[3], start[3], p[3];
  for (int r = 0; r < 3; ++r) arm[r] = f.meet[r] - o3[r], start[r] = o3[r] - f.foot_2[r], p[r] = goal[r] - f.foot_1[r];
  along = swept(w2, w3, arm);
  along.a[0] += dot3(w2, start);
  square = swept(start, w3, arm);
  for (double& k : square.a) k *= 2;
  square.a[0] += dot3(start, start) + dot3(arm, arm);
  const double cosine = dot3(w1, w2), a = f.normal_length;
  PieperQuartic q;
  for (int k = 0; k < 3; ++k) q.A.a[k] = -cosine * along.a[k], q.B.a[k] = -0.5 * square.a[k];
  q.A.a[0] += dot3(w1, p);
  q.B.a[0] += 0.5 * (dot3(p, p) - a * a);
  return q;
}

PIEPER_OUT_OF_LINE Roots pieper_roots(const ClosedForm& f, const double* goal) {
  Linear along, square;
  const PieperQuartic q = pieper_sides(f, goal, along, square);
  const double a2 = f.normal_length * f.normal_length, t2 = f.sine_12 * f.sine_12;
  Wave wave{};
  add_product(wave, t2, q.B, q.B);
  add_product(wave, a2, q.A, q.A);
  add_product(wave, a2 * t2, along, along);
  for (int k = 0; k < 3; ++k) wave.k[k] -= a2 * t2 * square.a[k];
  return spread(f, wave);
}

// The third joint slides: the distance of the wrist centre from where axes 1 and 2 meet is a quadratic in it.
PIEPER_INLINE void place_wrist_by_slide(const ClosedForm& f, const Point& goal, const Signs& signs, Turn* turn,
                                        IntVec& near) {
  const double *w1 = f.axis[0], *w2 = f.axis[1], *along = f.axis[2], *at = f.corner;
  const Point y = goal - at, start = point_of(f.meet) - at;
  const Vec middle = dot(along, start), distance = length(y), off = length(across(along, start));
  Fold fold = fold_of(f), other = fold;
  const Vec half2 = (distance - off) * (distance + off);
  other.near = magnitude(half2) <= other.within * distance * distance;
  const Vec slide = signs.elbow * root(widen(not_negative(half2), other.widened * distance * distance)) - middle;
  turn[2] = {slide, splat(0.0)};
  const Point x = start + scaled(slide, along);
  turn[1] = turn_onto(w2, x, between(f.shoulder, w2, x, y, signs.front, fold));
  turn[0] = turn_onto(w1, turned(w2, turn[1], x), y);
  near = near | fold.near | other.near;
}

PIEPER_INLINE void place_wrist_by_roots(const ClosedForm& f, const Point& goal, const Turn& third, Turn* turn) {
  const double *w1 = f.axis[0], *w2 = f.axis[1], *w3 = f.axis[2];
  turn[2] = third;
  const Point far = turned(w3, f.point[2], third, point_of(f.meet)), x = far - f.foot_2, p = goal - f.foot_1;
  const Vec along = dot(w2, x), X = dot(cross(f.normal, point_of(w2)), x), Y = dot(f.normal, x);
  const Vec a = splat(f.normal_length);
  const Vec U = 0.5 * (dot(p, p) - dot(x, x) - a * a) / a;
  const Vec V = (dot(w1, p) - dot(w1, point_of(w2)) * along) / f.sine_12;
  turn[1] = unit_turn(U * Y - V * X, U * X + V * Y);
  turn[0] = turn_onto(w1, turned(w2, turn[1], x) + f.foot_2 - f.foot_1, p);
}

// Subproblem 6: three parallel axes before two that are skew. Axes 2 to 4 keep heights, so for the direction of axis 6
// and for a point on it, h . R1^T (what the pose makes of it) = h . (what axis 5 makes of it): both sides are waves of
// one period,
//   M (c1, s1) + m = N (c5, s5) + n,
// and N^-1 gives (c5, s5) by (c1, s1); its length is one.
struct Heights {
  Linear pose[2], joint[2];
};

inline Heights heights(const ClosedForm& f, const Displacement& G) {
  const double *w1 = f.axis[0], *h = f.axis[1], *w5 = f.axis[4], *w6 = f.axis[5];
  double d[3], p[3], from_5[3], back[3];
  for (int r = 0; r < 3; ++r) {
    d[r] = G.m[4 * r] * w6[0] + G.m[4 * r + 1] * w6[1] + G.m[4 * r + 2] * w6[2];
    p[r] = G.m[4 * r] * f.meet[0] + G.m[4 * r + 1] * f.meet[1] + G.m[4 * r + 2] * f.meet[2] + G.m[4 * r + 3] -
           f.point[0][r];
    from_5[r] = f.meet[r] - f.point[4][r], back[r] = -w1[r];
  }
  Heights sides{{swept(h, back, d), swept(h, back, p)}, {swept(h, w5, w6), swept(h, w5, from_5)}};
  for (int k = 0; k < 3; ++k) sides.pose[1].a[k] /= f.scale, sides.joint[1].a[k] /= f.scale;
  sides.joint[1].a[0] += (dot3(h, f.point[4]) - dot3(h, f.point[0])) / f.scale;
  return sides;
}

PIEPER_OUT_OF_LINE Roots skew_roots(const ClosedForm& f, const Displacement& G) {
  const Heights side = heights(f, G);
  const double *n1 = side.joint[0].a, *n2 = side.joint[1].a;
  Linear c, s;  // det(N) times (c5, s5)
  const double determinant = n1[1] * n2[2] - n1[2] * n2[1];
  for (int k = 0; k < 3; ++k) {
    const double r1 = side.pose[0].a[k] - (k == 0 ? n1[0] : 0), r2 = side.pose[1].a[k] - (k == 0 ? n2[0] : 0);
    c.a[k] = n2[2] * r1 - n1[2] * r2, s.a[k] = n1[1] * r2 - n2[1] * r1;
  }
  Wave wave{};
  add_product(wave, 1, c, c);
  add_product(wave, 1, s, s);
  wave.k[0] -= determinant * determinant;
  return spread(f, wave);
}

// Turns 4, 5, 6 that leave axis 6 and a vector across it where the pose wants them.
PIEPER_INLINE void turn_wrist(const ClosedForm& f, const Displacement& G, Vec sign, Turn* turn, IntVec& near) {
  const double *w1 = f.axis[0], *w2 = f.axis[1], *w3 = f.axis[2], *w4 = f.axis[3], *w5 = f.axis[4], *w6 = f.axis[5];
  const auto before_wrist = [&](const Point& a) {
    Point b = turned(G, a);
    if (!f.slides[0]) b = turned_back(w2, turn[1], turned_back(w1, turn[0], b));
    return f.slides[2] ? b : turned_back(w3, turn[2], b);
  };
  const Point last = point_of(w6), side = point_of(f.across_last);
  const Point y = before_wrist(last);
  Fold fold = fold_of(f);
  const Point z = between(f.pair, w5, last, y, sign, fold);
  turn[4] = turn_onto(w5, last, z);
  turn[3] = turn_onto(w4, turned(w5, turn[4], last), y);
  turn[5] = turn_onto(w6, side, turned_back(w5, turn[4], turned_back(w4, turn[3], before_wrist(side))));
  near = near | fold.near;
}

// Turns 2, 3, 4 of three parallel axes, once the rest of the arm stands: `back` undoes what lies before and behind.
template <class Back, class BackDirection>
PIEPER_INLINE void turn_three(const ClosedForm& f, Back back, BackDirection back_direction, Vec sign, Turn* turn,
                              Fold& fold) {
  const double *w2 = f.axis[1], *w3 = f.axis[2], *w4 = f.axis[3];
  const double *o2 = f.point[1], *o3 = f.point[2];
  const Point o4 = point_of(f.point[3]);
  const Point u = back(o4) - o2;
  turn[2] = bent(f, w3, length(across(w2, u)), sign, fold);
  turn[1] = turn_onto(w2, turned(w3, o3, turn[2], o4) - o2, u);
  const Point side = point_of(f.across_last);
  turn[3] = turn_onto(w4, side, turned_back(w3, turn[2], turned_back(w2, turn[1], back_direction(side))));
}

// Axes 4 and 6 in one line with axis 6 free: turns axis 6 such that the elbow can reach, where it cannot as it stands.
// The squared distance that the elbow has to span is A + B cos q6 + C sin q6; three values give A, B and C.
template <class Reach>
PIEPER_OUT_OF_LINE Turn free_turn(const ClosedForm& f, IntVec free, const Turn& as_it_is, Reach reach_square) {
  const Vec least = splat(f.near_length > f.far_length ? f.near_length - f.far_length : f.far_length - f.near_length);
  const Vec most = splat(f.near_length + f.far_length);
  const Vec now = reach_square(as_it_is);
  const IntVec fits = (now >= least * least) & (now <= most * most);
  const Vec one = splat(1.0), zero = splat(0.0);
  const Vec at_0 = reach_square({one, zero}), at_half = reach_square({-one, zero}),
            at_quarter = reach_square({zero, one});
  const Vec A = 0.5 * (at_0 + at_half), B = 0.5 * (at_0 - at_half), C = at_quarter - A;
  const Vec size = root(B * B + C * C);
  const Vec low = larger(least * least, A - size), high = smaller(most * most, A + size);
  const Vec cosine = larger(smaller((0.5 * (low + high) - A) / select(size > 0.0, size, one), one), -one);
  const Vec sine = root(not_negative((1.0 - cosine) * (1.0 + cosine)));
  const Turn chosen = unit_turn(B * cosine - C * sine, C * cosine + B * sine);
  const IntVec change = free & ~fits;
  return {select(change, chosen.c, as_it_is.c), select(change, chosen.s, as_it_is.s)};
}

// Parallel axes alone, in slots 1 to 3: heights along them are left to the slide.
PIEPER_INLINE void planar(const ClosedForm& f, const Displacement& G, const Signs& signs, Turn* turn, IntVec& near) {
  const double *w2 = f.axis[1], *w3 = f.axis[2], *o2 = f.point[1];
  if (f.joint_of[0] >= 0)
    turn[0] = {splat(f.axis[0][0] * G.m[3] + f.axis[0][1] * G.m[7] + f.axis[0][2] * G.m[11]), splat(0.0)};
  if (f.uses_elbow) {
    Fold elbow = fold_of(f);
    turn_three(
        f, [&](const Point& a) { return moved(G, a); }, [&](const Point& a) { return turned(G, a); }, signs.elbow, turn,
        elbow);
    near = near | elbow.near;
    return;
  }
  const Point o3 = point_of(f.point[2]), side = point_of(f.across_last);
  turn[1] = turn_onto(w2, o3 - o2, moved(G, o3) - o2);
  turn[2] = turn_onto(w3, side, turned_back(w2, turn[1], turned(G, side)));
}

// Three slides carry up to three axes: the axes follow from the rotation, the slides from what is left of the position.
PIEPER_INLINE void gantry(const ClosedForm& f, const Displacement& G, const Signs& signs, Turn* turn, IntVec& near) {
  if (f.joints == 6) {
    turn_wrist(f, G, signs.wrist, turn, near);
  } else if (f.joints == 5) {
    const Point last = point_of(f.axis[4]), side = point_of(f.across_last);
    turn[3] = turn_onto(f.axis[3], last, turned(G, last));
    turn[4] = turn_onto(f.axis[4], side, turned_back(f.axis[3], turn[3], turned(G, side)));
  } else if (f.joints == 4) {
    const Point side = point_of(f.across_last);
    turn[3] = turn_onto(f.axis[3], side, turned(G, side));
  }
  Point a{splat(0.0), splat(0.0), splat(0.0)};
  for (std::size_t i = f.joints; i-- > 3;) a = turned(f.axis[i], f.point[i], turn[i], a);
  const Point left = Point{splat(G.m[3]), splat(G.m[7]), splat(G.m[11])} - a;
  for (int i = 0; i < 3; ++i) turn[i] = {dot(f.unmix + 3 * i, left), splat(0.0)};
}

PIEPER_INLINE void three_parallel_6(const ClosedForm& f, const Displacement& G, const Signs& signs, Turn* turn,
                                    IntVec& near) {
  const double *w1 = f.axis[0], *h = f.axis[1], *w5 = f.axis[4], *w6 = f.axis[5], *o1 = f.point[0], *c = f.meet;
  Fold front = fold_of(f), wrist = front, elbow = front;
  // axes 5 and 6 leave the point where they meet, axes 2 to 4 cannot change its height: that fixes axis 1
  const Point v = moved(G, point_of(c)) - o1;
  turn[0] = turn_onto(w1, at_height(f.front, v, splat(f.height), signs.front, front), v);
  // axes 2 to 4 leave their own direction, so R5 R6 n = h with n = R^T R1 h
  const Point n = turned_back(G, turned(w1, turn[0], point_of(h)));
  const Point z = between(f.pair, w6, n, point_of(h), signs.wrist, wrist);
  turn[5] = turn_onto(w6, n, z);
  turn[4] = turn_onto(w5, turned(w6, turn[5], n), point_of(h));
  const auto back_by = [&](const Turn& last, const Point& a) {
    const Point before = turned_back(w6, last, turned_back(w5, turn[4], a - c)) + c;
    return turned_back(w1, turn[0], moved(G, before) - o1) + o1;
  };
  const Point out = across(w6, n);
  constexpr double free_square = 1e-22;  // an axis off by 1e-11 rad is off by no more than that in the pose
  const IntVec free = dot(out, out) <= free_square;
  if (any(free))
    turn[5] = free_turn(f, free, turn[5], [&](const Turn& last) {
      const Point u = across(h, back_by(last, point_of(f.point[3])) - f.point[1]);
      return dot(u, u);
    });
  turn_three(
      f, [&](const Point& a) { return back_by(turn[5], a); },
      [&](const Point& a) {
        return turned_back(w1, turn[0], turned(G, turned_back(w6, turn[5], turned_back(w5, turn[4], a))));
      },
      signs.elbow, turn, elbow);
  near = near | front.near | wrist.near | elbow.near;
}

// Five joints: a pose that the arm can reach leaves two equations for axis 1, the height of a point on axis 5 and that
// of its direction; the one that tells more is taken. Signs are those of the point, so that a branch stays itself when the
// equations change places.
PIEPER_INLINE void three_parallel_5(const ClosedForm& f, const Displacement& G, const Signs& signs, Turn* turn,
                                    IntVec& near) {
  const double *w1 = f.axis[0], *h = f.axis[1], *w5 = f.axis[4], *o1 = f.point[0], *o5 = f.meet;
  Fold by_point = fold_of(f), by_direction = by_point, elbow = by_point;
  const Point v = moved(G, point_of(o5)) - o1, d = turned(G, point_of(w5));
  const Point z = at_height(f.front, v, splat(f.height), signs.front, by_point);
  const Point e = at_height(f.front, d, dot(h, point_of(w5)), signs.front, by_direction);
  const Vec along_z = dot(f.front.f, z), along_e = dot(f.front.f, e);
  const Point z_other = z - scaled(2.0 * along_z, f.front.f), e_other = e - scaled(2.0 * along_e, f.front.f);
  const Turn a = turn_onto(w1, z, v), b = turn_onto(w1, e, d);
  const Turn a_other = turn_onto(w1, z_other, v), b_other = turn_onto(w1, e_other, d);
  const auto alike = [](const Turn& one, const Turn& other) { return one.c * other.c + one.s * other.s; };
  const IntVec same = alike(a, b) + alike(a_other, b_other) >= alike(a, b_other) + alike(a_other, b);
  const Turn by_d{select(same, b.c, b_other.c), select(same, b.s, b_other.s)};
  const IntVec use = magnitude(along_z) >= f.scale * magnitude(along_e);
  turn[0] = {select(use, a.c, by_d.c), select(use, a.s, by_d.s)};
  const Point n = turned_back(G, turned(w1, turn[0], point_of(h)));
  turn[4] = turn_onto(w5, n, point_of(h));
  turn_three(
      f,
      [&](const Point& p) {
        return turned_back(w1, turn[0], moved(G, turned_back(w5, turn[4], p - o5) + o5) - o1) + o1;
      },
      [&](const Point& p) { return turned_back(w1, turn[0], turned(G, turned_back(w5, turn[4], p))); }, signs.elbow,
      turn, elbow);
  near = near | (by_point.near & by_direction.near) | elbow.near;
}

PIEPER_INLINE void three_parallel_skew(const ClosedForm& f, const Displacement& G, const Turn& first, Vec sign,
                                       Turn* turn, IntVec& near) {
  const double *w1 = f.axis[0], *h = f.axis[1], *w5 = f.axis[4], *w6 = f.axis[5], *o1 = f.point[0], *o5 = f.point[4],
               *o6 = f.point[5];
  turn[0] = first;
  const Heights side = heights(f, G);
  Vec r[2];
  for (int k = 0; k < 2; ++k) {
    const double* pose = side.pose[k].a;
    r[k] = pose[0] - side.joint[k].a[0] + pose[1] * first.c + pose[2] * first.s;
  }
  const double *n1 = side.joint[0].a, *n2 = side.joint[1].a;
  const double facing = n1[1] * n2[2] - n1[2] * n2[1] < 0 ? -1.0 : 1.0;
  turn[4] = unit_turn(facing * (n2[2] * r[0] - n1[2] * r[1]), facing * (n1[1] * r[1] - n2[1] * r[0]));
  const Point n = turned_back(G, turned(w1, turn[0], point_of(h)));
  turn[5] = turn_onto(w6, n, turned_back(w5, turn[4], point_of(h)));
  const auto back_by = [&](const Turn& last, const Point& a) {
    const Point before = turned_back(w6, o6, last, turned_back(w5, o5, turn[4], a));
    return turned_back(w1, o1, turn[0], moved(G, before));
  };
  // where axis 6 becomes parallel to axis 4 two roots meet, and are found to half of the digits
  constexpr double free_square = 1e-12;
  const Point out = across(w6, n);
  const IntVec free = dot(out, out) <= free_square;
  if (any(free))
    turn[5] = free_turn(f, free, turn[5], [&](const Turn& last) {
      const Point u = across(h, back_by(last, point_of(f.point[3])) - f.point[1]);
      return dot(u, u);
    });
  Fold elbow = fold_of(f);
  turn_three(
      f, [&](const Point& a) { return back_by(turn[5], a); },
      [&](const Point& a) {
        return turned_back(w1, turn[0], turned(G, turned_back(w6, turn[5], turned_back(w5, turn[4], a))));
      },
      sign, turn, elbow);
  near = near | elbow.near;
}

// Joint values of the branches in one vector; `near` where two of them may be the same.
PIEPER_INLINE void branch_turns(const ClosedForm& f, const Displacement& G, const Signs& signs, const Turn& root,
                                Turn* turn, IntVec& near) {
  if (f.family == ClosedFormFamily::planar) return planar(f, G, signs, turn, near);
  if (f.family == ClosedFormFamily::gantry) return gantry(f, G, signs, turn, near);
  if (f.family == ClosedFormFamily::three_parallel_skew)
    return three_parallel_skew(f, G, root, signs.wrist, turn, near);
  if (f.family == ClosedFormFamily::three_parallel) {
    if (f.joints == 6) return three_parallel_6(f, G, signs, turn, near);
    return three_parallel_5(f, G, signs, turn, near);
  }
  const Point goal = moved(G, point_of(f.meet));
  switch (f.first_three) {
    case FirstThree::parallel_23:
      place_wrist<FirstThree::parallel_23>(f, goal, signs, turn, near);
      break;
    case FirstThree::parallel_12:
      place_wrist<FirstThree::parallel_12>(f, goal, signs, turn, near);
      break;
    case FirstThree::intersecting_12:
      place_wrist<FirstThree::intersecting_12>(f, goal, signs, turn, near);
      break;
    case FirstThree::intersecting_23:
      place_wrist<FirstThree::intersecting_23>(f, goal, signs, turn, near);
      break;
    case FirstThree::sliding_3:
      place_wrist_by_slide(f, goal, signs, turn, near);
      break;
    case FirstThree::general:
      place_wrist_by_roots(f, goal, root, turn);
      break;
  }
  turn_wrist(f, G, signs.wrist, turn, near);
}

struct Measured {
  Vec position, rotation;  // [m], [rad]
};

// What the arm itself makes of joint values in [-pi, pi].
PIEPER_INLINE Measured measure(const Folded& chain, const double* T, const Vec* q) {
  JointState<Vec> state;
  states_of_lanes(chain, chain.count, q, state);
  const Pose<Vec> tip = tip_pose(chain, state);
  const Point off{tip.p[0] - T[3], tip.p[1] - T[7], tip.p[2] - T[11]};
  const Vec* columns[3] = {tip.x, tip.y, tip.z};
  Point sine{splat(0.0), splat(0.0), splat(0.0)};
  Vec cosine = splat(-1.0);
  for (int k = 0; k < 3; ++k) {
    const Vec* a = columns[k];
    const double t[3] = {T[k], T[4 + k], T[8 + k]};
    sine.x += a[1] * t[2] - a[2] * t[1];
    sine.y += a[2] * t[0] - a[0] * t[2];
    sine.z += a[0] * t[1] - a[1] * t[0];
    cosine += a[0] * t[0] + a[1] * t[1] + a[2] * t[2];
  }
  return {length(off), arctangent(length(sine), cosine)};  // both of twice the size
}

// The step of Gauss and Newton for fewer than six joints, (J^T J + damping I)^-1 J^T e: J J^T is never regular there.
PIEPER_INLINE void newton_step(const Columns& columns, std::size_t n, const Vec* e, Vec damping, Vec* step) {
  Vec A[6][6], inverse[6];
  for (std::size_t r = 0; r < n; ++r) {
    for (std::size_t c = 0; c <= r; ++c) {
      A[r][c] = columns[r][0] * columns[c][0];
      for (int k = 1; k < 6; ++k) A[r][c] += columns[r][k] * columns[c][k];
    }
    A[r][r] += damping;
    step[r] = columns[r][0] * e[0];
    for (int k = 1; k < 6; ++k) step[r] += columns[r][k] * e[k];
  }
  for (std::size_t k = 0; k < n; ++k) {
    inverse[k] = 1.0 / A[k][k];
    for (std::size_t r = k + 1; r < n; ++r) {
      const Vec factor = A[r][k] * inverse[k];
      for (std::size_t c = k + 1; c <= r; ++c) A[r][c] -= factor * A[c][k];
      step[r] -= factor * step[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t r = k + 1; r < n; ++r) step[k] -= A[r][k] * step[r];
    step[k] *= inverse[k];
  }
}

// Newton's method on the arm itself for lanes whose error is small but not that of rounding.
PIEPER_OUT_OF_LINE void polish(const Folded& chain, const ClosedForm& f, const double* T, Vec* q, Measured& m) {
  const Goal goal = goal_of(T, TargetRows{});
  SearchSpace space;
  space.joints = chain.count;
  const std::size_t n = chain.count;
  constexpr int most_steps = 12;
  constexpr double settled = 1e-28;
  Vec best[6], at[6], least = splat(1e300);
  for (std::size_t i = 0; i < n; ++i) at[i] = best[i] = q[i];
  const double capture = f.capture * f.capture;
  for (int step = 0;; ++step) {
    Columns columns;
    const Errors errors = evaluate(chain, space, goal, at, columns);
    const IntVec better = errors.cost < least;
    for (std::size_t i = 0; i < n; ++i) best[i] = select(better, at[i], best[i]);
    const Vec before = least;
    least = select(better, errors.cost, least);
    // goes on where there is something to win and the last step won something
    const IntVec going = (least > settled) & (least < capture) & (least < 0.9 * before);
    if (step == most_steps || !any(going)) break;
    Vec dq[6];
    const Vec damping = 0.01 * errors.cost + 1e-17;
    if (n < 6) {
      newton_step(columns, n, errors.rows, damping, dq);
    } else {  // at a singular pose what rounding adds to (J J^T)^-1 e is mostly lost in J^T
      damped_step(columns, n, errors.rows, damping, dq);
    }
    for (std::size_t i = 0; i < n; ++i) {
      constexpr double longest = 0.3;
      at[i] = select(going, at[i] + larger(smaller(dq[i], splat(longest)), splat(-longest)), best[i]);
    }
  }
  constexpr double turn = 0x1.921fb54442d18p+2;
  for (std::size_t i = 0; i < n; ++i) {
    q[i] = best[i];
    if (!chain.axes[i].revolute) continue;
    const Vec back = select(best[i] > 0.5 * turn, best[i] - turn, best[i]);
    q[i] = select(back < -0.5 * turn, back + turn, back);
  }
  m = measure(chain, T, q);
}

// Marks answers that repeat an earlier one.
PIEPER_OUT_OF_LINE void drop_repeated(const Folded& chain, std::size_t n, const double* q /* (8, n) */, bool* valid) {
  constexpr double same = 1e-7;  // rad or m; at a fold rounding of the pose moves an answer by 1e-8
  constexpr double turn = 0x1.921fb54442d18p+2;
  for (std::size_t b = 1; b < branches; ++b)
    for (std::size_t a = 0; a < b && valid[b]; ++a) {
      if (!valid[a]) continue;
      bool equal = true;
      for (std::size_t i = 0; equal && i < n; ++i) {
        double apart = std::fabs(q[a * n + i] - q[b * n + i]);
        if (chain.axes[i].revolute && apart > 0.5 * turn) apart = turn - apart;
        equal = apart < same;
      }
      if (equal) valid[b] = false;
    }
}

constexpr double rounding = 1e-12;  // of a pose that needs no polish, times the size of the arm

void solve_closed_form_of(const Folded& chain, const ClosedForm& f, const ClosedFormOptions& options,
                          const double* targets, std::size_t count, const ClosedFormResults& out) {
  const std::size_t n = f.joints;
  const double length_unit = f.scale > 1.0 ? f.scale : 1.0;
  for (std::size_t k = 0; k < count; ++k) {
    const double* T = targets + 16 * k;
    const Displacement G = displacement(f, T);
    double* q_out = out.q + k * branches * n;
    bool* valid = out.valid + k * branches;
    IntVec near = bits(splat(0.0));
    bool polished = false, doubtful = false;
    Roots roots{};
    if (f.family == ClosedFormFamily::three_parallel_skew) {
      roots = skew_roots(f, G);
    } else if (f.family == ClosedFormFamily::spherical_wrist && f.first_three == FirstThree::general) {
      double goal[3];
      for (int r = 0; r < 3; ++r)
        goal[r] = G.m[4 * r] * f.meet[0] + G.m[4 * r + 1] * f.meet[1] + G.m[4 * r + 2] * f.meet[2] + G.m[4 * r + 3];
      roots = pieper_roots(f, goal);
    }
    for (std::size_t part = 0; part < parts; ++part) {
      const std::size_t first = part * lanes;
      const Signs signs{load(branch_signs[0] + first), load(branch_signs[1] + first), load(branch_signs[2] + first)};
      Turn turn[6];
      const Turn root{load(roots.c + first), load(roots.s + first)};
      branch_turns(f, G, signs, root, turn, near);
      Vec q[6];
      for (std::size_t i = 0; i < 6; ++i)
        if (f.joint_of[i] >= 0) q[f.joint_of[i]] = f.slides[i] ? turn[i].c : arctangent(turn[i].s, turn[i].c);
      Measured m = measure(chain, T, q);
      const IntVec rough = (m.position > rounding * length_unit) | (m.rotation > rounding);
      const IntVec close = (m.position <= f.capture * f.scale) & (m.rotation <= f.capture);
      // off by what the difference of the arms can make of an ideal arm's answer; else by what rounding can, where several
      // folds come together
      constexpr double enlarged = 2500, rounded = 1e-5;
      const double most = enlarged * f.widened < f.capture ? enlarged * f.widened : f.capture;
      const double off = f.widened > 0 ? most : rounded;
      const IntVec expected = (m.position <= off * f.scale) & (m.rotation <= off);
      IntVec lost_way = bits(splat(0.0));
      if (any(rough & close)) {
        Vec start[6];
        for (std::size_t i = 0; i < n; ++i) start[i] = q[i];
        polish(chain, f, T, q, m), polished = true;
        for (std::size_t i = 0; i < n; ++i) {  // further than an answer of the ideal arm is from one of the arm
          constexpr double far = 0.1, turn = 0x1.921fb54442d18p+2;
          const Vec way = magnitude(q[i] - start[i]);
          lost_way = lost_way | ((way > far) & (magnitude(way - turn) > far));
        }
      }
      IntVec good = (m.position <= options.position_tolerance) & (m.rotation <= options.rotation_tolerance);
      IntVec used = signs.front == signs.front;
      if (!f.uses_front) used = used & (signs.front > 0.0);
      if (!f.uses_elbow) used = used & (signs.elbow > 0.0);
      if (!f.uses_wrist) used = used & (signs.wrist > 0.0);
      // with fewer than six joints most such answers are none of the arm's, which meets six equations
      if (n == 6 && any(used & expected & (good == 0))) doubtful = true;
      if (f.widened > 0 && n == 6 && any(used & close & lost_way)) doubtful = true;
      good = good & used;
      const Vec nan = splat(static_cast<double>(NAN));
      for (std::size_t i = 0; i < n; ++i) q[i] = select(good, q[i], nan);
      scatter(q, n, q_out + first * n, n, false);
      store(out.position_error + k * branches + first, select(good, m.position, nan));
      store(out.rotation_error + k * branches + first, select(good, m.rotation, nan));
      for (std::size_t l = 0; l < lanes; ++l) valid[first + l] = get(good, l);
    }
    bool found = false;
    for (std::size_t b = 0; b < branches; ++b) found = found || valid[b];
    // at a fold, or where a stage leaves a turn free, nothing found does not mean that there is nothing
    const bool unsure = f.widened > 0 || (n == 6 && !found);
    out.doubtful[k] = doubtful || (unsure && (any(near) || roots.close));
    if (out.singular) out.singular[k] = any(near);
    const bool by_roots = f.family == ClosedFormFamily::three_parallel_skew || f.first_three == FirstThree::general;
    if (polished || by_roots || any(near)) {
      bool before[branches];
      for (std::size_t b = 0; b < branches; ++b) before[b] = valid[b];
      drop_repeated(chain, n, q_out, valid);
      for (std::size_t b = 0; b < branches; ++b)
        if (before[b] && !valid[b]) {
          if (f.widened > 0) out.doubtful[k] = true;
          for (std::size_t i = 0; i < n; ++i) q_out[b * n + i] = static_cast<double>(NAN);
          out.position_error[k * branches + b] = out.rotation_error[k * branches + b] = static_cast<double>(NAN);
        }
    }
  }
}

}  // namespace
