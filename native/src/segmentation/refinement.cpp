#include "segmentation/refinement.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace pieper {
namespace {

struct Color {
  std::int32_t c[3];
};

struct PackedPixels {
  const FrameView& frame;
  Color operator()(std::size_t y, std::size_t x) const {
    const std::uint8_t* p = frame.rows + static_cast<std::ptrdiff_t>(y) * frame.stride + 3 * x;
    return {{p[0], p[1], p[2]}};
  }
};

struct LumaChroma {
  const FrameView& frame;
  Color operator()(std::size_t y, std::size_t x) const {
    const std::uint8_t *row = frame.rows + static_cast<std::ptrdiff_t>(y) * frame.stride, *u, *v, *luma = row + x;
    if (frame.layout == PixelLayout::yuyv) {
      luma = row + 2 * x;
      u = row + x / 2 * 4 + 1, v = u + 2;
    } else {
      const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(y / 2) * frame.chroma_stride;
      const bool pairs = frame.layout == PixelLayout::nv12;
      u = frame.chroma[0] + offset + (pairs ? x / 2 * 2 : x / 2);
      v = pairs ? u + 1 : frame.chroma[1] + offset + x / 2;
    }
    return {{*luma, *u, *v}};
  }
};

constexpr std::uint32_t edge = 2;  // pixels on either side of the border of the label in which the real edge is sought
constexpr std::uint32_t around = edge + 2;  // the background is taken from between `edge` and this
constexpr std::uint32_t margin = around + 1;
constexpr std::uint32_t widest = 240;   // of a blob that is refined
constexpr int enough = 12;              // pixels of background, and of inside where that is eroded
constexpr int plenty = 100;             // pixels of inside for its mean; of more, rows are left out
constexpr double contrast = 24;         // between inside and background, below which noise drowns the coverage
constexpr double luma_contrast = 30;    // above which luma, which every pixel has of its own, is enough
constexpr double grain = 1;             // variance of every pixel, of rounding and of what a small sample does not show
constexpr double contested = 1.0 / 12;  // variance of the coverage of a pixel that is taken by its label alone
constexpr double floor_variance = 1e-4;  // px^2: what no measurement of noise shows, 0.01 px

// Mean and covariance of pixels; fewer than 2^15 of them.
struct Spread {
  std::int32_t n = 0, sum[3] = {}, product[6] = {};
  double mean[3], covariance[6];  // xx, yy, zz, xy, xz, yz
  void add(const Color& p) {
    ++n;
    for (int c = 0; c < 3; ++c) sum[c] += p.c[c], product[c] += p.c[c] * p.c[c];
    product[3] += p.c[0] * p.c[1], product[4] += p.c[0] * p.c[2], product[5] += p.c[1] * p.c[2];
  }
  void finish() {
    const double N = n;
    for (int c = 0; c < 3; ++c) mean[c] = sum[c] / N, covariance[c] = product[c] / N - mean[c] * mean[c];
    covariance[3] = product[3] / N - mean[0] * mean[1];
    covariance[4] = product[4] / N - mean[0] * mean[2];
    covariance[5] = product[5] / N - mean[1] * mean[2];
  }
};

// The direction d with d . (m - b) = 1 along which the spread S is least, S^-1 (m - b) / ((m - b)' S^-1 (m - b)); returns
// that spread, or 0 where there is no such direction. Where a marker lies between two backgrounds, d is across what tells them apart.
double quiet_direction(const double S[6], const double difference[3], double d[3]) {
  const double xx = S[1] * S[2] - S[5] * S[5], yy = S[0] * S[2] - S[4] * S[4], zz = S[0] * S[1] - S[3] * S[3],
               xy = S[4] * S[5] - S[3] * S[2], xz = S[3] * S[5] - S[4] * S[1], yz = S[3] * S[4] - S[0] * S[5];
  const double determinant = S[0] * xx + S[3] * xy + S[4] * xz;
  d[0] = xx * difference[0] + xy * difference[1] + xz * difference[2];
  d[1] = xy * difference[0] + yy * difference[1] + yz * difference[2];
  d[2] = xz * difference[0] + yz * difference[1] + zz * difference[2];
  const double size = d[0] * difference[0] + d[1] * difference[1] + d[2] * difference[2];
  if (!(size > 0)) return 0;
  for (int c = 0; c < 3; ++c) d[c] /= size;
  return determinant / size;
}

// Clears what lies beyond the width.
void trim(BitRows& rows, std::size_t width) {
  if (width % 64 == 0) return;
  const std::uint64_t kept = (std::uint64_t{1} << width % 64) - 1;
  for (std::size_t k = rows.words() - 1; k < rows.size(); k += rows.words()) rows[k] &= kept;
}

}  // namespace

