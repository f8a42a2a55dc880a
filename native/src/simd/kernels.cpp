// The kernels of one instruction set: this file is compiled once for each, with PIEPER_ISA and PIEPER_LANES defined.
#include "pieper/kernels.hpp"

#include "simd/forward_kinematics.hpp"
#include "simd/jacobian.hpp"
#include "simd/numeric_ik.hpp"

namespace {

static_assert(max_axes == pieper::kernel_axes);

// From this size on, results go past the cache: they would push everything else out of it, and out of it themselves.
constexpr std::size_t streaming_bytes = std::size_t{8} << 20;

bool goes_past_cache(const double* out, std::size_t doubles) {
  return doubles * sizeof(double) >= streaming_bytes && reinterpret_cast<std::uintptr_t>(out) % 64 == 0;
}

// An angle beyond small_angle in [-pi, pi]; exact to the last place, which adding up large angles would not be.
double reduced(double angle) { return std::atan2(std::sin(angle), std::cos(angle)); }

// The joint values of `lanes` configurations, revolute ones reduced where they are large.
void load_joints(const Folded& chain, const double* q, std::size_t stride, Vec* joints) {
  Vec largest = splat(0.0);
  for (std::size_t i = 0; i < chain.count; ++i) {
    joints[i] = gather(q + i, stride);
    const Vec size = magnitude(joints[i]);
    largest = select(size > largest, size, largest);
  }
  if (!any(largest > small_angle)) return;
  for (std::size_t i = 0; i < chain.count; ++i) {
    if (!chain.axes[i].revolute) continue;
    for (std::size_t l = 0; l < lanes; ++l) {
      double& angle = lane(joints[i], l);
      if (std::fabs(angle) > small_angle) angle = reduced(angle);
    }
  }
}

void load_joints(const Folded& chain, const double* q, double* joints) {
  for (std::size_t i = 0; i < chain.count; ++i)
    joints[i] = chain.axes[i].revolute && std::fabs(q[i]) > small_angle ? reduced(q[i]) : q[i];
}

// Calls `block(q, valid, out)` for every `lanes` configurations; the last, incomplete block works on copies.
template <class Block>
void for_blocks(const double* q, std::size_t n, std::size_t count, double* out, std::size_t width, Block block) {
  const bool streamed = goes_past_cache(out, count * width);
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes) block(q + k * n, out + k * width, streamed);
  if (k == count) return;
  double q_padded[lanes * max_axes];
  double out_padded[lanes * 6 * max_axes];
  for (std::size_t l = 0; l < lanes; ++l) {
    const std::size_t from = k + l < count ? k + l : count - 1;
    for (std::size_t i = 0; i < n; ++i) q_padded[l * n + i] = q[from * n + i];
  }
  block(q_padded, out_padded, false);
  std::memcpy(out + k * width, out_padded, (count - k) * width * sizeof(double));
}

void poses(const Folded& chain, const double* q, std::size_t count, double* out) {
  const std::size_t n = chain.count;
  for_blocks(q, n, count, out, 16, [&](const double* from, double* to, bool streamed) {
    Vec joints[max_axes];
    load_joints(chain, from, n, joints);
    JointState<Vec> state;
    states_of_lanes(chain, joints, state);
    const Pose<Vec> tip = walk(chain, state, [](std::size_t, const Vec*, const Vec*) {});
    Vec numbers[16];
    for (int r = 0; r < 3; ++r) {
      numbers[4 * r] = tip.x[r], numbers[4 * r + 1] = tip.y[r], numbers[4 * r + 2] = tip.z[r];
      numbers[4 * r + 3] = tip.p[r];
    }
    numbers[12] = numbers[13] = numbers[14] = splat(0.0), numbers[15] = splat(1.0);
    scatter(numbers, 16, to, 16, streamed);
  });
}

