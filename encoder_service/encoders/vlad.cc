// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/util/random.h"
#include "encoder_service/encoding/byte_stream.h"
#include "encoder_service/encoding/dense_sift.h"
#include "encoder_service/encoding/kmeans.h"
#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {
namespace {

constexpr int kLocal = 128;                  // numbers of a local descriptor
constexpr int kTrainingPictures = 256;       // pictures to learn the words from
constexpr int kDescriptorsPerPicture = 128;  // local descriptors of each
constexpr std::uint64_t kSeed = 1;           // of the words
const std::string kFormat = "citylearn vlad 1";

/// Encodes pictures as vectors of locally aggregated descriptors (Jegou et al., CVPR 2010). Each visual word has the
/// sum of the differences to the local descriptors nearest to it, scaled to length 1 (intra-normalised: Arandjelovic &
/// Zisserman, CVPR 2013). With a spatial grid each of its cells has sums of its own.
class Vlad final : public PictureEncoder {
 public:
  Vlad(const std::string& name, const Parameters& parameters, int across, int down)
      : name_(encoder_name(name + "-1", parameters)),
        words_(parameters.integer("words")),
        side_(parameters.integer("size")),
        local_{.step = parameters.integer("step"), .bin = parameters.integer("bin")},
        across_(across),
        down_(down) {}

  Spec spec() const override { return {name_ + " learned=" + learned_, across_ * down_ * words_ * kLocal, batch()}; }

  int training_sample_count() const override { return kTrainingPictures; }

  void learn(std::span<const cv::Mat> pictures) override {
    if (pictures.empty()) throw Error("no pictures to learn from", name_);
    try {
      Eigen::MatrixXf sample(kLocal, static_cast<Eigen::Index>(pictures.size()) * kDescriptorsPerPicture);
      std::vector<Eigen::Index> chosen;  // of each picture's local descriptors
      Random random{kSeed};
      for (const cv::Mat& picture : pictures) {
        check_picture(picture);
        const int found = dense_sift_count(scaled_size(picture), local_);
        for (int i = 0; i < kDescriptorsPerPicture; ++i)
          chosen.push_back(static_cast<Eigen::Index>(random.below(static_cast<std::uint64_t>(found))));
      }
      for_each_on_threads(static_cast<int>(pictures.size()), [&](int picture) {
        const Eigen::MatrixXf found = local_descriptors(pictures[static_cast<std::size_t>(picture)]).values;
        for (Eigen::Index i = picture * kDescriptorsPerPicture; i < (picture + 1) * kDescriptorsPerPicture; ++i)
          sample.col(i) = found.col(chosen[static_cast<std::size_t>(i)]);
      });
      vocabulary_ = kmeans(sample, words_, 25, kSeed);
    } catch (const cv::Exception& exception) {
      throw Error("OpenCV: " + exception.err, name_);
    }
    name_state();
  }

  Bytes state() const override {
    if (vocabulary_.size() == 0) return {};
    ByteWriter out;
    out.put_text(kFormat);
    out.put_text(name_);
    out.put(vocabulary_.data(), static_cast<std::size_t>(vocabulary_.size()));
    return out.finish();
  }

  void restore(std::span<const std::byte> state) override {
    ByteReader in(state, "vocabulary", name_);
    if (in.get_text() != kFormat) throw Error("not a vocabulary, or one of another version", name_, "learn it again");
    const std::string name = in.get_text();
    if (name != name_) throw Error("a vocabulary of '" + name + "'", name_, "learn one with these parameters");
    Eigen::MatrixXf vocabulary(kLocal, words_);
    if (in.left() != static_cast<std::size_t>(vocabulary.size()) * sizeof(float)) in.fail();
    in.get(vocabulary.data(), static_cast<std::size_t>(vocabulary.size()));
    if (!vocabulary.allFinite()) in.fail();
    vocabulary_ = std::move(vocabulary);
    name_state();
  }

