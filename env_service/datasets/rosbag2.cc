// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>

#include "core/ros2/header.h"
#include "core/ros2/messages.h"
#include "core/util/sha256.h"
#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"
#include "env_service/ros2/bag.h"
#include "env_service/ros2/sensor_messages.h"
#include "env_service/traversal/poses.h"

namespace citylearn {
namespace {

using BagFix = sensor_msgs::msg::dds_::NavSatFix_;

constexpr std::uint64_t kBagDecodingVersion = 1;    // part of fingerprints; raised when bags give other pictures
constexpr std::size_t kBagSampledBytes = 16 << 10;  // bytes of a message that are hashed, at each end
constexpr double kBagReach = 1;                     // a frame has a position when one was measured as near, in seconds
const std::string kStrayStamp = "is stamped an hour or more from all others (see --rosbag2-stamp)";
const std::string kUndecodable = "is shorter than its lengths say, or of another type";

std::uint64_t fingerprint_of(std::span<const std::byte> message) {
  const std::size_t sampled = std::min(message.size(), kBagSampledBytes);
  Sha256 sha;
  sha.add(kBagDecodingVersion);
  sha.add(message.size());
  sha.add(message.data(), sampled);
  sha.add(message.last(sampled).data(), sampled);
  return sha.first_8_bytes();
}

struct BagPicture {
  double time, recorded;  ///< seconds, of the frame and of the recorder
  BagPlace place;
  std::uint64_t fingerprint;
  std::string fault;
};
struct BagPosition {
  double time, recorded;  ///< likewise
  double x, y, height;    ///< x and y, or latitude and longitude
};

/// What one topic gives.
struct BagTrack {
  std::vector<BagPicture> pictures;
  std::vector<BagPosition> positions;
  std::string frame;                   ///< in which all are
  std::map<std::string, int> refused;  ///< messages by reason

  /// Returns why a message in this frame does not belong to those taken before; empty when it does.
  std::string fault_of_frame(const std::string& given) {
    if (pictures.empty() && positions.empty()) frame = given;
    return given == frame ? "" : "is in frame '" + one_line(given) + "', others in '" + one_line(frame) + "'";
  }
};

/// Throws Error when the times of rows go back, or are all one, while those of the recorder grow.
template <class Row>
void require_running_clock(const std::vector<Row>& rows, const std::string& topic) {
  bool wrong = !rows.empty() && rows.front().recorded < rows.back().recorded && rows.front().time == rows.back().time;
  const Row* latest = rows.data();  // of those before
  for (const Row& row : rows) {
    wrong = wrong || (row.recorded > latest->recorded && row.time < latest->time - kBagReach);
    if (row.time > latest->time) latest = &row;
  }
  if (wrong)
    throw Error("its messages' stamps go back or stand still while they are recorded", topic,
                "--rosbag2-stamp 1 takes the recorder's times");
}

/// Calls `use` with an empty message of the topic's type, if that is one of `Messages`.
template <class... Messages, class Use>
bool with_message(const BagTopic& topic, Use use) {
  const auto one = [&]<class Message>(Message message) {
    if (topic.encoding != "cdr" || topic.type != ros2_type_of<Message>().name) return false;
    use(message);
    return true;
  };
  return (one(Messages()) || ...);
}
template <class Use>
bool with_picture(const BagTopic& topic, Use use) {
  return with_message<sensor_msgs::msg::dds_::Image_, sensor_msgs::msg::dds_::CompressedImage_>(topic, use);
}
template <class Use>
bool with_position(const BagTopic& topic, Use use) {
  return with_message<BagFix, nav_msgs::msg::dds_::Odometry_, geometry_msgs::msg::dds_::PoseStamped_>(topic, use);
}

bool is_camera(const BagTopic& topic) {
  return with_picture(topic, [](auto&) {});
}
bool is_position(const BagTopic& topic) {
  return with_position(topic, [](auto&) {});
}

std::string described(const BagTopic& topic) {
  return fmt::format("{} ({}{}, {} message{})", one_line(topic.name), one_line(topic.type),
                     topic.encoding == "cdr" ? "" : " as '" + one_line(topic.encoding) + "'", topic.messages,
                     topic.messages == 1 ? "" : "s");
}

class BagImages : public Images {
 public:
  BagImages(std::shared_ptr<Bag> bag, const BagTopic& topic, std::vector<BagPicture> pictures, const std::string& root)
      : bag_(std::move(bag)), topic_(topic), pictures_(std::move(pictures)), root_(root) {}

