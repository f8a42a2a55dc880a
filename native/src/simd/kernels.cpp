// The kernels of one instruction set: this file is compiled once for each, with PIEPER_ISA and PIEPER_LANES defined.
#include "pieper/kernels.hpp"

#include "simd/closed_form.hpp"
#include "simd/forward_kinematics.hpp"
#include "simd/jacobian.hpp"
#include "simd/numeric_ik.hpp"
#include "simd/scores.hpp"

namespace {

static_assert(max_axes == pieper::kernel_axes);

// From this size on, results go past the cache: they would push everything else out of it, and out of it themselves.
constexpr std::size_t streaming_bytes = std::size_t{8} << 20;

bool goes_past_cache(const double* out, std::size_t doubles) {
  return doubles * sizeof(double) >= streaming_bytes && reinterpret_cast<std::uintptr_t>(out) % 64 == 0;
}

// An angle beyond small_angle in [-pi, pi]; exact to the last place, which adding up large angles would not be.
double reduced(double angle) { return std::atan2(std::sin(angle), std::cos(angle)); }

// Large angles reduced in place; false when a value is too large or no number. Kept out of the way of the common case.
PIEPER_OUT_OF_LINE bool reduce_joints(const Folded& chain, Vec* joints) {
  for (std::size_t i = 0; i < chain.count; ++i)
    for (std::size_t l = 0; l < lanes; ++l) {
      double& value = lane(joints[i], l);
      if (!(std::fabs(value) <= pieper::largest_joint_value)) return false;
      if (chain.axes[i].revolute && std::fabs(value) > small_angle) value = reduced(value);
    }
  return true;
}

// Large angles reduced; false when a value is too large or no number.
PIEPER_INLINE bool reduced_joints(const Folded& chain, std::size_t n, Vec* joints) {
  Vec squares = joints[0] * joints[0];  // not a number, or infinite, when any of them is
  for (std::size_t i = 1; i < n; ++i) squares += joints[i] * joints[i];
  return all(squares <= small_angle * small_angle) || reduce_joints(chain, joints);
}

// The joint values of `lanes` configurations, large angles reduced; false when one is too large or no number.
PIEPER_INLINE bool load_joints(const Folded& chain, std::size_t n, const double* q, Vec* joints) {
  read_records(q, n, joints);
  return reduced_joints(chain, n, joints);
}

void load_joints(const Folded& chain, const double* q, double* joints) {
  for (std::size_t i = 0; i < chain.count; ++i)
    joints[i] = chain.axes[i].revolute && std::fabs(q[i]) > small_angle ? reduced(q[i]) : q[i];
}

// Room for the joints of one block; read_records() works on whole vectors of numbers.
using Joints = Vec[max_axes + lanes];

// Asks for the joint values that come up in a few blocks: the loop body is longer than what the processor looks ahead.
inline void prefetch_joints(const double* q, std::size_t n) {
#if defined(__GNUC__)
  constexpr std::size_t blocks_ahead = 8, doubles_per_line = 8;
  const double* end = q + (blocks_ahead + 1) * lanes * n;
  for (const double* line = end - lanes * n; line < end; line += doubles_per_line) __builtin_prefetch(line);
#else
  (void)q, (void)n;
#endif
}

// Calls `block(joints, out, streamed)` for every `lanes` configurations; the last, incomplete block works on copies.
// False as soon as a joint value is too large or no number.
template <class Block>
bool for_blocks(const Folded& chain, const double* q, std::size_t count, double* out, std::size_t width, Block block) {
  const std::size_t n = chain.count;
  const bool streamed = goes_past_cache(out, count * width);
  Joints joints;
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes) {
    prefetch_joints(q + k * n, n);
    if (!load_joints(chain, n, q + k * n, joints)) return false;
    block(joints, out + k * width, streamed);
  }
  end_streaming(streamed);
  if (k == count) return true;
  double q_padded[lanes * max_axes];
  double out_padded[lanes * 6 * max_axes];
  for (std::size_t l = 0; l < lanes; ++l) {
    const std::size_t from = k + l < count ? k + l : count - 1;
    for (std::size_t i = 0; i < n; ++i) q_padded[l * n + i] = q[from * n + i];
  }
  if (!load_joints(chain, n, q_padded, joints)) return false;
  block(joints, out_padded, false);
  std::memcpy(out + k * width, out_padded, (count - k) * width * sizeof(double));
  return true;
}

