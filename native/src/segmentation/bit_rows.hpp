// A picture of bits: what is near to what, many pixels at a time.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace pieper {

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

}  // namespace pieper
