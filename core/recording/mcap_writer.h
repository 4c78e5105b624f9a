// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/recording/mcap.h"

namespace citylearn {

/// Writes one file. What was flushed survives the end of this process, whatever ends it.
class McapWriter {
 public:
  struct Options {
    std::string library;                              ///< names the program that writes
    McapMetadata about;                               ///< kept as the metadata "recording"
    std::size_t chunk_bytes = 1 << 20;                ///< a chunk is written when it has so many
    std::uint64_t chunk_nanoseconds = 1'000'000'000;  ///< or spans so much time
    std::string profile = "citylearn";                ///< what readers may expect (https://mcap.dev/spec/registry)
  };
  /// Throws Error naming the file when it is there already or cannot be made; so do all others when it cannot be
  /// written (disk full).
  McapWriter(const std::string& path, const Options& options);
  /// Without close(), what is not flushed is lost, and the file has no summary.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  /// Adds a channel and returns its number.
  std::uint16_t add(const McapChannel& channel);
  void write(std::uint16_t channel, std::uint64_t time, std::span<const std::byte> data);
  /// Writes the chunk that is being filled.
  void flush();
  /// Returns the time since which something waits to be flushed; 0: nothing does.
  std::uint64_t waiting_since() const { return chunk_.empty() ? 0 : chunk_first_; }
  /// Writes all that is left and the summary. Nothing can be written afterwards.
  void close();

  std::uint64_t bytes() const { return at_ + chunk_.size(); }

 private:
  using Index = std::vector<std::pair<std::uint64_t, std::uint64_t>>;  // time, offset in the chunk
  struct Channel {
    std::uint32_t written = 0;
    Index index;  // of the chunk that is being filled
  };
  struct Chunk {
    std::uint64_t first, last, start, length, index_length, size;
    std::map<std::uint16_t, std::uint64_t> indexes;
  };
  void put(std::string_view bytes);

  const std::string path_;
  const Options options_;
  int file_ = -1;
  std::uint64_t at_ = 0;                          // bytes in the file
  std::uint64_t about_ = 0, about_length_ = 0;    // of the metadata: where they are, and their bytes
  std::uint32_t crc_ = 0;                         // of them
  std::string schema_records_, channel_records_;  // for the summary
  std::vector<Channel> channels_;                 // number - 1
  std::string chunk_;                             // records
  std::uint64_t chunk_first_ = 0, chunk_last_ = 0;
  std::vector<Chunk> chunks_;
};

}  // namespace citylearn
