// SPDX-License-Identifier: Apache-2.0
// NetvladHead as a safetensors file.
#include <algorithm>
#include <string>
#include <vector>

#include "core/files/safetensors.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "encoder_service/encoding/netvlad_head.h"

namespace citylearn {
namespace {

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::uint64_t kMaxSide = 1 << 20;
const char* const kCentroids = "centroids";
const char* const kWeight = "conv.weight";
const char* const kBias = "conv.bias";
const char* const kProjection = "wpca.weight";
const char* const kOffset = "wpca.bias";
const std::vector<std::string> kTensors = {kCentroids, kWeight, kBias, kProjection, kOffset};  // in the file's order

std::string side_text(Eigen::Index side) { return side ? std::to_string(side) : "any"; }

/// The file's tensors as matrices.
class Reader {
 public:
  Reader(std::span<const std::byte> bytes, const std::string& where)
      : where_(where), file_(Safetensors::parse({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, where)) {
    for (const auto& [name, tensor] : file_.tensors)
      if (std::find(kTensors.begin(), kTensors.end(), name) == kTensors.end())
        throw Error("unknown tensor '" + name + "'", where, "known: " + joined(kTensors));
  }

  bool has(const std::string& name) const { return file_.tensors.contains(name); }
  /// Returns a tensor of rows x columns; 0 stands for any.
  RowMajor matrix(const std::string& name, Eigen::Index rows, Eigen::Index columns) const {
    const auto found = file_.tensors.find(name);
    if (found == file_.tensors.end()) throw Error("has no tensor '" + name + "'", where_);
    const auto fail = [&](const std::string& what) { throw Error("tensor '" + name + "' " + what, where_); };
    std::vector<std::uint64_t> shape = found->second.shape;
    for (const std::uint64_t side : shape)
      if (side < 1 || side > kMaxSide) fail("has a side of " + std::to_string(side));
    while (shape.size() > 2 && shape.back() == 1) shape.pop_back();  // a 1 x 1 convolution
    if (shape.empty() || shape.size() > 2) fail("is neither a vector nor a matrix");
    const auto height = static_cast<Eigen::Index>(shape[0]);
    const auto width = static_cast<Eigen::Index>(shape.size() == 2 ? shape[1] : 1);
    if ((rows && rows != height) || (columns && columns != width))
      fail("is " + side_text(height) + " x " + side_text(width) + ", it has to be " + side_text(rows) + " x " +
           side_text(columns));
    const Eigen::Map<const RowMajor> numbers(found->second.numbers.data(), height, width);
    if (!numbers.allFinite()) fail("has numbers that are not finite");
    return numbers;
  }

 private:
  const std::string& where_;
  const Safetensors file_;
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
  Safetensors file;
  const auto add = [&file](const char* name, const std::vector<Eigen::Index>& shape, const RowMajor& numbers) {
    file.tensors[name] = {{shape.begin(), shape.end()}, {numbers.data(), numbers.data() + numbers.size()}};
  };
  add(kCentroids, {centroids.cols(), centroids.rows()}, centroids.transpose());
  add(kWeight, {weight.cols(), weight.rows()}, weight.transpose());
  add(kBias, {bias.size()}, bias);
  if (projection.size() > 0) {
    add(kProjection, {projection.rows(), projection.cols()}, projection);
    add(kOffset, {offset.size()}, offset);
  }
  const std::string text = file.bytes(kTensors);
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

}  // namespace citylearn
