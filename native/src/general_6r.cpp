// The general solver around its kernels: frames and constants of an arm, the choice among its twelve forms by measurement,
// and what to do when a form says that something went wrong.
#include "pieper/general_6r.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "pieper/kernels.hpp"
#include "simd/general_6r/left_line.hpp"
#include "vec3.hpp"
#include "workers.hpp"

namespace pieper {
namespace {

constexpr double pi = std::numbers::pi;

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

// Rigid motions, 3x4 row-major.
using Motion = std::array<double, 12>;

Motion operator*(const Motion& a, const Motion& b) {
  Motion c;
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 4; ++k) {
      double sum = k == 3 ? a[4 * r + 3] : 0.0;
      for (int j = 0; j < 3; ++j) sum += a[4 * r + j] * b[4 * j + k];
      c[4 * r + k] = sum;
    }
  return c;
}

Motion inverse(const Motion& K) {
  Motion out;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out[4 * r + c] = K[4 * c + r];
    out[4 * r + 3] = -(K[r] * K[3] + K[4 + r] * K[7] + K[8 + r] * K[11]);
  }
  return out;
}

Motion motion_of(const JointFrame& f) {
  const Vec3 y = cross(f.z, f.x);
  Motion out;
  for (int r = 0; r < 3; ++r)
    out[4 * r] = f.x[r], out[4 * r + 1] = y[r], out[4 * r + 2] = f.z[r], out[4 * r + 3] = f.origin[r];
  return out;
}

Motion turn_about_z(double c, double s) { return {c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0}; }

Motion slide_along_z(double d) { return {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, d}; }

Motion motion_of(const JointStep& s) {
  return {1, 0, 0, s.x, 0, s.cos_twist, -s.sin_twist, s.y, 0, s.sin_twist, s.cos_twist, s.z};
}

// A fixed sequence of numbers, the same on every machine (splitmix64; Steele, Lea, Flood 2014).
class Sequence {
 public:
  explicit Sequence(std::uint64_t seed) : state_(seed) {}
  double between(double lo, double hi) {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return lo + (hi - lo) * static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }

