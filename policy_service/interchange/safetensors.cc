// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/safetensors.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/util/error.h"
#include "core/util/files.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are copied as they lie in the file");

using Json = nlohmann::ordered_json;
using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::uint64_t kLargestHeader = 100'000'000;  // as the format has it
constexpr int kDeepest = 3;                            // header, tensor, shape
constexpr const char* kMetadata = "__metadata__";
constexpr const char* kReference = "reference";

std::string shape_text(const std::vector<std::uint64_t>& shape) {
  std::string text;
  for (const std::uint64_t side : shape) text += (text.empty() ? "" : ", ") + std::to_string(side);
  return "[" + text + "]";
}

Safetensors::Tensor tensor_of(const RowMajor& numbers) {
  return {{static_cast<std::uint64_t>(numbers.rows()), static_cast<std::uint64_t>(numbers.cols())},
          {numbers.data(), numbers.data() + numbers.size()}};
}

/// Takes a file apart.
class Reader {
 public:
  Reader(std::string_view bytes, const std::string& where) : where_(where) {
    if (bytes.size() < 8) fail("is no safetensors file: fewer than 8 bytes");
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data(), 8);
    if (length > kLargestHeader || length > bytes.size() - 8)
      fail("is no safetensors file, or was cut short: its header would have " + std::to_string(length) + " bytes");
    data_ = bytes.substr(8 + length);
    read_header(bytes.substr(8, length));
  }
  Safetensors take() { return std::move(result_); }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error(what, where_); }

  void read_header(std::string_view text) {
    bool deep = false;
    const auto shallow = [&](int depth, Json::parse_event_t, Json&) {
      deep = deep || depth > kDeepest;
      return !deep;  // what lies deeper is not built
    };
    const Json header = Json::parse(text, shallow, false);
    if (deep) fail("is no safetensors file: its header is nested too deeply");
    if (!header.is_object()) fail("is no safetensors file: its header is no JSON object");
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
    if (!entry.is_object()) fail("its __metadata__ is no JSON object");
    for (const auto& [key, value] : entry.items()) {
      if (!value.is_string()) fail("its __metadata__ '" + key + "' is no text");
      result_.metadata[key] = value.get<std::string>();
    }
  }

  std::uint64_t number(const std::string& name, const Json& value) const {
    if (!value.is_number_unsigned()) fail("tensor '" + name + "': shape and data_offsets must be whole numbers");
    return value.get<std::uint64_t>();
  }

  /// Returns where it lies among the numbers.
  std::pair<std::uint64_t, std::uint64_t> read_tensor(const std::string& name, const Json& entry) {
    if (!entry.is_object()) fail("tensor '" + name + "' is no JSON object");
    for (const char* key : {"dtype", "shape", "data_offsets"})
      if (!entry.contains(key)) fail("tensor '" + name + "' has no " + key);
    const Json &dtype = entry["dtype"], &shape = entry["shape"], &offsets = entry["data_offsets"];
    if (dtype != "F32") fail("tensor '" + name + "' has dtype " + dtype.dump(-1, ' ', true) + ", must be \"F32\"");
    if (!shape.is_array()) fail("tensor '" + name + "': its shape is no list");
    if (!offsets.is_array() || offsets.size() != 2)
      fail("tensor '" + name + "': its data_offsets are no list of two numbers");
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

std::string Safetensors::bytes() const {
  Json header = Json::object();
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

Safetensors Safetensors::parse(std::string_view bytes, const std::string& where) { return Reader(bytes, where).take(); }

Safetensors parameters_of(const TrainedAgent& agent, const std::map<std::string, std::string>& metadata) {
  Safetensors file;
  file.metadata = metadata;
  for (const Tensor& tensor : agent.network->tensors())
    file.tensors[tensor.name] =
        tensor_of(Eigen::Map<const Matrix<float>>(agent.parameters.data() + tensor.offset, tensor.rows, tensor.cols));
  if (agent.task.reference.size() > 0) file.tensors[kReference] = tensor_of(agent.task.reference.transpose());
  return file;
}

void load_parameters(const std::string& path, TrainedAgent& agent) {
  const Safetensors file = Safetensors::parse(read_file(path), path);
  const auto made_for = file.metadata.find("agent");
  if (made_for != file.metadata.end() && made_for->second != agent.name)
    throw Error("has parameters of network '" + made_for->second + "', the agent is '" + agent.name + "'", path);
  Vector<float> loaded = agent.parameters;
  std::size_t used = file.tensors.contains(kReference) ? 1 : 0;
  for (const Tensor& tensor : agent.network->tensors()) {
    const auto found = file.tensors.find(tensor.name);
    if (found == file.tensors.end()) throw Error("has no tensor '" + tensor.name + "'", path);
    const auto rows = static_cast<std::uint64_t>(tensor.rows), cols = static_cast<std::uint64_t>(tensor.cols);
    const std::vector<std::uint64_t>& shape = found->second.shape;
    if (shape != std::vector{rows, cols} && !(cols == 1 && shape == std::vector{rows}))
      throw Error("tensor '" + tensor.name + "' has shape " + shape_text(shape) + ", network '" + agent.name +
                      "' needs " + shape_text({rows, cols}),
                  path);
    const Eigen::Map<const RowMajor> numbers(found->second.numbers.data(), tensor.rows, tensor.cols);
    if (!numbers.allFinite()) throw Error("tensor '" + tensor.name + "' has numbers that are not finite", path);
    Eigen::Map<Matrix<float>>(loaded.data() + tensor.offset, tensor.rows, tensor.cols) = numbers;
    ++used;
  }
  if (used != file.tensors.size())
    for (const auto& [name, tensor] : file.tensors) {
      const auto& known = agent.network->tensors();
      if (name != kReference &&
          std::none_of(known.begin(), known.end(), [&name = name](const Tensor& one) { return one.name == name; }))
        throw Error("has tensor '" + name + "', which network '" + agent.name + "' does not know", path);
    }
  agent.parameters = std::move(loaded);
}

}  // namespace citylearn