// How much of a pixel is covered: offset + d . color, with this variance.
struct Refiner::Coverage {
  double offset, d[3], noise;
};

void Refiner::refine(Blob& blob, std::uint32_t set) {
  if (blob.width > widest || blob.height > widest) return;
  if (frame_.layout == PixelLayout::packed)
    refine(blob, set, PackedPixels{frame_});
  else
    refine(blob, set, LumaChroma{frame_});
}

template <class Pixels>
void Refiner::refine(Blob& blob, std::uint32_t set, Pixels pixels) {
  const Window window{blob.left > margin ? blob.left - margin : 0, blob.top > margin ? blob.top - margin : 0,
                      std::min<std::size_t>(blob.left + blob.width + margin, frame_.width),
                      std::min<std::size_t>(blob.top + blob.height + margin, frame_.height)};
  const bool crowded = look(set, window);
  const int middle = draw_masks(window.width(), crowded);
  Coverage coverage;
  if (measure_coverage(window, middle, pixels, coverage)) move_centroid(blob, window, coverage, pixels);
}

// Fills in which pixels of the window are the set's and which are another blob's; true if there are any of the latter.
bool Refiner::look(std::uint32_t set, const Window& window) {
  const std::size_t x0 = window.x0, y0 = window.y0, x1 = window.x1, y1 = window.y1;
  for (BitRows* rows : {&own_, &others_, &inside_, &near_, &far_, &scratch_}) rows->resize(y1 - y0, x1 - x0);
  bool crowded = false;
  for (std::size_t y = y0; y < y1; ++y) {
    const auto begin = found_.runs.begin() + static_cast<std::ptrdiff_t>(found_.first[y]),
               end = found_.runs.begin() + static_cast<std::ptrdiff_t>(found_.first[y + 1]);
    auto run = std::partition_point(begin, end, [&](const Run& r) { return r.end <= x0; });
    for (; run != end && run->start < x1; ++run) {
      const std::uint32_t root = found_.sets.root(run->set);
      if (root != set && found_.sums[root].n < min_area_) continue;
      (root == set ? own_ : others_)
          .set(y - y0, std::max<std::size_t>(run->start, x0) - x0, std::min<std::size_t>(run->end, x1) - x0);
      crowded = crowded || root != set;
    }
  }
  return crowded;
}

// Inside: whole pixels; near: up to where the edge may be; far: where the background is taken from. Returns how many pixels are
// inside.
int Refiner::draw_masks(std::size_t width, bool crowded) {
  erode(own_, scratch_, width), erode(scratch_, inside_, width);
  own_.spread(scratch_), scratch_.spread(near_);
  near_.spread(scratch_), scratch_.spread(far_);
  if (crowded) {  // a thin line of another label is the edge between two colours; only what has a middle is another thing
    erode(others_, scratch_, width);
    scratch_.spread(others_), others_.spread(scratch_), scratch_.spread(others_);
  }
  int middle = 0;
  for (std::size_t k = 0; k < own_.size(); ++k) {
    far_[k] &= ~near_[k] & ~others_[k];
    near_[k] &= ~inside_[k];
    middle += std::popcount(inside_[k]);
  }
  if (crowded)
    std::swap(others_, scratch_);  // the edge keeps away from another blob by one pixel, the background by two
  trim(far_, width), trim(near_, width);
  return middle;
}

