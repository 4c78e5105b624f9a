// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace citylearn {

/// Places of a city and the links between them. Link l leads from from[l] to to[l], and one who stands at its beginning
/// sees its end at heading[l]. The links of a place stand together, clockwise from north.
struct StreetMap {
  static constexpr std::size_t kMaxLinksOfPlace = 255;

  std::vector<float> east, north;       ///< P, metres of any plane
  std::vector<std::uint32_t> from, to;  ///< L, indices of places
  std::vector<float> heading;           ///< L, degrees clockwise from north, 0..360

  std::size_t places() const { return east.size(); }
  std::size_t links() const { return from.size(); }

  /// Takes headings modulo 360 and puts the links in order. Returns where each stood before, for what belongs to links.
  /// Throws Error that names the link or the place: an unknown end, a link from a place to itself, a position or
  /// heading that is not a number, more than kMaxLinksOfPlace links at a place, or a place that can be reached but not
  /// left.
  std::vector<std::uint32_t> put_in_order();
  /// Throws Error as put_in_order(), and where links are not in order.
  void check() const;
  /// Returns the first 8 bytes of SHA-256 over all.
  std::uint64_t hash() const;
  /// Returns the first link of each place, and behind them their number: P + 1.
  std::vector<std::uint32_t> first_links() const;
};

}  // namespace citylearn
