// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "core/dds/middleware.h"
#include "core/recording/mcap_writer.h"
#include "core/recording/wire_header.h"

namespace citylearn {

struct RecordingOptions {
  std::string output;               ///< FILE.mcap; the next parts are FILE-2.mcap, FILE-3.mcap ...
  std::string session;              ///< messages of other sessions are skipped; empty: all are recorded
  std::vector<std::string> topics;  ///< "scene" or "citylearn/scene"; empty: all
  std::uint64_t split = 0;          ///< bytes of a file at which the next part begins; 0: never
  std::string library;              ///< for the files' headers
};

/// Writes the messages of a domain to MCAP files: the bytes as they came, one channel a message type, whatever
/// services' topics they were sent on. It publishes and acknowledges nothing, and decodes only the headers. What is
/// sent on a topic of one service is recorded from when that topic is discovered, but for the newest message before.
/// Used by one thread.
class Recording {
 public:
  /// `middleware` must outlive it. Throws Error when a topic is unknown or the file cannot be made; the other methods
  /// throw when it cannot be written.
  Recording(Middleware& middleware, const RecordingOptions& options);

  /// Begins to record topics of services that were discovered since, and writes what has come. Flushes a chunk to disk
  /// when something has waited for a second.
  void poll();
  /// Writes what has come until now, and the summary.
  void close();

  struct Count {
    std::uint64_t messages = 0, bytes = 0;
    std::uint64_t missed = 0;  ///< by the senders' own count, since they were first heard; 0 for topics of kState
    auto operator<=>(const Count&) const = default;
  };
  const std::map<std::string, Count>& counts() const { return counts_; }  ///< by topic
  const std::vector<std::string>& files() const { return files_; }
  std::uint64_t other_sessions() const { return other_sessions_; }  ///< messages skipped

 private:
  struct Source {
    const Topic* topic;  // that every service reads
    std::unique_ptr<Subscription> subscription;
  };
  void begin_file();
  void find_topics();
  void write(const std::string& name, const Source& source);
  void follow(const std::string& name, const Source& source, const WireHeader& header);

  Middleware& middleware_;
  const RecordingOptions options_;
  std::map<std::string, Topic> topics_;             // that are recorded, by name: those of all
  std::map<std::string, Source> sources_;           // by topic
  std::map<const Topic*, std::uint16_t> channels_;  // in the present file
  Clock::time_point next_look_{};
  std::unique_ptr<McapWriter> writer_;
  std::vector<std::string> files_;
  std::map<std::string, Count> counts_;
  std::map<std::tuple<std::string, std::string, std::uint64_t>, std::uint64_t> newest_;  // by topic and sender
  std::uint64_t other_sessions_ = 0;
  Bytes taken_;
};

}  // namespace citylearn
