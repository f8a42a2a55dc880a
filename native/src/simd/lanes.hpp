// A vector of PIEPER_LANES doubles. Included once per instruction set: everything here has internal linkage, so that no
// linker can take the copy compiled for another processor.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#if PIEPER_LANES > 1 && (defined(__x86_64__) || defined(_M_X64))
#include <immintrin.h>
#endif

// Left to itself the compiler calls some steps of a kernel as functions, and the state goes through memory.
#if defined(__GNUC__)
#define PIEPER_INLINE [[gnu::always_inline]] inline
#define PIEPER_OUT_OF_LINE [[gnu::noinline, gnu::cold]]
#else
#define PIEPER_INLINE inline
#define PIEPER_OUT_OF_LINE
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
// True when a bit is set in any lane of a comparison's result.
inline bool any(IntVec mask) {
#if PIEPER_LANES == 8
  return _mm512_movepi64_mask(reinterpret_cast<__m512i>(mask)) != 0;
#elif PIEPER_LANES == 4
  return _mm256_movemask_pd(reinterpret_cast<__m256d>(mask)) != 0;
#elif defined(__SSE2__)
  return _mm_movemask_pd(reinterpret_cast<__m128d>(mask)) != 0;
#else
  std::int64_t seen = 0;
  for (std::size_t l = 0; l < lanes; ++l) seen |= mask[l];
  return seen != 0;
#endif
}
inline bool all(IntVec mask) { return !any(~mask); }
// `yes` where the lowest bit of `number` is set
inline Vec select_odd(IntVec number, Vec yes, Vec no) {
#if PIEPER_LANES == 8
  const __mmask8 odd = _mm512_test_epi64_mask(reinterpret_cast<__m512i>(number), _mm512_set1_epi64(1));
  return reinterpret_cast<Vec>(
      _mm512_mask_blend_pd(odd, reinterpret_cast<__m512d>(no), reinterpret_cast<__m512d>(yes)));
#else
  return select((number & 1) != 0, yes, no);
#endif
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
inline Vec select_odd(IntVec number, Vec yes, Vec no) { return (number & 1) != 0 ? yes : no; }
inline bool any(IntVec mask) { return mask != 0; }
inline bool all(IntVec mask) { return mask != 0; }
#endif

inline double splat_like(double, double value) { return value; }
#if PIEPER_LANES > 1
inline Vec splat_like(const Vec&, double value) { return splat(value); }
#endif

// a b + c in one rounding where the processor can. Mostly the compiler contracts a product and a sum by itself; this is
// for a product that it would rather share with another expression.
inline Vec multiply_add(Vec a, Vec b, Vec c) {
#if PIEPER_LANES == 8
  return reinterpret_cast<Vec>(
      _mm512_fmadd_pd(reinterpret_cast<__m512d>(a), reinterpret_cast<__m512d>(b), reinterpret_cast<__m512d>(c)));
#elif PIEPER_LANES == 4
  return reinterpret_cast<Vec>(
      _mm256_fmadd_pd(reinterpret_cast<__m256d>(a), reinterpret_cast<__m256d>(b), reinterpret_cast<__m256d>(c)));
#else
  return a * b + c;
#endif
}

// |value|, by clearing the sign bit
inline Vec magnitude(Vec value) { return from_bits(bits(value) & INT64_MAX); }

inline Vec square_root(Vec value) {
#if PIEPER_LANES == 8
  return reinterpret_cast<Vec>(_mm512_maskz_sqrt_pd(0xff, reinterpret_cast<__m512d>(value)));
#elif PIEPER_LANES == 4
  return reinterpret_cast<Vec>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(value)));
#elif PIEPER_LANES > 1
  Vec root;
  for (std::size_t l = 0; l < lanes; ++l) root[l] = __builtin_sqrt(value[l]);
  return root;
#else
  return std::sqrt(value);
#endif
}

inline Vec larger(Vec a, Vec b) { return select(a > b, a, b); }
inline Vec smaller(Vec a, Vec b) { return select(a < b, a, b); }

