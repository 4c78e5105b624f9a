// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_file.h"

#include <onnx/onnx_pb.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>
#include <string_view>

#include "core/util/error.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxModelBytes = (std::uint64_t{1} << 31) - 1;  // protobuf's own limit

/// Bytes of a number by onnx::TensorProto::DataType; 0: a text, or numbers that share bytes.
constexpr std::array<std::uint64_t, 17> kNumberBytes = {0, 4, 1, 1, 2, 2, 4, 8, 0, 1, 2, 8, 4, 8, 8, 16, 2};

onnx::ModelProto parse(std::span<const std::byte> bytes, const std::string& where) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (text.empty()) throw Error("an empty file", where);
  if (text.starts_with("version https://git-lfs"))
    throw Error("is a Git LFS pointer, not the model itself", where, "fetch it with 'git lfs pull'");
  onnx::ModelProto model;
  if (bytes.size() > kMaxModelBytes || !model.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    throw Error("is not an ONNX model, or one that was cut short", where, "--model names an .onnx file");
  return model;
}

std::vector<std::byte> serialised(const onnx::ModelProto& model, const std::string& where) {
  std::vector<std::byte> bytes(model.ByteSizeLong());
  if (!model.SerializeToArray(bytes.data(), static_cast<int>(bytes.size())))
    throw Error("is larger than 2 GiB with its weights", where);
  return bytes;
}

/// Calls `visit` for each tensor in a message: weights, attributes of nodes, graphs within graphs.
void visit_tensors(google::protobuf::Message& message, const std::function<void(onnx::TensorProto&)>& visit) {
  if (auto* tensor = dynamic_cast<onnx::TensorProto*>(&message)) return visit(*tensor);
  const google::protobuf::Reflection& fields = *message.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> present;
  fields.ListFields(message, &present);
  for (const auto* field : present) {
    if (field->cpp_type() != field->CPPTYPE_MESSAGE) continue;
    if (!field->is_repeated()) visit_tensors(*fields.MutableMessage(&message, field), visit);
    for (int i = 0; field->is_repeated() && i < fields.FieldSize(message, field); ++i)
      visit_tensors(*fields.MutableRepeatedMessage(&message, field, i), visit);
  }
}

/// Returns whether `file` lies in the folder of `model` or below, wherever symbolic links of either lead.
bool beside(const fs::path& file, const fs::path& model) {
  const fs::path real = fs::canonical(file);
  for (const fs::path& folder : {fs::canonical(fs::absolute(model).parent_path()), fs::canonical(model).parent_path()})
    if (std::mismatch(folder.begin(), folder.end(), real.begin(), real.end()).first == folder.end()) return true;
  return false;
}

/// Returns the bytes of weights of at most `most` bytes that the model at `path` keeps in another file.
std::string outside_weights(const onnx::TensorProto& tensor, const std::string& path, std::uint64_t most) {
  std::string location;
  std::uint64_t offset = 0, length = 0;
  for (const auto& entry : tensor.external_data()) {
    const std::string &key = entry.key(), &value = entry.value();
    if (key == "location") location = value;
    if (key != "offset" && key != "length") continue;
    const char* const end = value.data() + value.size();
    if (value.empty() || std::from_chars(value.data(), end, key == "offset" ? offset : length).ptr != end)
      throw Error("gives weights '" + tensor.name() + "' the " + key + " '" + value + "'", path, "export it again");
  }
  const fs::path name(location), file = fs::path(path).parent_path() / name;
  std::error_code error;
  if (name.empty() || name.is_absolute() || std::find(name.begin(), name.end(), "..") != name.end() ||
      (fs::exists(file, error) && !beside(file, path)))
    throw Error("keeps weights outside its own folder, in '" + location + "', which is not read", path,
                "put them beside it, and export it again");
  if (!fs::is_regular_file(file, error))
    throw Error("lacks the file of its weights, '" + location + "'", path, "put it beside the model");
  std::ifstream in(file, std::ios::binary);
  const std::uint64_t size = fs::file_size(file);
  if (length == 0) length = size - std::min(size, offset);
  if (length > most) throw Error("is larger than 2 GiB with its weights", path);
  std::string bytes(offset > size || length > size - offset ? 0 : length, '\0');
  if (!in.seekg(static_cast<std::streamoff>(offset)) ||
      !in.read(bytes.data(), static_cast<std::streamsize>(bytes.size())) || bytes.size() != length)
    throw Error("is cut short: weights '" + tensor.name() + "' are " + std::to_string(length) + " bytes from byte " +
                    std::to_string(offset) + " on",
                file, "copy it again");
  return bytes;
}

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
  const onnx::ModelProto model = parse(bytes, where);
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
      throw Error("keeps weights in other files, which are not read", where, "export it with the weights inside");
  }
  // Before IR version 4 each weight was listed among the inputs too.
  for (const onnx::ValueInfoProto& input : graph.input())
    if (!weights.contains(input.name()))
      file.inputs.push_back({input.name(), shape_of(input.type().tensor_type().shape())});
  return file;
}

std::vector<std::byte> with_batch(std::span<const std::byte> bytes, int batch, const std::string& where) {
  onnx::ModelProto model = parse(bytes, where);
  for (onnx::ValueInfoProto& input : *model.mutable_graph()->mutable_input())
    if (auto& shape = *input.mutable_type()->mutable_tensor_type()->mutable_shape(); shape.dim_size() > 0)
      shape.mutable_dim(0)->set_dim_value(batch);
  return serialised(model, where);
}

OnnxModel load_onnx(const std::string& path) {
  OnnxModel loaded{read_model_file(path, kMaxModelBytes), ""};
  onnx::ModelProto model = parse(loaded.bytes, path);
  std::string hashes = loaded.hash = short_hash(loaded.bytes);
  std::uint64_t total = loaded.bytes.size();
  visit_tensors(model, [&](onnx::TensorProto& tensor) {
    if (tensor.data_location() == onnx::TensorProto::EXTERNAL) {
      tensor.set_raw_data(outside_weights(tensor, path, kMaxModelBytes - total));
      tensor.clear_external_data();
      tensor.clear_data_location();
      total += tensor.raw_data().size();
      hashes += sha256(tensor.raw_data());
    } else if (!tensor.has_raw_data()) {
      return;
    }
    const auto type = static_cast<std::size_t>(tensor.data_type());
    std::uint64_t size = type < kNumberBytes.size() ? kNumberBytes[type] : 0;
    if (size == 0) return;
    for (const std::int64_t side : tensor.dims())
      size = std::min(size * std::clamp<std::uint64_t>(side, 0, kMaxModelBytes), kMaxModelBytes);
    if (size != tensor.raw_data().size())
      throw Error("has " + std::to_string(tensor.raw_data().size()) + " bytes of weights '" + tensor.name() +
                      "', whose sides need " + std::to_string(size),
                  path, "export it again");
  });
  if (hashes == loaded.hash) return loaded;
  loaded.hash = short_hash(std::as_bytes(std::span(hashes)));
  loaded.bytes = serialised(model, path);
  return loaded;
}

}  // namespace citylearn
