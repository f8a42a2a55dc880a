// Which starting points a target gets: those of a table of poses that are nearest to it, then a low-discrepancy sequence.
#pragma once

#include "simd/target_rows.hpp"

namespace {

// Number of starting points that one page of the table gives, whatever the width of a vector.
constexpr std::size_t strata = 16;

// Starting points for one target, in the order in which they are tried.
class Starts {
 public:
  Starts(const SearchSpace& space, const Goal& goal, const double* seed) : space_(space), goal_(goal), seed_(seed) {}

  // Writes the next starting point into lane l of q.
  void next(std::size_t l, Vec* q) {
    const std::size_t n = space_.joints;
    if (seed_) {
      for (std::size_t i = 0; i < n; ++i) lane(q[i], l) = seed_[i];
      seed_ = nullptr;
      return;
    }
    if (at_ == strata && page_ < space_.pages) read_page();
    if (at_ < strata) {
      const double* start = space_.starts + n * order_[at_++];
      for (std::size_t i = 0; i < n; ++i) lane(q[i], l) = start[i];
      return;
    }
    ++beyond_;
    for (std::size_t i = 0; i < n; ++i) {
      double part = 0.5 + static_cast<double>(space_.pages * space_.entries + beyond_) * space_.steps[i];
      part -= std::floor(part);
      lane(q[i], l) = space_.first[i] + part * (space_.last[i] - space_.first[i]);
    }
  }

 private:
  // The nearest entry of every stratum of the next page, the nearest of all first.
  void read_page() {
    constexpr std::size_t width = strata / lanes;
    Vec best[width], where[width];
    for (std::size_t w = 0; w < width; ++w) best[w] = splat(1e300), where[w] = splat(0.0);
    double weight_p = 0, turn[9] = {};
    for (int r = 0; r < 3; ++r) weight_p += goal_.weights[r] * goal_.weights[r] / 3;
    if (goal_.rotation == RotationTarget::full) {
      const double weight = (goal_.weights[3] + goal_.weights[4] + goal_.weights[5]) / 3;
      if (!goal_.part_of_rotation)
        for (int k = 0; k < 9; ++k) turn[k] = weight * weight * goal_.R[k];
    } else if (goal_.rotation == RotationTarget::axis) {
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
          turn[3 * r + c] = 2 * goal_.weights[3] * goal_.weights[3] * goal_.direction[r] * goal_.tool_axis[c];
    }
    const std::size_t entries = space_.entries;
    const double* page = space_.poses + page_ * 12 * entries;
    for (std::size_t k = 0; k < entries; k += strata)
      for (std::size_t w = 0; w < width; ++w) {
        const double* from = page + k + w * lanes;
        const Vec x = load(from) - goal_.p[0], y = load(from + entries) - goal_.p[1],
                  z = load(from + 2 * entries) - goal_.p[2];
        Vec score = weight_p * (x * x + y * y + z * z);
        for (std::size_t j = 0; j < 9; ++j) score -= turn[j] * load(from + (3 + j) * entries);
        const IntVec nearer = score < best[w];
        best[w] = select(nearer, score, best[w]);
        where[w] = select(nearer, splat(static_cast<double>(k + w * lanes)), where[w]);
      }
    double scores[strata];
    for (std::size_t w = 0; w < width; ++w)
      for (std::size_t l = 0; l < lanes; ++l) {
        const double score = lane(best[w], l);
        const std::size_t entry = page_ * entries + static_cast<std::size_t>(lane(where[w], l)) + l;
        std::size_t k = w * lanes + l;
        for (; k > 0 && scores[k - 1] > score; --k) scores[k] = scores[k - 1], order_[k] = order_[k - 1];
        scores[k] = score, order_[k] = entry;
      }
    ++page_, at_ = 0;
  }

  const SearchSpace& space_;
  const Goal& goal_;
  const double* seed_;
  std::size_t order_[strata];
  std::size_t at_ = strata, page_ = 0, beyond_ = 0;
};

}  // namespace