 private:
  std::uint64_t state_;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

TrigonometricTables make_tables() {
  TrigonometricTables t{};
  for (int which = 0; which < 3; ++which) {
    const int n = 8 * (which + 1), half = n / 2;
    for (int j = 0; j < n; ++j) {
      const double angle = 2 * pi * j / n;
      for (int k = 0; k <= half; ++k) {
        const double weight = k == 0 || k == half ? 1.0 / n : 2.0 / n;
        const double phase = 2 * pi * ((j * k) % n) / n;
        t.dft[which][j][k] = weight * std::cos(phase);
        if (k > 0 && k < half) t.dft[which][j][half + k] = weight * std::sin(phase);
      }
      for (int even = 0; even < 2; ++even) {
        t.sample_cosine[which][even][j] = std::cos(even ? angle / 2 : angle);
        t.sample_sine[which][even][j] = std::sin(even ? angle / 2 : angle);
      }
    }
  }
  for (int K = 1; K <= 8; ++K) {
    const double half = pi / (8 * K);
    for (int i = 0; i < 8 * K; ++i) {
      const double centre = (2 * i + 1) * half;
      t.cell_centre[K - 1][i] = centre;
      for (int k = 1; k <= K; ++k)
        t.cell_cosine[K - 1][k - 1][i] = std::cos(k * centre), t.cell_sine[K - 1][k - 1][i] = std::sin(k * centre);
    }
    for (int k = 1; k <= K; ++k) {
      double power = 1;
      for (int j = 0; j < 12; ++j) {
        t.powers[K - 1][j][k - 1] = power;
        power *= k * half / (j + 1);
      }
    }
  }
  // Chebyshev coefficients from samples at their zeros, and the monomials of the polynomials T_0 ... T_11
  double monomial[12][12] = {};
  monomial[0][0] = 1, monomial[1][1] = 1;
  for (int k = 2; k < 12; ++k)
    for (int j = 0; j < 12; ++j) monomial[k][j] = (j > 0 ? 2 * monomial[k - 1][j - 1] : 0) - monomial[k - 2][j];
  for (int i = 0; i < 16; ++i) {
    t.local_points[i] = std::cos(pi * (i + 0.5) / 16);
    for (int k = 0; k < 16; ++k) {
      const double c = (k == 0 ? 1.0 : 2.0) / 16 * std::cos(k * pi * (i + 0.5) / 16);
      if (k >= 12)
        t.local_fit[i][k] = c;
      else
        for (int j = 0; j <= k; ++j) t.local_fit[i][j] += c * monomial[k][j];
    }
  }
  return t;
}

const TrigonometricTables& tables() {
  static const TrigonometricTables made = make_tables();
  return made;
}

// Shift and direction of the forms, with the target on the right: q3 q1 q2 and, backwards, q4 q6 q5; on the left: q4 q5 q6
// and, backwards, q3 q2 q1.
constexpr int target_left_from = 6;
constexpr int form_shifts[form_count] = {0, 4, 5, 0, 4, 5, 1, 2, 3, 1, 2, 3};

// Which joint of the arm is joint `place` of the loop, both counted from 0.
int joint_at(const LoopForm& form, int place) {
  const int joint = (place + form.shift) % 6;
  return form.reversed ? 5 - joint : joint;
}

int remaining_joint(const LoopForm& form) { return joint_at(form, 2); }

// The remaining joint must turn, and so must the dropped one: a slide there would move the line along itself.
bool takes_slide(const LoopForm& form, int slide) { return joint_at(form, 2) != slide && joint_at(form, 5) != slide; }

Motion motion_of_joint(const GeneralArm& arm, int i, double c, double s) {
  return i == arm.slide ? slide_along_z(s) * turn_about_z(arm.slide_cosine, arm.slide_sine) : turn_about_z(c, s);
}

// The joint, then the step, for all joints.
Motion product(const GeneralArm& arm, const double* c, const double* s) {
  Motion T = motion_of_joint(arm, 0, c[0], s[0]);
  for (int i = 1; i < 6; ++i) T = T * motion_of(arm.steps[i - 1]) * motion_of_joint(arm, i, c[i], s[i]);
  return T;
}

Motion small_motion(const double* twist) {
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

bool slides_along(const double* screw) { return screw[3] == 0 && screw[4] == 0 && screw[5] == 0; }

// Smallest singular value of the Jacobian and its direction in the joints, by three steps of inverse iteration.
double least_singular_value(const GeneralArm& arm, const double* c, const double* s, double* direction) {
  double z[6][3], o[6][3], J[6][6];
  Motion T = motion_of_joint(arm, 0, c[0], s[0]);
  for (int i = 0; i < 6; ++i) {
    if (i > 0) T = T * motion_of(arm.steps[i - 1]) * motion_of_joint(arm, i, c[i], s[i]);
    for (int r = 0; r < 3; ++r) z[i][r] = T[4 * r + 2], o[i][r] = T[4 * r + 3];
  }
  for (int i = 0; i < 6; ++i) {
    double moment[3];
    cross_product(o[i], z[i], moment);
    for (int r = 0; r < 3; ++r) J[r][i] = moment[r], J[3 + r][i] = z[i][r];
    if (i == arm.slide)
      for (int r = 0; r < 3; ++r) J[r][i] = z[i][r], J[3 + r][i] = 0;
  }
  // J = Q R by the method of Gram and Schmidt in its stable order; forming J^T J would hide what is below 1e-8
  double R[6][6] = {};
  for (int j = 0; j < 6; ++j) {
    double square = 0;
    for (int r = 0; r < 6; ++r) square += J[r][j] * J[r][j];
    R[j][j] = std::max(std::sqrt(square), 1e-18);
    for (int r = 0; r < 6; ++r) J[r][j] /= R[j][j];
    for (int k = j + 1; k < 6; ++k) {
      for (int r = 0; r < 6; ++r) R[j][k] += J[r][j] * J[r][k];
      for (int r = 0; r < 6; ++r) J[r][k] -= R[j][k] * J[r][j];
    }
  }
  double x[6] = {0.61, -0.43, 0.37, 0.52, -0.29, 0.33}, growth = 1;
  for (int step = 0; step < 3; ++step) {
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < i; ++k) x[i] -= R[k][i] * x[k];
      x[i] /= R[i][i];
    }
    for (int i = 5; i >= 0; --i) {
      for (int k = i + 1; k < 6; ++k) x[i] -= R[i][k] * x[k];
      x[i] /= R[i][i];
    }
    growth = 0;
    for (double v : x) growth += v * v;
    growth = std::sqrt(growth);
    for (double& v : x) v /= growth;
  }
  std::copy_n(x, 6, direction);
  return 1 / std::sqrt(growth);
}

}  // namespace

