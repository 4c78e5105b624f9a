// SPDX-License-Identifier: Apache-2.0
// NetvladHead as a safetensors file: 8 bytes (little-endian) with the length of a JSON header, the header, the numbers.
#include <bit>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "core/util/error.h"
#include "encoder_service/encoding/netvlad_head.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are copied as they lie in the file");

using Json = nlohmann::ordered_json;
using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::uint64_t kLargestHeader = 1 << 20;
constexpr std::uint64_t kLargestSide = 1 << 20;
const char* const kCentroids = "centroids";
const char* const kWeight = "conv.weight";
const char* const kBias = "conv.bias";
const char* const kProjection = "wpca.weight";
const char* const kOffset = "wpca.bias";
const std::set<std::string> kTensors = {kCentroids, kWeight, kBias, kProjection, kOffset};

std::string list_tensors() {
  std::string names;
  for (const std::string& name : kTensors) names += (names.empty() ? "" : ", ") + name;
  return names;
}

struct Tensor {
  std::uint64_t rows = 0, columns = 0;  // a vector has one column
  std::uint64_t begin = 0, end = 0;     // among the numbers, bytes
};

class Reader {
 public:
  Reader(std::span<const std::byte> bytes, const std::string& where) : where_(where) {
    if (bytes.size() < 8) fail("is no safetensors file: fewer than 8 bytes");
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data(), 8);
    if (length > kLargestHeader || length > bytes.size() - 8)
      fail("is no safetensors file, or one that was cut short: a header of " + std::to_string(length) + " bytes");
    data_ = bytes.subspan(8 + length);
    const char* text = reinterpret_cast<const char*>(bytes.data()) + 8;
    // A depth limit of our own: the JSON reader has none.
    int depth = 0;
    for (std::uint64_t i = 0; i < length; ++i) {
      depth += text[i] == '{' || text[i] == '[' ? 1 : text[i] == '}' || text[i] == ']' ? -1 : 0;
      if (depth > 16) fail("is no safetensors file: its header is nested too deeply");
    }
    const Json header = Json::parse(text, text + length, nullptr, false);
    if (!header.is_object()) fail("is no safetensors file: its header is no JSON object");
    for (const auto& [name, entry] : header.items()) {
      if (name == "__metadata__") continue;
      if (!kTensors.contains(name)) fail("unknown tensor " + Json(name).dump(), "known: " + list_tensors());
      tensors_[name] = read_entry(name, entry);
    }
    check_coverage();
  }

  bool has(const std::string& name) const { return tensors_.contains(name); }
  /// rows x columns; 0 stands for any.
  RowMajor matrix(const std::string& name, Eigen::Index rows, Eigen::Index columns) const {
    const auto found = tensors_.find(name);
    if (found == tensors_.end()) fail("has no tensor '" + name + "'");
    const Tensor& tensor = found->second;
    const auto fits = [](std::uint64_t side, Eigen::Index wanted) {
      return wanted == 0 || side == static_cast<std::uint64_t>(wanted);
    };
    if (!fits(tensor.rows, rows) || !fits(tensor.columns, columns))
      fail("tensor '" + name + "' is " + std::to_string(tensor.rows) + " x " + std::to_string(tensor.columns) +
           ", it has to be " + (rows ? std::to_string(rows) : "any") + " x " +
           (columns ? std::to_string(columns) : "any"));
    RowMajor numbers(tensor.rows, tensor.columns);
    std::memcpy(numbers.data(), data_.data() + tensor.begin, tensor.end - tensor.begin);
    if (!numbers.allFinite()) fail("tensor '" + name + "' has numbers that are not finite");
    return numbers;
  }

 private:
  [[noreturn]] void fail(const std::string& what, const std::string& remedy = "") const {
    throw Error(what, where_, remedy);
  }
  std::uint64_t number(const std::string& name, const Json& value) const {
    if (!value.is_number_unsigned()) fail("tensor '" + name + "' has a broken description");
    return value.get<std::uint64_t>();
  }

  Tensor read_entry(const std::string& name, const Json& entry) const {
    if (!entry.is_object() || !entry.contains("dtype") || !entry.contains("shape") || !entry.contains("data_offsets") ||
        !entry["shape"].is_array() || !entry["data_offsets"].is_array() || entry["data_offsets"].size() != 2)
      fail("tensor '" + name + "' has a broken description");
    if (entry["dtype"] != "F32") fail("tensor '" + name + "' is of type " + entry["dtype"].dump() + ", not F32");
    std::vector<std::uint64_t> shape;
    for (const Json& side : entry["shape"]) {
      shape.push_back(number(name, side));
      if (shape.back() < 1 || shape.back() > kLargestSide)
        fail("tensor '" + name + "' has a side of " + std::to_string(shape.back()));
    }
    while (shape.size() > 2 && shape.back() == 1) shape.pop_back();  // a 1 x 1 convolution
    if (shape.empty() || shape.size() > 2) fail("tensor '" + name + "' is neither a vector nor a matrix");
    const Tensor tensor{shape[0], shape.size() == 2 ? shape[1] : 1, number(name, entry["data_offsets"][0]),
                        number(name, entry["data_offsets"][1])};
    if (tensor.begin > tensor.end || tensor.end > data_.size())
      fail("tensor '" + name + "' lies outside the file: cut short?");
    if ((tensor.end - tensor.begin) != tensor.rows * tensor.columns * sizeof(float))
      fail("tensor '" + name + "' has a shape that does not fit its bytes");
    return tensor;
  }

  /// Tensors lie one behind the other, without holes, as the format demands.
  void check_coverage() const {
    std::map<std::uint64_t, std::uint64_t> ranges;
    for (const auto& [name, tensor] : tensors_)
      if (!ranges.emplace(tensor.begin, tensor.end).second) fail("tensor '" + name + "' lies on another one");
    std::uint64_t at = 0;
    for (const auto& [begin, end] : ranges) {
      if (begin != at) fail("its tensors overlap or leave holes");
      at = end;
    }
    if (at != data_.size()) fail("has bytes that belong to no tensor");
  }

  const std::string& where_;
  std::span<const std::byte> data_;
  std::map<std::string, Tensor> tensors_;
};

}  // namespace

