// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/area_means.h"

#include <algorithm>
#include <vector>

namespace citylearn {
namespace {

constexpr double kSliver = 1e-3;  // of a pixel; less is rounding, as cv::resize has it

/// Along one axis: what each pixel takes from which pixels of the original.
struct AreaShares {
  AreaShares(int original, int scaled) {
    const double width = static_cast<double>(original) / scaled;
    for (int i = 0; i < scaled; ++i) {
      const double from = i * width, to = std::min<double>(original, from + width);
      first.push_back(static_cast<int>(from + kSliver));
      begin.push_back(static_cast<int>(shares.size()));
      for (int pixel = first.back(); pixel < to - kSliver; ++pixel)
        shares.push_back(static_cast<float>((std::min(to, pixel + 1.) - std::max<double>(from, pixel)) / width));
    }
    begin.push_back(static_cast<int>(shares.size()));
  }

  std::vector<float> shares;  ///< of all pixels, one after another
  std::vector<int> begin;     ///< of each pixel's, and their number
  std::vector<int> first;     ///< pixel of the original
};

}  // namespace

cv::Mat area_means(const cv::Mat& grey, cv::Size size) {
  CV_Assert(grey.type() == CV_8U && size.width <= grey.cols && size.height <= grey.rows && !size.empty());
  const AreaShares across(grey.cols, size.width), down(grey.rows, size.height);
  cv::Mat result(size, CV_32F);
  std::vector<float> row(static_cast<std::size_t>(grey.cols));
  for (std::size_t y = 0; y < down.first.size(); ++y) {
    std::fill(row.begin(), row.end(), 0.f);
    for (int i = down.begin[y]; i < down.begin[y + 1]; ++i) {
      const float share = down.shares[static_cast<std::size_t>(i)];
      const uchar* pixels = grey.ptr(down.first[y] + i - down.begin[y]);
      for (std::size_t x = 0; x < row.size(); ++x) row[x] += share * static_cast<float>(pixels[x]);
    }
    float* to = result.ptr<float>(static_cast<int>(y));
    for (std::size_t x = 0; x < across.first.size(); ++x) {
      const float* from = row.data() + across.first[x];
      float sum = 0;
      for (int i = across.begin[x]; i < across.begin[x + 1]; ++i)
        sum += across.shares[static_cast<std::size_t>(i)] * *from++;
      to[x] = sum;
    }
  }
  return result;
}

}  // namespace citylearn
