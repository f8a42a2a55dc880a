// Labels of one row of pixels, and where they change. Compiled once per instruction set.
#include "pieper/segmentation.hpp"

#include <bit>
#include <cstring>

#if defined(__AVX2__)
#include <immintrin.h>
#endif

namespace {

using pieper::ColorLookUp;

// Where the three bytes of pixel i are.
struct Packed {
  const std::uint8_t* pixels;
  std::uint8_t byte(std::size_t i, int c) const { return pixels[3 * i + c]; }
};
struct Planar {
  const std::uint8_t* planes[3];
  std::uint8_t byte(std::size_t i, int c) const { return planes[c][i]; }
};

// ColorLookUp with its numbers in registers.
struct Table {
  const std::uint8_t* labels;
  unsigned drop, place[3];
  explicit Table(const ColorLookUp& look_up)
      : labels(look_up.table), drop(look_up.drop), place{look_up.place[0], look_up.place[1], look_up.place[2]} {}
  template <class Pixels>
  std::uint8_t operator()(const Pixels& pixels, std::size_t i) const {
    const std::uint32_t a = pixels.byte(i, 0) >> drop, b = pixels.byte(i, 1) >> drop, c = pixels.byte(i, 2) >> drop;
    return labels[(a << place[0]) | (b << place[1]) | (c << place[2])];
  }
};

#if defined(__AVX2__)

constexpr std::size_t block = 32;

inline __m256i halves(const std::uint8_t* low, const std::uint8_t* high) {
  return _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(low))),
                                 _mm_loadu_si128(reinterpret_cast<const __m128i*>(high)), 1);
}

inline __m256i both(const std::int8_t* sixteen) {
  return _mm256_broadcastsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(sixteen)));
}

// 32 packed pixels from i, one vector per channel. Byte k of 48 goes with channel k mod 3; as 16 = 1 mod 3, the bytes of a channel lie
// in three loads at places of three different residues, so that a blend collects all 16 and a shuffle puts them in order.
struct Shuffles {
  __m256i residue[3], order[3];
  Shuffles() {
    std::int8_t mask[3][16], from[3][16];
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < 16; ++j) {
        mask[c][j] = static_cast<std::int8_t>(j % 3 == c ? -1 : 0);
        from[c][j] = static_cast<std::int8_t>((3 * j + c) % 16);
      }
    for (int c = 0; c < 3; ++c) residue[c] = both(mask[c]), order[c] = both(from[c]);
  }
  void load(const Packed& pixels, std::size_t i, __m256i out[3]) const {
    const std::uint8_t* p = pixels.pixels + 3 * i;
    const __m256i v0 = halves(p, p + 48), v1 = halves(p + 16, p + 64), v2 = halves(p + 32, p + 80);
    for (int c = 0; c < 3; ++c) {
      const __m256i mixed =
          _mm256_blendv_epi8(_mm256_blendv_epi8(v0, v1, residue[(c + 2) % 3]), v2, residue[(c + 1) % 3]);
      out[c] = _mm256_shuffle_epi8(mixed, order[c]);
    }
  }
  void load(const Planar& pixels, std::size_t i, __m256i out[3]) const {
    for (int c = 0; c < 3; ++c) out[c] = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(pixels.planes[c] + i));
  }
};

// More candidates than this in a block are looked up without asking which they are.
constexpr int crowded = 12;

template <class Pixels>
std::size_t changes_of(const ColorLookUp& look_up, const Pixels& pixels, std::size_t n, std::uint8_t* labels,
                       std::uint32_t* changes) {
  const Table table(look_up);
  const Shuffles shuffles;
  const __m256i low = _mm256_set1_epi8(15), zero = _mm256_setzero_si256();
  __m256i sieve[2][3];
  for (int k = 0; k < 2; ++k)
    for (int c = 0; c < 3; ++c) sieve[k][c] = both(reinterpret_cast<const std::int8_t*>(look_up.sieve[k][c]));
  std::size_t count = 0, i = 0;
  for (; i < n; i += block) {
    if (i + block <= n) {
      __m256i bytes[3];
      shuffles.load(pixels, i, bytes);
      for (__m256i& channel : bytes) channel = _mm256_and_si256(_mm256_srli_epi16(channel, 4), low);
      __m256i admitted = zero;
      for (int k = 0; k < 2; ++k) {
        const __m256i first = _mm256_shuffle_epi8(sieve[k][0], bytes[0]),
                      second = _mm256_shuffle_epi8(sieve[k][1], bytes[1]);
        admitted = _mm256_or_si256(
            admitted, _mm256_and_si256(_mm256_and_si256(first, second), _mm256_shuffle_epi8(sieve[k][2], bytes[2])));
      }
      std::uint32_t candidates = ~static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_cmpeq_epi8(admitted, zero)));
      if (candidates == 0 || std::popcount(candidates) <= crowded) {
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(labels + i), zero);
        if (candidates == 0 && labels[static_cast<std::ptrdiff_t>(i) - 1] == 0) continue;
        for (; candidates != 0; candidates &= candidates - 1) {
          const std::size_t k = i + static_cast<std::size_t>(std::countr_zero(candidates));
          labels[k] = table(pixels, k);
        }
      } else {
        for (std::size_t k = i; k < i + block; ++k) labels[k] = table(pixels, k);
      }
    } else {
      std::memset(labels + i, 0, block);
      for (std::size_t k = i; k < n; ++k) labels[k] = table(pixels, k);
    }
    const __m256i here = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(labels + i));
    const __m256i before = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(labels + i - 1));
    std::uint32_t differ = ~static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_cmpeq_epi8(here, before)));
    for (; differ != 0; differ &= differ - 1)
      changes[count++] = static_cast<std::uint32_t>(i) + static_cast<std::uint32_t>(std::countr_zero(differ));
  }
  if (i == n && n > 0 && labels[n - 1] != 0) changes[count++] = static_cast<std::uint32_t>(n);
  return count;
}

#else

template <class Pixels>
std::size_t changes_of(const ColorLookUp& look_up, const Pixels& pixels, std::size_t n, std::uint8_t* labels,
                       std::uint32_t* changes) {
  const Table table(look_up);
  std::size_t count = 0;
  std::uint8_t before = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint8_t here = table(pixels, i);
    labels[i] = here;
    // written in any case, kept if there is a change: no branch that noise could mislead
    changes[count] = static_cast<std::uint32_t>(i);
    count += here != before;
    before = here;
  }
  if (before != 0) changes[count++] = static_cast<std::uint32_t>(n);
  return count;
}

#endif

std::size_t packed(const ColorLookUp& look_up, const std::uint8_t* pixels, std::size_t n, std::uint8_t* labels,
                   std::uint32_t* changes) {
  return changes_of(look_up, Packed{pixels}, n, labels, changes);
}

std::size_t planar(const ColorLookUp& look_up, const std::uint8_t* const planes[3], std::size_t n, std::uint8_t* labels,
                   std::uint32_t* changes) {
  return changes_of(look_up, Planar{{planes[0], planes[1], planes[2]}}, n, labels, changes);
}

}  // namespace

#define PIEPER_JOIN_(a, b) a##b
#define PIEPER_JOIN(a, b) PIEPER_JOIN_(a, b)

namespace pieper {
extern const SegmentationKernels PIEPER_JOIN(segmentation_kernels_, PIEPER_ISA);
const SegmentationKernels PIEPER_JOIN(segmentation_kernels_, PIEPER_ISA){packed, planar};
}  // namespace pieper
