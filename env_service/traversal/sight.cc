// SPDX-License-Identifier: Apache-2.0
#include "sight.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "core/util/error.h"
#include "env_service/images/picture_descriptor.h"
#include "env_service/matching/descriptor_match.h"

namespace citylearn {
namespace {

constexpr int kMaxFrames = 40000;     // of a recording; of a longer one every second is looked at, or fewer
constexpr int kMaxHole = 3;           // frames without a pair that count as having one
constexpr int kMinMargin = 64;        // frames of a sibling looked at on either side of those asked for
constexpr int kSpeedFrames = 8;       // over which speed is measured
constexpr int kFewestApart = 3;       // frames; less does no harm
constexpr int kManyFrames = 5000;     // take a while
constexpr std::size_t kMaxNamed = 5;  // parts of a recording in a line

/// Returns "88-105, 200-230".
std::string ranges(const std::vector<std::pair<int, int>>& parts) {
  std::string text;
  for (std::size_t i = 0; i < std::min(parts.size(), kMaxNamed); ++i) {
    const auto& [begin, last] = parts[i];
    text += (i > 0 ? ", " : "") + std::to_string(begin) + (last > begin ? "-" + std::to_string(last) : "");
  }
  return parts.size() <= kMaxNamed ? text : fmt::format("{} and {} more parts", text, parts.size() - kMaxNamed);
}

/// Gives the frames of holes of at most `longest` their nearest neighbour's counterpart. Returns the parts left
/// without, as frames first to last. -1 stands for none.
std::vector<std::pair<int, int>> fill_holes(std::vector<int>& counterparts, int longest) {
  std::vector<std::pair<int, int>> parts;
  const int frames = static_cast<int>(counterparts.size());
  const auto at = [&](int frame) -> int& { return counterparts[static_cast<std::size_t>(frame)]; };
  for (int begin = 0, end = 0; begin < frames; begin = end + 1) {
    for (end = begin; end < frames && at(end) < 0;) ++end;
    if (end == begin) continue;
    if (end - begin > longest || end - begin == frames) {
      parts.emplace_back(begin, end - 1);
      continue;
    }
    const int before = begin > 0 ? at(begin - 1) : at(end), after = end < frames ? at(end) : before;
    for (int frame = begin; frame < end; ++frame) at(frame) = 2 * (frame - begin) < end - begin ? before : after;
  }
  return parts;
}

/// Returns the counterpart of each of `frames` frames, the middle one of several, -1 for none.
std::vector<int> counterparts_of(const std::vector<std::pair<int, int>>& pairs, int frames) {
  std::vector<int> result(static_cast<std::size_t>(frames), -1);
  for (std::size_t begin = 0, end = 0; begin < pairs.size(); begin = end) {
    while (end < pairs.size() && pairs[end].first == pairs[begin].first) ++end;
    result[static_cast<std::size_t>(pairs[begin].first)] = pairs[(begin + end - 1) / 2].second;
  }
  return result;
}

/// Returns the median, 0 where nothing tells, of how many counterparts lie from frame to frame.
double median_speed(const std::vector<int>& counterparts) {
  std::vector<double> speeds;
  for (std::size_t i = kSpeedFrames; i < counterparts.size(); ++i)
    if (std::all_of(&counterparts[i - kSpeedFrames], &counterparts[i] + 1, [](int frame) { return frame >= 0; }))
      speeds.push_back(static_cast<double>(counterparts[i] - counterparts[i - kSpeedFrames]) / kSpeedFrames);
  const auto middle = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() / 2);
  std::nth_element(speeds.begin(), middle, speeds.end());
  return speeds.empty() ? 0 : *middle;
}

Eigen::MatrixXf describe(const Traversal& traversal, int first, int count, int step) {
  std::vector<int> frames;
  for (int frame = first; frame < first + count; frame += step) frames.push_back(frame);
  if (traversal.images) return describe_pictures(*traversal.images, frames);
  Eigen::MatrixXf features(traversal.dimension, static_cast<Eigen::Index>(frames.size()));
  for (std::size_t i = 0; i < frames.size(); ++i)
    features.col(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::VectorXf>(traversal.feature(frames[i]).data(), traversal.dimension);
  return features;
}

}  // namespace

SightAlignment align_by_sight(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal) {
  const std::string where = "--align-by sight";
  if (!sibling.images != !traversal.images || sibling.dimension != traversal.dimension)
    throw Error("one of " + sibling.name + " and " + traversal.name + " has pictures or features that the other lacks",
                where, "align recordings of one kind");
  const int margin = std::max(kMinMargin, (frames.back() - frames.front()) / 4);
  const int first = std::max(0, frames.front() - margin), end = std::min(sibling.frames, frames.back() + 1 + margin);
  const auto step_of = [](int count) { return (count + kMaxFrames - 1) / kMaxFrames; };
  const int step = step_of(end - first), other_step = step_of(traversal.frames);
  if (end - first + traversal.frames > kManyFrames)
    spdlog::info("looks at {} frames of {} and {} of {}", end - first, sibling.name, traversal.frames, traversal.name);
  DescriptorMatch match =
      match_descriptors(describe(sibling, first, end - first, step),
                        describe(traversal, 0, traversal.frames, other_step), sibling.images ? kDescriptorColumn : 0);
  for (auto& [a, b] : match.pairs) {
    a = first + a * step;
    b *= other_step;
  }
  std::vector<int> shown = counterparts_of(match.pairs, sibling.frames);
  std::vector<float> sure(shown.size(), 0);
  for (std::size_t i = 0; i < match.pairs.size(); ++i) {
    const auto at = static_cast<std::size_t>(match.pairs[i].first), until = at + static_cast<std::size_t>(step);
    for (std::size_t frame = at; frame < std::min(until, sure.size()); ++frame)
      sure[frame] = std::max(sure[frame], match.confidence[i]);
  }
  for (auto& [a, b] : match.pairs) std::swap(a, b);
  std::vector<int> seen = counterparts_of(match.pairs, traversal.frames);
  const int longest = std::max(kMaxHole, std::max(step, other_step) - 1);
  fill_holes(shown, longest);
  const std::vector<std::pair<int, int>> strange = fill_holes(seen, longest);
  SightAlignment alignment;
  std::size_t matched = 0, apart = 0;
  for (const int frame : frames) {
    alignment.found.push_back(shown[static_cast<std::size_t>(frame)]);
    alignment.confidence.push_back(sure[static_cast<std::size_t>(frame)]);
    matched += alignment.found.back() >= 0;
    apart += alignment.found.back() >= 0 && std::abs(alignment.found.back() - frame) >= kFewestApart;
  }
  if (!match.clear || matched < 2)
    throw Error(fmt::format("no order of the frames of {} looks like those of {}", traversal.name, sibling.name), where,
                "does it show another street, or the way back? Look at both, or align another way");
  alignment.elsewhere = 5 * apart > matched;
  const std::vector<std::pair<int, int>> missed = fill_holes(alignment.found, 0);
  if (!missed.empty()) alignment.unmatched.assign(frames.size(), false);
  for (const auto& [begin, last] : missed) {
    const auto after = static_cast<std::size_t>(last) + 1, first_missed = static_cast<std::size_t>(begin);
    const int from = alignment.found[begin > 0 ? first_missed - 1 : after];
    const int to = after < frames.size() ? alignment.found[after] : from;
    for (std::size_t i = first_missed; i < after; ++i) {
      alignment.unmatched[i] = true;
      alignment.found[i] = from + (to - from) * static_cast<int>(i + 1 - first_missed) / (last - begin + 2);
    }
  }
  const bool whole_route = first == 0 && end == sibling.frames;
  alignment.summary = fmt::format("{}: {} of {} frames show places of {}", traversal.name,
                                  std::count_if(seen.begin(), seen.end(), [](int frame) { return frame >= 0; }),
                                  traversal.frames, sibling.name);
  if (!whole_route) alignment.summary += fmt::format("'s frames {}-{}", first, end - 1);
  if (const double speed = median_speed(seen); speed > 0)
    alignment.summary += fmt::format(", median speed {:.1f} times", speed);
  std::vector<std::pair<int, int>> told;  // beyond a part of the route nothing is known
  for (const auto& [begin, last] : strange)
    if (whole_route || (begin > 0 && last + 1 < traversal.frames)) told.emplace_back(begin, last);
  if (!told.empty()) alignment.summary += "; frames " + ranges(told) + " have no counterpart";
  if (missed.empty()) return alignment;
  told.clear();
  for (const auto& [begin, last] : missed)
    told.emplace_back(frames[static_cast<std::size_t>(begin)], frames[static_cast<std::size_t>(last)]);
  alignment.summary +=
      fmt::format("; it lacks frames {} of {}, where no task begins or ends", ranges(told), sibling.name);
  return alignment;
}

}  // namespace citylearn
