// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "core/dds/middleware.h"

namespace citylearn {

// Files of MCAP (https://mcap.dev/spec, version 0): messages of several channels, each with a schema, in chunks that
// are whole or not there. Knows bytes and names, no message of ours. Times are nanoseconds since 1970.

using McapMetadata = std::map<std::string, std::string>;

/// A channel and its schema.
struct McapChannel {
  std::string topic;
  std::string type;             ///< the schema's name: "citylearn::msg::Action"
  std::string schema_encoding;  ///< "omgidl"
  std::string schema;           ///< text of it
  std::string encoding;         ///< of messages: "cdr"
  McapMetadata metadata = {};
};

/// Where a message is in its file.
struct McapPlace {
  std::uint64_t record = 0;  ///< where its chunk begins, or itself
  std::uint64_t offset = 0;  ///< in the chunk
};

struct McapMessage {
  const McapChannel* channel = nullptr;  ///< lives as long as the reader
  std::uint32_t sequence = 0;
  std::uint64_t log_time = 0;
  std::span<const std::byte> data;  ///< until the next call
  McapPlace place = {};
};

/// Reads a file from its beginning to its end, chunk by chunk, without looking at its indexes: so one that was cut
/// short is read up to there. Chunks may be compressed with zstd or lz4.
class McapReader {
 public:
  /// Throws Error naming the file when it cannot be read or is not an MCAP file.
  explicit McapReader(const std::string& path);

  /// Returns the next message; nothing at the end. Throws Error naming the file and the byte where it is damaged: a
  /// wrong checksum, a record that ends beyond its place, a channel that was not announced, another compression, more
  /// than kMaxRecordBytes.
  std::optional<McapMessage> next();
  /// Returns the message at a place that next() told. next() then goes on behind it. Throws Error as next() does.
  McapMessage read(const McapPlace& place);
  static constexpr std::uint64_t kMaxRecordBytes = 512u << 20;  ///< of a record, and of a chunk's contents

  /// Returns what is missing at the end, once it is reached ("cut short after 12345 bytes"); empty for a whole file.
  const std::string& missing() const { return missing_; }
  const std::string& path() const { return path_; }
  /// Returns what kind of recording it says to be: "ros2", "citylearn"; may be empty.
  const std::string& profile() const { return profile_; }
  /// Returns all metadata records so far, by name.
  const std::map<std::string, McapMetadata>& metadata() const { return metadata_; }

 private:
  struct Schema {
    std::string name, encoding, data;
  };
  bool read_record();
  void cut_short();
  void take_chunk(std::string_view content);
  void take_schema(std::string_view content);
  void take_channel(std::string_view content);
  McapMessage message(std::string_view content, std::uint64_t offset) const;
  [[noreturn]] void fail(const std::string& what, const std::string& remedy = "") const;

  const std::string path_;
  std::ifstream file_;
  std::uint64_t size_ = 0, at_ = 0;  // bytes of the file, and of those before the next record
  std::uint64_t record_ = 0;         // where the present one begins
  unsigned char opcode_ = 0;
  std::string content_;  // of the present record
  std::string chunk_;
  std::size_t chunk_at_ = 0;
  bool ended_ = false;
  std::string missing_, profile_;
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::string, McapMetadata> metadata_;
};

}  // namespace citylearn