NetvladHead NetvladHead::parse(std::span<const std::byte> bytes, const std::string& where) {
  const Reader reader(bytes, where);
  NetvladHead head;
  head.centroids = reader.matrix(kCentroids, 0, 0).transpose();
  const Eigen::Index clusters = head.centroids.cols();
  head.weight = reader.matrix(kWeight, clusters, head.centroids.rows()).transpose();
  head.bias = Eigen::VectorXf::Zero(clusters);
  if (reader.has(kBias)) head.bias = reader.matrix(kBias, clusters, 1);
  if (reader.has(kProjection)) {
    head.projection = reader.matrix(kProjection, 0, head.centroids.size());
    head.offset = Eigen::VectorXf::Zero(head.projection.rows());
  }
  if (reader.has(kOffset)) {
    if (head.projection.size() == 0) throw Error("has tensor 'wpca.bias' without 'wpca.weight'", where);
    head.offset = reader.matrix(kOffset, head.projection.rows(), 1);
  }
  return head;
}

Bytes NetvladHead::save() const {
  Json header = Json::object();
  std::vector<float> numbers;
  const auto add = [&](const char* name, const std::vector<Eigen::Index>& shape, const RowMajor& tensor) {
    const std::size_t begin = numbers.size();
    numbers.insert(numbers.end(), tensor.data(), tensor.data() + tensor.size());
    header[name] = {{"dtype", "F32"}, {"shape", shape}, {"data_offsets", {begin * 4, numbers.size() * 4}}};
  };
  add(kCentroids, {centroids.cols(), centroids.rows()}, centroids.transpose());
  add(kWeight, {weight.cols(), weight.rows()}, weight.transpose());
  add(kBias, {bias.size()}, bias);
  if (projection.size() > 0) {
    add(kProjection, {projection.rows(), projection.cols()}, projection);
    add(kOffset, {offset.size()}, offset);
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');  // numbers begin at a multiple of 8
  const std::uint64_t length = text.size();
  Bytes bytes(8 + text.size() + numbers.size() * sizeof(float));
  std::memcpy(bytes.data(), &length, 8);
  std::memcpy(bytes.data() + 8, text.data(), text.size());
  std::memcpy(bytes.data() + 8 + text.size(), numbers.data(), numbers.size() * sizeof(float));
  return bytes;
}

}  // namespace citylearn
