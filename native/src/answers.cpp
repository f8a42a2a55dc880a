#include "pieper/answers.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "pieper/kernels.hpp"
#include "workers.hpp"

namespace pieper {
namespace {

constexpr double turn = 2 * std::numbers::pi;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// No copy farther out than this [rad]: there an angle has no digits to spare.
constexpr double farthest_copy = 1e3;

// Up to this far outside a limit [rad or m] an answer is put on the limit.
constexpr double rounding = 1e-9;

// The nearest whole number, for magnitudes below 2^51; std::round is a call where the processor may be an old one.
double whole(double x) {
  constexpr double magic = 0x1.8p52;
  return (x + magic) - magic;
}

// One answer while it is put in its place.
struct Row {
  bool outside;
  double distance;
  std::size_t slot;
  signed char branch;
  double position_error, rotation_error;
  bool before(const Row& other) const { return outside != other.outside ? other.outside : distance < other.distance; }
};

class Arranger {
 public:
  Arranger(const Chain& chain, const AnswerOptions& options, const Answers& out)
      : chain_(chain), options_(options), out_(out), n_(chain.joints()) {
    if (out.slots <= few) {
      rows_ = few_rows_;
    } else {
      many_rows_.resize(out.slots);
      rows_ = many_rows_.data();
    }
    if (out.slots * n_ <= few * kernel_axes) {
      kept_ = few_kept_;
    } else {
      many_kept_.resize(out.slots * n_);
      kept_ = many_kept_.data();
    }
    if (options.branch_of_slot)
      for (std::size_t s = 0; s < out.slots; ++s) slot_of_branch_[options.branch_of_slot[s]] = s;
  }
  Arranger(const Arranger&) = delete;
  Arranger& operator=(const Arranger&) = delete;

  void operator()(const double* target, const double* seed, std::size_t k) {
    const std::size_t first = k * out_.slots;
    double* q = out_.q + first * n_;
    std::size_t count = 0, inside = 0;
    bool in_order = true, sorted = true;
    for (std::size_t b = 0; b < out_.slots; ++b) {
      const std::size_t s = options_.branch_of_slot ? slot_of_branch_[b] : b, at = first + s;
      if (!out_.valid[at] || !good(at)) continue;
      Row row{false, 0, s, branch_of(s, at), 0, 0};
      row.outside = !bring_inside(target, seed, q + s * n_, at);
      row.position_error = out_.position_error[at], row.rotation_error = out_.rotation_error[at];
      if (seed) row.distance = distance(q + s * n_, seed);
      inside += !row.outside;
      in_order = in_order && s == count;
      sorted = sorted && (count == 0 || !row.before(rows_[count - 1]));
      rows_[count++] = row;
    }
    out_.status[k] = static_cast<signed char>(inside  ? AnswerStatus::reached
                                              : count ? AnswerStatus::outside_limits
                                                      : AnswerStatus::unreachable);
    if (!sorted) {
      sort(count);
      in_order = false;
    }
    if (!in_order) {
      for (std::size_t j = 0; j < count; ++j) std::copy_n(q + rows_[j].slot * n_, n_, kept_ + j * n_);
      std::copy_n(kept_, count * n_, q);
    }
    for (std::size_t j = 0; j < count; ++j) {
      const Row& row = rows_[j];
      out_.position_error[first + j] = row.position_error, out_.rotation_error[first + j] = row.rotation_error;
      out_.valid[first + j] = true, out_.within_limits[first + j] = !row.outside;
      out_.branch[first + j] = row.branch;
    }
    for (std::size_t at = first + count; at < first + out_.slots; ++at) {
      std::fill_n(out_.q + at * n_, n_, nan);
      out_.position_error[at] = out_.rotation_error[at] = nan;
      out_.valid[at] = out_.within_limits[at] = false;
      out_.branch[at] = -1;
    }
  }

 private:
  static constexpr std::size_t few = 16;

  bool good(std::size_t at) const {
    return out_.position_error[at] <= options_.position_tolerance &&
           out_.rotation_error[at] <= options_.rotation_tolerance;
  }

  signed char branch_of(std::size_t slot, std::size_t at) const {
    if (options_.branch_of_slot) return options_.branch_of_slot[slot];
    return options_.branches ? options_.branches[at] : static_cast<signed char>(-1);
  }

