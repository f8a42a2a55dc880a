// The sieve of a colour table: products of sets that cover the labelled cells.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "pieper/segmentation.hpp"

namespace pieper {
namespace {

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

}  // namespace pieper