  int frames() const override { return static_cast<int>(pictures_.size()); }
  std::string name(int frame) const override {
    return path_below(bag_->path(at(frame).place), root_) + ", frame " + std::to_string(frame) + " of " + topic_.name;
  }
  std::uint64_t fingerprint(int frame) const override { return at(frame).fingerprint; }
  std::string fault(int frame) const override { return at(frame).fault; }
  void read(int frame, Bytes& bytes) override {
    const std::span<const std::byte> data = bag_->read(at(frame).place);
    if (fingerprint_of(data) != at(frame).fingerprint)
      throw Error("has changed since this traversal was opened", name(frame), "restart what reads it");
    std::string fault = kUndecodable;
    with_picture(topic_, [&](auto& image) {
      if (decode_ros2(data, image)) fault = read_picture(image, bytes);
    });
    if (!fault.empty()) throw Error(fault, name(frame));
  }

 private:
  const BagPicture& at(int frame) const { return pictures_.at(static_cast<std::size_t>(frame)); }

  const std::shared_ptr<Bag> bag_;
  const BagTopic topic_;
  const std::vector<BagPicture> pictures_;
  const std::string root_;
};

/// Bags of ROS 2 (rosbag2), each a traversal: the pictures of one topic, placed by the messages of another one.
///   <bag>/ with metadata.yaml and the files it names: .mcap or .db3, perhaps compressed with zstd
///   <bag>/ without it, as a recorder leaves it that was killed: all such files in it are one bag
///   <bag>.mcap, <bag>.db3: a bag of one file
/// The folder may also be a bag itself. Frames are in the order of their times, which are those of the messages'
/// headers, or of the recorder. A frame has a position where one was measured within a second.
class Rosbag2 : public FolderDataset {
 public:
  Rosbag2(const std::string& folder, const Parameters& parameters)
      : FolderDataset("rosbag2", folder, "bags of ROS 2"),
        camera_(parameters.integer("camera")),
        position_(parameters.integer("position")),
        recorded_(parameters.flag("stamp")) {}

  std::vector<std::string> names() override {
    return names_of(sources(), "bag in it: a folder with metadata.yaml, or a file .mcap or .db3");
  }

  /// Returns false where folders of pictures lie beside the bags.
  bool distinctive() override {
    const std::vector<std::string> pictures =
        is_folder(folder_) ? picture_folders(folder_, 1) : std::vector<std::string>();
    return std::none_of(pictures.begin(), pictures.end(), [&](const std::string& path) { return path != folder_; });
  }

  Correspondence correspondence() const override {
    return matches_file().empty() ? by_position_.value_or(Correspondence::kIndex) : Correspondence::kMatches;
  }
  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    return matches_file().empty() ? Dataset::matches(a, b) : read_matches(matches_file(), a, b);
  }
  LeftOut left_out(const std::string& name) override { return left_out_[name]; }

 private:
  std::map<std::string, std::string> sources() const {
    const std::string own = std::filesystem::weakly_canonical(folder_).filename();
    if (is_file(folder_) && !Bag::stem(own).empty()) return {{Bag::stem(own), folder_}};
    const std::vector<std::string> files = Bag::files_of(folder_);
    // rosbag2 calls the files in a folder after it, and counts them from 0.
    const bool parts = std::any_of(files.begin(), files.end(), [&](const std::string& path) {
      return Bag::stem(path_below(path, folder_)) == own + "_0";
    });
    if (parts || (!files.empty() && is_file(below(folder_, "metadata.yaml")))) return {{own, folder_}};
    std::vector<std::string> all;
    for (const std::string& path : files) all.push_back(path_below(path, folder_));
    for (const std::string& name : folders_in(folder_))
      if (!Bag::files_of(below(folder_, name)).empty()) all.push_back(name);
    const auto stem = [](const std::string& name) { return Bag::stem(name).empty() ? name : Bag::stem(name); };
    std::map<std::string, int> count;
    for (const std::string& name : all) ++count[stem(name)];
    std::map<std::string, std::string> found;
    for (const std::string& name : all) found[count[stem(name)] > 1 ? name : stem(name)] = below(folder_, name);
    return found;
  }

