// Patches of one colour in a frame, in one pass: table look-up, run-length, union-find, moments.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pieper {

// Rows and columns of a frame; sums of squares of coordinates stay below 2^64.
inline constexpr std::size_t largest_side = 32768;

// How the bytes of a frame lie: three per pixel; a plane of luma and two planes, or one plane of pairs, of chroma that four pixels
// share; or Y U Y V, where two pixels share theirs.
enum class PixelLayout : int { packed = 0, i420 = 1, nv12 = 2, yuyv = 3 };

// A frame where it lies. `rows` is the packed frame or the luma; chroma is for planar layouts alone. Strides are bytes from
// row to row, of any sign. Planar frames have even sides, YUYV an even width.
struct FrameView {
  PixelLayout layout;
  std::size_t width, height;
  const std::uint8_t* rows;
  std::ptrdiff_t stride;
  const std::uint8_t* chroma[2];
  std::ptrdiff_t chroma_stride;
};

// The label of each cell of pixel values, as the kernels read it.
//
// Almost every pixel of a frame has label 0. The sieve says so of most of them, 32 at a time and without touching the table: the
// cells with a label are covered by up to sixteen products A x B x C of sets of values (the high four bits of each channel), and a
// pixel that lies in none of them has no label.
struct ColorLookUp {
  // `labels` is (2^bits, 2^bits, 2^bits), first index from byte 0 of a pixel; with `reversed`, from byte 2.
  ColorLookUp(const std::uint8_t* labels, unsigned bits, bool reversed);
  ColorLookUp(const ColorLookUp&) = delete;
  ColorLookUp& operator=(const ColorLookUp&) = delete;

  const std::vector<std::uint8_t> kept;
  const std::uint8_t* const table;
  unsigned drop;                 // low bits of each byte that do not count
  unsigned place[3];             // of each byte's high bits in the index into the table
  std::uint8_t sieve[2][3][16];  // by the high four bits of each byte, the products that admit it
};

// Kernels that exist once per instruction set.
struct SegmentationKernels {
  // Labels of a row of n packed pixels, and the columns where the label changes (the first against 0, and n if the last has one).
  // `labels` has a 0 before it and room for n rounded up to 32; `changes` has room for n + 1. Returns how many changes there are.
  std::size_t (*packed)(const ColorLookUp&, const std::uint8_t* pixels, std::size_t n, std::uint8_t* labels,
                        std::uint32_t* changes);
  // The same of three rows of bytes.
  std::size_t (*planar)(const ColorLookUp&, const std::uint8_t* const planes[3], std::size_t n, std::uint8_t* labels,
                        std::uint32_t* changes);
};

struct SegmentOptions {
  std::uint64_t min_area, max_area;  // pixels
  bool refine;                       // centroid by coverage of the pixels at the edge
};

// Pixels that touch by a side or a corner and have the same label.
struct Blob {
  std::uint8_t label;
  std::uint64_t area;
  double x, y;        // centroid
  double xx, xy, yy;  // its covariance
  std::uint32_t left, top, width, height;
  double circularity;
};

// Blobs in the order of their first pixels. `numbers`, unless null, is (height, width) and gets 0 for no blob, k + 1 for the k-th.
std::vector<Blob> segment(const FrameView&, const ColorLookUp&, const SegmentOptions&, std::int32_t* numbers = nullptr);

// The label of each pixel, (height, width).
void classify(const FrameView&, const ColorLookUp&, std::uint8_t* labels);

}  // namespace pieper
