// Starting points: the additive recurrence of Roberts (2018), the generalised golden ratio, over the box of the joints.
#include "pieper/search_table.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pieper/kernels.hpp"

namespace pieper {
namespace {

constexpr double turn = 2 * std::numbers::pi;
// Limits beyond this bound nothing [rad or m]; a seed beyond it is too far away to be followed by whole turns.
constexpr double endless = 1e3, endless_slide = 1e6;
// Where a search without limits starts: about one turn, and what a rail or a mobile base may cover.
constexpr double first_turn = 1, first_slide = 100;
constexpr std::size_t table_pages = 4, page_entries = 1024;

// The joint only slides axes.
bool sliding_joint(const Chain& chain, std::size_t joint) {
  for (std::size_t i = 0; i < chain.axes(); ++i) {
    const double factor = chain.coupled() ? chain.coupling(i)[joint] : (i == joint ? 1.0 : 0.0);
    if (factor != 0 && chain.folded().axes[i].revolute) return false;
  }
  return true;
}

}  // namespace

SearchTable::SearchTable(const Chain& chain) {
  set_boxes(chain);
  set_reach(chain);
  set_starts(chain);
}

void SearchTable::set_boxes(const Chain& chain) {
  const std::size_t n = chain.joints();
  turns_ = std::make_unique<bool[]>(n);
  for (std::size_t i = 0; i < n; ++i) {
    double lower = chain.lower(i), upper = chain.upper(i), shift = 0;
    limits_.push_back(lower), limits_.push_back(upper);
    const bool periodic = chain.range(i).turns;
    const bool turns = periodic && upper - lower >= turn;
    double first = lower, last = upper;
    if (turns) {
      const double middle = std::min(std::max(0.0, lower + turn / 2), upper - turn / 2);
      first = middle - turn / 2, last = middle + turn / 2;
      lower = -INFINITY, upper = INFINITY;
    }
    const bool slides = sliding_joint(chain, i);
    const double most = slides ? endless_slide : endless, room = slides ? first_slide : first_turn;
    if (!turns && (std::abs(lower) > most || std::abs(upper) > most)) {  // unbounded, or on one side
      first = std::abs(lower) <= most ? lower : std::abs(upper) <= most ? upper - 2 * room : -room;
      last = std::abs(upper) <= most ? upper : first + 2 * room;
    }
    longest_step_.push_back(slides ? std::max(1.0, 0.25 * (last - first)) : 1.0);
    if (periodic) {
      shift = turn * std::round(0.5 * (first + last) / turn);
      first -= shift, last -= shift, lower -= shift, upper -= shift;
    }
    lower_.push_back(lower), upper_.push_back(upper), first_.push_back(first), last_.push_back(last);
    shift_.push_back(shift), turns_[i] = turns, periodic_.push_back(periodic);
  }
  space_.joints = n;
  space_.lower = lower_.data(), space_.upper = upper_.data();
  space_.first = first_.data(), space_.last = last_.data();
  space_.longest_step = longest_step_.data();
  space_.turns = turns_.get();
  space_.coupling = chain.coupled() ? chain.coupling(0) : nullptr;
}

void SearchTable::set_reach(const Chain& chain) {
  for (std::size_t i = 0; i < chain.axes(); ++i) {
    const Axis& axis = chain.folded().axes[i];
    reach_ += std::hypot(axis.x, axis.y, axis.z);
    if (axis.revolute) continue;
    double slide = 0;
    for (std::size_t k = 0; k < chain.joints(); ++k) {
      const double factor = chain.coupled() ? chain.coupling(i)[k] : (i == k ? 1.0 : 0.0);
      if (factor != 0) slide += std::abs(factor) * std::max(std::abs(chain.lower(k)), std::abs(chain.upper(k)));
    }
    reach_ += slide;
  }
}

void SearchTable::set_starts(const Chain& chain) {
  const std::size_t n = chain.joints(), total = table_pages * page_entries;
  double ratio = 2;  // root of x^(n + 1) = x + 1
  for (int k = 0; k < 64; ++k) ratio = std::pow(1 + ratio, 1.0 / static_cast<double>(n + 1));
  for (std::size_t i = 0; i < n; ++i) steps_.push_back(std::pow(ratio, -static_cast<double>(i + 1)));
  starts_.resize(total * n);
  for (std::size_t k = 0; k < total; ++k)
    for (std::size_t i = 0; i < n; ++i) {
      const double part = 0.5 + static_cast<double>(k) * steps_[i];
      starts_[k * n + i] = first_[i] + (part - std::floor(part)) * (last_[i] - first_[i]);
    }
  std::vector<double> full(total * 16);
  forward_kinematics(chain, starts_.data(), total, 1, full.data());
  poses_.resize(total * 12);
  constexpr std::size_t from[12] = {3, 7, 11, 0, 1, 2, 4, 5, 6, 8, 9, 10};
  for (std::size_t page = 0; page < table_pages; ++page)
    for (std::size_t row = 0; row < 12; ++row)
      for (std::size_t k = 0; k < page_entries; ++k)
        poses_[(page * 12 + row) * page_entries + k] = full[(page * page_entries + k) * 16 + from[row]];
  space_.poses = poses_.data(), space_.starts = starts_.data(), space_.steps = steps_.data();
  space_.pages = table_pages, space_.entries = page_entries;
}

void SearchTable::to_search(const double* q, double* out) const {
  for (std::size_t i = 0; i < space_.joints; ++i) {
    double x = q[i] - shift_[i];
    if (periodic_[i] && (turns_[i] || x < lower_[i] || x > upper_[i])) {
      const double middle = 0.5 * (first_[i] + last_[i]);
      x -= turn * std::round((x - middle) / turn);
    }
    out[i] = std::min(std::max(x, lower_[i]), upper_[i]);
  }
}

void SearchTable::from_search(const double* x, const double* near, double* q) const {
  for (std::size_t i = 0; i < space_.joints; ++i) {
    q[i] = x[i] + shift_[i];
    if (turns_[i]) {
      const double wanted = near && std::abs(near[i]) <= endless ? near[i] : shift_[i] + 0.5 * (first_[i] + last_[i]);
      q[i] -= turn * std::round((q[i] - wanted) / turn);
      if (q[i] < limits_[2 * i]) q[i] += turn * std::ceil((limits_[2 * i] - q[i]) / turn);
      if (q[i] > limits_[2 * i + 1]) q[i] -= turn * std::ceil((q[i] - limits_[2 * i + 1]) / turn);
    }
    q[i] = std::min(std::max(q[i], limits_[2 * i]), limits_[2 * i + 1]);
  }
}

const SearchTable& Chain::search_table() const {
  std::call_once(search_table_once_, [this] { search_table_ = std::make_shared<const SearchTable>(*this); });
  return *search_table_;
}

}  // namespace pieper
