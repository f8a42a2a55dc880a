// Rigid motions, 3x4 row-major, and those of an arm in its own frames.
#pragma once

#include <array>
#include <cmath>

#include "pieper/general_6r.hpp"
#include "vec3.hpp"

namespace pieper {

using Motion = std::array<double, 12>;

inline bool slides_along(const double* screw) { return screw[3] == 0 && screw[4] == 0 && screw[5] == 0; }

inline Motion operator*(const Motion& a, const Motion& b) {
  Motion c;
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 4; ++k) {
      double sum = k == 3 ? a[4 * r + 3] : 0.0;
      for (int j = 0; j < 3; ++j) sum += a[4 * r + j] * b[4 * j + k];
      c[4 * r + k] = sum;
    }
  return c;
}

inline Motion inverse(const Motion& K) {
  Motion out;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out[4 * r + c] = K[4 * c + r];
    out[4 * r + 3] = -(K[r] * K[3] + K[4 + r] * K[7] + K[8 + r] * K[11]);
  }
  return out;
}

inline Motion turn_about_z(double c, double s) { return {c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0}; }

inline Motion slide_along_z(double d) { return {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, d}; }

inline Motion motion_of(const JointStep& s) {
  return {1, 0, 0, s.x, 0, s.cos_twist, -s.sin_twist, s.y, 0, s.sin_twist, s.cos_twist, s.z};
}

inline Motion motion_of_joint(const GeneralArm& arm, int i, double c, double s) {
  return i == arm.slide ? slide_along_z(s) * turn_about_z(arm.slide_cosine, arm.slide_sine) : turn_about_z(c, s);
}

// The joint, then the step, for all joints.
inline Motion product(const GeneralArm& arm, const double* c, const double* s) {
  Motion T = motion_of_joint(arm, 0, c[0], s[0]);
  for (int i = 1; i < 6; ++i) T = T * motion_of(arm.steps[i - 1]) * motion_of_joint(arm, i, c[i], s[i]);
  return T;
}

// Of a twist, linear part first: to first order in the translation.
inline Motion small_motion(const double* twist) {
  const Vec3 w{twist[3], twist[4], twist[5]};
  const double angle = norm(w);
  const double s = std::sin(angle) / angle, c = (1 - std::cos(angle)) / (angle * angle);
  Motion out;
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) {
      const double W = r == k ? 0 : ((k - r + 3) % 3 == 1 ? -w[3 - r - k] : w[3 - r - k]);
      out[4 * r + k] = (r == k ? 1 - c * angle * angle : 0.0) + s * W + c * w[r] * w[k];
    }
    out[4 * r + 3] = twist[r];
  }
  return out;
}

}  // namespace pieper
