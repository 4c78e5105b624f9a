// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// EXIF data of a picture (CIPA DC-008): directories of numbered fields, in the form of a TIFF file of either byte
/// order. Reads only bytes that are there: what is broken is not told.
class Exif {
 public:
  enum class Directory { kImage, kPhoto, kGps };

  /// `tiff` begins with "II*" or "MM" and outlives this object; it may be empty.
  explicit Exif(std::span<const std::byte> tiff) : tiff_(tiff) {}
  /// Returns a field's first numbers, at most 8; a rational whose denominator is 0 is NaN. Empty where it is not told.
  std::vector<double> numbers(Directory directory, unsigned tag) const;
  /// Returns a field's text without blanks and zeros at its end.
  std::string text(Directory directory, unsigned tag) const;
  /// Returns how pixels are to be turned, 1..8; 1, as they are, where it does not say.
  int orientation() const;

 private:
  struct Field {
    std::size_t type = 0, count = 0, at = 0;  ///< `at`: where its values begin; type 0: there is none
  };
  std::size_t number(std::size_t at, std::size_t size) const;
  Field field(Directory directory, unsigned tag) const;

  std::span<const std::byte> tiff_;
};

}  // namespace citylearn
