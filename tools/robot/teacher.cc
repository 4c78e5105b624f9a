// SPDX-License-Identifier: Apache-2.0
#include "tools/robot/teacher.h"

#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <utility>

#include "core/files/files.h"
#include "core/files/image_header.h"
#include "core/util/error.h"
#include "core/util/name.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr double kSecond = 1e9;  // nanoseconds
constexpr std::chrono::seconds kSilent{3};

/// Returns the path of something new.
std::string fresh(const TeachOptions& options, const std::string& suffix) {
  if (const std::string problem = name_problem(options.traversal); !problem.empty())
    throw Error(problem, "--traversal");
  create_folder(options.folder, "choose another --output");
  std::string path = options.folder + "/" + options.traversal + suffix;
  if (fs::exists(path)) throw Error("is there already", path, "choose another --traversal, or remove it");
  return path;
}

std::string suffix_of(const Bytes& file) {
  const std::string format = read_image_header(file, "a picture of the camera").format;
  return format == "jpeg" ? ".jpg" : "." + format;
}

}  // namespace

Teacher::Teacher(const TeachOptions& options, Ros2Participant& ros)
    : options_(options),
      senses_(ros, options.topics),
      pictures_(fresh(options, "")),
      poses_path_(fresh(options, ".poses.csv")) {
  create_folder(pictures_);
}

Teacher::~Teacher() {
  std::error_code ignored;
  if (frames_ == 0) fs::remove(pictures_, ignored);  // so that the next attempt finds nothing there
}

void Teacher::poll() {
  senses_.poll();
  const Clock::time_point now = Clock::now();
  if (std::exchange(pictures_taken_, senses_.counts().pictures) != senses_.counts().pictures) picture_came_ = now;
  const std::uint64_t stamp = senses_.position() ? senses_.position()->stamp : 0;
  if (std::exchange(position_taken_, stamp) != stamp) position_came_ = now;
  if (is_next()) write_frame();
}

std::string Teacher::trouble(Clock::time_point now) const {
  if (now - picture_came_ > kSilent) return senses_.why_no_picture();
  if (!options_.topics.position.empty() && now - position_came_ > kSilent) return senses_.why_no_position();
  return "";
}

/// Returns whether the newest picture is the next frame.
bool Teacher::is_next() const {
  if (!senses_.picture() || senses_.picture()->stamp == picture_) return false;
  if (options_.topics.position.empty())
    return frames_ == 0 ||
           static_cast<double>(senses_.picture()->stamp) >= static_cast<double>(picture_) + kSecond * options_.interval;
  if (!senses_.position()) return false;
  if (!position_) return true;
  return PositionTopic::metres_between(options_.topics.source, *position_, *senses_.position()) >= options_.spacing;
}

void Teacher::write_frame() {
  const RobotSenses::Picture& picture = *senses_.picture();
  const std::string file = fmt::format("{:06}{}", frames_, suffix_of(picture.file));
  write_file(pictures_ + "/" + file, {reinterpret_cast<const char*>(picture.file.data()), picture.file.size()});
  if (!options_.topics.position.empty()) {
    const bool fix = options_.topics.source == PositionSource::kFix;
    if (!poses_) {
      poses_ = std::make_unique<GrowingFile>(poses_path_);
      poses_->add(fix ? "file,lat,lon,time\n" : "file,x,y,time\n");
    }
    position_ = senses_.position();
    poses_->add(fmt::format("{},{:.9f},{:.9f},{:.3f}\n", file, position_->x, position_->y,
                            static_cast<double>(picture.stamp) / kSecond));
    if (!poses_->sync()) throw Error(poses_->problem(), poses_path_);
  }
  picture_ = picture.stamp;
  ++frames_;
}

}  // namespace citylearn
