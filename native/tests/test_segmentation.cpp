// Segmentation against a flood fill on random frames that end where their memory ends, so that a sanitiser sees any step beyond.
#include <algorithm>
#include <memory>
#include <numeric>

#include "check.hpp"
#include "pieper/segmentation.hpp"

namespace {

using pieper::FrameView;
using pieper::PixelLayout;
using std::size_t;
using std::uint8_t;

// Bytes with nothing behind them.
struct Memory {
  explicit Memory(size_t size) : bytes(new uint8_t[std::max<size_t>(size, 1)]), count(size) {}
  std::unique_ptr<uint8_t[]> bytes;
  size_t count;
};

struct Image {
  Memory memory;
  FrameView view;
};

class Draw {
 public:
  explicit Draw(unsigned seed) : engine_(seed) {}
  size_t below(size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(engine_); }

 private:
  std::mt19937 engine_;
};

Image random_image(Draw& draw, PixelLayout layout, size_t width, size_t height, size_t shades, bool upside_down) {
  const bool planar = layout == PixelLayout::i420 || layout == PixelLayout::nv12;
  if (layout != PixelLayout::packed) width = width / 2 * 2;
  if (planar) height = height / 2 * 2;
  const size_t row = width * (layout == PixelLayout::packed ? 3 : layout == PixelLayout::yuyv ? 2 : 1);
  const size_t gap = planar ? 0 : draw.below(5), rows = planar ? height / 2 * 3 : height;
  Image image{Memory(rows == 0 ? 0 : (row + gap) * (rows - 1) + row), {}};
  std::vector<uint8_t> palette(shades);
  for (uint8_t& shade : palette) shade = static_cast<uint8_t>(draw.below(256));
  for (size_t k = 0; k < image.memory.count; ++k) image.memory.bytes[k] = palette[draw.below(shades)];
  FrameView& view = image.view;
  view = {layout, width, height, image.memory.bytes.get(), static_cast<std::ptrdiff_t>(row + gap), {nullptr, nullptr},
          0};
  if (planar) {
    view.chroma[0] = view.rows + width * height;
    view.chroma[1] = view.chroma[0] + width / 2 * (height / 2);
    view.chroma_stride = static_cast<std::ptrdiff_t>(layout == PixelLayout::nv12 ? width : width / 2);
  } else if (upside_down && height > 0) {
    view.rows += static_cast<std::ptrdiff_t>(height - 1) * view.stride;
    view.stride = -view.stride;
  }
  return image;
}

uint8_t byte_of(const FrameView& view, size_t y, size_t x, int c) {
  const uint8_t* row = view.rows + static_cast<std::ptrdiff_t>(y) * view.stride;
  if (view.layout == PixelLayout::packed) return row[3 * x + static_cast<size_t>(c)];
  if (view.layout == PixelLayout::yuyv) return c == 0 ? row[2 * x] : row[x / 2 * 4 + (c == 1 ? 1 : 3)];
  if (c == 0) return row[x];
  const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(y / 2) * view.chroma_stride;
  if (view.layout == PixelLayout::nv12) return view.chroma[0][offset + static_cast<std::ptrdiff_t>(x / 2 * 2) + c - 1];
  return view.chroma[c - 1][offset + static_cast<std::ptrdiff_t>(x / 2)];
}

struct Patch {
  uint8_t label;
  std::vector<std::array<size_t, 2>> pixels;
};

// Pixels of one label that touch by side or corner, in the order of their first.
std::vector<Patch> flood(const std::vector<uint8_t>& labels, size_t width, size_t height) {
  std::vector<Patch> patches;
  std::vector<bool> seen(labels.size());
  for (size_t k = 0; k < labels.size(); ++k) {
    if (labels[k] == 0 || seen[k]) continue;
    Patch patch{labels[k], {{k / width, k % width}}};
    seen[k] = true;
    for (size_t next = 0; next < patch.pixels.size(); ++next) {
      const auto [y, x] = patch.pixels[next];
      for (size_t v = y > 0 ? y - 1 : 0; v < std::min(y + 2, height); ++v)
        for (size_t u = x > 0 ? x - 1 : 0; u < std::min(x + 2, width); ++u)
          if (!seen[v * width + u] && labels[v * width + u] == patch.label) {
            seen[v * width + u] = true;
            patch.pixels.push_back({v, u});
          }
    }
    patches.push_back(patch);
  }
  return patches;
}

std::vector<uint8_t> random_table(Draw& draw, unsigned bits, size_t sparse) {
  std::vector<uint8_t> table(size_t{1} << 3 * bits);
  for (uint8_t& label : table) label = static_cast<uint8_t>(draw.below(sparse) == 0 ? 1 + draw.below(5) : 0);
  return table;
}

void same_as_flooding(unsigned seed) {
  Draw draw(seed);
  const PixelLayout layouts[] = {PixelLayout::packed, PixelLayout::packed, PixelLayout::i420, PixelLayout::nv12,
                                 PixelLayout::yuyv};
  const size_t sizes[] = {0, 1, 2, 3, 31, 32, 33, 64, 97, 200}, shades[] = {2, 3, 256}, sparse[] = {1, 2, 50};
  const Image image = random_image(draw, layouts[draw.below(5)], sizes[draw.below(10)] + draw.below(3), draw.below(40),
                                   shades[draw.below(3)], draw.below(2) == 0);
  const FrameView& view = image.view;
  const size_t width = view.width, height = view.height;
  const unsigned bits = 1 + static_cast<unsigned>(draw.below(6));
  const bool reversed = draw.below(2) == 0;
  const std::vector<uint8_t> table = random_table(draw, bits, sparse[draw.below(3)]);
  const pieper::ColorLookUp look_up(table.data(), bits, reversed);

  std::vector<uint8_t> labels(width * height), expected(width * height);
  for (size_t y = 0; y < height; ++y)
    for (size_t x = 0; x < width; ++x) {
      size_t cell = 0;
      for (int c = 0; c < 3; ++c) cell = cell << bits | byte_of(view, y, x, reversed ? 2 - c : c) >> (8 - bits);
      expected[y * width + x] = table[cell];
    }
  pieper::classify(view, look_up, labels.data());
  check::that(labels == expected, "labels of seed " + std::to_string(seed));

  const std::uint64_t least = 1 + draw.below(4);
  std::vector<std::int32_t> numbers(width * height), drawn(width * height, 0);
  const std::vector<pieper::Blob> plain = pieper::segment(view, look_up, {least, 1 << 30, false}, numbers.data()),
                                  refined = pieper::segment(view, look_up, {least, 1 << 30, true});
  size_t k = 0;
  for (const Patch& patch : flood(expected, width, height)) {
    if (patch.pixels.size() < least) continue;
    if (k == plain.size()) break;
    const std::string what = "seed " + std::to_string(seed) + ", blob " + std::to_string(k);
    double x = 0, y = 0;
    for (const auto& pixel : patch.pixels) {
      y += static_cast<double>(pixel[0]), x += static_cast<double>(pixel[1]);
      drawn[pixel[0] * width + pixel[1]] = static_cast<std::int32_t>(k + 1);
    }
    const double n = static_cast<double>(patch.pixels.size());
    check::that(plain[k].label == patch.label && plain[k].area == patch.pixels.size(), what);
    check::near(plain[k].x, x / n, 1e-11, what);
    check::near(plain[k].y, y / n, 1e-11, what);
    check::that(plain[k].xx > 0 && plain[k].xx * plain[k].yy > plain[k].xy * plain[k].xy, what + ": covariance");
    check::that(refined[k].xx > 0 && refined[k].xx * refined[k].yy > refined[k].xy * refined[k].xy, what + ": refined");
    check::that(plain[k].circularity > 0 && plain[k].circularity <= 1 + 1e-12, what + ": circularity");
    ++k;
  }
  check::that(k == plain.size() && k == refined.size(), "number of blobs of seed " + std::to_string(seed));
  check::that(numbers == drawn, "numbers of seed " + std::to_string(seed));
}

// Big blobs of few colours, where refinement has something to do, up to and beyond what it takes.
void boxes(unsigned seed) {
  Draw draw(seed);
  const size_t width = 40 + draw.below(300), height = 40 + draw.below(300);
  Image image = random_image(draw, PixelLayout::packed, width, height, 1, false);
  for (int box = 0; box < 12; ++box) {
    const size_t x0 = draw.below(width), y0 = draw.below(height), w = 1 + draw.below(280), h = 1 + draw.below(280);
    const uint8_t shade = static_cast<uint8_t>(draw.below(4) * 80);
    for (size_t y = y0; y < std::min(y0 + h, height); ++y)
      for (size_t x = x0; x < std::min(x0 + w, width); ++x)
        for (size_t c = 0; c < 3; ++c)
          image.memory.bytes[y * static_cast<size_t>(image.view.stride) + 3 * x + c] = shade;
  }
  const std::vector<uint8_t> table = random_table(draw, 3, 2);
  const pieper::ColorLookUp look_up(table.data(), 3, false);
  const std::vector<pieper::Blob> plain = pieper::segment(image.view, look_up, {1, 1 << 30, false}),
                                  refined = pieper::segment(image.view, look_up, {1, 1 << 30, true});
  check::that(plain.size() == refined.size(), "boxes of seed " + std::to_string(seed));
  for (size_t k = 0; k < plain.size(); ++k) {
    const pieper::Blob &a = plain[k], &b = refined[k];
    check::that(a.area == b.area && std::isfinite(b.x) && std::isfinite(b.y) && b.xx > 0 && b.yy > 0,
                "boxes of seed " + std::to_string(seed));
  }
}

}  // namespace

int main() {
  check::with_every_instruction_set([](const std::string&) {
    for (unsigned seed = 0; seed < 300; ++seed) same_as_flooding(seed);
    for (unsigned seed = 0; seed < 40; ++seed) boxes(seed);
  });
  return check::result();
}