constexpr double same_solution = 1e-6;      // rad
constexpr double always_doubtful = 0.2;     // share of hard flags of a form that says nothing by them
constexpr double always_twice = 0.5;        // share of requests and twins that belongs to the arm
constexpr double nearly_vanishing = 1e-13;  // median noise of a form that cannot say that there is nothing
constexpr double same_after_resort = 1e-5;  // rad, for solutions that were continued to a singular target

struct General6R::Scratch {
  FormResult form, partners;
};

// Distinct solutions of one target.
struct General6R::Set {
  static constexpr std::size_t capacity = 96;
  double c[capacity][6], s[capacity][6], residual[capacity];
  std::size_t count = 0;

  // Two are the same when all joints agree: near a singular pose the error is the square root of the residual.
  bool add(const FormResult& from, std::size_t k, double least_distance) {
    double cosine[6], sine[6];
    for (int i = 0; i < 6; ++i) cosine[i] = from.cosine[i][k], sine[i] = from.sine[i][k];
    for (std::size_t j = 0; j < count; ++j) {
      const double distance = std::max(least_distance, 10 * std::sqrt(std::max(from.residual[k], residual[j])));
      double apart = 0;
      for (int i = 0; i < 6; ++i) apart = std::max({apart, std::abs(cosine[i] - c[j][i]), std::abs(sine[i] - s[j][i])});
      if (apart > distance) continue;
      if (from.residual[k] < residual[j]) set(j, cosine, sine, from.residual[k]);
      return false;
    }
    if (count == capacity) return false;
    set(count++, cosine, sine, from.residual[k]);
    return true;
  }

  std::size_t add_all(const FormResult& from, double least_distance) {
    std::size_t added = 0;
    for (std::size_t k = 0; k < from.count; ++k) added += add(from, k, least_distance);
    return added;
  }

  // Whether these joints are among them.
  bool holds(const double* cosine, const double* sine) const {
    for (std::size_t j = 0; j < count; ++j) {
      double apart = 0;
      for (int i = 0; i < 6; ++i) apart = std::max({apart, std::abs(cosine[i] - c[j][i]), std::abs(sine[i] - s[j][i])});
      if (apart < same_after_resort) return true;
    }
    return false;
  }

  // Isolated regular solutions are never more than 16; of a continuum the most regular ones are kept.
  void keep_most_regular(const GeneralArm& arm) {
    if (count <= most_solutions) return;
    std::vector<std::pair<double, std::size_t>> ranked(count);
    double direction[6];
    for (std::size_t k = 0; k < count; ++k) ranked[k] = {-least_singular_value(arm, c[k], s[k], direction), k};
    std::sort(ranked.begin(), ranked.end());
    Set kept;
    for (std::size_t k = 0; k < most_solutions; ++k) {
      const std::size_t j = ranked[k].second;
      kept.set(kept.count++, c[j], s[j], residual[j]);
    }
    *this = kept;
  }

 private:
  void set(std::size_t j, const double* cosine, const double* sine, double left) {
    std::copy_n(cosine, 6, c[j]), std::copy_n(sine, 6, s[j]);
    residual[j] = left;
  }
};

bool General6R::fits(const Chain& chain) {
  if (chain.coupled() || chain.axes() != 6) return false;
  int slides = 0;
  for (std::size_t i = 0; i < 6; ++i) slides += slides_along(chain.screw(i));
  return slides <= 1;
}

General6R::General6R(const Chain& chain) : chain_(chain) {
  set_frames();
  for (const JointStep& step : arm_.steps) reach_ += std::hypot(step.x, step.y, step.z);
  constexpr double rounding = 1e-9;
  reach_ = arm_.slide < 0 ? reach_ * (1 + rounding) : std::numeric_limits<double>::infinity();
  set_forms();
  measure_support();
  choose_forms();
}

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

