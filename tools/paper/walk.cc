// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/walk.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "core/wire/messages.h"
#include "core/task/route_map.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn::paper {
namespace {

constexpr int kCandidates = 20;
// Of a sheet of strips, in pixels.
constexpr int kWide = 128, kMost = 128, kGap = 6, kText = 22, kLabel = 18;
const cv::Scalar kGround(255, 255, 255), kInk(40, 35, 31);

void write(cv::Mat& sheet, const std::string& text, int x, int baseline, double size) {
  cv::putText(sheet, text, {x, baseline}, cv::FONT_HERSHEY_SIMPLEX, size, kInk, 1, cv::LINE_AA);
}

cv::Mat thumbnail(const Traversal& traversal, int frame) {
  Bytes bytes;
  traversal.images->read(frame, bytes);
  const cv::Mat picture = decode_picture(bytes, traversal.images->name(frame));
  const double scale = std::min(double{kWide} / picture.cols, double{kMost} / picture.rows);
  const cv::Size size(std::max(1, static_cast<int>(std::lround(picture.cols * scale))),
                      std::max(1, static_cast<int>(std::lround(picture.rows * scale))));
  cv::Mat result;
  cv::resize(picture, result, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_NEAREST);
  return result;
}

}  // namespace

std::vector<int> places_walked(int start, int steps, std::span<const std::uint8_t> path, const std::vector<int>& turns,
                               int places) {
  std::vector<int> walked = {start};
  for (int step = 0; step < steps; ++step) {
    const auto at = static_cast<std::size_t>(step);
    const auto action = static_cast<std::uint8_t>(at / 4 < path.size() ? path[at / 4] >> 2 * (at % 4) & 3 : kNoAction);
    const int place = action < kActions ? place_after(walked.back(), action, turns) : -1;
    if (place < 0 || place >= places)
      throw Error("step " + std::to_string(step) + " leads off the route", "path of an episode");
    walked.push_back(place);
  }
  return walked;
}

Json walk_of(const std::vector<Environment::Episode>& episodes, int frames) {
  const auto end = episodes.begin() + std::min<std::ptrdiff_t>(kCandidates, std::ssize(episodes));
  const Environment::Episode& episode = *std::max_element(
      episodes.begin(), end, [](const auto& one, const auto& other) { return one.shortest < other.shortest; });
  // Of a long one there may be no actions, or not all.
  const int known = std::min(episode.steps, 4 * static_cast<int>(episode.path.size()));
  return {{"task", episode.task},
          {"goal", episode.goal},
          {"completed", episode.completed},
          {"frames", places_walked(episode.start, known, episode.path, {}, frames)}};
}

std::vector<int> spread(int count, int most) {
  std::vector<int> chosen;
  if (count <= most)
    for (int i = 0; i < count; ++i) chosen.push_back(i);
  else
    for (int i = 0; i < most; ++i)
      chosen.push_back(static_cast<int>(std::lround(double(i) * (count - 1) / (most - 1))));
  return chosen;
}

std::string png_of(const std::vector<Strip>& strips) {
  std::vector<std::vector<cv::Mat>> rows;
  int width = 0, height = kGap;
  for (const Strip& strip : strips) {
    std::vector<cv::Mat>& row = rows.emplace_back();
    int across = kGap, tall = 0;
    for (const int frame : strip.frames) {
      row.push_back(thumbnail(*strip.traversal, frame));
      across += kWide + kGap;
      tall = std::max(tall, row.back().rows);
    }
    width = std::max(width, across);
    height += kText + tall + kLabel + kGap;
  }
  cv::Mat sheet(height, std::max(width, 1), CV_8UC3, kGround);
  int top = kGap;
  for (std::size_t i = 0; i < strips.size(); ++i) {
    write(sheet, strips[i].text, kGap, top + 15, 0.5);
    top += kText;
    int left = kGap, tall = 0;
    for (std::size_t k = 0; k < rows[i].size(); ++k) {
      const cv::Mat& picture = rows[i][k];
      picture.copyTo(sheet(cv::Rect(left, top, picture.cols, picture.rows)));
      write(sheet, strips[i].labels[k], left, top + picture.rows + 13, 0.38);
      left += kWide + kGap;
      tall = std::max(tall, picture.rows);
    }
    top += tall + kLabel + kGap;
  }
  std::vector<unsigned char> png;
  if (!cv::imencode(".png", sheet, png)) throw Error("cannot be made", "a PNG of pictures along the way");
  return {png.begin(), png.end()};
}

}  // namespace citylearn::paper
