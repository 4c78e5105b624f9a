// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// Returns the first 8 hexadecimal digits of the SHA-256 of `bytes`, which tell models apart in the names of encoders.
std::string short_hash(std::span<const std::byte> bytes);

/// Reads the whole file. Throws Error naming `path` when it is missing, not a file, larger than `largest` bytes or
/// cannot be read.
std::vector<std::byte> read_model_file(const std::string& path, std::uint64_t largest);

/// The facts that are read from an ONNX model before OpenCV loads it.
struct OnnxFile {
  struct Input {
    std::string name;
    std::vector<std::int64_t> shape;  ///< -1: left open by the model
  };
  std::vector<Input> inputs;  ///< of the graph, weights excluded
  std::int64_t opset = 0;     ///< of the standard operators
  int nodes = 0;
  std::map<std::string, std::string> metadata;
};

/// Reads inputs, size and metadata of an ONNX model. Throws Error naming `where` when it is something else, cut short
/// or damaged, has a graph without nodes, or keeps weights in other files.
OnnxFile read_onnx(std::span<const std::byte> bytes, const std::string& where);

/// Returns the model with inputs of `batch` rows each. OpenCV 4.10 refuses to read agents whose batch is open. Throws
/// Error naming `where` when the bytes are not an ONNX model.
std::vector<std::byte> with_batch(std::span<const std::byte> bytes, int batch, const std::string& where);

/// A model with all its weights inside.
struct OnnxModel {
  std::vector<std::byte> bytes;  ///< the file's own when it keeps no weights elsewhere
  std::string hash;              ///< short_hash() of the file, with its weights elsewhere
};

/// Reads the model at `path` and puts weights inside that it keeps in other files (external data). Throws Error naming
/// the file when it is not an ONNX model, when weights are cut short, lie elsewhere than in its folder or below
/// (symbolic links followed), or when all together is larger than protobuf's 2 GiB.
OnnxModel load_onnx(const std::string& path);

}  // namespace citylearn
