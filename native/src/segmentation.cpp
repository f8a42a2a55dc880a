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
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>

#include "pieper/kernels.hpp"

namespace pieper {
namespace {

// ---- the sieve: products of sets that cover the labelled cells

constexpr int levels = 16, most_products = 16;

// How much it costs to admit a cell without a label, by how common its pixels are: most of what cameras see is nearly grey.
// Labelled cells cost nothing.
class Costs {
 public:
  explicit Costs(const std::vector<std::uint16_t>& labelled) {
    for (int a = 0; a < levels; ++a)
      for (int b = 0; b < levels; ++b)
        for (int c = 0; c < levels; ++c) {
          const float colorful = static_cast<float>(std::max({a, b, c}) - std::min({a, b, c})) / 2;
          of_[a << 8 | b << 4 | c] = std::exp(-colorful * colorful) + 0.01f;
        }
    for (std::uint16_t cell : labelled) of_[cell] = 0;
  }
  float operator()(const std::uint16_t sets[3]) const {
    float sum = 0;
    for (unsigned A = sets[0]; A != 0; A &= A - 1)
      for (unsigned B = sets[1]; B != 0; B &= B - 1) {
        const float* row = &of_[static_cast<std::size_t>(std::countr_zero(A) << 8 | std::countr_zero(B) << 4)];
        for (unsigned C = sets[2]; C != 0; C &= C - 1) sum += row[std::countr_zero(C)];
      }
    return sum;
  }

 private:
  float of_[levels * levels * levels];
};

int value_of(std::uint16_t cell, int channel) { return cell >> (8 - 4 * channel) & 15; }

struct Product {
  std::vector<std::uint16_t> cells;  // a << 8 | b << 4 | c
  std::uint16_t sets[3] = {};
  float cost = 0;
  // the cut in two, at a value of one channel, that saves most
  float gain = 0;
  int channel = 0, at = 0;

  Product(std::vector<std::uint16_t> own, const Costs& costs) : cells(std::move(own)) {
    for (std::uint16_t cell : cells)
      for (int c = 0; c < 3; ++c) sets[c] = static_cast<std::uint16_t>(sets[c] | 1u << value_of(cell, c));
    cost = costs(sets);
    for (int c = 0; c < 3; ++c) find_cut(c, costs);
  }

 private:
  void find_cut(int along, const Costs& costs) {
    std::uint16_t seen[levels][3] = {};  // of the cells with each value of the channel
    for (std::uint16_t cell : cells)
      for (int c = 0; c < 3; ++c) {
        std::uint16_t& set = seen[value_of(cell, along)][c];
        set = static_cast<std::uint16_t>(set | 1u << value_of(cell, c));
      }
    const auto cost_of = [&](int from, int to) {
      std::uint16_t part[3] = {};
      for (int v = from; v < to; ++v)
        for (int c = 0; c < 3; ++c) part[c] = static_cast<std::uint16_t>(part[c] | seen[v][c]);
      return costs(part);
    };
    for (int v = 1; v < levels; ++v) {
      const float saved = cost - cost_of(0, v) - cost_of(v, levels);
      if (saved > gain) gain = saved, channel = along, at = v;
    }
  }
};

std::vector<Product> cover(std::vector<std::uint16_t> cells) {
  std::vector<Product> products;
  if (cells.empty()) return products;
  const Costs costs(cells);
  products.emplace_back(std::move(cells), costs);
  while (products.size() < most_products) {
    Product& worst = *std::max_element(products.begin(), products.end(),
                                       [](const Product& a, const Product& b) { return a.gain < b.gain; });
    if (!(worst.gain > 0)) break;
    std::vector<std::uint16_t> low, high;
    for (std::uint16_t cell : worst.cells) (value_of(cell, worst.channel) < worst.at ? low : high).push_back(cell);
    worst = Product(std::move(low), costs);
    products.emplace_back(std::move(high), costs);
  }
  return products;
}

// Which cells of 16 x 16 x 16 hold a label.
std::vector<std::uint16_t> labelled_cells(const std::uint8_t* labels, unsigned bits) {
  std::array<bool, levels * levels * levels> any{};
  const std::size_t side = std::size_t{1} << bits;
  const auto span = [&](std::size_t v) {  // the values of four bits that one of `bits` bits stands for
    return bits >= 4 ? std::array<std::size_t, 2>{v >> (bits - 4), (v >> (bits - 4)) + 1}
                     : std::array<std::size_t, 2>{v << (4 - bits), (v + 1) << (4 - bits)};
  };
  for (std::size_t a = 0; a < side; ++a)
    for (std::size_t b = 0; b < side; ++b)
      for (std::size_t c = 0; c < side; ++c) {
        if (labels[(a * side + b) * side + c] == 0) continue;
        const auto A = span(a), B = span(b), C = span(c);
        for (std::size_t i = A[0]; i < A[1]; ++i)
          for (std::size_t j = B[0]; j < B[1]; ++j)
            for (std::size_t k = C[0]; k < C[1]; ++k) any[i << 8 | j << 4 | k] = true;
      }
  std::vector<std::uint16_t> cells;
  for (std::size_t k = 0; k < any.size(); ++k)
    if (any[k]) cells.push_back(static_cast<std::uint16_t>(k));
  return cells;
}

// ---- rows of a frame, whatever its layout

class Rows {
 public:
  explicit Rows(const FrameView& frame)
      : frame_(frame), labels_(32 + (frame.width + 31) / 32 * 32, 0), changes_(frame.width + 1) {
    if (frame.layout == PixelLayout::yuyv) planes_.resize(3 * frame.width);
    if (frame.layout == PixelLayout::i420 || frame.layout == PixelLayout::nv12) planes_.resize(2 * frame.width);
  }