// False where background and inside do not tell themselves apart.
template <class Pixels>
bool Refiner::measure_coverage(const Window& window, int middle, Pixels pixels, Coverage& out) {
  Spread background, marker;
  far_.each(1,
            [&](std::size_t y, std::size_t x, std::size_t) { background.add(pixels(window.y0 + y, window.x0 + x)); });
  if (background.n < enough) return false;
  const BitRows& sure = middle < enough ? own_ : inside_;
  const auto note = [&](std::size_t y, std::size_t x, std::size_t) {
    marker.add(pixels(window.y0 + y, window.x0 + x));
  };
  sure.each(middle < 2 * plenty ? 1 : middle < 3 * plenty ? 2 : 4, note);
  if (marker.n < enough) marker = Spread{}, sure.each(1, note);
  background.finish(), marker.finish();
  double difference[3], S[6], size = 0, *const d = out.d;
  for (int c = 0; c < 3; ++c) {
    difference[c] = marker.mean[c] - background.mean[c];
    size += difference[c] * difference[c];
  }
  if (size < contrast * contrast) return false;
  for (int c = 0; c < 6; ++c) S[c] = (background.covariance[c] + marker.covariance[c]) / 2 + (c < 3 ? grain : 0);
  out.noise = quiet_direction(S, difference, d);
  if (frame_.layout != PixelLayout::packed && std::abs(difference[0]) >= luma_contrast) {
    d[0] = 1 / difference[0], d[1] = d[2] = 0;
    out.noise = S[0] * d[0] * d[0];
  }
  if (!(out.noise > 0)) return false;
  out.offset = 0;
  for (int c = 0; c < 3; ++c) out.offset -= d[c] * background.mean[c];
  return true;
}

// How far the pixels of the edge move the centroid that the label gave.
template <class Pixels>
void Refiner::move_centroid(Blob& blob, const Window& window, const Coverage& coverage, Pixels pixels) const {
  const double* d = coverage.d;
  const double cx = blob.x - static_cast<double>(window.x0), cy = blob.y - static_cast<double>(window.y0);
  double n = static_cast<double>(blob.area), dx = 0, dy = 0, xx = 0, xy = 0, yy = 0;
  near_.each(1, [&](std::size_t y, std::size_t x, std::size_t word) {
    const double labelled = static_cast<double>(own_[word] >> x % 64 & 1);
    double cover = labelled, variance = contested;
    if ((others_[word] >> x % 64 & 1) == 0) {
      const Color p = pixels(window.y0 + y, window.x0 + x);
      const double raw = coverage.offset + d[0] * p.c[0] + d[1] * p.c[1] + d[2] * p.c[2];
      cover = std::min(std::max(raw, 0.0), 1.0), variance = cover == raw ? coverage.noise : 0;
    }
    const double u = static_cast<double>(x) - cx, v = static_cast<double>(y) - cy, more = cover - labelled;
    n += more, dx += more * u, dy += more * v;
    xx += variance * u * u, xy += variance * u * v, yy += variance * v * v;
  });
  if (!(n >= 1)) return;
  blob.x += dx / n, blob.y += dy / n;
  blob.xx = xx / (n * n) + floor_variance, blob.xy = xy / (n * n), blob.yy = yy / (n * n) + floor_variance;
}

// What is set and touches only what is set; beyond the rectangle all is. Beyond the width it says nothing.
void Refiner::erode(const BitRows& from, BitRows& to, std::size_t width) {
  complement_.resize(from.rows(), width);
  for (std::size_t k = 0; k < from.size(); ++k) complement_[k] = ~from[k];
  trim(complement_, width);
  complement_.spread(to);
  for (std::size_t k = 0; k < to.size(); ++k) to[k] = ~to[k];
  trim(to, width);
}

}  // namespace pieper
