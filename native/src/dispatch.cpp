// Which kernels run, and how work is split among threads.
#include <algorithm>
#include <atomic>

#include "pieper/differential.hpp"
#include "pieper/kernels.hpp"
#include "workers.hpp"

namespace pieper {

#if PIEPER_HAS_PORTABLE
extern const Kernels kernels_portable;
#endif
#if PIEPER_HAS_BASELINE
extern const Kernels kernels_baseline;
#endif
#if PIEPER_HAS_AVX2
extern const Kernels kernels_avx2;
#endif
#if PIEPER_HAS_AVX512
extern const Kernels kernels_avx512;
#endif

namespace {

std::vector<const Kernels*> supported() {
  std::vector<const Kernels*> found;
#if PIEPER_HAS_PORTABLE
  found.push_back(&kernels_portable);
#endif
#if PIEPER_HAS_BASELINE
  found.push_back(&kernels_baseline);
#endif
#if PIEPER_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) found.push_back(&kernels_avx2);
#endif
#if PIEPER_HAS_AVX512
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw"))
    found.push_back(&kernels_avx512);
#endif
  return found;
}

const Kernels* by_name(const std::string& name) {
  for (const Kernels* k : supported())
    if (name == k->name) return k;
  return nullptr;
}

std::atomic<const Kernels*>& current() {
  static std::atomic<const Kernels*> in_use = supported().back();
  return in_use;
}

// A worker below this many configurations costs more to start than it saves.
constexpr std::size_t worth_a_thread = 4096;

// Calls run(first, count) on up to `threads` contiguous parts; true when every part says so.
template <class Run>
bool split(std::size_t count, std::size_t threads, Run run, std::size_t worth = worth_a_thread) {
  const std::size_t parts = std::min(std::max<std::size_t>(threads, 1), std::max<std::size_t>(count / worth, 1));
  if (parts == 1) return run(std::size_t{0}, count);
  std::atomic<bool> good = true;
  {
    Workers workers;
    // parts of a multiple of eight configurations, so that every part starts on a whole vector
    const std::size_t step = (count / parts + 7) / 8 * 8;
    for (std::size_t first = step; first < count; first += step)
      workers.start([=, &good] {
        if (!run(first, std::min(step, count - first))) good = false;
      });
    if (!run(std::size_t{0}, std::min(step, count))) good = false;
  }
  return good;
}

bool usable(const double* q, std::size_t count) { return kernels().all_within(q, count, largest_joint_value); }

bool for_kernels(const Chain& chain) { return !chain.coupled() && chain.axes() > 0 && chain.axes() <= kernel_axes; }

}  // namespace

const Kernels& kernels() { return *current().load(std::memory_order_relaxed); }

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
  for (const Kernels* k : supported()) names.emplace_back(k->name);
  return names;
}

bool use_instruction_set(const std::string& name) {
  const Kernels* k = by_name(name);
  if (k) current().store(k);
  return k != nullptr;
}

bool forward_kinematics(const Chain& chain, const double* q, std::size_t count, std::size_t threads, double* out) {
  const std::size_t n = chain.joints();
  if (!for_kernels(chain)) return usable(q, count * n) && (plain_poses(chain, q, count, out), true);
  if (count == 1) {
    if (!usable(q, n)) return false;
    double pose[12];
    kernels().pose_and_jacobian(chain.folded(), q, pose, nullptr);
    std::copy(pose, pose + 12, out);
    out[12] = out[13] = out[14] = 0, out[15] = 1;
    return true;
  }
  return split(count, threads, [&](std::size_t first, std::size_t some) {
    return kernels().poses(chain.folded(), q + first * n, some, out + first * 16);
  });
}

bool jacobian(const Chain& chain, const double* q, std::size_t count, JacobianKind kind, std::size_t threads,
              double* out) {
  const std::size_t n = chain.joints();
  if (!for_kernels(chain)) return usable(q, count * n) && (plain_jacobians(chain, q, count, kind, out), true);
  if (count == 1 && kind == JacobianKind::geometric) {
    if (!usable(q, n)) return false;
    kernels().pose_and_jacobian(chain.folded(), q, nullptr, out);
    return true;
  }
  return split(count, threads, [&](std::size_t first, std::size_t some) {
    return kernels().jacobians(chain.folded(), q + first * n, some, kind, out + first * 6 * n);
  });
}

bool manipulability(const Chain& chain, const double* q, std::size_t count, std::size_t threads, double* out) {
  const std::size_t n = chain.joints();
  if (!for_kernels(chain)) return usable(q, count * n) && (plain_manipulability(chain, q, count, out), true);
  return split(count, threads, [&](std::size_t first, std::size_t some) {
    return kernels().manipulability(chain.folded(), q + first * n, some, out + first);
  });
}

void solve_closed_form(const Chain& chain, const ClosedForm& form, const double* targets, std::size_t count,
                       const ClosedFormOptions& options, std::size_t threads, const ClosedFormResults& out) {
  split(count, threads, [&](std::size_t first, std::size_t some) {
    const std::size_t slot = first * closed_form_branches;
    kernels().solve_closed_form(
        chain.folded(), form, options, targets + 16 * first, some,
        {out.q + slot * form.joints, out.position_error + slot, out.rotation_error + slot, out.valid + slot,
         out.singular ? out.singular + first : nullptr, out.doubtful + first});
    return true;
  });
}

bool score_answers(const Chain& chain, const double* q, const bool* counted, std::size_t groups,
                   const ScoreOptions& options, std::size_t threads, const Scores& out) {
  const std::size_t places = options.poses * options.slots,
                    worth = worth_a_thread / std::max<std::size_t>(places, 1) + 1;
  return split(
      groups, threads,
      [&](std::size_t first, std::size_t some) {
        Scores part{out.reached + first, out.solutions + first, out.most + first, nullptr, nullptr, nullptr};
        if (options.measures) {
          part.manipulability = out.manipulability + first;
          part.singularity = out.singularity + first;
          part.margin = out.margin + first;
        }
        return score_some(chain, q + first * places * chain.joints(), counted + first * places, some, options, part);
      },
      worth);
}

}  // namespace pieper
