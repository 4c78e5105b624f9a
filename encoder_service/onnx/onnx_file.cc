// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_file.h"

#include <onnx/onnx_pb.h>

#include <cerrno>
#include <climits>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <string_view>

#include "core/util/error.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

/// Returns the sides of a tensor; -1: left open.
std::vector<std::int64_t> shape_of(const onnx::TensorShapeProto& shape) {
  std::vector<std::int64_t> sides;
  for (const auto& dimension : shape.dim()) sides.push_back(dimension.dim_value() > 0 ? dimension.dim_value() : -1);
  return sides;
}

}  // namespace

std::string short_hash(std::span<const std::byte> bytes) {
  return sha256({reinterpret_cast<const char*>(bytes.data()), bytes.size()}).substr(0, 8);
}

std::vector<std::byte> read_model_file(const std::string& path, std::uint64_t largest) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) throw Error(error ? error.message() : "is not a file", path);
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw Error(error.message(), path);
  if (size > largest) throw Error("is larger than " + std::to_string(largest >> 20) + " MiB", path);
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(std::strerror(errno), path);
  std::vector<std::byte> bytes(size);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size)))
    throw Error("cannot be read", path);
  return bytes;
}

OnnxFile read_onnx(std::span<const std::byte> bytes, const std::string& where) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (text.empty()) throw Error("an empty file", where);
  if (text.starts_with("version https://git-lfs"))
    throw Error("is a Git LFS pointer, not the model itself", where, "fetch it with 'git lfs pull'");
  onnx::ModelProto model;
  if (bytes.size() > INT_MAX || !model.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    throw Error("is not an ONNX model, or one that was cut short", where, "--model names an .onnx file");
  const onnx::GraphProto& graph = model.graph();
  if (graph.node_size() == 0)
    throw Error("is not an ONNX model: it has no operators", where, "--model names an .onnx file");
  OnnxFile file;
  file.nodes = graph.node_size();
  for (const auto& entry : model.metadata_props()) file.metadata[entry.key()] = entry.value();
  for (const auto& opset : model.opset_import())
    if (opset.domain().empty() || opset.domain() == "ai.onnx") file.opset = opset.version();
  std::set<std::string> weights;
  for (const onnx::TensorProto& tensor : graph.initializer()) {
    weights.insert(tensor.name());
    if (tensor.data_location() == onnx::TensorProto::EXTERNAL)
      throw Error("keeps weights in other files, which OpenCV does not read", where,
                  "export it with the weights inside, below 2 GB");
  }
  // Before IR version 4 each weight was listed among the inputs too.
  for (const onnx::ValueInfoProto& input : graph.input())
    if (!weights.contains(input.name()))
      file.inputs.push_back({input.name(), shape_of(input.type().tensor_type().shape())});
  return file;
}

}  // namespace citylearn
