// SPDX-License-Identifier: Apache-2.0
#include "core/files/safetensors.h"

#include <bit>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are copied as they lie in the file");

using Json = nlohmann::json;  // its objects are quick with any number of names

constexpr std::uint64_t kMaxHeaderBytes = 100'000'000;  // the format's own limit
constexpr const char* kMetadata = "__metadata__";

/// Reads a file piece by piece.
class SafetensorsReader {
 public:
  SafetensorsReader(std::string_view bytes, const std::string& where) : where_(where) {
    if (bytes.size() < 8) fail("is not a safetensors file: fewer than 8 bytes");
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data(), 8);
    if (length > kMaxHeaderBytes || length > bytes.size() - 8)
      fail("is not a safetensors file, or was cut short: its header would have " + std::to_string(length) + " bytes");
    data_ = bytes.substr(8 + length);
    read_header(bytes.substr(8, length));
  }
  Safetensors take() { return std::move(result_); }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error(what, where_); }

  void read_header(std::string_view text) {
    const auto header = parse_json_or_null<Json>(text);
    if (!header.is_object()) fail("is not a safetensors file: its header is not a JSON object");
    std::map<std::uint64_t, std::pair<std::uint64_t, std::string>> ranges;  // begin: end and name
    for (const auto& [name, entry] : header.items()) {
      if (name == kMetadata) {
        read_metadata(entry);
        continue;
      }
      const auto [begin, end] = read_tensor(name, entry);
      if (begin == end) continue;
      const auto [other, fresh] = ranges.emplace(begin, std::pair{end, name});
      if (!fresh) fail("tensors '" + other->second.second + "' and '" + name + "' overlap");
    }
    std::uint64_t at = 0;
    std::string before;
    for (const auto& [begin, rest] : ranges) {
      const auto& [end, name] = rest;
      if (begin < at) fail("tensors '" + before + "' and '" + name + "' overlap");
      if (begin > at) fail("has a hole of " + std::to_string(begin - at) + " bytes before tensor '" + name + "'");
      at = end;
      before = name;
    }
    if (at != data_.size()) fail("has " + std::to_string(data_.size() - at) + " bytes that belong to no tensor");
  }

  void read_metadata(const Json& entry) {
    if (!entry.is_object()) fail("its __metadata__ is not a JSON object");
    for (const auto& [key, value] : entry.items()) {
      if (!value.is_string()) fail("its __metadata__ '" + key + "' is not a string");
      result_.metadata[key] = value.get<std::string>();
    }
  }

  std::uint64_t number(const std::string& name, const Json& value) const {
    if (!value.is_number_unsigned()) fail("tensor '" + name + "': shape and data_offsets must be whole numbers");
    return value.get<std::uint64_t>();
  }

  /// Returns where it lies among the numbers.
  std::pair<std::uint64_t, std::uint64_t> read_tensor(const std::string& name, const Json& entry) {
    if (!entry.is_object()) fail("tensor '" + name + "' is not a JSON object");
    for (const char* key : {"dtype", "shape", "data_offsets"})
      if (!entry.contains(key)) fail("tensor '" + name + "' has no " + key);
    const Json &dtype = entry["dtype"], &shape = entry["shape"], &offsets = entry["data_offsets"];
    if (dtype != "F32") fail("tensor '" + name + "' has dtype " + dtype.dump(-1, ' ', true) + ", must be \"F32\"");
    if (!shape.is_array()) fail("tensor '" + name + "': its shape is not a list");
    if (!offsets.is_array() || offsets.size() != 2)
      fail("tensor '" + name + "': its data_offsets are not a list of two numbers");
    Safetensors::Tensor tensor;
    std::optional<std::uint64_t> bytes = sizeof(float);
    for (const Json& side : shape) {
      const std::uint64_t length = number(name, side);
      tensor.shape.push_back(length);
      if (bytes && length > 0 && *bytes > data_.size() / length)
        bytes.reset();  // more than there are, whatever follows
      else if (bytes)
        *bytes *= length;
    }
    for (const std::uint64_t length : tensor.shape)
      if (length == 0) bytes = 0;
    const std::uint64_t begin = number(name, offsets[0]), end = number(name, offsets[1]);
    if (begin > end || end > data_.size())
      fail("tensor '" + name + "' lies at " + shape_text({begin, end}) + ", the file has " +
           std::to_string(data_.size()) + " bytes of numbers: cut short?");
    if (!bytes || end - begin != *bytes)
      fail("tensor '" + name + "' of shape " + shape_text(tensor.shape) + " does not fit its " +
           std::to_string(end - begin) + " bytes");
    tensor.numbers.resize((end - begin) / sizeof(float));
    if (begin < end) std::memcpy(tensor.numbers.data(), data_.data() + begin, end - begin);
    result_.tensors[name] = std::move(tensor);
    return {begin, end};
  }

  const std::string& where_;
  std::string_view data_;
  Safetensors result_;
};

}  // namespace

std::string shape_text(const std::vector<std::uint64_t>& shape) {
  return "[" + joined(shape, [](std::uint64_t side) { return std::to_string(side); }) + "]";
}

std::string Safetensors::bytes() const {
  auto header = nlohmann::ordered_json::object();
  if (!metadata.empty()) header[kMetadata] = metadata;
  std::uint64_t at = 0;
  for (const auto& [name, tensor] : tensors) {
    const std::uint64_t end = at + tensor.numbers.size() * sizeof(float);
    header[name] = {{"dtype", "F32"}, {"shape", tensor.shape}, {"data_offsets", {at, end}}};
    at = end;
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');  // the numbers begin at a multiple of 8
  const std::uint64_t length = text.size();
  std::string all(sizeof length, '\0');
  std::memcpy(all.data(), &length, sizeof length);
  all += text;
  all.reserve(all.size() + at);
  for (const auto& [name, tensor] : tensors)
    all.append(reinterpret_cast<const char*>(tensor.numbers.data()), tensor.numbers.size() * sizeof(float));
  return all;
}

Safetensors Safetensors::parse(std::string_view bytes, const std::string& where) {
  return SafetensorsReader(bytes, where).take();
}

}  // namespace citylearn
