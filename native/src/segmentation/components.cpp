#include "segmentation/components.hpp"

#include <algorithm>

#include "segmentation/rows.hpp"

namespace pieper {
namespace {

std::uint64_t triangle(std::uint64_t n) { return n * (n - 1) / 2; }  // 0 + 1 + ... + (n - 1); 0 of 0
std::uint64_t pyramid(std::uint64_t n) { return n == 0 ? 0 : (n - 1) * n * (2 * n - 1) / 6; }  // of squares

void add(Sums& sums, const Run& run, std::uint32_t y) {
  const std::uint64_t n = run.end - run.start, x = triangle(run.end) - triangle(run.start);
  sums.n += n;
  sums.x += x;
  sums.y += n * y;
  sums.xx += pyramid(run.end) - pyramid(run.start);
  sums.xy += x * y;
  sums.yy += n * y * y;
  sums.left = std::min(sums.left, run.start);
  sums.right = std::max(sums.right, run.end);
  sums.bottom = y + 1;
}

void add(Sums& sums, const Sums& other) {
  sums.n += other.n;
  sums.x += other.x, sums.y += other.y;
  sums.xx += other.xx, sums.xy += other.xy, sums.yy += other.yy;
  sums.left = std::min(sums.left, other.left);
  sums.right = std::max(sums.right, other.right);
  sums.top = std::min(sums.top, other.top);
  sums.bottom = std::max(sums.bottom, other.bottom);
}

}  // namespace

Components components(const FrameView& frame, const ColorLookUp& look_up) {
  Components found;
  Rows rows(frame);
  std::vector<Run>& runs = found.runs;
  found.first.reserve(frame.height + 1);
  std::size_t above = 0;  // first run of the row above
  for (std::size_t y = 0; y < frame.height; ++y) {
    const std::size_t begin = runs.size();
    found.first.push_back(begin);
    const std::size_t count = rows.label(y, look_up);
    const std::uint8_t* labels = rows.labels();
    const std::uint32_t* changes = rows.changes();
    std::size_t candidate = above;
    for (std::size_t k = 0; k + 1 < count; ++k) {
      const std::uint8_t label = labels[changes[k]];
      if (label == 0) continue;
      Run run{changes[k], changes[k + 1], 0, label};
      bool alone = true;
      while (candidate < begin && runs[candidate].end < run.start) ++candidate;
      for (std::size_t other = candidate; other < begin && runs[other].start <= run.end; ++other) {
        if (runs[other].label != label) continue;
        run.set = alone ? found.sets.root(runs[other].set) : found.sets.join(run.set, runs[other].set);
        alone = false;
      }
      if (alone) {
        run.set = found.sets.make();
        Sums sums;
        sums.left = run.start, sums.right = run.end, sums.top = static_cast<std::uint32_t>(y), sums.label = label;
        found.sums.push_back(sums);
      }
      add(found.sums[run.set], run, static_cast<std::uint32_t>(y));
      runs.push_back(run);
    }
    above = begin;
  }
  found.first.push_back(runs.size());
  for (std::size_t k = found.sums.size(); k-- > 0;) {  // a root is less than its members
    const std::uint32_t root = found.sets.root(static_cast<std::uint32_t>(k));
    if (root != k) add(found.sums[root], found.sums[k]);
  }
  return found;
}

}  // namespace pieper