PIEPER_INLINE void write_pose(const Folded& chain, const JointState<Vec>& state, double* to, bool streamed) {
  const Pose<Vec> tip = tip_pose(chain, state);
  Vec numbers[16];
  for (int r = 0; r < 3; ++r) {
    numbers[4 * r] = tip.x[r], numbers[4 * r + 1] = tip.y[r], numbers[4 * r + 2] = tip.z[r];
    numbers[4 * r + 3] = tip.p[r];
  }
  numbers[12] = numbers[13] = numbers[14] = splat(0.0), numbers[15] = splat(1.0);
  scatter(numbers, 16, to, 16, streamed);
}

// The sines of one block are computed while the poses of the block before are put together: each is a long chain of
// dependent operations, and the processor runs the two chains at once.
// `axes` is the number of axes when it is known, else 0: the common ones are worth a copy of the loop.
template <std::size_t axes>
bool poses_of(const Folded& chain, const double* q, std::size_t count, double* out) {
  const bool streamed = goes_past_cache(out, count * 16);
  JointState<Vec> state[2];
  const std::size_t n = axes ? axes : chain.count, step = lanes * n;
  std::size_t block = 0;
  for (; (block + 1) * lanes <= count; ++block) {
    Joints joints;
    prefetch_joints(q + block * step, n);
    if (!load_joints(chain, n, q + block * step, joints)) return false;
    states_of_lanes(chain, n, joints, state[block % 2]);
    if (block > 0) write_pose(chain, state[(block - 1) % 2], out + (block - 1) * lanes * 16, streamed);
  }
  if (block > 0) write_pose(chain, state[(block - 1) % 2], out + (block - 1) * lanes * 16, streamed);
  end_streaming(streamed);
  const std::size_t done = block * lanes;
  return for_blocks(chain, q + done * n, count - done, out + done * 16, 16, [&](const Vec* joints, double* to, bool) {
    states_of_lanes(chain, n, joints, state[0]);
    write_pose(chain, state[0], to, false);
  });
}

bool poses(const Folded& chain, const double* q, std::size_t count, double* out) {
  switch (chain.count) {
    case 5:
      return poses_of<5>(chain, q, count, out);
    case 6:
      return poses_of<6>(chain, q, count, out);
    case 7:
      return poses_of<7>(chain, q, count, out);
    default:
      return poses_of<0>(chain, q, count, out);
  }
}

void columns(const Folded& chain, const Vec* joints, pieper::JacobianKind kind, Vec* numbers) {
  const std::size_t n = chain.count;
  JointState<Vec> state;
  states_of_lanes(chain, n, joints, state);
  Axes<Vec> axes;
  const Pose<Vec> tip = walk_with_axes(chain, state, axes);
  for (std::size_t i = 0; i < n; ++i) {
    Vec six[6];
    column(chain, tip, axes, i, kind, six);
    for (std::size_t r = 0; r < 6; ++r) numbers[r * n + i] = six[r];
  }
}

bool jacobians(const Folded& chain, const double* q, std::size_t count, pieper::JacobianKind kind, double* out) {
  const std::size_t width = 6 * chain.count;
  return for_blocks(chain, q, count, out, width, [&](const Vec* joints, double* to, bool streamed) {
    Vec numbers[6 * max_axes];
    columns(chain, joints, kind, numbers);
    scatter(numbers, width, to, width, streamed && width % lanes == 0);
  });
}

bool manipulabilities(const Folded& chain, const double* q, std::size_t count, double* out) {
  return for_blocks(chain, q, count, out, 1, [&](const Vec* joints, double* to, bool) {
    Vec numbers[6 * max_axes];
    columns(chain, joints, pieper::JacobianKind::geometric, numbers);
    Vec square = manipulability(numbers, chain.count);
    for (std::size_t l = 0; l < lanes; ++l) to[l] = std::sqrt(lane(square, l));
  });
}

