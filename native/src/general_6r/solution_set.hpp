// The distinct solutions of one target.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "general_6r/singular_value.hpp"
#include "pieper/general_6r.hpp"

namespace pieper {

inline constexpr double same_solution = 1e-6;      // rad
inline constexpr double same_after_resort = 1e-5;  // rad, for solutions that were continued to a singular target

struct SolutionSet {
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
    SolutionSet kept;
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

}  // namespace pieper
