// What the general solver needs of a vector beyond lanes.hpp: masks and records in memory.
#pragma once

#include "simd/lanes.hpp"

#if defined(__GNUC__)
#define PIEPER_NOINLINE [[gnu::noinline]]
#else
#define PIEPER_NOINLINE
#endif

namespace {

// |size| with the sign of `sign`
inline Vec with_sign(Vec size, Vec sign) { return from_bits((bits(size) & INT64_MAX) | (bits(sign) & INT64_MIN)); }

inline IntVec none(IntVec mask) {
#if PIEPER_LANES > 1
  return ~mask;
#else
  return mask == 0;
#endif
}

// Bit l is set where lane l of a comparison's result is.
inline unsigned lane_bits(IntVec mask) {
#if PIEPER_LANES == 8
  return _mm512_movepi64_mask(reinterpret_cast<__m512i>(mask));
#elif PIEPER_LANES == 4
  return static_cast<unsigned>(_mm256_movemask_pd(reinterpret_cast<__m256d>(mask)));
#elif PIEPER_LANES == 2
  return (mask[0] ? 1u : 0u) | (mask[1] ? 2u : 0u);
#else
  return mask ? 1u : 0u;
#endif
}

inline double lane_of(Vec value, std::size_t l) { return lane(value, l); }

// 0, 1, 2, ...
inline Vec lane_numbers() {
  Vec v = splat(0.0);
  for (std::size_t l = 0; l < lanes; ++l) lane(v, l) = static_cast<double>(l);
  return v;
}

// Lanes below `count`.
inline IntVec first_lanes(std::size_t count) { return lane_numbers() < splat(static_cast<double>(count)); }

// Reads `lanes` records of `width` doubles (a multiple of 8); afterwards numbers[k] holds number k of every record.
template <std::size_t width>
PIEPER_INLINE void read_rows(const double* from, Vec* numbers) {
  for (std::size_t k = 0; k < width; k += lanes) {
    for (std::size_t l = 0; l < lanes; ++l) numbers[k + l] = load(from + l * width + k);
    transpose(numbers + k);
  }
}

// Appends the records of the chosen lanes to a list of `count` records; false when it is full.
template <std::size_t width>
PIEPER_INLINE bool append_rows(const Vec* numbers, IntVec chosen, double* list, std::size_t& count,
                               std::size_t capacity) {
  const unsigned which = lane_bits(chosen);
  if (!which) return true;
  alignas(64) double rows[lanes * width];
  scatter(numbers, width, rows, width, false);
  for (std::size_t l = 0; l < lanes; ++l) {
    if (!(which >> l & 1)) continue;
    if (count == capacity) return false;
    std::memcpy(list + count++ * width, rows + l * width, width * sizeof(double));
  }
  return true;
}

}  // namespace
