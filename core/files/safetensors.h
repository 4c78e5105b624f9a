// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// A safetensors file (https://github.com/huggingface/safetensors): 8 bytes (little-endian) with the length of a JSON
/// header, the header, the numbers. Here all of them are 32-bit floats.
struct Safetensors {
  struct Tensor {
    std::vector<std::uint64_t> shape;
    std::vector<float> numbers;  ///< row-major: the last side runs fastest
  };
  std::map<std::string, std::string> metadata;
  std::map<std::string, Tensor> tensors;

  /// Returns the file, its tensors by name. The same contents give the same bytes.
  std::string bytes() const;
  /// Reads a file. Throws Error naming `where` and the tensor when the header, a type or a shape is wrong, a tensor
  /// does not fit its bytes, or tensors overlap or leave holes. Sizes are checked before memory is taken.
  static Safetensors parse(std::string_view bytes, const std::string& where);
};

/// "[2, 3]".
std::string shape_text(const std::vector<std::uint64_t>& shape);

}  // namespace citylearn
