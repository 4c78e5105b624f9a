// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/descriptors.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "core/command_line/progress.h"
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

Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store) {
  const Clock::time_point start = Clock::now();
  const Encoder::Spec spec = encoder.spec();
  Descriptors result;
  result.matrix.resize(spec.dimension, traversal.frames);
  std::optional<FeatureStore> kept;
  if (!store.empty())
    kept.emplace(store, FeatureStore::Key{spec.name, spec.dimension, traversal.hash(), traversal.frames});
  const auto column = [&](int frame) {
    return std::span<float>(result.matrix.col(frame).data(), static_cast<std::size_t>(spec.dimension));
  };
  std::vector<int> missing;
  for (int frame = 0; frame < traversal.frames; ++frame)
    if (!kept || !kept->read(frame, column(frame))) missing.push_back(frame);

  Progress progress(label + " " + traversal.name, static_cast<int>(missing.size()));
  const std::size_t batch = static_cast<std::size_t>(std::max(1, spec.batch));
  std::vector<cv::Mat> pictures;
  for (std::size_t first = 0; first < missing.size(); first += batch) {
    const std::size_t size = std::min(batch, missing.size() - first);
    pictures.clear();
    for (std::size_t i = 0; i < size; ++i) pictures.push_back(read_picture(traversal, missing[first + i]));
    const Eigen::MatrixXf columns = encoder.encode(pictures);
    for (std::size_t i = 0; i < size; ++i) {
      const int frame = missing[first + i];
      result.matrix.col(frame) = columns.col(static_cast<Eigen::Index>(i));
      if (kept) kept->write(frame, column(frame));
    }
    progress.done(static_cast<int>(size));
  }
  result.encoded = static_cast<int>(missing.size());
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
