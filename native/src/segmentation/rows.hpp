// The labels of a frame row by row, whatever its layout.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "pieper/kernels.hpp"
#include "pieper/segmentation.hpp"

namespace pieper {

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

}  // namespace pieper
