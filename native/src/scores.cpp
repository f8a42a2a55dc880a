// Answers of a group are rated one block after the other; what may be the best of its group is looked at again.
#include "pieper/scores.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "pieper/differential.hpp"
#include "pieper/kernels.hpp"

namespace pieper {
namespace {

// Answers that are rated together: their numbers stay in the cache of the first level.
constexpr std::size_t block = 128;

// The quick measure may be wrong by this much of itself and of what the arm's size makes of one.
constexpr double quick_relative = 1e-6, quick_absolute = 1e-13;

constexpr double nowhere = -std::numeric_limits<double>::infinity();

class Rating {
 public:
  Rating(const Chain& chain, const ScoreOptions& options, const Scores& out)
      : chain_(chain), options_(options), out_(out), n_(chain.joints()), q_(block * n_), jacobians_(block * 6 * n_) {
    for (std::size_t i = 0; i < n_; ++i) limits_.insert(limits_.end(), {chain.lower(i), chain.upper(i)});
    plain_ = chain.coupled() || chain.axes() == 0 || chain.axes() > kernel_axes;
    double size = 1;
    for (std::size_t i = 0; i < chain.axes(); ++i) {
      const double* v = chain.screw(i);
      size = std::max(size, std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
    }
    slack_ = quick_absolute * size * size * size;
  }

  // Answers of a group, at most a block of them, that lie one after the other.
  void add(const double* q, std::size_t count, std::size_t group) {
    if (held_ + count > block) rate();
    std::copy_n(q, count * n_, &q_[held_ * n_]);
    held_ += count;
    if (runs_ > 0 && run_groups_[runs_ - 1] == group) --runs_;
    run_groups_[runs_] = group;
    run_ends_[runs_++] = held_;
  }

  bool finish() {
    rate();
    settle();
    look_again();
    return good_;
  }

 private:
  // Measure and margin of the answers held, and which of them may be the best.
  void rate() {
    if (held_ == 0) return;
    good_ = good_ && measures();
    std::size_t k = 0;
    for (std::size_t run = 0; good_ && run < runs_; ++run) {
      if (run_groups_[run] != group_) {
        settle();
        group_ = run_groups_[run];
        most_ = margin_ = nowhere;
      }
      double margin = margin_, enough = enough_;
      for (; k < run_ends_[run]; ++k) {
        margin = std::max(margin, margins_[k]);
        if (measures_[k] >= enough) enough = keep(k);
      }
      margin_ = margin;
    }
    held_ = runs_ = 0;
  }

  // One that may be the best so far; returns what others must have from here on.
  double keep(std::size_t k) {
    if (measures_[k] > most_) most_ = measures_[k], enough_ = most_ * (1 - quick_relative) - slack_;
    near_.push_back(measures_[k]);
    const double* from = &q_[k * n_];
    near_q_.insert(near_q_.end(), from, from + n_);
    return enough_;
  }

  bool measures() {
    const std::size_t n = n_;
    if (!plain_ && options_.rows == 6)
      return kernels().score(chain_.folded(), &limits_[0], &q_[0], held_, measures_, margins_);
    if (!jacobians(&q_[0], held_)) return false;
    double smallest[block];
    kernels().singular_values(&jacobians_[0], held_, n, options_.rows, measures_, smallest);
    for (std::size_t k = 0; k < held_; ++k) {
      double margin = std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < n; ++i)
        margin = std::min({margin, q_[k * n + i] - limits_[2 * i], limits_[2 * i + 1] - q_[k * n + i]});
      margins_[k] = margin;
    }
    return true;
  }

  // Always as a batch: one configuration alone is computed in another order, and how many there are depends on the threads.
  bool jacobians(const double* q, std::size_t count) {
    if (plain_) return jacobian(chain_, q, count, JacobianKind::geometric, 1, &jacobians_[0]);
    return kernels().jacobians(chain_.folded(), q, count, JacobianKind::geometric, &jacobians_[0]);
  }

  // The group is complete: those of its answers that may be the best, now that it is known how good that is, wait to be looked at.
  void settle() {
    if (group_ == none) return;
    out_.margin[group_] = margin_;
    for (std::size_t k = 0; k < near_.size(); ++k) {
      if (near_[k] < enough_) continue;
      const double* from = &near_q_[k * n_];
      chosen_.push_back(group_);
      chosen_q_.insert(chosen_q_.end(), from, from + n_);
    }
    near_.clear(), near_q_.clear();
    enough_ = nowhere;
    if (chosen_.size() >= block) look_again();
  }

  // Singular values of what was chosen; all that is left of a group is here at once.
  void look_again() {
    const std::size_t count = chosen_.size(), n = n_;
    if (!good_ || count == 0) return;
    std::vector<double> product(count), smallest(count);
    for (std::size_t first = 0; first < count; first += block) {
      const std::size_t some = std::min(block, count - first);
      if (!jacobians(&chosen_q_[first * n], some)) {
        good_ = false;
        return;
      }
      kernels().singular_values(&jacobians_[0], some, n, options_.rows, &product[first], &smallest[first]);
    }
    for (std::size_t first = 0, last; first < count; first = last) {
      const std::size_t group = chosen_[first];
      double most = 0, singularity = 0;
      for (last = first; last < count && chosen_[last] == group; ++last) most = std::max(most, product[last]);
      for (std::size_t k = first; k < last; ++k)
        if (product[k] >= most * (1 - options_.alike)) singularity = std::max(singularity, smallest[k]);
      out_.manipulability[group] = most;
      out_.singularity[group] = singularity;
    }
    chosen_.clear(), chosen_q_.clear();
  }

  static constexpr std::size_t none = static_cast<std::size_t>(-1);

  const Chain& chain_;
  const ScoreOptions& options_;
  const Scores& out_;
  const std::size_t n_;
  bool plain_ = false, good_ = true;
  double slack_ = 0;
  std::vector<double> limits_, q_, jacobians_;
  std::size_t held_ = 0, runs_ = 0, run_groups_[block], run_ends_[block];
  double measures_[block], margins_[block];
  // the group that is being rated
  std::size_t group_ = none;
  double most_ = nowhere, enough_ = nowhere, margin_ = nowhere;
  std::vector<double> near_, near_q_;
  // of all groups since the last look
  std::vector<std::size_t> chosen_;
  std::vector<double> chosen_q_;
};

}  // namespace

bool score_some(const Chain& chain, const double* q, const bool* counted, std::size_t groups,
                const ScoreOptions& options, const Scores& out) {
  const std::size_t n = chain.joints(), slots = options.slots;
  Rating rating(chain, options, out);
  for (std::size_t g = 0; g < groups; ++g) {
    std::int64_t reached = 0, solutions = 0, most = 0;
    for (std::size_t pose = 0; pose < options.poses; ++pose, q += slots * n, counted += slots) {
      std::int64_t here = 0;
      for (std::size_t k = 0; k < slots;) {
        if (!counted[k]) {
          ++k;
          continue;
        }
        const std::size_t from = k;
        while (k < slots && counted[k] && k - from < block) ++k;
        here += static_cast<std::int64_t>(k - from);
        if (options.measures) rating.add(q + from * n, k - from, g);
      }
      reached += here > 0;
      solutions += here;
      most = std::max(most, here);
    }
    out.reached[g] = reached, out.solutions[g] = solutions, out.most[g] = most;
    if (options.measures && solutions == 0)
      out.manipulability[g] = out.singularity[g] = out.margin[g] = std::numeric_limits<double>::quiet_NaN();
  }
  return rating.finish();
}

}  // namespace pieper
