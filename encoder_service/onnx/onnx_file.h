// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// First 8 hexadecimal digits of the SHA-256 of `bytes`: tells one model from another in the names of encoders.
std::string short_hash(std::span<const std::byte> bytes);

/// The whole file. Throws Error naming `path`: missing, no plain file, larger than `largest` bytes, unreadable.
std::vector<std::byte> read_model_file(const std::string& path, std::uint64_t largest);

/// What is read of an ONNX model before OpenCV sees it.
struct OnnxFile {
  struct Input {
    std::string name;
    std::vector<std::int64_t> shape;  ///< -1: left open by the model
  };
  std::vector<Input> inputs;  ///< of the graph, weights excluded
  std::int64_t opset = 0;     ///< of the standard operators
  int nodes = 0;
};

/// Reads the frame of an ONNX model (onnx.proto3, protobuf wire format). Throws Error naming `where`: something else, a
/// file cut short or damaged, a graph without nodes, weights kept in other files.
OnnxFile read_onnx(std::span<const std::byte> bytes, const std::string& where);

}  // namespace citylearn
