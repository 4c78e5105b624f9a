// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/walk.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/task/path.h"
#include "core/task/state_map.h"
#include "core/util/error.h"
#include "core/wire/messages.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn::paper {
namespace {

constexpr int kCandidates = 20;
constexpr int kSide = 128, kColumn = 134;  // pixels: longest side of a picture, and with the gap to the next

cv::Mat thumbnail(const Traversal& traversal, int frame) {
  Bytes bytes;
  traversal.images->read(frame, bytes);
  const cv::Mat picture = decode_picture(bytes, traversal.images->name(frame));
  const double scale = std::min(double{kSide} / picture.cols, double{kSide} / picture.rows);
  const cv::Size size(std::max(1, static_cast<int>(std::lround(picture.cols * scale))),
                      std::max(1, static_cast<int>(std::lround(picture.rows * scale))));
  cv::Mat result;
  cv::resize(picture, result, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_NEAREST);
  return result;
}

/// Returns the places that an episode visits, from `start` on; `path` holds its actions as in EpisodeStat. Throws Error
/// when they lead off the route.
std::vector<int> places_walked(int start, int steps, std::span<const std::uint8_t> path, int places) {
  const StateMap route(places);
  std::vector<int> walked = {start};
  for (int step = 0; step < steps; ++step) {
    const std::uint8_t action = action_at(path, static_cast<std::size_t>(step));
    const int place = action < kActions ? route.next(walked.back(), action) : -1;
    if (place < 0) throw Error("step " + std::to_string(step) + " leads off the route", "path of an episode");
    walked.push_back(place);
  }
  return walked;
}

}  // namespace

Json walk_of(const std::vector<Environment::Episode>& episodes, int frames) {
  const auto end = episodes.begin() + std::min<std::ptrdiff_t>(kCandidates, std::ssize(episodes));
  const Environment::Episode& episode = *std::max_element(
      episodes.begin(), end, [](const auto& one, const auto& other) { return one.shortest < other.shortest; });
  // Long episodes may lack some or all of their actions.
  const int known = std::min(episode.steps, 4 * static_cast<int>(episode.path.size()));
  return {{"task", episode.task},
          {"goal", episode.goal},
          {"completed", episode.completed},
          {"frames", places_walked(episode.start, known, episode.path, frames)}};
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

std::string strip_png(const Traversal& traversal, const std::vector<int>& frames) {
  std::vector<cv::Mat> pictures;
  int height = 1;
  for (const int frame : frames) {
    pictures.push_back(thumbnail(traversal, frame));
    height = std::max(height, pictures.back().rows);
  }
  cv::Mat strip(height, kColumn * std::max(1, static_cast<int>(pictures.size())), CV_8UC3, cv::Scalar(255, 255, 255));
  for (std::size_t i = 0; i < pictures.size(); ++i)
    pictures[i].copyTo(strip(cv::Rect(kColumn * static_cast<int>(i), 0, pictures[i].cols, pictures[i].rows)));
  std::vector<unsigned char> png;
  if (!cv::imencode(".png", strip, png)) throw Error("cannot be made", "a PNG of pictures along the way");
  return {png.begin(), png.end()};
}

}  // namespace citylearn::paper
