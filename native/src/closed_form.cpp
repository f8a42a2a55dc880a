// The constants of a closed form from the screws of the arm.
#include "pieper/closed_form.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "pieper/kernels.hpp"
#include "vec3.hpp"

namespace pieper {
namespace {

Vec3 across(const Vec3& axis, const Vec3& a) {
  const Vec3 once = a - dot(axis, a) * axis;
  return once - dot(axis, once) * axis;
}
Vec3 any_across(const Vec3& axis) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (std::abs(axis[k]) < std::abs(axis[least])) least = k;
  Vec3 e{0, 0, 0};
  e[least] = 1;
  return unit(across(axis, e));
}
void put(double* to, const Vec3& from) { std::copy(from.begin(), from.end(), to); }

struct Line {
  Vec3 direction, point;
};

// The point of `b` nearest to `a`, two lines that are not parallel.
Vec3 foot(const Line& a, const Line& b) {
  const Vec3 n = cross(a.direction, b.direction);
  const double t = dot(cross(b.point - a.point, a.direction), n) / dot(n, n);
  return b.point + t * b.direction;
}

// The middle of the common normal of two lines that are not parallel: where they meet.
Vec3 meeting(const Line& a, const Line& b) { return 0.5 * (foot(a, b) + foot(b, a)); }

HeightFrame frame_of(const Vec3& axis, const Vec3& other) {
  HeightFrame frame{};
  const Vec3 e = across(axis, other);
  const double sine = norm(e);
  put(frame.axis, axis);
  put(frame.e, (1.0 / sine) * e);
  put(frame.f, cross(axis, (1.0 / sine) * e));
  frame.cosine = dot(axis, other), frame.inverse_sine = 1.0 / sine;
  return frame;
}

}  // namespace

ClosedForm::ClosedForm(ClosedFormFamily family, FirstThree first_three, bool reversed, const double* screws,
                       std::size_t joints, const double* home, double scale, double capture, double widened)
    : family(family),
      first_three(first_three),
      reversed(reversed),
      joints(joints),
      scale(scale),
      capture(capture),
      widened(widened) {
  Line line[6];
  std::size_t turning = 0;
  uses_front = uses_elbow = uses_wrist = true;
  for (std::size_t i = 0; i < 6; ++i) joint_of[i] = -1, slides[i] = false;
  // planar arms have their axes in slots 1 to 3 and the slide in slot 0; gantries are in order
  for (std::size_t i = 0; i < joints; ++i) {
    const std::size_t joint = reversed ? joints - 1 - i : i;
    const double* screw = screws + 6 * joint;
    const double sign = reversed ? -1.0 : 1.0;
    const Vec3 v{sign * screw[0], sign * screw[1], sign * screw[2]},
        w{sign * screw[3], sign * screw[4], sign * screw[5]};
    const bool slide = dot(w, w) == 0;
    const Vec3 direction = unit(slide ? v : w);
    const std::size_t slot = family != ClosedFormFamily::planar ? i : slide ? 0 : ++turning;
    line[slot] = {direction, slide ? Vec3{0, 0, 0} : cross(direction, v)};
    joint_of[slot] = static_cast<int>(joint), slides[slot] = slide;
    put(axis[slot], direction), put(point[slot], line[slot].point);
  }
  // inverse of the home pose
  for (std::size_t r = 0; r < 3; ++r) {
    double p = 0;
    for (std::size_t k = 0; k < 3; ++k) undo_home[4 * r + k] = home[4 * k + r], p -= home[4 * k + r] * home[4 * k + 3];
    undo_home[4 * r + 3] = p;
  }
  const auto w = [&](std::size_t i) { return line[i - 1].direction; };
  const auto o = [&](std::size_t i) { return line[i - 1].point; };
  const auto elbow = [&](const Vec3& about, const Vec3& near, const Vec3& far) {
    put(near_arm, across(about, near)), put(far_arm, across(about, far));
    near_length = norm(across(about, near)), far_length = norm(across(about, far));
    offset = dot(about, near + far);
  };

  if (family == ClosedFormFamily::planar) {
    uses_front = uses_wrist = false, uses_elbow = turning == 3;
    put(across_last, any_across(w(2)));
    if (turning == 3) elbow(w(2), o(3) - o(2), o(4) - o(3));
    return;
  }
  if (family == ClosedFormFamily::gantry) {
    uses_front = uses_elbow = false, uses_wrist = joints == 6;
    const Vec3 rows[3] = {cross(w(2), w(3)), cross(w(3), w(1)), cross(w(1), w(2))};
    const double volume = dot(w(1), rows[0]);
    for (std::size_t r = 0; r < 3; ++r) put(unmix + 3 * r, (1.0 / volume) * rows[r]);
    if (joints == 6) pair = frame_of(w(4), w(5));
    if (joints > 3) put(across_last, any_across(w(joints)));
    return;
  }
  if (family == ClosedFormFamily::three_parallel_skew) {
    put(meet, foot(line[4], line[5]));
    front = frame_of(w(1), w(2)), pair = frame_of(w(5), w(6));
    elbow(w(2), o(3) - o(2), o(4) - o(3));
    put(across_last, any_across(w(4)));
    return;
  }
  if (family == ClosedFormFamily::three_parallel) {
    // with five joints any point on axis 5 will do; the one nearest to axis 4 keeps numbers small
    const Vec3 c = joints == 6 ? meeting(line[4], line[5]) : foot(line[3], line[4]);
    put(meet, c);
    front = frame_of(w(1), w(2)), height = dot(w(2), c - o(1));
    if (joints == 6) pair = frame_of(w(5), w(6));
    uses_wrist = joints == 6;
    elbow(w(2), o(3) - o(2), o(4) - o(3));
    put(across_last, any_across(w(4)));
    return;
  }
  const Vec3 c = meeting(line[3], line[4]);
  put(meet, c);
  pair = frame_of(w(4), w(5));
  put(across_last, any_across(w(6)));
  switch (first_three) {
    case FirstThree::parallel_23:
      front = frame_of(w(1), w(2)), height = dot(w(2), c - o(1));
      elbow(w(3), o(3) - o(2), c - o(3));
      break;
    case FirstThree::parallel_12:
      front = frame_of(w(3), w(1));
      elbow(w(2), o(2) - o(1), c - o(2));
      break;
    case FirstThree::intersecting_12: {
      const Vec3 at = meeting(line[0], line[1]);
      put(corner, at);
      shoulder = frame_of(w(1), w(2));
      elbow(w(3), o(3) - at, c - o(3));
      break;
    }
    case FirstThree::intersecting_23: {
      const Vec3 at = meeting(line[1], line[2]);
      put(corner, at);
      shoulder = frame_of(w(2), w(3));
      elbow(w(1), o(1) - at, c - at);
      height = norm(c - at);
      break;
    }
    case FirstThree::sliding_3: {
      const Vec3 at = meeting(line[0], line[1]);
      put(corner, at);
      shoulder = frame_of(w(1), w(2));
      break;
    }
    case FirstThree::general: {
      const Vec3 n = cross(w(1), w(2));
      const Vec3 a = foot(line[1], line[0]), b = foot(line[0], line[1]);
      put(foot_1, a), put(foot_2, b), put(normal, unit(n));
      normal_length = dot(b - a, unit(n)), sine_12 = norm(n);
      break;
    }
  }
}

}  // namespace pieper