void columns(const Folded& chain, const double* from, pieper::JacobianKind kind, Vec* numbers) {
  const std::size_t n = chain.count;
  Vec joints[max_axes];
  load_joints(chain, from, n, joints);
  JointState<Vec> state;
  states_of_lanes(chain, joints, state);
  Axes<Vec> axes;
  const Pose<Vec> tip = walk_with_axes(chain, state, axes);
  for (std::size_t i = 0; i < n; ++i) {
    Vec six[6];
    column(chain, tip, axes, i, kind, six);
    for (std::size_t r = 0; r < 6; ++r) numbers[r * n + i] = six[r];
  }
}

void jacobians(const Folded& chain, const double* q, std::size_t count, pieper::JacobianKind kind, double* out) {
  const std::size_t n = chain.count, width = 6 * n;
  for_blocks(q, n, count, out, width, [&](const double* from, double* to, bool streamed) {
    Vec numbers[6 * max_axes];
    columns(chain, from, kind, numbers);
    scatter(numbers, width, to, width, streamed && width % lanes == 0);
  });
}

void manipulabilities(const Folded& chain, const double* q, std::size_t count, double* out) {
  for_blocks(q, chain.count, count, out, 1, [&](const double* from, double* to, bool) {
    Vec numbers[6 * max_axes];
    columns(chain, from, pieper::JacobianKind::geometric, numbers);
    Vec square = manipulability(numbers, chain.count);
    for (std::size_t l = 0; l < lanes; ++l) to[l] = std::sqrt(lane(square, l));
  });
}

void pose_and_jacobian(const Folded& chain, const double* q, double* pose, double* jacobian) {
  double joints[max_axes];
  load_joints(chain, q, joints);
  JointState<double> state;
  state_of_one(chain, joints, state);
  Pose<double> tip;
  if (jacobian) {
    Axes<double> axes;
    tip = walk_with_axes(chain, state, axes);
    const std::size_t m = chain.count;
    for (std::size_t i = 0; i < m; ++i) {
      double six[6];
      column(chain, tip, axes, i, pieper::JacobianKind::geometric, six);
      for (std::size_t r = 0; r < 6; ++r) jacobian[r * m + i] = six[r];
    }
  } else {
    tip = walk(chain, state, [](std::size_t, const double*, const double*) {});
  }
  if (!pose) return;
  for (int r = 0; r < 3; ++r) {
    pose[4 * r] = tip.x[r], pose[4 * r + 1] = tip.y[r], pose[4 * r + 2] = tip.z[r];
    pose[4 * r + 3] = tip.p[r];
  }
}

void sincos_of(const double* angle, std::size_t count, double* sine, double* cosine) {
  Vec s = splat(0.0), c = splat(0.0);
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes) {
    sincos(load(angle + k), s, c);
    store(sine + k, s), store(cosine + k, c);
  }
  for (; k < count; ++k) {
    sincos(splat(angle[k]), s, c);
    sine[k] = lane(s, 0), cosine[k] = lane(c, 0);
  }
}

bool all_finite(const double* numbers, std::size_t count) {
  // x - x is 0 for a finite x and NaN for the rest
  Vec sum = splat(0.0);
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes) {
    const Vec x = load(numbers + k);
    sum += x - x;
  }
  double rest = 0;
  for (; k < count; ++k) rest += numbers[k] - numbers[k];
  for (std::size_t l = 0; l < lanes; ++l) rest += lane(sum, l);
  return rest == 0;
}

}  // namespace

#define PIEPER_JOIN_(a, b) a##b
#define PIEPER_JOIN(a, b) PIEPER_JOIN_(a, b)
#define PIEPER_TEXT_(a) #a
#define PIEPER_TEXT(a) PIEPER_TEXT_(a)

namespace pieper {
extern const Kernels PIEPER_JOIN(kernels_, PIEPER_ISA);
const Kernels PIEPER_JOIN(kernels_, PIEPER_ISA){PIEPER_TEXT(PIEPER_ISA), lanes, poses, jacobians, manipulabilities,
                                                pose_and_jacobian,       sincos_of, all_finite, solve_numeric_target};
}  // namespace pieper
