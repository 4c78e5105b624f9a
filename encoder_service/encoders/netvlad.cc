// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>

#include "core/util/random.h"
#include "encoder_service/encoding/netvlad_head.h"
#include "encoder_service/onnx/onnx_file.h"
#include "encoder_service/onnx/onnx_network.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kMaxHeadBytes = std::uint64_t{2} << 30;
/// Local features that centres are learned on, drawn evenly from the training sample.
constexpr Eigen::Index kTrainingFeatures = 50000;

using FeatureMap = Eigen::Map<const Eigen::MatrixXf>;

/// NetVLAD over the feature map of any convolutional network: D = K C numbers of length 1, or those of the head's
/// projection. Without --head the centres are learned on the reference traversal.
class Netvlad : public Encoder {
 public:
  Netvlad(const Parameters& parameters, const EncoderFiles& files)
      : network_(parameters, files),
        clusters_(parameters.integer("clusters")),
        training_sample_count_(parameters.integer("lessons")) {
    if (network_.shape().size() != 4)
      throw Error("netvlad needs a layer that gives a feature map [1,C,H,W]", network_.model(),
                  "name a convolutional one with --layer");
    if (files.head.empty()) return;
    training_sample_count_ = 0;
    take(read_model_file(files.head, kMaxHeadBytes), files.head);
  }

  Spec spec() const override {
    return {fit_name("netvlad-2 " + network_.description() + " head=" + hash_), head().dimension(),
            network_.pictures_a_call()};
  }

  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    Eigen::MatrixXf descriptors(head().dimension(), pictures.size());
    network_.forward(
        pictures, [&](std::size_t i, std::span<const float> numbers) { descriptors.col(i) = head()(map_of(numbers)); });
    return descriptors;
  }

  int training_sample_count() const override { return training_sample_count_; }

  void learn(std::span<const cv::Mat> pictures) override {
    if (training_sample_count_ == 0 || pictures.empty()) return;
    const auto& shape = network_.shape();
    const Eigen::Index positions = static_cast<Eigen::Index>(shape[2]) * shape[3];
    const Eigen::Index each = std::min(positions, kTrainingFeatures / static_cast<Eigen::Index>(pictures.size()) + 1);
    Random random({0x4C65'7373'6F6E'73});  // "Lessons"
    Eigen::MatrixXf features(shape[1], each * static_cast<Eigen::Index>(pictures.size()));
    Eigen::Index column = 0;
    std::vector<Eigen::Index> order(positions);
    network_.forward(pictures, [&](std::size_t, std::span<const float> numbers) {
      for (Eigen::Index i = 0; i < positions; ++i) order[i] = i;
      for (Eigen::Index i = 0; i < each; ++i) {  // `each` of them by chance, none twice
        std::swap(order[i], order[i + static_cast<Eigen::Index>(random.below(positions - i))]);
        features.col(column++) = map_of(numbers).row(order[i]).transpose();
      }
    });
    features.colwise().normalize();  // a zero feature stays zero
    take(NetvladHead::learn(features, clusters_).save(), "netvlad");
  }

  Bytes state() const override { return training_sample_count_ > 0 && head_ ? head_->save() : Bytes(); }

  void restore(std::span<const std::byte> state) override {
    const std::string where = "saved state of netvlad";
    if (training_sample_count_ == 0)
      throw Error("this encoder has its head from a file, nothing is to be restored", where);
    const NetvladHead saved = NetvladHead::parse(state, where);
    if (saved.clusters() != clusters_ || saved.projection.size() > 0)
      throw Error("belongs to an encoder with other parameters", where);
    take(state, where);
  }

 private:
  /// H W x C.
  FeatureMap map_of(std::span<const float> numbers) const {
    const auto& shape = network_.shape();
    return FeatureMap(numbers.data(), static_cast<Eigen::Index>(shape[2]) * shape[3], shape[1]);
  }

  const NetvladHead& head() const {
    if (!head_) throw Error("netvlad has no centres yet", "", "it has to learn or restore them first, or give --head");
    return *head_;
  }

  void take(std::span<const std::byte> bytes, const std::string& where) {
    NetvladHead head = NetvladHead::parse(bytes, where);
    if (head.channels() != network_.shape()[1])
      throw Error("is made for " + std::to_string(head.channels()) + " channels, the network's layer has " +
                      std::to_string(network_.shape()[1]),
                  where);
    head_ = std::move(head);
    hash_ = short_hash(bytes);
  }

  OnnxNetwork network_;
  int clusters_, training_sample_count_;
  std::optional<NetvladHead> head_;
  std::string hash_;
};

std::vector<ParameterSpec> netvlad_parameters() {
  std::vector<ParameterSpec> specs = network_parameters();
  specs.push_back({"clusters", "K, centres to learn (without --head)", 64, 1, 1024, true});
  specs.push_back(
      {"lessons", "pictures of the reference to learn the centres from (without --head)", 100, 1, 5000, true});
  return specs;
}

const EncoderRegistry::Registration netvlad_registration({
    "netvlad",
    "NetVLAD over a network's feature map (--model FILE.onnx, --layer); centres from --head, or learned",
    netvlad_parameters(),
    [](const Parameters& values, const EncoderFiles& files) { return std::make_unique<Netvlad>(values, files); },
    {},
    {{"presets", list_presets()}},
});

}  // namespace
}  // namespace citylearn
