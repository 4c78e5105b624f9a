// SPDX-License-Identifier: Apache-2.0
#include "env_service/imperfections.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "core/util/error.h"
#include "core/wire/service.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

// They name the random numbers.
enum Stream : std::uint64_t { kSlips = 201, kDroppedFrames, kKidnappings, kBlurredFrames, kUnevenSpeed };

/// Returns the frame seen at each place.
std::vector<int> drive_unevenly(int frames, int most, Random random) {
  std::vector<int> seen(static_cast<std::size_t>(frames));
  int ahead = 0;
  for (int place = 1; place < frames; ++place) {
    ahead = std::clamp(ahead + static_cast<int>(random.below(3)) - 1, -most, most);
    const int frame = std::clamp(place + ahead, 0, frames - 1);
    ahead = frame - place;  // less where the recording ends
    seen[static_cast<std::size_t>(place)] = frame;
  }
  return seen;
}

void show(Traversal& traversal, const std::vector<int>& frames) {
  if (traversal.images) traversal.images = picked(traversal.images, frames);
  if (traversal.dimension == 0) return;
  std::vector<float> features;
  features.reserve(traversal.features.size());
  for (const int frame : frames) {
    const auto feature = traversal.feature(frame);
    features.insert(features.end(), feature.begin(), feature.end());
  }
  traversal.features = std::move(features);
}

/// Some pictures of one source, the others of another one.
class MixedImages : public DerivedImages {
 public:
  MixedImages(std::shared_ptr<Images> images, std::shared_ptr<Images> others, std::vector<bool> other)
      : DerivedImages(std::move(images)), others_(std::move(others)), other_(std::move(other)) {}
  void read(int frame, Bytes& bytes) override { of(frame).read(frame, bytes); }
  std::uint64_t fingerprint(int frame) const override { return of(frame).fingerprint(frame); }

 private:
  Images& of(int frame) const { return other_.at(static_cast<std::size_t>(frame)) ? *others_ : *images_; }

  const std::shared_ptr<Images> others_;
  const std::vector<bool> other_;
};

/// Smears a picture sideways, as a camera does that turns while its shutter is open.
cv::Mat smeared(const cv::Mat& picture) {
  cv::Mat result;
  cv::blur(picture, result, cv::Size(std::max(3, picture.cols / 8), 1));
  return result;
}

void blur(Traversal& traversal, double share, Random random) {
  if (!traversal.images)
    throw Error("traversal '" + traversal.name + "' has features, and only pictures can be blurred", "--blurred-frames",
                "leave it out, or host the pictures");
  std::vector<bool> blurred(static_cast<std::size_t>(traversal.frames));
  for (std::size_t frame = 0; frame < blurred.size(); ++frame) blurred[frame] = random.uniform() < share;
  traversal.images = std::make_shared<MixedImages>(
      traversal.images, changed(traversal.images, "smeared sideways by an eighth", smeared), std::move(blurred));
}

}  // namespace

void add_imperfection_options(CLI::App& app, Imperfections& imperfections, const std::string& group) {
  const OptionGroup options(app, group);
  const auto probability = [&](const char* name, double& value, const char* help) {
    app.add_option(name, value, help)->capture_default_str()->check(CLI::Range(0.0, 1.0))->type_name("P");
  };
  const auto count = [&](const char* name, int& value, const char* unit, const char* help) {
    app.add_option(name, value, help)->capture_default_str()->check(CLI::Range(0, 1000))->type_name(unit);
  };
  probability("--slip", imperfections.slip,
              "Probability that an action slips: it is done never or twice, which are as likely");
  probability("--dropped-frames", imperfections.dropped_frames,
              "Probability that after a step the agent sees the frame that it saw before");
  count("--kidnappings", imperfections.kidnappings, "N",
        "How often in each episode the agent is carried to another place, never its goal, without being told");
  probability("--blurred-frames", imperfections.blurred_frames,
              "Share of the pictures that are blurred, the same ones at each visit; features are refused");
  count("--uneven-speed", imperfections.uneven_speed, "FRAMES",
        "Frames that the recording is ahead or behind of its places at most, as if driven at uneven speed");
  app.add_option("--recording-seed", imperfections.recording_seed,
                 "Chooses which pictures are blurred and where the speed changes")
      ->capture_default_str();
}

Traversal imperfect(Traversal traversal, const Imperfections& imperfections) {
  const std::string world = world_of(imperfections);
  if (world.empty()) return traversal;
  const std::uint64_t hash = traversal.hash(), seed = imperfections.recording_seed;
  if (const int most = imperfections.uneven_speed; most > 0)
    show(traversal, drive_unevenly(traversal.frames, most, Random{seed, hash, kUnevenSpeed}));
  if (const double share = imperfections.blurred_frames; share > 0)
    blur(traversal, share, Random{seed, hash, kBlurredFrames});
  traversal.name = name_in_world(traversal.name, world);
  return traversal;
}

Mishaps::Mishaps(const Imperfections& imperfections, std::uint64_t seed, std::uint64_t number)
    : slip_(imperfections.slip),
      dropped_frames_(imperfections.dropped_frames),
      kidnappings_(imperfections.kidnappings),
      slips_{seed, number, kSlips},
      drops_{seed, number, kDroppedFrames},
      kidnaps_{seed, number, kKidnappings} {}

int Mishaps::times_done() {
  if (slip_ <= 0) return 1;
  const double drawn = slips_.uniform();
  return drawn >= slip_ ? 1 : drawn < slip_ / 2 ? 0 : 2;
}

bool Mishaps::frame_dropped() { return dropped_frames_ > 0 && drops_.uniform() < dropped_frames_; }

void Mishaps::plan_kidnappings(int distance) {
  left_ = kidnappings_;
  await_kidnapping(distance);
}

void Mishaps::await_kidnapping(int distance) {
  if (left_ == 0) return;
  wait_ = 1 + static_cast<int>(kidnaps_.below(static_cast<std::uint64_t>(std::max(1, distance - 1))));
}

int Mishaps::state_kidnapped_to(std::span<const int> excluded, int states) {
  const int others = states - static_cast<int>(excluded.size());
  if (others < 1) return -1;
  --left_;
  int state = static_cast<int>(kidnaps_.below(static_cast<std::uint64_t>(others)));
  for (const int other : excluded) state += state >= other;
  return state;
}

}  // namespace citylearn
