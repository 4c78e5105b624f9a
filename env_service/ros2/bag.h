// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/util/types.h"

namespace citylearn {

struct BagTopic {
  std::string name;                     ///< "/camera/image_raw"
  std::string type;                     ///< "sensor_msgs/msg/Image"
  std::string encoding;                 ///< of its messages: "cdr"
  std::string schema_encoding, schema;  ///< as McapChannel's; empty where the file has none
  std::uint64_t messages = 0;           ///< that read_all() found
};

/// Where a message is in a bag.
struct BagPlace {
  std::size_t file = 0;
  std::uint64_t record = 0, offset = 0;  ///< as McapPlace; or the number of a row
};

struct BagMessage {
  std::size_t topic = 0;            ///< among topics()
  std::uint64_t time = 0;           ///< when it was recorded, nanoseconds since 1970
  std::span<const std::byte> data;  ///< until the next call
  BagPlace place = {};
};

/// Takes what is in a file.
struct BagVisitor {
  std::function<std::size_t(const BagTopic&)> topic;  ///< returns the number of a topic
  std::function<bool(std::size_t topic)> count;       ///< counts a message, and returns whether it is to be read
  std::function<void(const BagMessage&)> use;
};

/// One file of a bag. Every Error names it.
class BagFile {
 public:
  virtual ~BagFile() = default;
  /// Reads the file once. Throws Error where it is cut short or damaged, after all that is before.
  virtual void read_all(const BagVisitor& visitor) = 0;
  /// Returns the message at a place that read_all() told, until the next call.
  virtual std::span<const std::byte> read(const BagPlace& place) = 0;
};

/// Opens a file of MCAP or SQLite, or one that zstd compressed as a whole: this is decompressed into a temporary file.
std::unique_ptr<BagFile> open_bag_file(const std::string& path);

/// A bag of ROS 2's rosbag2: files of MCAP or SQLite, of any version, with metadata.yaml or without. Used by one
/// thread.
class Bag {
 public:
  static constexpr std::size_t kMaxMessageBytes = std::size_t{256} << 20;

  /// `path`: the bag's folder, or its only file. Throws Error naming it when it holds no bag, or one of another kind.
  explicit Bag(const std::string& path);

  /// Returns a file's name without .mcap, .db3, .mcap.zstd or .db3.zstd; empty when it ends in none of them.
  static std::string stem(const std::string& file);
  /// Returns the paths of a folder's files of bags, in natural order, without recordings of CityLearn itself.
  static std::vector<std::string> files_of(const std::string& folder);

  /// Reads the bag once, file by file, and calls `use` for each message of topics that are `wanted`. Goes on with the
  /// next file where one is cut short, damaged or missing, and adds that to faults(). Throws Error when no file has a
  /// topic.
  void read_all(const std::function<bool(const BagTopic&)>& wanted, const std::function<void(const BagMessage&)>& use);
  /// Returns the message at a place that read_all() told, until the next call. Throws Error when that fails.
  std::span<const std::byte> read(const BagPlace& place);

  const std::vector<BagTopic>& topics() const { return topics_; }
  const std::vector<std::string>& faults() const { return faults_; }
  const std::string& path(const BagPlace& place) const { return paths_[place.file]; }

 private:
  void read_metadata(const std::string& path);
  std::span<const std::byte> decompressed(std::span<const std::byte> data);

  const std::string path_, parent_;  // the folder above it, which faults_ leave out
  std::vector<std::string> paths_, faults_;
  std::vector<std::unique_ptr<BagFile>> files_;  // as paths_
  std::vector<BagTopic> topics_;
  std::uint64_t told_ = 0;  // messages, by metadata.yaml
  std::string buffer_;      // a message that was compressed alone
};

}  // namespace citylearn
