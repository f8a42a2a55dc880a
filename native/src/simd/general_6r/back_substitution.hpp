// From a null vector to the cosines and sines of all six joints, one start per lane.
#pragma once

#include "simd/general_6r/null_vectors.hpp"

namespace {

// Joint cosines and sines in the order of the arm, in the frames of GeneralArm; 0 and d of a prismatic joint.
struct Joints {
  Vec c[6], s[6];
};

PIEPER_INLINE void turn_z(Vec c, Vec s, Vec* v) {
  const Vec x = c * v[0] - s * v[1];
  v[1] = s * v[0] + c * v[1], v[0] = x;
}

PIEPER_INLINE void rotate(const double* K, Vec* v) {
  const Vec x = v[0], y = v[1], z = v[2];
  for (int r = 0; r < 3; ++r) v[r] = K[4 * r] * x + K[4 * r + 1] * y + K[4 * r + 2] * z;
}

PIEPER_INLINE void rotate_back(const double* K, Vec* v) {
  const Vec x = v[0], y = v[1], z = v[2];
  for (int c = 0; c < 3; ++c) v[c] = K[c] * x + K[4 + c] * y + K[8 + c] * z;
}

PIEPER_INLINE void translate(const double* K, Vec* p) {
  for (int r = 0; r < 3; ++r) p[r] += K[4 * r + 3];
}

PIEPER_INLINE void normalise_pair(Vec& c, Vec& s) {
  const Vec inverse = 1.0 / square_root(c * c + s * s + 1e-300);
  c *= inverse, s *= inverse;
}

PIEPER_INLINE void back_substitute(const LoopForm& form, const Equations& equations, const Vec* row, Joints& out) {
  const Vec c3 = row[0], s3 = row[1];
  const Vec *u = row + 2, *l = row + 5;
  const Vec uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2], ll = l[0] * l[0] + l[1] * l[1] + l[2] * l[2];
  const Vec ul = u[0] * l[0] + u[1] * l[1] + u[2] * l[2];
  Vec c4 = ll - uu, s4 = 2.0 * ul;
  normalise_pair(c4, s4);
  // half of angle 4, from the larger of cosine and sine
  const Vec big = square_root(0.5 + 0.5 * magnitude(c4)), small = 0.5 * s4 / big;
  const Vec k = select(c4 >= 0.0, big, small), h = select(c4 >= 0.0, small, big);
  Vec b[3];
  for (int i = 0; i < 3; ++i) b[i] = h * u[i] + k * l[i];
  const Vec total = b[0] + b[2], sign = select(total < 0.0, splat(-1.0), splat(1.0));
  Vec c5 = (b[2] - b[0]) * sign, s5 = 1.4142135623730951 * b[1] * sign;
  normalise_pair(c5, s5);
  // the displacement of a slide stands for the tangent of the half angle
  const int slide = form.slide;
  Vec d = splat(0.0);
  if (slide == 4) d = h / with_sign(larger(magnitude(k), splat(1e-12)), k);
  if (slide == 5)
    d = select(c5 > 0.0, s5 / larger(1.0 + c5, splat(1e-3)),
               (1.0 - c5) / with_sign(larger(magnitude(s5), splat(1e-12)), s5));

  // the left line in the frame after K2, and the x axis of its frame
  Vec z[3], p[3], x[3];
  for (int r = 0; r < 3; ++r) {
    x[r] = splat(form.K5[4 * r]), z[r] = splat(form.K5[4 * r + 2]), p[r] = splat(form.K5[4 * r + 3]);
  }
  const auto step = [&](int joint, Vec c, Vec s, const double* K) {
    if (joint == slide)
      p[2] += d;
    else
      turn_z(c, s, x), turn_z(c, s, z), turn_z(c, s, p);
    rotate(K, x), rotate(K, z), rotate(K, p);
    translate(K, p);
  };
  step(5, c5, s5, form.K4);
  step(4, c4, s4, form.K3);
  step(3, c3, s3, equations.K2);

  const Vec pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], pl = p[0] * z[0] + p[1] * z[1] + p[2] * z[2];
  const Vec m[3] = {p[1] * z[2] - p[2] * z[1], p[2] * z[0] - p[0] * z[2], p[0] * z[1] - p[1] * z[0]};
  const auto number_h = [&](int r) { return pp * z[r] - 2.0 * pl * p[r]; };
  Vec left[6] = {z[2], p[2], pp, pl, m[2], number_h(2)};
  if (slide == 2) left[0] = z[0], left[1] = z[1], left[2] = z[2], left[3] = p[0], left[4] = p[1];
  Vec c1 = splat(0.0), s1 = splat(0.0);
  for (int i = 0; i < 6; ++i) {
    const Vec apart = left[i] - equations.z0[i];
    c1 += equations.pseudo_inverse[0][i] * apart, s1 += equations.pseudo_inverse[1][i] * apart;
  }
  if (slide == 1)
    d = c1, s1 = d * d;  // (d1, d1^2) stands for (cos t1, sin t1)
  else
    normalise_pair(c1, s1);
  const Vec pairs[4][2] = {{z[0], z[1]}, {p[0], p[1]}, {m[0], m[1]}, {number_h(0), number_h(1)}};
  Vec c2 = splat(0.0), s2 = splat(0.0);  // e^{-i t2} = sum conj(right) left
  for (int i = 0; i < 4; ++i) {
    const auto& P = equations.pairs;
    const Vec re = P[0][i][0] + P[1][i][0] * c1 + P[2][i][0] * s1, im = P[0][i][1] + P[1][i][1] * c1 + P[2][i][1] * s1;
    c2 += re * pairs[i][0] + im * pairs[i][1];
    s2 -= re * pairs[i][1] - im * pairs[i][0];
  }
  normalise_pair(c2, s2);
  if (slide == 2)
    d = equations.before_slide[0] + equations.before_slide[1] * c1 + equations.before_slide[2] * s1 - p[2];
  // K6 Rz1 K1 Rz2 (left frame) = Rz(-t6): its x axis is (cos t6, -sin t6, 0)
  if (slide != 2) turn_z(c2, s2, x);
  rotate_back(equations.K1_inverse, x);
  if (slide != 1) turn_z(c1, s1, x);
  rotate_back(equations.K6_inverse, x);
  Vec c6 = x[0], s6 = -x[1];
  normalise_pair(c6, s6);

  // the generic turns were part of K3 and K4
  const Vec t4c = c4 * turn_4_cosine - s4 * turn_4_sine, t4s = s4 * turn_4_cosine + c4 * turn_4_sine;
  const Vec t5c = c5 * turn_5_cosine - s5 * turn_5_sine, t5s = s5 * turn_5_cosine + c5 * turn_5_sine;
  Vec c[6] = {c1, c2, c3, t4c, t5c, c6}, s[6] = {s1, s2, s3, t4s, t5s, s6};
  if (slide) {
    if (slide == 4) d += turn_4;
    if (slide == 5) d += turn_5;
    c[slide - 1] = splat(0.0), s[slide - 1] = d;
  }
  for (int i = 0; i < 6; ++i) {
    const int joint = (i + form.shift) % 6;
    if (form.reversed)
      out.c[5 - joint] = c[i], out.s[5 - joint] = -s[i];
    else
      out.c[joint] = c[i], out.s[joint] = s[i];
  }
}

}  // namespace
