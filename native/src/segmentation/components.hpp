// The runs of a frame, and which of them hang together: one label, touching by side or corner.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "pieper/segmentation.hpp"

namespace pieper {

struct Run {
  std::uint32_t start, end;  // columns, the last not included
  std::uint32_t set;
  std::uint8_t label;
};

struct Sums {
  std::uint64_t n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  std::uint32_t left, right, top, bottom;  // right and bottom not included
  std::uint8_t label;
};

class Sets {
 public:
  std::uint32_t make() {
    parent_.push_back(static_cast<std::uint32_t>(parent_.size()));
    return parent_.back();
  }
  std::uint32_t root(std::uint32_t k) {
    while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
    return k;
  }
  std::uint32_t join(std::uint32_t a, std::uint32_t b) {
    a = root(a), b = root(b);
    return a < b ? parent_[b] = a : parent_[a] = b;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

struct Components {
  std::vector<Run> runs;
  std::vector<std::size_t> first;  // run of each row, and one past the last
  std::vector<Sums> sums;          // of each set; whole where the set is its root
  Sets sets;
};

Components components(const FrameView&, const ColorLookUp&);

}  // namespace pieper
