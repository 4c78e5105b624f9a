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
namespace {

constexpr int kBatchesOfBlock = 16;

}  // namespace

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

int encode_blocks(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store,
                  const std::function<void(int first, const Eigen::MatrixXf& block)>& use) {
  const Encoder::Spec spec = encoder.spec();
  std::optional<FeatureStore> kept;
  if (!store.empty())
    kept.emplace(store, FeatureStore::Key{spec.name, spec.dimension, traversal.hash(), traversal.frames});
  Progress progress(label + " " + traversal.name, traversal.frames);
  const int batch = std::max(1, spec.batch), size = kBatchesOfBlock * batch;
  int encoded = 0;
  Eigen::MatrixXf block;
  std::vector<cv::Mat> pictures;
  for (int first = 0; first < traversal.frames; first += size) {
    block.resize(spec.dimension, std::min(size, traversal.frames - first));
    const auto column = [&](int frame) {
      return std::span<float>(block.col(frame - first).data(), static_cast<std::size_t>(spec.dimension));
    };
    std::vector<int> missing;
    for (int frame = first; frame < first + block.cols(); ++frame)
      if (!kept || !kept->read(frame, column(frame))) missing.push_back(frame);
    progress.done(static_cast<int>(block.cols()) - static_cast<int>(missing.size()));
    encoded += static_cast<int>(missing.size());
    for (auto from = missing.begin(); from != missing.end();) {
      const auto to = from + std::min<std::ptrdiff_t>(batch, missing.end() - from);
      pictures.clear();
      for (auto frame = from; frame != to; ++frame) pictures.push_back(read_picture(traversal, *frame));
      const Eigen::MatrixXf columns = encoder.encode(pictures);
      for (Eigen::Index i = 0; from != to; ++from, ++i) {
        block.col(*from - first) = columns.col(i);
        if (kept) kept->write(*from, column(*from));
      }
      progress.done(static_cast<int>(columns.cols()));
    }
    use(first, block);
  }
  return encoded;
}

Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store) {
  const Clock::time_point start = Clock::now();
  Descriptors result;
  result.matrix.resize(encoder.spec().dimension, traversal.frames);
  result.encoded = encode_blocks(encoder, traversal, label, store, [&](int first, const Eigen::MatrixXf& block) {
    result.matrix.middleCols(first, block.cols()) = block;
  });
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
