// The centroid of a blob by how much of each pixel at its edge it covers.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pieper/segmentation.hpp"
#include "segmentation/bit_rows.hpp"
#include "segmentation/components.hpp"

namespace pieper {

class Refiner {
 public:
  Refiner(const FrameView& frame, Components& found, std::uint64_t min_area)
      : frame_(frame), found_(found), min_area_(min_area) {}

  // Of a set of the components: its centroid and covariance, where background and inside tell themselves apart.
  void refine(Blob&, std::uint32_t set);

 private:
  // The part of the frame that is looked at: the blob and what is around it.
  struct Window {
    std::size_t x0, y0, x1, y1;
    std::size_t width() const { return x1 - x0; }
  };
  struct Coverage;

  template <class Pixels>
  void refine(Blob&, std::uint32_t set, Pixels);
  template <class Pixels>
  bool measure_coverage(const Window&, int middle, Pixels, Coverage&);
  template <class Pixels>
  void move_centroid(Blob&, const Window&, const Coverage&, Pixels) const;
  bool look(std::uint32_t set, const Window&);
  int draw_masks(std::size_t width, bool crowded);
  void erode(const BitRows& from, BitRows& to, std::size_t width);

  const FrameView& frame_;
  Components& found_;
  std::uint64_t min_area_;
  BitRows own_, others_, inside_, near_, far_, scratch_, complement_;
};

}  // namespace pieper