// `axes` is 6 when there are six and all of them turn, else 0.
template <std::size_t axes>
bool score_of(const Folded& chain, const double* limits, const double* q, std::size_t count, double* measure,
              double* margin) {
  const std::size_t n = axes ? axes : chain.count;
  double padded[lanes * max_axes];
  for (std::size_t k = 0; k < count; k += lanes) {
    const std::size_t some = count - k < lanes ? count - k : lanes;
    const double* from = q + k * n;
    if (some < lanes) {
      for (std::size_t l = 0; l < lanes; ++l)
        std::memcpy(padded + l * n, from + (l < some ? l : some - 1) * n, n * sizeof(double));
      from = padded;
    }
    Joints joints;
    read_records(from, n, joints);
    Vec distance = margin_of(limits, n, joints), best;
    if (!reduced_joints(chain, n, joints)) return false;
    if constexpr (axes == 6) {
      best = six_axis_manipulability(chain, joints);
    } else {
      Vec numbers[6 * max_axes];
      columns(chain, joints, pieper::JacobianKind::geometric, numbers);
      best = square_root(manipulability(numbers, n));
    }
    if (some == lanes) {
      store(measure + k, best), store(margin + k, distance);
    } else {
      for (std::size_t l = 0; l < some; ++l) measure[k + l] = lane(best, l), margin[k + l] = lane(distance, l);
    }
  }
  return true;
}

bool score(const Folded& chain, const double* limits, const double* q, std::size_t count, double* measure,
           double* margin) {
  return six_turn(chain) ? score_of<6>(chain, limits, q, count, measure, margin)
                         : score_of<0>(chain, limits, q, count, measure, margin);
}

void singular_values(const double* jacobians, std::size_t count, std::size_t n, std::size_t rows, double* product,
                     double* smallest) {
  const bool wide = n >= rows;
  const std::size_t vectors = wide ? rows : n, length = wide ? n : rows;
  for (std::size_t k = 0; k < count; k += lanes) {
    Vec of[6][max_axes];
    for (std::size_t l = 0; l < lanes; ++l) {
      const double* J = jacobians + (k + l < count ? k + l : count - 1) * 6 * n;
      for (std::size_t i = 0; i < vectors; ++i)
        for (std::size_t j = 0; j < length; ++j) lane(of[i][j], l) = wide ? J[i * n + j] : J[j * n + i];
    }
    Vec all, least;
    singular_values_of(of, vectors, length, all, least);
    for (std::size_t l = 0; l < lanes && k + l < count; ++l)
      product[k + l] = lane(all, l), smallest[k + l] = lane(least, l);
  }
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
    tip = tip_pose(chain, state);
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

void arctangents(const double* y, const double* x, std::size_t count, double* angle) {
  for (std::size_t k = 0; k < count; ++k) {
    Vec a = arctangent(splat(y[k]), splat(x[k]));
    angle[k] = lane(a, 0);
  }
}

bool all_within(const double* numbers, std::size_t count, double limit) {
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes)
    if (!all(magnitude(load(numbers + k)) <= limit)) return false;
  for (; k < count; ++k)
    if (!(std::fabs(numbers[k]) <= limit)) return false;
  return true;
}

}  // namespace

#define PIEPER_JOIN_(a, b) a##b
#define PIEPER_JOIN(a, b) PIEPER_JOIN_(a, b)
#define PIEPER_TEXT_(a) #a
#define PIEPER_TEXT(a) PIEPER_TEXT_(a)

namespace pieper {
extern const GeneralKernels PIEPER_JOIN(general_kernels_, PIEPER_ISA);
extern const SegmentationKernels PIEPER_JOIN(segmentation_kernels_, PIEPER_ISA);
extern const Kernels PIEPER_JOIN(kernels_, PIEPER_ISA);
const Kernels PIEPER_JOIN(kernels_, PIEPER_ISA){PIEPER_TEXT(PIEPER_ISA),
                                                lanes,
                                                poses,
                                                jacobians,
                                                manipulabilities,
                                                pose_and_jacobian,
                                                sincos_of,
                                                all_within,
                                                solve_numeric_target,
                                                solve_closed_form_of,
                                                arctangents,
                                                score,
                                                singular_values,
                                                &PIEPER_JOIN(general_kernels_, PIEPER_ISA),
                                                &PIEPER_JOIN(segmentation_kernels_, PIEPER_ISA)};
}  // namespace pieper