 private:
  /// The words change the numbers, so they belong into the name.
  void name_state() {
    const auto* first = reinterpret_cast<const std::byte*>(vocabulary_.data());
    learned_ = fmt::format("{:08x}", checksum({first, static_cast<std::size_t>(vocabulary_.size()) * sizeof(float)}));
  }

  /// The longer side is brought to one length, so that a bin sees the same part of pictures of any size.
  cv::Size scaled_size(const cv::Mat& picture) const {
    const double scale = static_cast<double>(side_) / std::max(picture.cols, picture.rows);
    const int least = 4 * local_.bin;
    return {std::max(least, static_cast<int>(std::lround(picture.cols * scale))),
            std::max(least, static_cast<int>(std::lround(picture.rows * scale)))};
  }

  LocalDescriptors local_descriptors(const cv::Mat& picture) const {
    const cv::Size size = scaled_size(picture);
    return dense_root_sift(scaled_grey(picture, size.width, size.height), local_);
  }

  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) const override {
    if (vocabulary_.size() == 0) throw Error("has not learned its words yet", name_, "learn() or restore() first");
    const cv::Size size = scaled_size(picture);
    const LocalDescriptors local = local_descriptors(picture);
    const std::vector<int> word = nearest(local.values, vocabulary_);
    using Locals = Eigen::Matrix<float, kLocal, Eigen::Dynamic>;
    Eigen::Map<Locals> sums(descriptor.data(), kLocal, static_cast<Eigen::Index>(across_) * down_ * words_);
    const Eigen::Map<const Locals> values(local.values.data(), kLocal, local.values.cols()),
        words(vocabulary_.data(), kLocal, words_);
    for (std::size_t i = 0; i < word.size(); ++i) {
      const cv::Point2f centre = local.centres[i];
      const int column = std::min(across_ - 1, static_cast<int>(centre.x * static_cast<float>(across_)) / size.width);
      const int row = std::min(down_ - 1, static_cast<int>(centre.y * static_cast<float>(down_)) / size.height);
      sums.col((row * across_ + column) * words_ + word[i]) +=
          values.col(static_cast<Eigen::Index>(i)) - words.col(word[i]);
    }
    for (auto sum : sums.colwise()) {
      const float length = sum.norm();
      if (length > 1e-6f) sum /= length;
    }
    const float length = descriptor.norm();
    if (length > 0) descriptor /= length;
  }

  std::string name_, learned_ = "nothing";
  int words_, side_;
  DenseSiftOptions local_;
  int across_, down_;           // cells of the spatial grid
  Eigen::MatrixXf vocabulary_;  // kLocal x words
};

std::vector<ParameterSpec> parameters(double words) {
  return {{"words", "visual words", words, 1, 4096, true},
          {"size", "longer side of the scaled picture, pixels", 160, 16, 2048, true},
          {"step", "pixels between local descriptors", 4, 1, 64, true},
          {"bin", "pixels of a bin of a local descriptor, which has 4 x 4", 8, 2, 64, true}};
}

const EncoderRegistry::Registration vlad_registration({
    .name = "vlad",
    .help = "dense RootSIFT in VLAD: for changes of viewpoint; learns its words on the reference",
    .parameters = parameters(64),
    .create = [](const Parameters& values, const EncoderFiles&) -> std::unique_ptr<Encoder> {
      return std::make_unique<Vlad>("vlad", values, 1, 1);
    },
});

const EncoderRegistry::Registration vlad_spatial_registration({
    .name = "vlad_spatial",
    .help = "vlad in each of 4 x 2 parts of the picture: between vlad and hog",
    .parameters = parameters(16),
    .create = [](const Parameters& values, const EncoderFiles&) -> std::unique_ptr<Encoder> {
      return std::make_unique<Vlad>("vlad_spatial", values, 4, 2);
    },
});

}  // namespace
}  // namespace citylearn