  Traversal read(const std::string& name) override {
    const std::string path = sources().at(name);
    const auto bag = std::make_shared<Bag>(path);
    std::vector<BagTrack> tracks;
    bag->read_all(
        [&](const BagTopic& topic) {
          tracks.emplace_back();
          return is_camera(topic) || is_position(topic);
        },
        [&](const BagMessage& message) { take(bag->topics()[message.topic], message, tracks[message.topic]); });
    for (BagTrack& track : tracks)
      if (const int strays = erase_strays(track.pictures, [](const BagPicture& picture) { return picture.time; }) +
                             erase_strays(track.positions, [](const BagPosition& row) { return row.time; }))
        track.refused[kStrayStamp] = strays;
    const std::vector<BagTopic>& topics = bag->topics();
    const std::optional<std::size_t> camera = choose(topics, is_camera, camera_, "camera", path),
                                     position = choose(topics, is_position, position_, "position", path);
    if (!camera)
      throw Error("has no pictures: sensor_msgs/msg/Image or CompressedImage", path,
                  "its topics are " + joined(topics, described));

    LeftOut& left_out = left_out_[name] = {{}, bag->faults()};
    for (std::size_t i = 0; i < topics.size(); ++i) {
      const bool taken = i == camera || i == position;
      for (const auto& [why, count] : taken ? tracks[i].refused : std::map<std::string, int>())
        (why == kUndecodable || why == kStrayStamp || i == camera ? left_out.faults : left_out.on_purpose)
            .push_back(fmt::format("{} of {} not taken: each {}", count, described(topics[i]), why));
      if (!taken)
        left_out.on_purpose.push_back(described(topics[i]) +
                                      (is_camera(topics[i])     ? ": --rosbag2-camera chooses another topic"
                                       : is_position(topics[i]) ? ": --rosbag2-position chooses another topic"
                                                                : ": messages that are not read"));
    }
    for (const std::string& fault : left_out.faults) spdlog::warn("{}: {}", folder_, fault);

    std::vector<BagPicture>& pictures = tracks[*camera].pictures;
    if (pictures.empty()) throw Error(left_out.faults.back(), path);
    require_running_clock(pictures, path + ": " + topics[*camera].name);
    std::stable_sort(pictures.begin(), pictures.end(), [](auto& a, auto& b) { return a.time < b.time; });
    Traversal traversal = unfilled(name, static_cast<int>(pictures.size()), path);
    for (const BagPicture& picture : pictures) traversal.times.push_back(picture.time);
    if (position) {
      auto& positions = tracks[*position].positions;
      GpsRows rows{{}, {}, {}, {}, path + ": " + topics[*position].name};
      require_running_clock(positions, rows.log);
      std::stable_sort(positions.begin(), positions.end(), [](auto& a, auto& b) { return a.time < b.time; });
      for (const BagPosition& row : positions) rows.add(row.time, row.x, row.y, row.height);
      traversal.places_from = topics[*position].name;
      place(traversal, rows, topics[*position].type == ros2_type_of<BagFix>().name);
    }
    traversal.images = std::make_shared<BagImages>(bag, topics[*camera], std::move(pictures), folder_);
    return traversal;
  }

  void take(const BagTopic& topic, const BagMessage& message, BagTrack& track) const {
    double time = 0;
    const double recorded = 1e-9 * static_cast<double>(message.time);
    const auto fault_of = [&](auto& decoded) {
      if (!decode_ros2(message.data, decoded)) return kUndecodable;
      const std::uint64_t nanoseconds = recorded_ ? message.time : ros2_time(decoded.header());
      time = 1e-9 * static_cast<double>(nanoseconds);
      return std::string(nanoseconds ? "" : "has no stamp (--rosbag2-stamp 1 takes the recorder's times)");
    };
    std::string fault;
    with_picture(topic, [&](auto& image) {
      if (fault = fault_of(image); fault.empty()) fault = track.fault_of_frame(image.header().frame_id());
      if (fault.empty())
        track.pictures.push_back({time, recorded, message.place, fingerprint_of(message.data), picture_fault(image)});
    });
    with_position(topic, [&](auto& sensed) {
      if (fault = fault_of(sensed); !fault.empty()) return;
      const SensedPosition position = position_of(sensed);
      fault = position.fault == kAtNullIsland ? "" : position.fault;  // the whole drive tells
      if (fault.empty()) fault = track.fault_of_frame(position.frame);
      if (fault.empty()) track.positions.push_back({time, recorded, position.x, position.y, position.height});
    });
    if (!fault.empty()) ++track.refused[fault];
  }

