// Folding a chain: each axis gets a frame with z along the axis, chosen so that most constants are zero.
//
// F_i is the pose at home of the frame on axis i. Between neighbours, F_i^-1 F_{i+1} = Rz(phi) Trans(x, y, z) Rx(alpha):
// x of F_{i+1} is taken perpendicular to both axes, and phi becomes an offset of the joint angle. Where the axes are
// clearly skew the origin sits at the foot of the common normal (Denavit and Hartenberg 1955), so y is zero; where they
// are nearly parallel that foot runs away, so the origin stays next to the previous one and y is kept.
#include "pieper/chain.hpp"

#include <algorithm>
#include <cmath>

#include "vec3.hpp"

namespace pieper {
namespace {

// Rounding of a dozen pose products; an angle below it is rounding noise of the description's own arithmetic.
constexpr double angle_noise = 5e-15;
// Below this sine of the twist the foot of the common normal may lie so far away that rounding grows; it is not used.
constexpr double clearly_skew = 0.1;

// The part of `a` that is perpendicular to the unit vector `z`, made a unit vector.
Vec3 perpendicular(const Vec3& a, const Vec3& z) {
  const Vec3 once = a - dot(a, z) * z;
  return unit(once - dot(once, z) * z);
}

struct Line {
  Vec3 direction;
  Vec3 point;  // meaningless for a prismatic axis
  bool revolute;
};

struct FrameOnAxis {
  Vec3 x, z, origin;
};

Line line_of_screw(const double* screw) {
  const Vec3 v{screw[0], screw[1], screw[2]}, w{screw[3], screw[4], screw[5]};
  if (w[0] == 0 && w[1] == 0 && w[2] == 0) return {unit(v), {0, 0, 0}, false};
  const Vec3 z = unit(w);
  return {z, cross(z, v), true};  // the point nearest the base origin
}

double without_noise(double value, double scale) { return std::abs(value) < 1e-15 * scale ? 0.0 : value; }

// Where the next frame sits on its axis.
Vec3 origin_on(const Line& next, const FrameOnAxis& frame, bool previous_slides) {
  if (!next.revolute) return frame.origin;  // only the direction of a sliding axis matters
  const Vec3 z = next.direction;
  const Vec3 nearest = next.point + dot(frame.origin - next.point, z) * z;
  const Vec3 normal = cross(frame.z, z);
  const double sine2 = dot(normal, normal);
  if (sine2 < clearly_skew * clearly_skew || previous_slides) return nearest;
  // foot of the common normal on the next axis: the point of it nearest to the previous axis
  const Vec3 across = frame.origin - next.point;
  const double along = dot(cross(across, frame.z), cross(z, frame.z)) / sine2;
  return next.point + along * z;
}

void set_twist(Axis& axis, double cosine, double sine) {
  if (std::abs(sine) < angle_noise && cosine > 0) {
    axis.twist = Twist::parallel, cosine = 1, sine = 0;
  } else if (std::abs(cosine) < angle_noise) {
    axis.twist = Twist::square, cosine = 0,
    sine = 1;  // x is the normal from one axis to the next, so the sine is positive
  } else {
    axis.twist = Twist::general;
  }
  axis.cos_twist = cosine, axis.sin_twist = sine;
}

// Fills the constants between the frame on this axis and the next frame (x, z, origin); returns nothing else.
void connect(Axis& axis, const FrameOnAxis& from, const FrameOnAxis& to, double scale) {
  const Vec3 y = cross(from.z, from.x);
  const double phi = std::atan2(dot(to.x, y), dot(to.x, from.x));
  axis.offset += std::abs(phi) < angle_noise ? 0.0 : phi;
  const Vec3 after_y = cross(from.z, to.x);  // the frame after Rz(phi): x, after_y, z
  const Vec3 step = to.origin - from.origin;
  axis.x = without_noise(dot(step, to.x), scale);
  axis.y = without_noise(dot(step, after_y), scale);
  axis.z = without_noise(dot(step, from.z), scale);
  set_twist(axis, dot(to.z, from.z), dot(to.z, (-1.0) * after_y));
}

}  // namespace

Chain::Chain(const double* screws, std::size_t m, const double* home, const double* coupling, std::size_t n,
             const double* limits)
    : joints_(n), screws_(screws, screws + 6 * m), axes_(m) {
  std::copy(home, home + 12, home_.begin());
  bool identity = m == n;
  for (std::size_t i = 0; identity && i < m; ++i)
    for (std::size_t k = 0; k < n; ++k) identity = identity && coupling[i * n + k] == (i == k ? 1.0 : 0.0);
  if (!identity) coupling_.assign(coupling, coupling + m * n);
  for (std::size_t i = 0; i < n; ++i) {
    constexpr double far = 1e6;  // such limits bound nothing
    const double lower = limits[2 * i], upper = limits[2 * i + 1], centre = 0.5 * (lower + upper);
    ranges_.push_back({lower, upper, std::abs(centre) < far ? centre : 0.0, false});
  }
  fold();
  for (std::size_t i = 0; i < n; ++i) ranges_[i].turns = is_periodic(i);
}

// Whole multiples of a turn of this joint leave every axis where it was.
bool Chain::is_periodic(std::size_t joint) const {
  bool moves = false;
  for (std::size_t i = 0; i < axes(); ++i) {
    const double factor = coupled() ? coupling(i)[joint] : (i == joint ? 1.0 : 0.0);
    if (factor == 0) continue;
    if (!axes_[i].revolute || factor != std::round(factor)) return false;
    moves = true;
  }
  return moves;
}

void Chain::fold() {
  const std::size_t m = axes_.size();
  const std::array<double, 12>& home = home_;
  const Vec3 tip_x{home[0], home[4], home[8]}, tip_z{home[2], home[6], home[10]}, tip{home[3], home[7], home[11]};

  double scale = norm(tip);
  std::vector<Line> lines(m);
  for (std::size_t i = 0; i < m; ++i) {
    lines[i] = line_of_screw(screw(i));
    scale = std::max(scale, norm(lines[i].point));
  }
  scale = std::max(scale, 1e-3);

  // The first frame: base axes where the first axis is the base z, else x perpendicular to base z and the axis.
  FrameOnAxis frame{{1, 0, 0}, {0, 0, 1}, {0, 0, 0}};
  if (m > 0) {
    Line& first = lines[0];
    double sign = first.direction[2] < 0 ? -1.0 : 1.0;
    Vec3 z = sign * first.direction;
    if (std::hypot(z[0], z[1]) < angle_noise) {
      z = {0, 0, 1};
    } else {
      frame.x = perpendicular(cross({0, 0, 1}, z), z);
      folded_.base_turned = true;
    }
    frame.z = z;
    frame.origin = first.revolute ? first.point : Vec3{0, 0, 0};
    axes_[0].sign = sign;
  }
  const Vec3 y = cross(frame.z, frame.x);
  for (std::size_t r = 0; r < 3; ++r) {
    folded_.base_rotation[3 * r] = frame.x[r];
    folded_.base_rotation[3 * r + 1] = y[r];
    folded_.base_rotation[3 * r + 2] = frame.z[r];
    folded_.base_position[r] = frame.origin[r];
  }
  folded_.axes = axes_.data();
  folded_.count = m;

  for (std::size_t i = 0; i < m; ++i) {
    Axis& axis = axes_[i];
    axis.revolute = lines[i].revolute;
    axis.offset = 0;
    FrameOnAxis next;
    if (i + 1 < m) {
      const Line& line = lines[i + 1];
      const double cosine = dot(line.direction, frame.z);
      const double sign =
          cosine < 0 ? -1.0 : 1.0;  // a twist stays within +-90 degrees; anti-parallel axes turn backwards
      axes_[i + 1].sign = sign;
      next.z = sign * line.direction;
      next.origin = origin_on({next.z, line.point, line.revolute}, frame, !axis.revolute);
      const Vec3 normal = cross(frame.z, next.z);
      const Vec3 step = next.origin - frame.origin;
      const Vec3 aside = step - dot(step, frame.z) * frame.z;
      if (norm(normal) >= angle_noise) {
        next.x = perpendicular(normal, next.z);
      } else {
        next.z = frame.z;  // parallel up to rounding
        next.x = norm(aside) > 1e-12 * scale ? perpendicular(aside, next.z) : frame.x;
      }
      connect(axis, frame, next, scale);
      frame = next;
    } else {
      // home = F_n Rz(phi) Trans(x, y, z) Rx(alpha) Rz(psi): the last frame's x is free, so the tip needs one more turn
      const Vec3 normal = cross(frame.z, tip_z);
      next.z = tip_z;
      next.origin = tip;
      next.x = norm(normal) >= angle_noise ? perpendicular(normal, tip_z) : tip_x;
      connect(axis, frame, next, scale);
      const Vec3 next_y = cross(next.z, next.x);
      double cosine = dot(tip_x, next.x), sine = dot(tip_x, next_y);
      if (std::abs(sine) < angle_noise) sine = 0, cosine = cosine < 0 ? -1 : 1;
      const double ca = axis.cos_twist, sa = axis.sin_twist;  // Rx(alpha) Rz(psi)
      const double rotation[9] = {cosine, -sine, 0, ca * sine, ca * cosine, -sa, sa * sine, sa * cosine, ca};
      std::copy(rotation, rotation + 9, folded_.tip_rotation);
      folded_.tip_turned = axis.twist != Twist::parallel || cosine != 1;
    }
  }
  for (std::size_t i = 0; i + 1 < m; ++i)  // turning about z and moving along it commute
    if (axes_[i].twist == Twist::parallel) axes_[i + 1].z += axes_[i].z, axes_[i].z = 0;
  for (Axis& axis : axes_) {
    axis.reach = axis.y != 0 ? Reach::both : axis.x != 0 ? Reach::along_x : Reach::none;
    axis.turn = axis.revolute ? axis.sign : 0;
  }
}

}  // namespace pieper