// Transposes a square block: afterwards rows[i] holds what lane i held.
#if PIEPER_LANES == 8
#define PIEPER_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
PIEPER_INLINE void transpose(Vec* r) {
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
PIEPER_INLINE void transpose(Vec* r) {
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
PIEPER_INLINE void transpose(Vec* r) {
  const Vec first{r[0][0], r[1][0]}, second{r[0][1], r[1][1]};
  r[0] = first, r[1] = second;
}
#else
PIEPER_INLINE void transpose(Vec*) {}
#endif

// Writes `width` numbers of each of `lanes` records: numbers[k] holds number k of every record, records lie `stride`
// doubles apart. `streamed` bypasses the cache (results larger than it, written once, aligned to 64 bytes).
PIEPER_INLINE void scatter(const Vec* numbers, std::size_t width, double* to, std::size_t stride, bool streamed) {
  for (std::size_t k = 0; k + lanes <= width; k += lanes) {
    Vec block[lanes];
    for (std::size_t i = 0; i < lanes; ++i) block[i] = numbers[k + i];
    transpose(block);
#if PIEPER_LANES == 8
    if (streamed) {
      for (std::size_t l = 0; l < lanes; ++l)
        _mm512_stream_pd(to + l * stride + k, reinterpret_cast<__m512d>(block[l]));
      continue;
    }
#elif PIEPER_LANES == 4
    if (streamed) {
      for (std::size_t l = 0; l < lanes; ++l)
        _mm256_stream_pd(to + l * stride + k, reinterpret_cast<__m256d>(block[l]));
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

// Makes streamed results visible to other threads in the usual order.
inline void end_streaming(bool streamed) {
#if PIEPER_LANES >= 4 && defined(__x86_64__)
  if (streamed) _mm_sfence();
#else
  (void)streamed;
#endif
}

#if PIEPER_LANES == 8
// Eight records of six numbers fill six vectors exactly, which saves the loads that straddle cache lines.
PIEPER_INLINE void read_records_of_6(const double* from, Vec* numbers) {
  // w[k] holds numbers 8k ... 8k+7; record l, number k is number 6l + k
  Vec w[6];
  for (int k = 0; k < 6; ++k) w[k] = load(from + 8 * k);
  // pairs (0 1), (2 3), (4 5) of records 0-3 and of records 4-7, which lie alike in w[0..2] and w[3..5]
  Vec pair[2][3];
  for (int half = 0; half < 2; ++half) {
    const Vec a = w[3 * half], b = w[3 * half + 1], c = w[3 * half + 2];
    const Vec p01 = PIEPER_SHUFFLE(a, b, 0, 1, 6, 7, 12, 13, -1, -1);
    pair[half][0] = PIEPER_SHUFFLE(p01, c, 0, 1, 2, 3, 4, 5, 10, 11);
    const Vec p23 = PIEPER_SHUFFLE(a, b, 2, 3, 8, 9, 14, 15, -1, -1);
    pair[half][1] = PIEPER_SHUFFLE(p23, c, 0, 1, 2, 3, 4, 5, 12, 13);
    const Vec p45 = PIEPER_SHUFFLE(a, b, 4, 5, 10, 11, -1, -1, -1, -1);
    pair[half][2] = PIEPER_SHUFFLE(p45, c, 0, 1, 2, 3, 8, 9, 14, 15);
  }
  for (int k = 0; k < 3; ++k) {
    numbers[2 * k] = PIEPER_SHUFFLE(pair[0][k], pair[1][k], 0, 2, 4, 6, 8, 10, 12, 14);
    numbers[2 * k + 1] = PIEPER_SHUFFLE(pair[0][k], pair[1][k], 1, 3, 5, 7, 9, 11, 13, 15);
  }
}
#endif

// Reads `lanes` records of n numbers that lie one after the other: afterwards numbers[k] holds number k of every record.
// `numbers` has room for n rounded up to whole vectors.
PIEPER_INLINE void read_records(const double* from, std::size_t n, Vec* numbers) {
#if PIEPER_LANES == 8
  if (n == 6) return read_records_of_6(from, numbers);
  if (n <= 8) {  // masked loads never touch what lies behind the last record
    const __mmask8 mask = static_cast<__mmask8>((1u << n) - 1);
    for (std::size_t l = 0; l < 8; ++l) numbers[l] = reinterpret_cast<Vec>(_mm512_maskz_loadu_pd(mask, from + l * n));
    return transpose(numbers);
  }
#elif PIEPER_LANES == 4
  if (n <= 8) {
    const __m256i count = _mm256_set1_epi64x(static_cast<long long>(n));
    for (std::size_t k = 0; k < n; k += 4) {
      const __m256i index =
          _mm256_add_epi64(_mm256_set1_epi64x(static_cast<long long>(k)), _mm256_set_epi64x(3, 2, 1, 0));
      const __m256i mask = _mm256_cmpgt_epi64(count, index);
      for (std::size_t l = 0; l < 4; ++l)
        numbers[k + l] = reinterpret_cast<Vec>(_mm256_maskload_pd(from + l * n + k, mask));
      transpose(numbers + k);
    }
    return;
  }
#endif
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t l = 0; l < lanes; ++l) lane(numbers[k], l) = from[l * n + k];
}

}  // namespace
