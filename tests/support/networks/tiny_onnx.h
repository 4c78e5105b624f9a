// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"
#include "tests/support/data/proto.h"

namespace citylearn::testing {

inline EncoderFiles network(const std::string& model, const std::string& layer = "", const std::string& preset = "") {
  return {model, layer, preset};
}

/// A graph with nodes one after the other: each reads the output of the one before.
class TinyOnnx {
 public:
  /// Sides below 1 are left open.
  TinyOnnx& input(const std::vector<std::int64_t>& shape, const std::string& name = "input") {
    graph_.message(11, value(name, shape));
    if (last_.empty()) last_ = name;
    return *this;
  }
  TinyOnnx& integers(const std::string& name, const std::vector<std::int64_t>& numbers) {
    std::string raw(numbers.size() * sizeof numbers[0], '\0');
    std::memcpy(raw.data(), numbers.data(), raw.size());
    graph_.message(
        5, Proto().number(1, static_cast<std::int64_t>(numbers.size())).number(2, 7).text(8, name).text(9, raw));
    return *this;
  }
  TinyOnnx& weights(const std::string& name, const std::vector<std::int64_t>& shape,
                    const std::vector<float>& numbers) {
    return tensor(name, shape, Proto().text(9, raw(numbers)));
  }
  /// Keeps them in another file: `place` has its location, and may have offset and length.
  TinyOnnx& outside_weights(const std::string& name, const std::vector<std::int64_t>& shape,
                            const std::vector<std::pair<std::string, std::string>>& place) {
    Proto outside;
    for (const auto& [key, value] : place) outside.message(13, Proto().text(1, key).text(2, value));
    return tensor(name, shape, outside.number(14, 1));
  }
  static std::string raw(const std::vector<float>& numbers) {
    return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(float)};
  }
  TinyOnnx& opset(std::int64_t version) { return opset_ = version, *this; }
  TinyOnnx& producer(const std::string& name) { return producer_ = name, *this; }
  /// `others`: names of its weights, after the output of the node before unless "@" says where that stands.
  TinyOnnx& node(const std::string& type, const std::string& name, const std::vector<std::string>& others = {},
                 const std::vector<std::pair<std::string, std::vector<std::int64_t>>>& lists = {},
                 const std::vector<std::pair<std::string, std::int64_t>>& numbers = {},
                 const std::vector<std::pair<std::string, std::string>>& words = {},
                 const std::vector<std::pair<std::string, float>>& reals = {}) {
    Proto node;
    if (std::find(others.begin(), others.end(), "@") == others.end()) node.text(1, last_);
    for (const std::string& other : others) node.text(1, other == "@" ? last_ : other);
    last_ = name + "_out";
    node.text(2, last_).text(3, name).text(4, type);
    for (const auto& [key, list] : lists) {
      Proto attribute;
      attribute.text(1, key).number(20, 7);
      for (const std::int64_t one : list) attribute.number(8, one);
      node.message(5, attribute);
    }
    for (const auto& [key, number] : numbers) node.message(5, Proto().text(1, key).number(20, 2).number(3, number));
    for (const auto& [key, word] : words) node.message(5, Proto().text(1, key).number(20, 3).text(4, word));
    for (const auto& [key, real] : reals) node.message(5, Proto().text(1, key).number(20, 1).real(2, real));
    graph_.message(1, node);
    return *this;
  }
  std::string bytes() const {
    Proto graph = graph_;
    graph.text(2, "tiny").message(12, value(last_, {0}));
    return Proto()
        .number(1, 6)
        .text(2, producer_)
        .message(7, graph)
        .message(8, Proto().text(1, "").number(2, opset_))
        .bytes();
  }
  std::string save(const std::string& path) const {
    std::ofstream(path, std::ios::binary) << bytes();
    return path;
  }

 private:
  TinyOnnx& tensor(const std::string& name, const std::vector<std::int64_t>& shape, Proto numbers) {
    for (const std::int64_t side : shape) numbers.number(1, side);
    graph_.message(5, numbers.number(2, 1).text(8, name));
    return *this;
  }

  static Proto value(const std::string& name, const std::vector<std::int64_t>& shape) {
    Proto sides;
    for (const std::int64_t side : shape) {
      Proto dimension;
      if (side > 0)
        dimension.number(1, side);
      else
        dimension.text(2, "open");
      sides.message(1, dimension);
    }
    Proto tensor;
    tensor.number(1, 1);
    tensor.message(2, sides);
    return Proto().text(1, name).message(2, Proto().message(1, tensor));
  }

  Proto graph_;
  std::string last_, producer_ = "citylearn";
  std::int64_t opset_ = 11;
};

/// 3 x 3 convolution to `maps` maps ("conv"), ReLU ("relu") and global average ("pool"), with weights of no meaning.
inline TinyOnnx tiny_convolution(const std::vector<std::int64_t>& shape, int maps,
                                 std::vector<float>* kernel = nullptr) {
  std::vector<float> numbers(static_cast<std::size_t>(maps) * 27);
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<float>((i * 7919) % 101) / 101.0f - 0.5f;
  if (kernel) *kernel = numbers;
  return TinyOnnx()
      .input(shape)
      .weights("kernel", {maps, 3, 3, 3}, numbers)
      .node("Conv", "conv", {"kernel"}, {{"kernel_shape", {3, 3}}, {"pads", {1, 1, 1, 1}}, {"strides", {1, 1}}})
      .node("Relu", "relu")
      .node("GlobalAveragePool", "pool");
}

}  // namespace citylearn::testing
