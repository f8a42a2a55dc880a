// Patches of one colour in a frame.
//
// 1. Labels. Each pixel's bytes index a table; the kernels say where the label changes along a row.
// 2. Runs. Between two changes lies a run of one label.
// 3. Union-find. A run belongs to the blobs of the runs of its label in the row above that it touches, by side or corner
//    (8-connectivity); Rosenfeld and Pfaltz 1966. The least number of a set is its root, so that blobs are in the order of their first
//    pixels.
// 4. Moments. Each run adds its pixels, coordinates and their products in closed form, in integers: the area centroid is exact.
// 5. Refinement. A table cuts an anti-aliased edge at some threshold. How much of an edge pixel the patch covers is
//    measured instead: the projection of (pixel - background around) on (inside - background around), which is linear in coverage.
#include "pieper/segmentation.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "segmentation/components.hpp"
#include "segmentation/refinement.hpp"
#include "segmentation/rows.hpp"

namespace pieper {
namespace {

// Of the part of an edge pixel that is counted wrongly when it is in or out: uniform. Discs show that pixels of an edge err
// nearly independently.
constexpr double cut_variance = 1.0 / 12;

Blob blob_of(const Sums& sums) {
  Blob blob;
  const double n = static_cast<double>(sums.n);
  // about a corner of the extent, so that no digits are lost far from the origin
  const double x0 = sums.left, y0 = sums.top;
  const double mx = (static_cast<double>(sums.x) - n * x0) / n, my = (static_cast<double>(sums.y) - n * y0) / n;
  const auto central = [&](std::uint64_t square, std::uint64_t a, std::uint64_t b, std::uint64_t a0, std::uint64_t b0) {
    // sum (a - a0)(b - b0) in integers, which wrap around and come back
    return static_cast<double>(static_cast<std::int64_t>(square - a0 * b - b0 * a + sums.n * a0 * b0)) / n;
  };
  const double xx = central(sums.xx, sums.x, sums.x, sums.left, sums.left) - mx * mx + 1.0 / 12,
               yy = central(sums.yy, sums.y, sums.y, sums.top, sums.top) - my * my + 1.0 / 12,
               xy = central(sums.xy, sums.x, sums.y, sums.left, sums.top) - mx * my;
  constexpr double pi = 3.14159265358979323846;
  blob.label = sums.label;
  blob.area = sums.n;
  blob.x = x0 + mx, blob.y = y0 + my;
  blob.left = sums.left, blob.top = sums.top;
  blob.width = sums.right - sums.left, blob.height = sums.bottom - sums.top;
  blob.circularity = n / (2 * pi * (xx + yy));
  const double length = 2 * std::sqrt(pi * n / blob.circularity);  // pixels, as many as a disc of these moments has
  const double scale = cut_variance * length * 2 / (n * n);
  blob.xx = scale * xx, blob.yy = scale * yy, blob.xy = scale * xy;
  return blob;
}

// A blob that touches the border of the frame goes on outside, nobody knows how far.
void widen_at_border(Blob& blob, const FrameView& frame) {
  const auto unknown = [](double size) { return size * size / 16; };
  if (blob.left == 0 || blob.left + blob.width == frame.width) blob.xx += unknown(blob.width);
  if (blob.top == 0 || blob.top + blob.height == frame.height) blob.yy += unknown(blob.height);
}

}  // namespace

std::vector<Blob> segment(const FrameView& frame, const ColorLookUp& look_up, const SegmentOptions& options,
                          std::int32_t* numbers) {
  std::vector<Blob> blobs;
  if (numbers) std::fill_n(numbers, frame.width * frame.height, 0);
  if (frame.width == 0 || frame.height == 0) return blobs;
  Components found = components(frame, look_up);
  Refiner refiner(frame, found, options.min_area);
  std::vector<std::int32_t> number(numbers ? found.sums.size() : 0, 0);
  for (std::uint32_t k = 0; k < found.sums.size(); ++k) {
    const Sums& sums = found.sums[k];
    if (found.sets.root(k) != k || sums.n < options.min_area || sums.n > options.max_area) continue;
    blobs.push_back(blob_of(sums));
    if (options.refine) refiner.refine(blobs.back(), k);
    widen_at_border(blobs.back(), frame);
    if (numbers) number[k] = static_cast<std::int32_t>(blobs.size());
  }
  if (numbers)
    for (std::size_t y = 0; y < frame.height; ++y)
      for (std::size_t r = found.first[y]; r < found.first[y + 1]; ++r) {
        const Run& run = found.runs[r];
        std::fill(numbers + y * frame.width + run.start, numbers + y * frame.width + run.end,
                  number[found.sets.root(run.set)]);
      }
  return blobs;
}

void classify(const FrameView& frame, const ColorLookUp& look_up, std::uint8_t* labels) {
  if (frame.width == 0) return;
  Rows rows(frame);
  for (std::size_t y = 0; y < frame.height; ++y) {
    rows.label(y, look_up);
    std::memcpy(labels + y * frame.width, rows.labels(), frame.width);
  }
}

}  // namespace pieper
