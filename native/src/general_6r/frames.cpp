// The frames of an arm on its axes, and its targets in them.
#include <algorithm>
#include <cmath>

#include "general_6r/motion.hpp"
#include "pieper/general_6r.hpp"

namespace pieper {
namespace {

// Below this sine of the angle between two axes the foot of their common normal may lie far away.
constexpr double clearly_skew = 0.1;
constexpr double no_angle = 5e-15;
constexpr double least_scale = 1e-4;            // [m] that stand for 1 in the equations
constexpr double least_scale_of_extent = 1e-5;  // the same, of the largest coordinate

Vec3 perpendicular(const Vec3& a, const Vec3& z) {
  const Vec3 once = unit(a - dot(a, z) * z);
  return unit(once - dot(once, z) * z);
}

struct JointFrame {
  Vec3 x, z, origin;
};

Motion motion_of(const JointFrame& f) {
  const Vec3 y = cross(f.z, f.x);
  Motion out;
  for (int r = 0; r < 3; ++r)
    out[4 * r] = f.x[r], out[4 * r + 1] = y[r], out[4 * r + 2] = f.z[r], out[4 * r + 3] = f.origin[r];
  return out;
}

}  // namespace

// Frames on the axes after Denavit and Hartenberg, where the common normals are well defined.
void General6R::set_frames() {
  Vec3 z[6], point[6];
  for (std::size_t i = 0; i < 6; ++i) {
    const double* screw = chain_.screw(i);
    if (slides_along(screw)) {
      arm_.slide = static_cast<int>(i);
      z[i] = unit({screw[0], screw[1], screw[2]});
      continue;
    }
    z[i] = unit({screw[3], screw[4], screw[5]});
    point[i] = cross(z[i], {screw[0], screw[1], screw[2]});
  }
  if (arm_.slide == 0) point[0] = point[1];  // any line will do
  JointFrame frames[6];
  // the point of axis b nearest to axis a, or to a point when they are nearly parallel
  const auto foot = [&](std::size_t a, std::size_t b, const Vec3& near) {
    const Vec3 normal = cross(z[a], z[b]);
    const double sine2 = dot(normal, normal);
    if (sine2 < clearly_skew * clearly_skew) return point[b] + dot(near - point[b], z[b]) * z[b];
    const Vec3 across = point[a] - point[b];
    return point[b] + (dot(cross(across, z[a]), cross(z[b], z[a])) / sine2) * z[b];
  };
  frames[0].z = z[0];
  frames[0].origin = foot(1, 0, point[1]);
  frames[0].x = perpendicular(std::abs(z[0][0]) < 0.8 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}, z[0]);
  double length = 0;
  for (std::size_t i = 0; i < 5; ++i) {
    const JointFrame& from = frames[i];
    JointFrame& to = frames[i + 1];
    to.z = z[i + 1];
    if (arm_.slide == static_cast<int>(i) + 1) point[i + 1] = from.origin;
    to.origin = foot(i, i + 1, from.origin);
    const Vec3 normal = cross(from.z, to.z), step = to.origin - from.origin;
    const Vec3 aside = step - dot(step, from.z) * from.z;
    if (norm(normal) >= no_angle)
      to.x = perpendicular(normal, to.z);
    else
      to.x = norm(aside) > 1e-12 ? perpendicular(aside, to.z) : perpendicular(from.x, to.z);
    const Vec3 y = cross(from.z, from.x), after_y = cross(from.z, to.x);
    offset_[i] = std::atan2(dot(to.x, y), dot(to.x, from.x));
    const double cosine = dot(to.z, from.z), sine = -dot(to.z, after_y), size = std::hypot(cosine, sine);
    JointStep& out = arm_.steps[i];
    out = {dot(step, to.x), dot(step, after_y), dot(step, from.z), cosine / size, sine / size};
    if (std::abs(out.sin_twist) < no_angle) out.sin_twist = 0, out.cos_twist = out.cos_twist < 0 ? -1 : 1;
    if (std::abs(out.cos_twist) < no_angle) out.cos_twist = 0, out.sin_twist = out.sin_twist < 0 ? -1 : 1;
    length += norm(step);
  }
  offset_[5] = 0;
  double low = 0, high = 0;
  if (arm_.slide >= 0) {
    double& offset = offset_[arm_.slide];
    arm_.slide_cosine = std::cos(offset), arm_.slide_sine = std::sin(offset), offset = 0;
    if (std::abs(arm_.slide_sine) < no_angle) arm_.slide_sine = 0, arm_.slide_cosine = arm_.slide_cosine < 0 ? -1 : 1;
    if (std::abs(arm_.slide_cosine) < no_angle) arm_.slide_cosine = 0, arm_.slide_sine = arm_.slide_sine < 0 ? -1 : 1;
    low = chain_.lower(arm_.slide), high = chain_.upper(arm_.slide);
    if (!std::isfinite(low) || !std::isfinite(high) || high <= low) high = length > 0 ? length : 1, low = -high;
    length += 0.5 * (high - low);
  }
  // no less than what rounding of the coordinates leaves certain: arms whose axes all but meet in one point
  double extent = 0;
  for (const JointFrame& frame : frames) extent = std::max(extent, norm(frame.origin));
  for (int r = 0; r < 3; ++r) extent = std::max(extent, std::abs(chain_.home()[4 * r + 3]));
  scale_ = length > 0 ? std::max({0.4 * length, least_scale, least_scale_of_extent * extent}) : 1;
  slide_low_ = low / scale_, slide_high_ = high / scale_;
  for (JointStep& step : arm_.steps) {
    step.x /= scale_, step.y /= scale_, step.z /= scale_;
    for (double* value : {&step.x, &step.y, &step.z})
      if (std::abs(*value) < 1e-15) *value = 0;
  }
  Motion home;
  std::copy_n(chain_.home(), 12, home.begin());
  const Motion base = inverse(motion_of(frames[0])), tip = inverse(home) * motion_of(frames[5]);
  std::copy_n(base.begin(), 12, base_inverse_), std::copy_n(tip.begin(), 12, tip_inverse_);
}

// The target in the frames of the arm, made orthonormal to the last digit.
void General6R::normalise_target(const double* target, double* G) const {
  Motion T, base, tip;
  std::copy_n(target, 12, T.begin());
  for (int pass = 0; pass < 2; ++pass) {  // Newton's iteration for the polar factor
    double R[9];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) {
        double sum = 1.5 * T[4 * r + c];
        for (int j = 0; j < 3; ++j) {
          double product = 0;
          for (int k = 0; k < 3; ++k) product += T[4 * k + j] * T[4 * k + c];
          sum -= 0.5 * T[4 * r + j] * product;
        }
        R[3 * r + c] = sum;
      }
    for (int r = 0; r < 3; ++r) std::copy_n(R + 3 * r, 3, &T[4 * r]);
  }
  std::copy_n(base_inverse_, 12, base.begin()), std::copy_n(tip_inverse_, 12, tip.begin());
  const Motion out = base * T * tip;
  std::copy_n(out.begin(), 12, G);
  for (int r = 0; r < 3; ++r) G[4 * r + 3] /= scale_;
}

}  // namespace pieper