  /// Returns the topic of that number, from 1 in the order of names; for 0 the one with the most messages.
  static std::optional<std::size_t> choose(const std::vector<BagTopic>& topics, bool (*fits)(const BagTopic&),
                                           int number, const std::string& option, const std::string& path) {
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < topics.size(); ++i)
      if (fits(topics[i]) && topics[i].messages > 0) found.push_back(i);
    std::sort(found.begin(), found.end(), [&](auto a, auto b) { return topics[a].name < topics[b].name; });
    int counted = 0;
    const std::string list =
        joined(found, [&](std::size_t i) { return std::to_string(++counted) + ": " + described(topics[i]); });
    if (number > counted)
      throw Error(fmt::format("has {} topics for --rosbag2-{} {}", counted, option, number), path, list);
    if (found.empty()) return std::nullopt;
    const auto most = std::max_element(found.begin(), found.end(),
                                       [&](auto a, auto b) { return topics[a].messages < topics[b].messages; });
    const std::size_t best = number > 0 ? found[static_cast<std::size_t>(number - 1)] : *most;
    if (counted > 1)
      spdlog::info("{}: takes {}; --rosbag2-{} chooses of {}", path, one_line(topics[best].name), option, list);
    return best;
  }

  void place(Traversal& traversal, const GpsRows& rows, bool on_earth) {
    if (rows.times.empty()) return;
    if (on_earth) locate(traversal, rows, kBagReach);
    std::vector<double> a = traversal.latitude, b = traversal.longitude;
    if (!on_earth) {
      a = interpolate(rows.times, rows.latitude, traversal.times, kBagReach);
      b = interpolate(rows.times, rows.longitude, traversal.times, kBagReach);
    }
    bool any = false;
    for (std::size_t frame = 0; frame < a.size(); ++frame) {
      const double now = traversal.times[frame];
      const auto next = std::lower_bound(rows.times.begin(), rows.times.end(), now - kBagReach);
      const bool near = next != rows.times.end() && *next - now <= kBagReach;
      if (!near) a[frame] = b[frame] = std::nan("");
      any = any || near;
    }
    if (any)
      by_position_ = on_earth ? Correspondence::kGps : Correspondence::kDistance;
    else
      spdlog::warn("{}: no picture was taken within {} s of a position: do clocks differ (--rosbag2-stamp 1)?",
                   rows.log, kBagReach);
    if (on_earth) return locate(traversal, std::move(a), std::move(b));
    traversal.positions = metres_along_plane(a, b);
    traversal.x = std::move(a);
    traversal.y = std::move(b);
  }

  const int camera_, position_;
  const bool recorded_;
  std::optional<Correspondence> by_position_;  // that bags which were loaded allow
  std::map<std::string, LeftOut> left_out_;
};

const DatasetRegistry::Registration rosbag2_registration({
    "rosbag2",
    "bags of ROS 2 (rosbag2) in a folder (--data), or one: .mcap or .db3; pictures of one topic, positions of another",
    {{"camera", "topic of pictures, from 1 in the order of names; 0: the one with the most messages", 0, 0, 99, true},
     {"position", "topic of positions (NavSatFix, Odometry, PoseStamped), likewise", 0, 0, 99, true},
     {"stamp", "times of frames: 0 of the messages' headers, 1 of the recorder", 0, 0, 1, true}},
    open_folder<Rosbag2>,
    {},
    {{"paper", "none"}, {"address", "your own recordings: ros2 bag record"}, {"licence", "yours"}, {"size", "any"}},
});

}  // namespace
}  // namespace citylearn
