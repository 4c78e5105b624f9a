// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {
namespace {

constexpr int kCell = 8;           // pixels
constexpr int kBlock = 2 * kCell;  // 2 x 2 cells
constexpr double kSigma = 8.5;     // pixels, of the sliding normalisation
constexpr float kClip = 0.2f;      // of a normalised block

/// How much a pixel of a block counts for the block's first and second cell along one axis: linear interpolation
/// between the cells' middles times a Gaussian about the block's middle, sigma half a cell (Dalal & Triggs, CVPR 2005,
/// 6.3 and 6.4). In two dimensions the weight is the product of both axes.
std::array<std::array<float, 2>, kBlock> block_weights() {
  std::array<std::array<float, 2>, kBlock> weights{};
  for (int pixel = 0; pixel < kBlock; ++pixel) {
    const double middle = pixel + 0.5;
    const double gaussian = std::exp(-0.5 * std::pow((middle - kCell) / (kCell / 2.0), 2));
    for (int cell = 0; cell < 2; ++cell) {
      const double distance = std::abs(middle - kCell * (cell + 0.5)) / kCell;
      weights[pixel][cell] = static_cast<float>(gaussian * std::max(0.0, 1 - distance));
    }
  }
  return weights;
}

/// Histograms of oriented gradients (Dalal & Triggs, CVPR 2005): cells of 8 x 8 pixels, unsigned orientations, blocks
/// of 2 x 2 cells a cell apart, each clipped at 0.2 and of length 1.
class Hog final : public PictureEncoder {
 public:
  explicit Hog(const Parameters& parameters)
      : name_(encoder_name("hog-1", parameters)),
        bins_(parameters.integer("bins")),
        contrast_(parameters.flag("contrast")),
        across_(parameters.integer("cells-across")),
        down_(parameters.integer("cells-down")) {
    row_.resize(static_cast<std::size_t>(across_ - 1) * 2 * bins_);
  }

  Spec spec() const override { return {name_, blocks() * 4 * bins_ * (contrast_ ? 2 : 1), 16}; }

 private:
  int blocks() const { return (across_ - 1) * (down_ - 1); }

  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) override {
    const cv::Mat grey = scaled_grey(picture, across_ * kCell, down_ * kCell);
    const Eigen::Index part = static_cast<Eigen::Index>(blocks()) * 4 * bins_;
    cv::Mat root;
    cv::sqrt(grey, root);  // compresses bright edges, as the paper's square root gamma
    // The constants keep blocks without texture from becoming all noise; in units of the gradients of each copy.
    histograms(root, 0.1f * 4 * static_cast<float>(bins_), descriptor.head(part));
    if (contrast_) histograms(sliding_normalised(grey, kSigma), kContrastFloor, descriptor.tail(part));
  }

  static constexpr float kContrastFloor = 1.0f;

  void histograms(const cv::Mat& image, float floor, Eigen::Ref<Eigen::VectorXf> out) {
    gradients(image);
    // Sums over a row's pixels first, then over rows: the weights are products of one factor for each axis.
    const int width = 2 * bins_;  // numbers of a block in a row: two cells
    const int stride = 2 * width;
    for (int y = 0; y < image.rows; ++y) {
      sum_row(y);
      for (int block = std::max(0, y / kCell - 1); block <= std::min(down_ - 2, y / kCell); ++block) {
        const auto& weights = weights_[y - block * kCell];
        for (int cell = 0; cell < 2; ++cell) {
          if (weights[cell] == 0) continue;
          float* to = out.data() + static_cast<std::ptrdiff_t>(block) * (across_ - 1) * stride + cell * width;
          const float* from = row_.data();
          for (int x = 0; x < across_ - 1; ++x, to += stride, from += width)
            for (int i = 0; i < width; ++i) to[i] += weights[cell] * from[i];
        }
      }
    }
    for (int block = 0; block < blocks(); ++block) {
      auto values = out.segment(static_cast<Eigen::Index>(block) * stride, stride);
      values /= values.norm() + floor;
      values = values.cwiseMin(kClip);
      values /= values.norm() + 1e-3f;
    }
  }

  /// Magnitude and orientation in bins, of central differences with repeated borders.
  void gradients(const cv::Mat& image) {
    dx_.create(image.size(), CV_32F);
    dy_.create(image.size(), CV_32F);
    const int last = image.cols - 1;
    for (int y = 0; y < image.rows; ++y) {
      const float* row = image.ptr<float>(y);
      const float* above = image.ptr<float>(std::max(y - 1, 0));
      const float* below = image.ptr<float>(std::min(y + 1, image.rows - 1));
      float* dx = dx_.ptr<float>(y);
      float* dy = dy_.ptr<float>(y);
      for (int x = 1; x < last; ++x) dx[x] = row[x + 1] - row[x - 1];
      dx[0] = row[1] - row[0];
      dx[last] = row[last] - row[last - 1];
      for (int x = 0; x <= last; ++x) dy[x] = below[x] - above[x];
    }
    cv::cartToPolar(dx_, dy_, magnitude_, orientation_);
    orientation_ *= bins_ / CV_PI;
  }

  void sum_row(int y) {
    std::fill(row_.begin(), row_.end(), 0.f);
    const float* magnitude = magnitude_.ptr<float>(y);
    const float* orientation = orientation_.ptr<float>(y);
    for (int x = 0; x < magnitude_.cols; ++x) {
      // Shared between the two nearest bins, whose middles are at 0.5, 1.5, ...
      const float position = orientation[x] + static_cast<float>(bins_) - 0.5f;
      const int lower = static_cast<int>(position);
      const float share = magnitude[x] * (position - static_cast<float>(lower));
      const int first = lower % bins_, second = first + 1 == bins_ ? 0 : first + 1;
      for (int block = std::max(0, x / kCell - 1); block <= std::min(across_ - 2, x / kCell); ++block) {
        const auto& weights = weights_[x - block * kCell];
        float* cells = row_.data() + static_cast<std::ptrdiff_t>(block) * 2 * bins_;
        for (int cell = 0; cell < 2; ++cell, cells += bins_) {
          cells[first] += weights[cell] * (magnitude[x] - share);
          cells[second] += weights[cell] * share;
        }
      }
    }
  }

  std::string name_;
  int bins_;
  bool contrast_;
  int across_, down_;  // cells
  const std::array<std::array<float, 2>, kBlock> weights_ = block_weights();
  cv::Mat dx_, dy_, magnitude_, orientation_;
  std::vector<float> row_;
};

const EncoderRegistry::Registration hog_registration({
    .name = "hog",
    .help = "histograms of oriented gradients: for changes of season, weather and light on the same track",
    .parameters = {{"bins", "orientations between 0 and 180 degrees", 12, 2, 36, true},
                   {"contrast", "1: adds histograms of a copy with normalised local contrast", 1, 0, 1, true},
                   {"cells-across", "cells of 8 pixels across the scaled picture", 16, 2, 128, true},
                   {"cells-down", "cells of 8 pixels down the scaled picture", 8, 2, 128, true}},
    .create = make_encoder<Hog>,
});

}  // namespace
}  // namespace citylearn
