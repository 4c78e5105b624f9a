// SPDX-License-Identifier: Apache-2.0
#include "tools/robot/teacher.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
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
constexpr std::chrono::seconds kMaxSilence{3};
constexpr std::chrono::milliseconds kMaxAge{250};  // what is older may not be of this place
constexpr double kMinSilence = 0.75;               // seconds: a hole of a shorter silence has another cause
constexpr double kMaxOffset = 2;                   // seconds by which one topic begins or ends before the other

double seconds(Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

/// Returns "4 s without a position".
std::string silence(double seconds, bool of_position) {
  return fmt::format("{:.{}f} s without a {}", seconds, seconds < 1 ? 2 : 0, of_position ? "position" : "picture");
}

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
      ros_(ros),
      senses_(ros, options.topics),
      record_(ros.offer<SetBoolRequest, SetBoolResponse>("record")),
      paused_(options.paused),
      pictures_(fresh(options, "")),
      poses_path_(fresh(options, ".poses.csv")) {
  create_folder(pictures_);
  pictures_heard_.came = positions_heard_.came = ros.now();
  senses_.limit_deviation(kMaxPlacesAway * options.spacing);
}

Teacher::~Teacher() {
  std::error_code ignored;
  if (frames_ == 0) fs::remove(pictures_, ignored);  // so that the next attempt finds nothing there
}

void Teacher::Topic::hear(std::uint64_t newest, Clock::time_point now) {
  if (newest == stamp) return;
  silence = std::max(silence, now - came);
  if (stamp != 0) interval = now - came;
  stamp = newest;
  came = now;
}

/// Returns whether the next message is late.
bool Teacher::Topic::silent(Clock::time_point now) const {
  return now - came > std::max<Clock::duration>(kMaxAge, interval + interval / 2);
}

void Teacher::poll(Clock::time_point steady) {
  const Clock::time_point now = ros_.clock().at(steady);
  senses_.poll();
  pictures_heard_.hear(senses_.picture() ? senses_.picture()->stamp : 0, now);
  positions_heard_.hear(senses_.position() ? senses_.position()->stamp : 0, now);
  record_.serve([&](const SetBoolRequest* request) { return set_recording(request, steady); });
  was_paused_ |= paused_;
  if (!paused_ && is_next(now)) write_frame(now);
}

Teacher::SetBoolResponse Teacher::set_recording(const SetBoolRequest* request, Clock::time_point steady) {
  SetBoolResponse response;
  response.success(request != nullptr);
  if (request && std::exchange(paused_, !request->data()) == request->data())
    spdlog::info(paused_ ? "is paused by a node" : "records");
  const std::string frames = fmt::format("{} frames", frames_), obstacle = paused_ ? "" : trouble(steady);
  response.message(!request ? "the request cannot be read"
                            : frames + (paused_ ? ", paused" : "") + (obstacle.empty() ? "" : "; " + obstacle));
  return response;
}

std::string Teacher::trouble(Clock::time_point steady) const {
  const Clock::time_point now = ros_.clock().at(steady);
  if (now - pictures_heard_.came > kMaxSilence) return senses_.why_no_picture(true);
  if (!options_.topics.position.empty() && now - positions_heard_.came > kMaxSilence)
    return senses_.why_no_position(true);
  return "";
}

/// Returns whether the newest picture is the next frame. An old one of a silent topic does not show the robot's place.
bool Teacher::is_next(Clock::time_point now) const {
  if (!ros_.clock().known() || !senses_.picture() || senses_.picture()->stamp == picture_) return false;
  const std::uint64_t stamp = senses_.picture()->stamp;
  if (options_.topics.position.empty())  // earlier: the camera's clock was set back
    return stamp < picture_ ||
           static_cast<double>(stamp) >= static_cast<double>(picture_) + kSecond * options_.interval;
  if (!senses_.position() || pictures_heard_.silent(now) || positions_heard_.silent(now)) return false;
  return !position_ || metres_to(*senses_.position()) >= options_.spacing;
}

/// Notes that frames are missing before this one, where they are.
void Teacher::note_hole(const std::string& file, Clock::time_point now) {
  const bool placed = !options_.topics.position.empty();
  const double no_picture = seconds(pictures_heard_.silence), no_position = seconds(positions_heard_.silence);
  if (frames_ == 0) {  // both since this program started
    if (const double begin = no_position - no_picture; placed && std::abs(begin) > kMaxOffset)
      first_hole_ = silence(std::abs(begin), begin > 0) + ": no frames before " + file;
    return;
  }
  const double size = placed ? metres_to(*senses_.position()) : seconds(now - frame_came_);
  if (size <= 2 * (placed ? options_.spacing : options_.interval)) return;
  ++holes_;
  if (size <= longest_) return;
  longest_ = size;
  const double silent = std::max(no_picture, no_position);
  longest_hole_ = was_paused_                      ? "recording was paused"
                  : placed && silent < kMinSilence ? "the position leapt"
                                                   : silence(silent, no_position > no_picture);
  longest_hole_ +=
      placed ? fmt::format(": {:.1f} m without frames before {}", size, file) : ": no frames before " + file;
}

std::vector<std::string> Teacher::shortcomings() const {
  std::vector<std::string> lines = {senses_.picture_faults().text(), senses_.position_faults().text(), first_hole_,
                                    longest_hole_};
  if (holes_ > 1) lines.back() += fmt::format(", the longest of {} holes", holes_);
  const double end = seconds(pictures_heard_.came - positions_heard_.came);
  if (frames_ > 0 && !options_.topics.position.empty() && std::abs(end) > kMaxOffset)
    lines.push_back(silence(std::abs(end), end > 0) + ": no frames after " + file_);
  std::erase(lines, "");
  return lines;
}

std::string Teacher::why_no_route() const {
  const MessageFaults& pictures = senses_.picture_faults();
  if (pictures.used() < 2 && pictures.came() > pictures.used())
    return fmt::format("{} of {} pictures were refused: {}", pictures.came() - pictures.used(), pictures.came(),
                       pictures.text());
  if (pictures.used() == 0) return senses_.why_no_picture(true);
  const bool lost = !senses_.position() || senses_.position_faults().refused();
  return !options_.topics.position.empty() && lost ? senses_.why_no_position(true)
                                                   : "let the robot drive while this records";
}

void Teacher::write_frame(Clock::time_point now) {
  const RobotSenses::Picture& picture = *senses_.picture();
  const std::string file = fmt::format("{:06}{}", frames_, suffix_of(picture.file));
  write_file(pictures_ + "/" + file, {reinterpret_cast<const char*>(picture.file.data()), picture.file.size()});
  note_hole(file, now);
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
  frame_came_ = now;
  file_ = file;
  pictures_heard_.silence = positions_heard_.silence = {};
  was_paused_ = false;
  ++frames_;
}

}  // namespace citylearn
