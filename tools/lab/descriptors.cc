// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/descriptors.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <vector>

#include "core/wire/service.h"
#include "encoder_service/pipeline/feature_store.h"

namespace citylearn::lab {

cv::Mat read_picture(const Traversal& traversal, int frame) {
  if (stop_requested()) throw Stopped{};
  Bytes bytes;
  traversal.images->read(frame, bytes);
  return decode_picture(bytes, traversal.images->name(frame));
}

void fit_encoder(Encoder& encoder, const Traversal& reference) {
  const std::vector<int> frames = training_frames(encoder.training_sample_count(), reference.frames);
  if (frames.empty()) return;
  Progress progress("learning from " + reference.name, static_cast<int>(frames.size()));
  std::vector<cv::Mat> pictures;
  for (const int frame : frames) {
    pictures.push_back(read_picture(reference, frame));
    progress.done(1);
  }
  encoder.learn(pictures);
}

Encoding::Encoding(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store)
    : encoder_(encoder),
      traversal_(traversal),
      dimension_(encoder.spec().dimension),
      progress_(label + " " + traversal.name, traversal.frames) {
  if (!store.empty())
    store_ = std::make_unique<FeatureStore>(
        store, FeatureStore::Key{encoder.spec().name, dimension_, traversal.hash(), traversal.frames});
}
Encoding::~Encoding() = default;

void Encoding::read(Eigen::Index first, Eigen::Ref<Eigen::MatrixXf> descriptors) {
  const auto column = [&](int frame) {
    return std::span<float>(descriptors.col(frame - first).data(), static_cast<std::size_t>(dimension_));
  };
  std::vector<int> missing;
  for (int frame = static_cast<int>(first); frame < first + descriptors.cols(); ++frame)
    if (!store_ || !store_->read(frame, column(frame))) missing.push_back(frame);
  progress_.done(static_cast<int>(descriptors.cols()) - static_cast<int>(missing.size()));
  const std::ptrdiff_t batch = std::max(1, encoder_.spec().batch);
  std::vector<cv::Mat> pictures;
  for (auto from = missing.begin(); from != missing.end();) {
    const auto to = from + std::min(batch, missing.end() - from);
    pictures.clear();
    for (auto frame = from; frame != to; ++frame) pictures.push_back(read_picture(traversal_, *frame));
    const Eigen::MatrixXf columns = encoder_.encode(pictures);
    for (Eigen::Index i = 0; from != to; ++from, ++i) {
      descriptors.col(*from - first) = columns.col(i);
      if (store_) store_->write(*from, column(*from));
    }
    encoded_ += static_cast<int>(columns.cols());
    progress_.done(static_cast<int>(columns.cols()));
  }
}

Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store) {
  const Clock::time_point start = Clock::now();
  Encoding encoding(encoder, traversal, label, store);
  Descriptors result;
  result.matrix.resize(encoder.spec().dimension, traversal.frames);
  encoding.read(0, result.matrix);
  result.encoded = encoding.encoded();
  result.seconds = seconds_since(start);
  return result;
}

Traversal with_features(Traversal traversal, const Eigen::MatrixXf& features) {
  traversal.images.reset();
  traversal.frames = static_cast<int>(features.cols());
  traversal.positions.resize(static_cast<std::size_t>(traversal.frames));
  traversal.dimension = static_cast<int>(features.rows());
  traversal.features.assign(features.data(), features.data() + features.size());
  return traversal;
}

Descriptors features_of(const Traversal& traversal) {
  Descriptors result;
  result.matrix = Eigen::MatrixXf::Map(traversal.features.data(), traversal.dimension, traversal.frames);
  return result;
}

}  // namespace citylearn::lab