  // Labels of row y; where they change is in changes().
  std::size_t label(std::size_t y, const ColorLookUp& look_up) {
    const SegmentationKernels& run = *kernels().segmentation;
    const std::uint8_t* row = frame_.rows + static_cast<std::ptrdiff_t>(y) * frame_.stride;
    const std::size_t n = frame_.width;
    if (frame_.layout == PixelLayout::packed) return run.packed(look_up, row, n, labels(), changes_.data());
    const std::uint8_t* planes[3] = {row, &planes_[0], &planes_[n]};
    if (frame_.layout == PixelLayout::yuyv) {
      std::uint8_t *luma = &planes_[2 * n], *u = &planes_[0], *v = &planes_[n];
      for (std::size_t x = 0; x + 1 < n; x += 2, row += 4) {
        luma[x] = row[0], luma[x + 1] = row[2];
        u[x] = u[x + 1] = row[1];
        v[x] = v[x + 1] = row[3];
      }
      planes[0] = luma;
    } else if (y % 2 == 0) {  // the next row has the same chroma
      const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(y / 2) * frame_.chroma_stride;
      const bool pairs = frame_.layout == PixelLayout::nv12;
      const std::uint8_t* u = frame_.chroma[0] + offset;
      const std::uint8_t* v = pairs ? u + 1 : frame_.chroma[1] + offset;
      const std::size_t step = pairs ? 2 : 1;
      for (std::size_t x = 0; x + 1 < n; x += 2, u += step, v += step) {
        planes_[x] = planes_[x + 1] = *u;
        planes_[n + x] = planes_[n + x + 1] = *v;
      }
    }
    return run.planar(look_up, planes, n, labels(), changes_.data());
  }

  std::uint8_t* labels() { return labels_.data() + 32; }
  const std::uint32_t* changes() const { return changes_.data(); }

