// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <optional>

#include "encoder_service/encoding/gradients.h"
#include "encoder_service/encoding/picture_encoder.h"
#include "encoder_service/encoding/sliding_normalisation.h"

namespace citylearn {
namespace {

constexpr int kCell = 8;        // pixels
constexpr double kSigma = 8.5;  // pixels, of the sliding normalisation
constexpr float kClip = 0.2f;   // of a normalised block

/// Weights of a cell's pixels along one axis in the blocks that have the cell: for the first and second cell of the
/// block that begins one cell earlier, then for the first and second cell of the block that begins here.
using CellWeights = Eigen::Matrix<float, 4, kCell>;

/// Linear interpolation between the cells' middles times a Gaussian about the block's middle, sigma half a cell (Dalal
/// & Triggs, CVPR 2005, 6.3 and 6.4). In two dimensions the weight is the product of both axes.
CellWeights cell_weights() {
  CellWeights weights;
  for (int pixel = 0; pixel < 2 * kCell; ++pixel) {  // of a block
    const double middle = pixel + 0.5;
    const double gaussian = std::exp(-0.5 * std::pow((middle - kCell) / (kCell / 2.0), 2));
    for (int cell = 0; cell < 2; ++cell) {
      const double distance = std::abs(middle - kCell * (cell + 0.5)) / kCell;
      weights(pixel < kCell ? 2 + cell : cell, pixel % kCell) =
          static_cast<float>(gaussian * std::max(0.0, 1 - distance));
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
        across_(parameters.integer("cells-across")),
        down_(parameters.integer("cells-down")),
        // The middles of the bins are at 0.5, 1.5, ...
        orientations_{
            .bins = bins_, .scale = static_cast<float>(bins_ / CV_PI), .offset = static_cast<float>(bins_) - 0.5f} {
    if (parameters.flag("contrast")) contrast_.emplace(cv::Size(across_ * kCell, down_ * kCell), kSigma);
  }

  Spec spec() const override { return {name_, blocks() * 4 * bins_ * (contrast_ ? 2 : 1), batch()}; }

 private:
  int blocks() const { return (across_ - 1) * (down_ - 1); }

  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) const override {
    const cv::Mat grey = scaled_grey(picture, across_ * kCell, down_ * kCell);
    const Eigen::Index part = static_cast<Eigen::Index>(blocks()) * 4 * bins_;
    cv::Mat root;
    cv::sqrt(grey, root);  // compresses bright edges, as the paper's square root gamma
    // The constants keep blocks without texture from becoming all noise; in units of the gradients of each copy.
    histograms(root, 0.1f * 4 * static_cast<float>(bins_), descriptor.head(part));
    if (contrast_) histograms(contrast_->apply(grey), kContrastFloor, descriptor.tail(part));
  }

  static constexpr float kContrastFloor = 1.0f;

  /// Weighs pixels across, then down. Both are products of matrices, whose rows are long for the processor's sake.
  void histograms(const cv::Mat& image, float floor, Eigen::Ref<Eigen::VectorXf> out) const {
    const Gradients gradients = gradients_of(image);
    const Eigen::Index numbers = static_cast<Eigen::Index>(across_) * bins_;  // of a row of cells
    RowMajorXf pixels(kCell, numbers);                                        // by place in the cell
    RowMajorXf rows(kCell, 4 * numbers), cells(4, 4 * numbers);               // by row of the cell, by weight down
    for (int cell_row = 0; cell_row < down_; ++cell_row) {
      for (int y = 0; y < kCell; ++y) {
        const float* magnitude = gradients.magnitude.ptr<float>(cell_row * kCell + y);
        const float* angle = gradients.angle.ptr<float>(cell_row * kCell + y);
        pixels.setZero();
        for (int cell = 0; cell < across_; ++cell)
          for (int x = 0; x < kCell; ++x)
            orientations_.put(*magnitude++, *angle++, pixels.row(x).data() + cell * bins_);
        Eigen::Map<Eigen::Matrix<float, 4, Eigen::Dynamic, Eigen::RowMajor>>(rows.row(y).data(), 4, numbers) =
            weights_.lazyProduct(pixels);
      }
      cells = weights_.lazyProduct(rows);
      for (int vertical = 0; vertical < 4; ++vertical)
        if (const int block_row = cell_row - 1 + vertical / 2; block_row >= 0 && block_row < down_ - 1)
          for (int horizontal = 0; horizontal < 4; ++horizontal)
            add_cells(cells.row(vertical).segment(horizontal * numbers, numbers).data(), horizontal / 2,
                      out.data() + static_cast<std::ptrdiff_t>(block_row) * (across_ - 1) * 4 * bins_ +
                          (vertical % 2 * 2 + horizontal % 2) * bins_);
    }
    for (int block = 0; block < blocks(); ++block) {
      auto values = out.segment(static_cast<Eigen::Index>(block) * 4 * bins_, 4 * bins_);
      values /= values.norm() + floor;
      values = values.cwiseMin(kClip);
      values /= values.norm() + 1e-3f;
    }
  }

  /// Adds a row of cells' histograms to those of blocks. `begins`: 1: they are of blocks that begin in the cell; 0: a
  /// cell earlier. `to`: the cell's histogram in the row's first block.
  void add_cells(const float* cells, int begins, float* to) const {
    const float* from = cells + (1 - begins) * bins_;
    for (int block = 0; block < across_ - 1; ++block, from += bins_, to += 4 * bins_)
      for (int bin = 0; bin < bins_; ++bin) to[bin] += from[bin];
  }

  std::string name_;
  int bins_;
  int across_, down_;  // cells
  const CellWeights weights_ = cell_weights();
  OrientationBins orientations_;
  std::optional<SlidingNormalisation> contrast_;  // of the copy with normalised contrast
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
