// A vector of PIEPER_LANES doubles. Included once per instruction set: everything here has internal linkage, so that no
// linker can take the copy compiled for another processor.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#if PIEPER_LANES > 1 && (defined(__x86_64__) || defined(_M_X64))
#include <immintrin.h>
#endif

namespace {

constexpr std::size_t lanes = PIEPER_LANES;

#if PIEPER_LANES > 1
// GCC and Clang vector types; arithmetic, comparison and ?: work element by element.
typedef double Vec __attribute__((vector_size(8 * PIEPER_LANES)));
typedef std::int64_t IntVec __attribute__((vector_size(8 * PIEPER_LANES)));
typedef double UnalignedVec __attribute__((vector_size(8 * PIEPER_LANES), aligned(8), may_alias));

inline Vec splat(double value) { return Vec{} + value; }
inline IntVec bits(Vec value) { return reinterpret_cast<IntVec>(value); }
inline Vec from_bits(IntVec value) { return reinterpret_cast<Vec>(value); }
inline double& lane(Vec& value, std::size_t l) { return reinterpret_cast<double*>(&value)[l]; }
inline Vec load(const double* from) { return *reinterpret_cast<const UnalignedVec*>(from); }
inline void store(double* to, Vec value) { *reinterpret_cast<UnalignedVec*>(to) = value; }
inline Vec select(IntVec mask, Vec yes, Vec no) { return mask ? yes : no; }
inline bool any(IntVec mask) {
  std::int64_t seen = 0;
  for (std::size_t l = 0; l < lanes; ++l) seen |= mask[l];
  return seen != 0;
}
#else
// The portable path: one lane, plain double, and masks that are all ones or all zeros as above.
using Vec = double;
using IntVec = std::int64_t;

inline Vec splat(double value) { return value; }
inline IntVec bits(Vec value) { return std::bit_cast<IntVec>(value); }
inline Vec from_bits(IntVec value) { return std::bit_cast<Vec>(value); }
inline double& lane(Vec& value, std::size_t) { return value; }
inline Vec load(const double* from) { return *from; }
inline void store(double* to, Vec value) { *to = value; }
inline Vec select(IntVec mask, Vec yes, Vec no) { return mask ? yes : no; }
inline bool any(IntVec mask) { return mask != 0; }
#endif

inline double splat_like(double, double value) { return value; }
#if PIEPER_LANES > 1
inline Vec splat_like(const Vec&, double value) { return splat(value); }
#endif

// |value|, by clearing the sign bit
inline Vec magnitude(Vec value) { return from_bits(bits(value) & INT64_MAX); }

// Transposes a square block: afterwards rows[i] holds what lane i held.
#if PIEPER_LANES == 8
#define PIEPER_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
inline void transpose(Vec* r) {
  Vec t[8], u[8];
  for (int i = 0; i < 8; i += 2) {
    t[i] = PIEPER_SHUFFLE(r[i], r[i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
    t[i + 1] = PIEPER_SHUFFLE(r[i], r[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (int i = 0; i < 8; i += 4)
    for (int j = 0; j < 2; ++j) {
      u[i + j] = PIEPER_SHUFFLE(t[i + j], t[i + j + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      u[i + j + 2] = PIEPER_SHUFFLE(t[i + j], t[i + j + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int j = 0; j < 4; ++j) {
    r[j] = PIEPER_SHUFFLE(u[j], u[j + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    r[j + 4] = PIEPER_SHUFFLE(u[j], u[j + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}
#elif PIEPER_LANES == 4
#define PIEPER_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
inline void transpose(Vec* r) {
  Vec t[4];
  for (int i = 0; i < 4; i += 2) {
    t[i] = PIEPER_SHUFFLE(r[i], r[i + 1], 0, 4, 2, 6);
    t[i + 1] = PIEPER_SHUFFLE(r[i], r[i + 1], 1, 5, 3, 7);
  }
  for (int j = 0; j < 2; ++j) {
    r[j] = PIEPER_SHUFFLE(t[j], t[j + 2], 0, 1, 4, 5);
    r[j + 2] = PIEPER_SHUFFLE(t[j], t[j + 2], 2, 3, 6, 7);
  }
}
#elif PIEPER_LANES == 2
inline void transpose(Vec* r) {
  const Vec first{r[0][0], r[1][0]}, second{r[0][1], r[1][1]};
  r[0] = first, r[1] = second;
}
#else
inline void transpose(Vec*) {}
#endif

// Writes `width` numbers of each of `lanes` records: numbers[k] holds number k of every record, records lie `stride`
// doubles apart. `streamed` bypasses the cache (results larger than it, written once, aligned to 64 bytes).
inline void scatter(const Vec* numbers, std::size_t width, double* to, std::size_t stride, bool streamed) {
  for (std::size_t k = 0; k + lanes <= width; k += lanes) {
    Vec block[lanes];
    for (std::size_t i = 0; i < lanes; ++i) block[i] = numbers[k + i];
    transpose(block);
#if PIEPER_LANES == 8
    if (streamed) {
      for (std::size_t l = 0; l < lanes; ++l) _mm512_stream_pd(to + l * stride + k, reinterpret_cast<__m512d>(block[l]));
      continue;
    }
#elif PIEPER_LANES == 4
    if (streamed) {
      for (std::size_t l = 0; l < lanes; ++l) _mm256_stream_pd(to + l * stride + k, reinterpret_cast<__m256d>(block[l]));
      continue;
    }
#endif
    for (std::size_t l = 0; l < lanes; ++l) store(to + l * stride + k, block[l]);
  }
  (void)streamed;
  for (std::size_t k = width - width % lanes; k < width; ++k) {
    Vec rest = numbers[k];
    for (std::size_t l = 0; l < lanes; ++l) to[l * stride + k] = lane(rest, l);
  }
}

// Reads one number of each of `lanes` records that lie `stride` doubles apart.
inline Vec gather(const double* from, std::size_t stride) {
  Vec value = splat(0.0);
  for (std::size_t l = 0; l < lanes; ++l) lane(value, l) = from[l * stride];
  return value;
}

}  // namespace