 private:
  FrameView frame_;
  std::vector<std::uint8_t> labels_;  // after 32 zeros
  std::vector<std::uint32_t> changes_;
  std::vector<std::uint8_t> planes_;
};

// ---- runs and their sets

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

// ---- a set as a blob, by its area alone

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

// ---- the centroid by coverage

// Rows of bits, one word or a few each.
class BitRows {
 public:
  void resize(std::size_t height, std::size_t width) {
    words_ = (width + 63) / 64;
    rows_ = height;
    bits_.assign(rows_ * words_, 0);
  }
  std::size_t rows() const { return rows_; }
  std::uint64_t* row(std::size_t y) { return &bits_[y * words_]; }
  std::size_t words() const { return words_; }
  std::uint64_t& operator[](std::size_t k) { return bits_[k]; }
  std::uint64_t operator[](std::size_t k) const { return bits_[k]; }
  std::size_t size() const { return bits_.size(); }
  void set(std::size_t y, std::size_t from, std::size_t to) {
    for (std::size_t w = from / 64; w * 64 < to; ++w) {
      const std::size_t low = std::max(from, w * 64) - w * 64, high = std::min(to, w * 64 + 64) - w * 64;
      bits_[y * words_ + w] |= (high == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << high) - 1) & ~std::uint64_t{0}
                                                                                                       << low;
    }
  }
  // What is set or touches what is set, by a side or a corner.
  void spread(BitRows& wide) {
    if (words_ == 1) {
      for (std::size_t y = 0; y < rows_; ++y) wide.bits_[y] = bits_[y] | bits_[y] << 1 | bits_[y] >> 1;
    } else {
      for (std::size_t k = 0; k < bits_.size(); ++k) {
        const std::size_t w = k % words_;
        const std::uint64_t from_left = w > 0 ? bits_[k - 1] >> 63 : 0,
                            from_right = w + 1 < words_ ? bits_[k + 1] << 63 : 0;
        wide.bits_[k] = bits_[k] | bits_[k] << 1 | bits_[k] >> 1 | from_left | from_right;
      }
    }
    for (std::size_t w = 0; w < words_; ++w) {
      std::uint64_t above = 0;
      for (std::size_t y = 0; y < rows_; ++y) {
        const std::size_t k = y * words_ + w;
        const std::uint64_t here = wide.bits_[k], below = y + 1 < rows_ ? wide.bits_[k + words_] : 0;
        wide.bits_[k] = above | here | below;
        above = here;
      }
    }
  }
  // Calls visit(row, column, word) for every bit of every `step`-th row; `word` is the index of the word it is in.
  template <class Do>
  void each(std::size_t step, Do visit) const {
    for (std::size_t y = 0; y < rows_; y += step)
      for (std::size_t w = 0; w < words_; ++w)
        for (std::uint64_t word = bits_[y * words_ + w]; word != 0; word &= word - 1)
          visit(y, w * 64 + static_cast<std::size_t>(std::countr_zero(word)), y * words_ + w);
  }

 private:
  std::size_t words_ = 0, rows_ = 0;
  std::vector<std::uint64_t> bits_;
};

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

class Refiner {
 public:
  Refiner(const FrameView& frame, Components& found, std::uint64_t min_area)
      : frame_(frame), found_(found), min_area_(min_area) {}

  void refine(Blob& blob, std::uint32_t set) {
    if (blob.width > widest || blob.height > widest) return;
    if (frame_.layout == PixelLayout::packed)
      refine(blob, set, PackedPixels{frame_});
    else
      refine(blob, set, LumaChroma{frame_});
  }