template <class Numbers>
void General6R::draw_joints(Numbers& numbers, double* c, double* s) const {
  for (int i = 0; i < 6; ++i) {
    if (i == arm_.slide) {
      c[i] = 0, s[i] = numbers.between(slide_low_, slide_high_);
      continue;
    }
    const double q = numbers.between(-pi, pi);
    c[i] = std::cos(q), s[i] = std::sin(q);
  }
}

void General6R::set_forms() {
  const Motion unit_motion{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  for (int f = 0; f < form_count; ++f) {
    LoopForm& form = arm_.forms[f];
    form = {};
    form.shift = form_shifts[f], form.reversed = f / 3 % 2;
    form.target_in = 6 - form.shift;
    Motion K[6];
    for (int j = 0; j < 6; ++j) {
      const int i = (j + form.shift) % 6;
      if (i == 5) {
        K[j] = unit_motion;
        continue;
      }
      const int from = form.reversed ? 4 - i : i;
      Motion step = motion_of(arm_.steps[from]);
      if (from == arm_.slide) step = turn_about_z(arm_.slide_cosine, arm_.slide_sine) * step;
      K[j] = form.reversed ? inverse(step) : step;
    }
    for (int place = 0; place < 6 && arm_.slide >= 0; ++place)
      if (joint_at(form, place) == arm_.slide) form.slide = place + 1;
    if (form.slide == 3 || form.slide == 6) form.slide = 0;  // not to be used
    const auto put = [](const Motion& from, double* to) { std::copy_n(from.begin(), 12, to); };
    put(inverse(K[0]), form.K1_inverse), put(K[1], form.K2), put(inverse(K[5]), form.K6_inverse);
    set_K3(form, K[2].data()), set_K4(form, K[3].data());
    put(K[4], form.K5);
    expand_left_line(form);
  }
}

// Which harmonics the determinant of each form has; structured arms lack some.
void General6R::measure_support() {
  constexpr int probes = 48;
  constexpr double present = 3e-13;
  const GeneralKernels& kernel = *kernels().general;
  Sequence numbers(1);
  std::vector<Motion> targets(probes);
  for (int p = 0; p < probes; ++p) {
    double c[6], s[6];
    draw_joints(numbers, c, s);
    targets[p] = product(arm_, c, s);
    if (p % 2)
      for (int r = 0; r < 3; ++r) targets[p][4 * r + 3] = numbers.between(-1.5, 1.5);
  }
  for (LoopForm& form : arm_.forms) {
    if (!takes_slide(form, arm_.slide)) continue;
    std::vector<double> sizes[13];
    for (const Motion& G : targets) {
      double size[13];
      if (!kernel.spectrum(tables(), form, G.data(), size)) continue;
      for (int k = 0; k <= 12; ++k) sizes[k].push_back(size[k]);
    }
    int highest = 1;
    bool odd = false;
    for (int k = 1; k <= 12 && sizes[k].size() > probes / 2; ++k) {
      const auto quartile = sizes[k].begin() + 3 * sizes[k].size() / 4;
      std::nth_element(sizes[k].begin(), quartile, sizes[k].end());
      if (*quartile <= present) continue;
      highest = k;
      odd = odd || k % 2;
    }
    highest = std::min(highest, 8);
    form.even = !odd && highest >= 2;
    form.harmonics = form.even ? highest / 2 : highest;
    form.samples = form.harmonics <= 2 ? 8 : form.harmonics <= 6 ? 16 : 24;
  }
}

bool General6R::add_fold_partners(const double* G, Scratch& scratch, Set& set) const {
  constexpr double nearly_singular = 1e-4, on_a_curve = 3e-9;  // least singular value of the Jacobian
  constexpr double rounding = 4e-14, most_uncertain = 3e-2;
  constexpr double distances[] = {1e-3, -1e-3, 2e-2, -2e-2};
  constexpr Refinement to_a_double_root{0, 24, acceptable_residual, false};
  FormResult& starts = scratch.partners;
  starts.count = 0;
  for (std::size_t k = 0; k < set.count && starts.count + 4 <= most_starts; ++k) {
    double direction[6];
    const double least = least_singular_value(arm_, set.c[k], set.s[k], direction);
    if (least > nearly_singular) continue;
    for (double distance : distances) {
      const std::size_t at = starts.count++;
      for (int i = 0; i < 6; ++i) {
        const double d = distance * direction[i];
        const bool slides = i == arm_.slide;
        starts.cosine[i][at] = slides ? 0 : set.c[k][i] * std::cos(d) - set.s[k][i] * std::sin(d);
        starts.sine[i][at] = slides ? set.s[k][i] + d : set.s[k][i] * std::cos(d) + set.c[k][i] * std::sin(d);
      }
    }
  }
  if (starts.count == 0) return false;
  kernels().general->refine(arm_, G, to_a_double_root, starts);
  for (std::size_t k = 0; k < starts.count; ++k) {
    double c[6], s[6], direction[6];
    for (int i = 0; i < 6; ++i) c[i] = starts.cosine[i][k], s[i] = starts.sine[i][k];
    // as far as rounding lets it slide along a flat valley, it is the solution that it comes from
    const double uncertain = rounding / std::max(least_singular_value(arm_, c, s, direction), 1e-12);
    set.add(starts, k, std::clamp(uncertain, same_solution, most_uncertain));
  }
  double direction[6];
  for (std::size_t k = 0; k < set.count; ++k)
    if (least_singular_value(arm_, set.c[k], set.s[k], direction) < on_a_curve) return true;
  return false;
}

bool General6R::run_form(int form, const double* G, Scratch& scratch, Set& set, unsigned& flags) const {
  kernels().general->solve_form(tables(), arm_, arm_.forms[form], G, scratch.form);
  flags = scratch.form.flags;
  const std::size_t before = set.count;
  set.add_all(scratch.form, same_solution);
  if ((flags & flag_near_fold) && add_fold_partners(G, scratch, set)) flags |= flag_singular;
  // solutions come in pairs, and simple roots have one each; two roots must not have led to the same
  if (before == 0 && (set.count % 2 != 0 || set.count < scratch.form.simple_roots)) flags |= flag_lost;
  // next to an arm that cannot reach all of space rounding may lift a double root off zero
  if (set.count == 0 && reports_[form].median_tail > nearly_vanishing) return false;
  if (!(flags & flag_hard)) return !(flags & flag_some_requests) || (set.count > 0 && !(flags & flag_near_twins));
  // a form whose roots always coincide (spherical wrists) has doubts at every pose: what counts is that it agrees
  if (before == 0 || set.count != before || reports_[form].flagged < always_doubtful) return false;
  Set own;
  own.add_all(scratch.form, same_solution);
  if (flags & flag_near_fold) add_fold_partners(G, scratch, own);
  return own.count == before;
}

// Tries the forms on random poses. The union of what they find is the reference; the best single form comes first, then
// those that add most to it.
void General6R::choose_forms() {
  constexpr int poses = 200, first_look = 24;
  constexpr double worst_tail = 1e-9, least_found = 0.8, per_work = 2e-4, per_flag = 0.02;
  constexpr double least_seeds = 0.95;
  struct Trial {
    std::vector<double> tails, works;
    std::vector<std::array<bool, Set::capacity>> hits;
    int flagged = 0, looked_twice = 0, looked_closely = 0;
    bool dropped = false;
  };
  Trial trials[form_count];
  for (int f = 0; f < form_count; ++f) trials[f].dropped = !takes_slide(arm_.forms[f], arm_.slide);
  Scratch scratch;
  Sequence numbers(2);
  std::size_t known = 0, seeds_found = 0;
  std::vector<std::size_t> counts;
  for (int p = 0; p < poses; ++p) {
    double c[6], s[6];
    draw_joints(numbers, c, s);
    const Motion G = product(arm_, c, s);
    if (p == first_look) {
      int clean = 0;
      for (int f = 0; f < form_count; ++f) {
        Trial& trial = trials[f];
        trial.dropped = trial.dropped || median(trial.tails) > worst_tail;
        const bool doubtful = trial.flagged >= always_doubtful * first_look;
        // those with the target on the left take longer: only where three of the others will not do
        if (f >= target_left_from && (clean >= 3 || (clean >= 1 && doubtful))) trial.dropped = true;
        clean += !trial.dropped && !doubtful;
      }
    }
    Set all;
    std::vector<FormResult> results(form_count);
    for (int f = 0; f < form_count; ++f) {
      if (trials[f].dropped) continue;
      kernels().general->solve_form(tables(), arm_, arm_.forms[f], G.data(), results[f]);
      all.add_all(results[f], same_solution);
    }
    counts.push_back(all.count);
    seeds_found += all.holds(c, s);
    known += all.count;
    for (int f = 0; f < form_count; ++f) {
      Trial& trial = trials[f];
      trial.hits.emplace_back();
      if (trial.dropped) continue;
      trial.tails.push_back(results[f].tail), trial.works.push_back(static_cast<double>(results[f].work));
      trial.flagged += (results[f].flags & flag_hard) != 0;
      trial.looked_twice += (results[f].flags & (flag_request | flag_twins)) != 0;
      trial.looked_closely += (results[f].flags & (flag_some_requests | flag_near_twins)) != 0;
      for (std::size_t k = 0; k < results[f].count; ++k)
        for (std::size_t j = 0; j < all.count; ++j) {
          double apart = 0;
          for (int i = 0; i < 6; ++i)
            apart = std::max({apart, std::abs(results[f].cosine[i][k] - all.c[j][i]),
                              std::abs(results[f].sine[i][k] - all.s[j][i])});
          if (apart < 10 * same_solution) trial.hits.back()[j] = true;
        }
    }
  }
  const auto share = [&](const std::vector<std::array<bool, Set::capacity>>& hits) {
    std::size_t found = 0;
    for (std::size_t p = 0; p < hits.size(); ++p)
      found += std::count(hits[p].begin(), hits[p].begin() + counts[p], true);
    return known ? static_cast<double>(found) / static_cast<double>(known) : 0.0;
  };
  double score[form_count];
  for (int f = 0; f < form_count; ++f) {
    const Trial& trial = trials[f];
    FormReport report{};
    report.remaining_joint = remaining_joint(arm_.forms[f]);
    report.harmonics = arm_.forms[f].harmonics, report.even = arm_.forms[f].even;
    report.median_tail = median(trial.tails), report.median_work = median(trial.works);
    report.found = trial.dropped ? 0 : share(trial.hits);
    const auto tried = static_cast<double>(std::max<std::size_t>(trial.tails.size(), 1));
    report.flagged = trial.flagged / tried, report.looked_twice = trial.looked_twice / tried;
    report.rank = -1;
    score[f] = report.found - per_work * report.median_work - per_flag * report.flagged;
    reports_.push_back(report);
  }
  const auto usable = [&](int f) {
    return !trials[f].dropped && reports_[f].median_tail <= worst_tail && reports_[f].found >= least_found;
  };
  const int best = static_cast<int>(std::max_element(score, score + form_count,
                                                     [&](const double& a, const double& b) {
                                                       const bool ua = usable(static_cast<int>(&a - score)),
                                                                  ub = usable(static_cast<int>(&b - score));
                                                       return ua != ub ? ub : a < b;
                                                     }) -
                                    score);
  order_ = {best};
  // where roots coincide, or nearly do, by the structure of the arm, that they do tells nothing
  const auto often = [&](int poses_with) {
    return poses_with >= always_twice * static_cast<double>(trials[best].tails.size());
  };
  if (!often(trials[best].looked_twice))
    unclear_ |= flag_request | flag_twins;
  else if (!often(trials[best].looked_closely))
    unclear_ |= flag_some_requests | flag_near_twins;
  dependable_ = usable(best) && static_cast<double>(seeds_found) >= least_seeds * poses;
  std::vector<std::array<bool, Set::capacity>> covered = trials[best].hits;
  while (order_.size() < 3) {
    int next = -1;
    double most = 0;
    for (int f = 0; f < form_count; ++f) {
      if (!usable(f) || std::find(order_.begin(), order_.end(), f) != order_.end()) continue;
      auto with = covered;
      for (std::size_t p = 0; p < with.size(); ++p)
        for (std::size_t j = 0; j < counts[p]; ++j) with[p][j] = with[p][j] || trials[f].hits[p][j];
      const double value = share(with) - per_work * reports_[f].median_work - per_flag * reports_[f].flagged;
      if (next < 0 || value > most) next = f, most = value;
    }
    if (next < 0) break;
    for (std::size_t p = 0; p < covered.size(); ++p)
      for (std::size_t j = 0; j < counts[p]; ++j) covered[p][j] = covered[p][j] || trials[next].hits[p][j];
    order_.push_back(next);
  }
  for (std::size_t rank = 0; rank < order_.size(); ++rank) reports_[order_[rank]].rank = static_cast<int>(rank);
}

// For targets at which every form degenerates: targets nearby, and their solutions continued to the true one.
void General6R::last_resort(const double* G, Scratch& scratch, Set& set) const {
  constexpr double sizes[] = {1e-3, 1e-2, 3e-3, 3e-2, 1e-4, 1e-2, 1e-3, 5e-2};
  constexpr int most_idle = 2, most_batches = 8, patient_from = 4;
  constexpr std::size_t patient_starts = 8;
  constexpr double last_tolerance = 8e-10;  // m and rad: within what answers promise
  const Refinement quick{60, 12, acceptable_residual, false};
  const Refinement patient{300, 4, last_tolerance / std::max(scale_, 1.0), true};
  Sequence numbers(3);
  Motion target;
  std::copy_n(G, 12, target.begin());
  int idle = 0;
  for (int k = 0; k < 8 && !(idle >= most_idle && k >= 3); ++k) {
    double twist[6];
    for (double& value : twist) value = sizes[k] * numbers.between(-1, 1);
    const Motion displaced = small_motion(twist) * target;
    std::size_t added = 0;
    for (int form : order_) {
      if (form != order_[0] && set.count > 0 && reports_[form].flagged >= always_doubtful) continue;
      kernels().general->solve_form(tables(), arm_, arm_.forms[form], displaced.data(), scratch.form);
      const unsigned flags = scratch.form.flags;
      kernels().general->refine(arm_, G, quick, scratch.form);
      added += set.add_all(scratch.form, same_after_resort);
      if (!(flags & flag_hard)) break;
    }
    idle = added ? 0 : idle + 1;
  }
  // where nothing was found, and where there is no second form to confirm what was
  const int least_batches = order_.size() == 1 ? 2 : 0;
  for (int batch = 0; batch < least_batches || (batch < most_batches && set.count == 0); ++batch) {
    scratch.form.count = batch < patient_from ? most_starts : patient_starts;
    for (std::size_t k = 0; k < scratch.form.count; ++k) {
      double c[6], s[6];
      draw_joints(numbers, c, s);
      for (int i = 0; i < 6; ++i) scratch.form.cosine[i][k] = c[i], scratch.form.sine[i][k] = s[i];
    }
    // long valleys: axes that are nearly parallel or coincident
    kernels().general->refine(arm_, G, batch < patient_from ? quick : patient, scratch.form);
    set.add_all(scratch.form, same_after_resort);
  }
}

void General6R::solve_one(const double* target, GeneralMode mode, int only_form, Scratch& scratch,
                          const GeneralResults& out, std::size_t k) const {
  double G[12];
  normalise_target(target, G);
  Set set;
  unsigned flags = 0;
  if (only_form >= 0) {
    run_form(only_form, G, scratch, set, flags);
    out.flags[k] = static_cast<int>(flags);
    return write(target, set, out, k);
  }
  if (G[3] * G[3] + G[7] * G[7] + G[11] * G[11] > reach_ * reach_) {
    out.flags[k] = 0;
    return write(target, set, out, k);
  }
  bool trusted = run_form(order_[0], G, scratch, set, flags) && dependable_;
  out.flags[k] = static_cast<int>(flags);
  // a pose at which axes lie in a row may slip by one form: a second one has to agree that there is nothing
  constexpr double rarely = 0.02;
  if (trusted && set.count == 0 && mode != GeneralMode::fast && order_.size() > 1 &&
      reports_[order_[1]].flagged < rarely)
    trusted = run_form(order_[1], G, scratch, set, flags) && set.count == 0;
  unsigned seen = flags | static_cast<unsigned>(out.flags[k]);
  const bool shared = (flags & flag_third) != 0;  // not to be settled by a form that always has doubts
  const bool again =
      !trusted || mode == GeneralMode::complete || (mode == GeneralMode::checked && (flags & unclear_) != 0);
  if (again && order_.size() > 1) {
    const bool second = run_form(order_[1], G, scratch, set, flags);
    seen |= flags;
    out.flags[k] |= solve_second_form | static_cast<int>(flags & flag_singular);
    trusted = trusted || (second && dependable_ && !(shared && (flags & flag_hard)));
    if (!trusted && order_.size() > 2) {
      trusted = run_form(order_[2], G, scratch, set, flags) && dependable_ && !(shared && (flags & flag_hard));
      out.flags[k] |= solve_third_form | static_cast<int>(flags & flag_singular);
    }
  }
  // two solutions at one angle, of which none arrived
  if (mode != GeneralMode::fast && set.count == 0 && (seen & flag_twins)) trusted = false;
  if (!trusted) {
    out.flags[k] |= solve_doubtful | solve_last_resort;
    last_resort(G, scratch, set);
    if (add_fold_partners(G, scratch, set)) out.flags[k] |= static_cast<int>(flag_singular);
  }
  if (out.flags[k] & static_cast<int>(flag_singular)) out.flags[k] |= solve_doubtful;
  set.keep_most_regular(arm_);
  write(target, set, out, k);
}

// Angles of the true arm, and how well they do at the true target.
void General6R::write(const double* target, const Set& set, const GeneralResults& out, std::size_t k) const {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  double* q = out.q + k * most_solutions * 6;
  const std::size_t count = std::min(set.count, most_solutions);
  double angles[most_solutions * 6 + 8];
  kernels().general->angles(set.c[0], set.s[0], 6 * count, angles);
  std::array<double, 6> rows[most_solutions];
  for (std::size_t j = 0; j < count; ++j)
    for (int i = 0; i < 6; ++i) {
      if (i == arm_.slide) {
        rows[j][i] = set.s[j][i] * scale_;
        continue;
      }
      double angle = angles[6 * j + i] - offset_[i];
      if (angle > pi) angle -= 2 * pi;
      if (angle <= -pi) angle += 2 * pi;
      rows[j][i] = angle;
    }
  std::sort(rows, rows + count);
  for (std::size_t j = 0; j < count; ++j) std::copy_n(rows[j].begin(), 6, q + 6 * j);
  std::fill(q + 6 * count, q + 6 * most_solutions, nan);
  double poses[most_solutions * 16];
  if (count > 0) forward_kinematics(chain_, q, count, 1, poses);
  for (std::size_t j = 0; j < most_solutions; ++j) {
    const std::size_t at = k * most_solutions + j;
    out.valid[at] = j < count;
    out.position_error[at] = out.rotation_error[at] = nan;
    if (j >= count) continue;
    const double* T = poses + 16 * j;
    double turn[3] = {0, 0, 0}, square = 0;
    for (int c = 0; c < 3; ++c) {
      const double a[3] = {T[c], T[4 + c], T[8 + c]}, b[3] = {target[c], target[4 + c], target[8 + c]};
      double part[3];
      cross_product(a, b, part);
      for (int r = 0; r < 3; ++r) turn[r] += 0.5 * part[r];
    }
    for (int r = 0; r < 3; ++r) square += (T[4 * r + 3] - target[4 * r + 3]) * (T[4 * r + 3] - target[4 * r + 3]);
    out.position_error[at] = std::sqrt(square);
    out.rotation_error[at] = std::sqrt(dot_product(turn, turn));  // small: the solver has excluded half turns
  }
}

void General6R::solve(const double* targets, std::size_t count, GeneralMode mode, std::size_t threads,
                      const GeneralResults& out) const {
  const std::size_t workers = std::min(std::max<std::size_t>(threads, 1), std::max<std::size_t>(count / 64, 1));
  // some targets take a hundred times longer than others, so workers fetch a few at a time
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    Scratch scratch;
    for (std::size_t first; (first = next.fetch_add(16)) < count;)
      for (std::size_t k = first; k < std::min(first + 16, count); ++k)
        solve_one(targets + 16 * k, mode, -1, scratch, out, k);
  };
  Workers others;
  for (std::size_t w = 1; w < workers; ++w) others.start(work);
  work();
}

void General6R::solve_one_form(int form, const double* targets, std::size_t count, const GeneralResults& out) const {
  Scratch scratch;
  for (std::size_t k = 0; k < count; ++k) solve_one(targets + 16 * k, GeneralMode::fast, form, scratch, out, k);
}

}  // namespace pieper