  // Each joint as the copy that suits; true when all are inside their limits.
  bool bring_inside(const double* target, const double* seed, double* q, std::size_t at) {
    bool all = true, moved = false;
    for (std::size_t i = 0; i < n_; ++i) {
      const JointRange& range = chain_.range(i);
      double x = q[i];
      if (range.turns) {
        const double wanted = seed && std::abs(seed[i]) <= farthest_copy ? seed[i] : range.centre;
        if (std::abs(wanted - x) > turn / 2) x += turn * whole((wanted - x) / turn);
        if (x < range.lower - rounding || x > range.upper + rounding) {
          // the first copy above the lower limit; or the one below it, when that violates less
          const double above = x + turn * std::ceil((range.lower - rounding - x) / turn), below = above - turn;
          const bool inside = above <= range.upper + rounding;
          if (inside && x > range.upper) {  // from above: the last one below the upper limit
            x -= turn * std::ceil((x - range.upper - rounding) / turn);
          } else {
            x = inside || above - range.upper <= range.lower - below ? above : below;
          }
        }
      }
      if (x < range.lower || x > range.upper) {
        const double limit = std::clamp(x, range.lower, range.upper);
        if (std::abs(limit - x) <= rounding) {
          x = limit, moved = true;
        } else {
          all = false;
        }
      }
      q[i] = x;
    }
    if (moved) measure_again(target, q, at);
    return all;
  }

  void measure_again(const double* target, const double* q, std::size_t at) {
    double pose[16];
    if (!forward_kinematics(chain_, q, 1, 1, pose)) return;
    const PoseError error = pose_error(target, pose, options_.rows);
    out_.position_error[at] = error.position, out_.rotation_error[at] = error.rotation;
  }

  double distance(const double* q, const double* seed) const {
    double sum = 0;
    for (std::size_t i = 0; i < n_; ++i) sum += (q[i] - seed[i]) * (q[i] - seed[i]);
    return sum;
  }

  // Keeps the order of equals: by insertion where there are few.
  void sort(std::size_t count) {
    if (count > few) {
      std::stable_sort(rows_, rows_ + count, [](const Row& a, const Row& b) { return a.before(b); });
      return;
    }
    for (std::size_t j = 1; j < count; ++j) {
      const Row row = rows_[j];
      std::size_t to = j;
      for (; to > 0 && row.before(rows_[to - 1]); --to) rows_[to] = rows_[to - 1];
      rows_[to] = row;
    }
  }

  const Chain& chain_;
  const AnswerOptions& options_;
  const Answers& out_;
  std::size_t n_;
  Row few_rows_[few], *rows_;
  double few_kept_[few * kernel_axes], *kept_;
  std::size_t slot_of_branch_[closed_form_branches] = {};
  std::vector<Row> many_rows_;
  std::vector<double> many_kept_;
};

// Calls run(first, count) on parts of the work, a few dozen targets each, from up to `threads` workers.
template <class Run>
void in_parts(std::size_t count, std::size_t threads, Run run) {
  constexpr std::size_t part = 64;
  const std::size_t workers = std::min(std::max<std::size_t>(threads, 1), std::max<std::size_t>(count / 4096, 1));
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t first; (first = next.fetch_add(part)) < count;) run(first, std::min(part, count - first));
  };
  Workers others;
  for (std::size_t w = 1; w < workers; ++w) others.start(work);
  work();
}

}  // namespace

void arrange(const Chain& chain, const double* targets, const double* seeds, std::size_t count,
             const AnswerOptions& options, const Answers& out) {
  Arranger arranger(chain, options, out);
  for (std::size_t k = 0; k < count; ++k) arranger(targets + 16 * k, seeds ? seeds + chain.joints() * k : nullptr, k);
}

void answer_by_closed_form(const Chain& chain, const ClosedForm& form, const double* targets, const double* seeds,
                           std::size_t count, const AnswerOptions& options, std::size_t threads, const Answers& out,
                           bool* singular, bool* doubtful) {
  const ClosedFormOptions tolerances{options.position_tolerance, options.rotation_tolerance};
  const std::size_t n = chain.joints();
  AnswerOptions labelled = options;
  labelled.branch_of_slot = form.branch_of_slot;
  in_parts(count, threads, [&](std::size_t first, std::size_t some) {
    const std::size_t slot = first * closed_form_branches;
    const Answers part{closed_form_branches,      out.q + slot * n,  out.position_error + slot,
                       out.rotation_error + slot, out.valid + slot,  out.within_limits + slot,
                       out.branch + slot,         out.status + first};
    kernels().solve_closed_form(
        chain.folded(), form, tolerances, targets + 16 * first, some,
        {part.q, part.position_error, part.rotation_error, part.valid, singular + first, doubtful + first});
    arrange(chain, targets + 16 * first, seeds ? seeds + n * first : nullptr, some, labelled, part);
  });
}

}  // namespace pieper
