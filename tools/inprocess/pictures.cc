// SPDX-License-Identifier: Apache-2.0
#include "tools/inprocess/pictures.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <vector>

#include "core/util/error.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {

struct Pictures::Parts {
  std::unique_ptr<Encoder> encoder;
  int first = 0, frames = 0;

  /// `count` pictures of the route from its frame `begin` on, each `step`-th.
  std::vector<cv::Mat> read(const Traversal& traversal, int begin, int step, int count) const {
    if (!traversal.images)
      throw Error("has no pictures to encode", "traversal '" + traversal.name + "'", "leave --encoder out");
    if (traversal.frames < first + frames)
      throw Error(
          "has " + std::to_string(traversal.frames) + " frames, the route ends at " + std::to_string(first + frames),
          "traversal '" + traversal.name + "'", "ask for a shorter route");
    std::vector<cv::Mat> pictures;
    Bytes bytes;
    for (int i = 0; i < count; ++i) {
      const int frame = first + begin + i * step;
      traversal.images->read(frame, bytes);
      pictures.push_back(decode_picture(bytes, traversal.images->name(frame)));
    }
    return pictures;
  }
};

Pictures::Pictures(const std::string& encoder, const Traversal& reference, int first, int frames)
    : parts_(std::make_unique<Parts>()) {
  const auto& entry = EncoderRegistry::instance().find("encoder", encoder);
  parts_->encoder = entry.create(Parameters("encoder " + encoder, entry.parameters, {}), {});
  parts_->first = first;
  parts_->frames = frames;
  const int sample = std::min(parts_->encoder->training_sample_count(), frames);
  if (sample > 0) parts_->encoder->learn(parts_->read(reference, 0, frames / sample, sample));
}

Pictures::~Pictures() = default;

Traversal Pictures::encode(const Traversal& traversal) {
  const Encoder::Spec spec = parts_->encoder->spec();
  Traversal result = traversal;
  result.images.reset();
  result.dimension = spec.dimension;
  result.frames = parts_->first + parts_->frames;
  result.features.assign(static_cast<std::size_t>(result.frames) * static_cast<std::size_t>(spec.dimension), 0.0f);
  result.positions.resize(static_cast<std::size_t>(result.frames));
  Eigen::Map<Eigen::MatrixXf> columns(result.features.data(), spec.dimension, result.frames);
  for (int begin = 0; begin < parts_->frames; begin += spec.batch) {
    const int count = std::min(spec.batch, parts_->frames - begin);
    columns.middleCols(parts_->first + begin, count) =
        parts_->encoder->encode(parts_->read(traversal, begin, 1, count));
  }
  return result;
}

}  // namespace citylearn
