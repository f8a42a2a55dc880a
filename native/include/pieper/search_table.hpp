// The space in which inverse kinematics looks for solutions, and a table of starting points with their poses.
#pragma once

#include <memory>
#include <vector>

#include "pieper/chain.hpp"
#include "pieper/numeric_ik.hpp"

namespace pieper {

// Joints of the search space differ from those of the chain in two ways: whole turns are taken off, and joints that can
// make a full turn have no limits.
class SearchTable {
 public:
  explicit SearchTable(const Chain&);

  const SearchSpace& space() const { return space_; }
  // Sum of the distances from axis to axis up to the tip: no tip is farther from the first axis point than this [m].
  double reach() const { return reach_; }

  // The nearest point of the search space to joint values, and back: the copy within limits that is nearest to `near`
  // (null: to the middle of the starting box).
  void to_search(const double* q, double* out) const;
  void from_search(const double* x, const double* near, double* q) const;

 private:
  void set_boxes(const Chain&);
  void set_reach(const Chain&);
  void set_starts(const Chain&);

  SearchSpace space_;
  double reach_ = 0;
  std::vector<double> lower_, upper_, first_, last_, longest_step_, steps_, starts_, poses_;
  std::vector<double> limits_, shift_;  // q = x + shift
  std::vector<char> periodic_;
  std::unique_ptr<bool[]> turns_;
};

}  // namespace pieper