 private:
  template <class Pixels>
  void refine(Blob& blob, std::uint32_t set, Pixels pixels) {
    const std::size_t x0 = blob.left > margin ? blob.left - margin : 0, y0 = blob.top > margin ? blob.top - margin : 0;
    const std::size_t x1 = std::min<std::size_t>(blob.left + blob.width + margin, frame_.width),
                      y1 = std::min<std::size_t>(blob.top + blob.height + margin, frame_.height);
    const bool crowded = look(set, x0, y0, x1, y1);

    // inside: whole pixels; near: up to where the edge may be; far: up to where the background is taken from
    erode(own_, scratch_, x1 - x0), erode(scratch_, inside_, x1 - x0);
    own_.spread(scratch_), scratch_.spread(near_);
    near_.spread(scratch_), scratch_.spread(far_);
    if (crowded) {  // a thin line of another label is the edge between two colours; only what has a middle is another thing
      erode(others_, scratch_, x1 - x0);
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
    trim(far_, x1 - x0), trim(near_, x1 - x0);

    Spread background, marker;
    far_.each(1, [&](std::size_t y, std::size_t x, std::size_t) { background.add(pixels(y0 + y, x0 + x)); });
    if (background.n < enough) return;
    const BitRows& sure = middle < enough ? own_ : inside_;
    const auto note = [&](std::size_t y, std::size_t x, std::size_t) { marker.add(pixels(y0 + y, x0 + x)); };
    sure.each(middle < 2 * plenty ? 1 : middle < 3 * plenty ? 2 : 4, note);
    if (marker.n < enough) marker = Spread{}, sure.each(1, note);
    background.finish(), marker.finish();
    double difference[3], S[6], d[3], size = 0;
    for (int c = 0; c < 3; ++c) {
      difference[c] = marker.mean[c] - background.mean[c];
      size += difference[c] * difference[c];
    }
    if (size < contrast * contrast) return;
    for (int c = 0; c < 6; ++c) S[c] = (background.covariance[c] + marker.covariance[c]) / 2 + (c < 3 ? grain : 0);
    double noise = quiet_direction(S, difference, d);
    if (frame_.layout != PixelLayout::packed && std::abs(difference[0]) >= luma_contrast) {
      d[0] = 1 / difference[0], d[1] = d[2] = 0;
      noise = S[0] * d[0] * d[0];
    }
    if (!(noise > 0)) return;

    // how far the edge pixels move the centroid that the label gave
    double offset = 0;
    for (int c = 0; c < 3; ++c) offset -= d[c] * background.mean[c];
    const double cx = blob.x - static_cast<double>(x0), cy = blob.y - static_cast<double>(y0);
    double n = static_cast<double>(blob.area), dx = 0, dy = 0, xx = 0, xy = 0, yy = 0;
    near_.each(1, [&](std::size_t y, std::size_t x, std::size_t word) {
      const double labelled = static_cast<double>(own_[word] >> x % 64 & 1);
      double cover = labelled, variance = contested;
      if ((others_[word] >> x % 64 & 1) == 0) {
        const Color p = pixels(y0 + y, x0 + x);
        const double raw = offset + d[0] * p.c[0] + d[1] * p.c[1] + d[2] * p.c[2];
        cover = std::min(std::max(raw, 0.0), 1.0), variance = cover == raw ? noise : 0;
      }
      const double u = static_cast<double>(x) - cx, v = static_cast<double>(y) - cy, more = cover - labelled;
      n += more, dx += more * u, dy += more * v;
      xx += variance * u * u, xy += variance * u * v, yy += variance * v * v;
    });
    if (!(n >= 1)) return;
    blob.x += dx / n, blob.y += dy / n;
    blob.xx = xx / (n * n) + floor_variance, blob.xy = xy / (n * n), blob.yy = yy / (n * n) + floor_variance;
  }

  // Fills in which pixels of a rectangle are the set's and which are another blob's; true if there are any of the latter.
  bool look(std::uint32_t set, std::size_t x0, std::size_t y0, std::size_t x1, std::size_t y1) {
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

  // What is set and touches only what is set; beyond the rectangle all is. Beyond the width it says nothing.
  void erode(BitRows& from, BitRows& to, std::size_t width) {
    complement_.resize(from.rows(), width);
    for (std::size_t k = 0; k < from.size(); ++k) complement_[k] = ~from[k];
    trim(complement_, width);
    complement_.spread(to);
    for (std::size_t k = 0; k < to.size(); ++k) to[k] = ~to[k];
    trim(to, width);
  }

  // Clears what lies beyond the width.
  static void trim(BitRows& rows, std::size_t width) {
    if (width % 64 == 0) return;
    const std::uint64_t kept = (std::uint64_t{1} << width % 64) - 1;
    for (std::size_t k = rows.words() - 1; k < rows.size(); k += rows.words()) rows[k] &= kept;
  }

  const FrameView& frame_;
  Components& found_;
  std::uint64_t min_area_;
  BitRows own_, others_, inside_, near_, far_, scratch_, complement_;
};

// A blob that touches the border of the frame goes on outside, nobody knows how far.
void widen_at_border(Blob& blob, const FrameView& frame) {
  const auto unknown = [](double size) { return size * size / 16; };
  if (blob.left == 0 || blob.left + blob.width == frame.width) blob.xx += unknown(blob.width);
  if (blob.top == 0 || blob.top + blob.height == frame.height) blob.yy += unknown(blob.height);
}

}  // namespace

ColorLookUp::ColorLookUp(const std::uint8_t* labels, unsigned bits, bool reversed)
    : kept(labels, labels + (std::size_t{1} << (3 * bits))), table(kept.data()), drop(8 - bits) {
  const unsigned places[3] = {2 * bits, bits, 0};
  std::memset(sieve, 0, sizeof sieve);
  for (int c = 0; c < 3; ++c) place[c] = places[reversed ? 2 - c : c];
  const std::vector<Product> products = cover(labelled_cells(labels, bits));
  for (std::size_t k = 0; k < products.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int v = 0; v < levels; ++v)
        if (products[k].sets[c] >> v & 1) {
          std::uint8_t& admitted = sieve[k / 8][reversed ? 2 - c : c][v];
          admitted = static_cast<std::uint8_t>(admitted | 1u << k % 8);
        }
}

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
