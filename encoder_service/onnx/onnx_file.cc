// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_file.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string_view>

#include "core/util/error.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

/// The fields of one protobuf message, one after the other.
class Message {
 public:
  Message(std::string_view bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  /// Goes to the next field; false at the end.
  bool next() {
    if (at_ == bytes_.size()) return false;
    const std::uint64_t key = varint();
    field_ = static_cast<std::uint32_t>(key >> 3);
    wire_ = static_cast<int>(key & 7);
    if (field_ == 0) fail("is not an ONNX model");
    number_ = 0;
    text_ = {};
    switch (wire_) {
      case 0:
        number_ = varint();
        break;
      case 1:
        take(8);
        break;
      case 2:
        text_ = take(varint());
        break;
      case 5:
        take(4);
        break;
      default:  // groups (3, 4) are in no ONNX file
        fail("is not an ONNX model");
    }
    return true;
  }
  bool is(std::uint32_t field, int wire) const { return field_ == field && wire_ == wire; }
  std::int64_t number() const { return static_cast<std::int64_t>(number_); }
  std::string text() const { return std::string(text_); }
  Message message() const { return Message(text_, where_); }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error(what, where_, "--model names an .onnx file"); }

  std::uint64_t varint() {
    std::uint64_t number = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const auto byte = static_cast<unsigned char>(take(1)[0]);
      number |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if (!(byte & 0x80)) return number;
    }
    fail("is not an ONNX model");
  }
  std::string_view take(std::uint64_t count) {
    if (count > bytes_.size() - at_) fail("is not an ONNX model, or one that was cut short");
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }

  std::string_view bytes_;
  const std::string& where_;
  std::size_t at_ = 0;
  std::uint32_t field_ = 0;
  int wire_ = 0;
  std::uint64_t number_ = 0;
  std::string_view text_;
};

constexpr int kVarint = 0, kBytes = 2;

// Field numbers below are those of onnx.proto3.

std::vector<std::int64_t> read_shape(Message shape) {
  std::vector<std::int64_t> sides;
  while (shape.next()) {
    if (!shape.is(1, kBytes)) continue;
    std::int64_t side = -1;
    for (Message dimension = shape.message(); dimension.next();)
      if (dimension.is(1, kVarint) && dimension.number() > 0) side = dimension.number();
    sides.push_back(side);
  }
  return sides;
}

OnnxFile::Input read_input(Message value) {
  OnnxFile::Input input;
  while (value.next()) {
    if (value.is(1, kBytes)) input.name = value.text();
    if (!value.is(2, kBytes)) continue;
    for (Message type = value.message(); type.next();) {
      if (!type.is(1, kBytes)) continue;
      for (Message tensor = type.message(); tensor.next();)
        if (tensor.is(2, kBytes)) input.shape = read_shape(tensor.message());
    }
  }
  return input;
}

/// The name of a weight.
std::string read_initializer(Message tensor, const std::string& where) {
  std::string name;
  bool elsewhere = false;
  while (tensor.next()) {
    if (tensor.is(8, kBytes)) name = tensor.text();
    if (tensor.is(14, kVarint)) elsewhere = tensor.number() == 1;
  }
  if (elsewhere)
    throw Error("keeps weights in other files, which OpenCV does not read", where,
                "export it with the weights inside, below 2 GB");
  return name;
}

void read_graph(Message graph, OnnxFile& file, const std::string& where) {
  std::set<std::string> weights;
  while (graph.next()) {
    if (graph.is(1, kBytes)) ++file.nodes;
    if (graph.is(5, kBytes)) weights.insert(read_initializer(graph.message(), where));
    if (graph.is(11, kBytes)) file.inputs.push_back(read_input(graph.message()));
  }
  // Before IR version 4 each weight was listed among the inputs too.
  std::erase_if(file.inputs, [&](const OnnxFile::Input& input) { return weights.contains(input.name); });
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
  OnnxFile file;
  for (Message model(text, where); model.next();) {
    if (model.is(7, kBytes)) read_graph(model.message(), file, where);
    if (!model.is(8, kBytes)) continue;
    std::string domain;
    std::int64_t version = 0;
    for (Message opset = model.message(); opset.next();) {
      if (opset.is(1, kBytes)) domain = opset.text();
      if (opset.is(2, kVarint)) version = opset.number();
    }
    if (domain.empty() || domain == "ai.onnx") file.opset = version;
  }
  if (file.nodes == 0) throw Error("is not an ONNX model: it has no operators", where, "--model names an .onnx file");
  return file;
}

}  // namespace citylearn
