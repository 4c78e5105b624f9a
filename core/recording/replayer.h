// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/exchange/log_sender.h"
#include "core/recording/chunk_store.h"
#include "core/recording/mcap.h"
#include "core/recording/recording_clock.h"
#include "core/recording/replay_clock.h"
#include "core/recording/replay_options.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Plays recordings into a middleware: the recorded bytes on their topics, each sender with writers of its own, in the
/// order and at the distance in time in which they came. Sends episodes and training figures again until recorders
/// acknowledge them, and maps and pictures to the service that asks now, so that recorders get all of them at any
/// speed. Used by one thread, but for clock().
class Replayer {
 public:
  /// `middleware` must outlive it. Throws Error when a file is not an MCAP recording, or a topic is unknown.
  Replayer(Middleware& middleware, const ReplayOptions& options);

  /// Plays what is due. Call it when a message may have arrived, and at due(). Returns false when all is played and no
  /// reader waits for more. Throws Error naming the byte where a file is damaged; what stands before it was played.
  bool poll();
  Clock::time_point due() const { return due_; }
  const ReplayFigures& figures() const { return figures_; }
  /// Any thread may use it as ReplayClock says.
  const ReplayClock& clock() const { return clock_; }

 private:
  using Key = std::pair<std::string, std::uint64_t>;  // sender and incarnation
  /// Records of one log that wait to be acknowledged. A recording lacks records, repeats some and has others late, so a
  /// LogSender numbers those that wait anew, without gaps.
  struct ReplayedLog {
    LogSender log{LogOptions()};
    std::map<std::uint64_t, Bytes> waiting;  // by the number in the recording
    std::uint64_t begin = 0;                 // number of the record played first
    Clock::time_point progress;
    Publisher* publisher = nullptr;
    bool given_up = false;  // no acknowledgement came for long
  };
  /// The writer of one recorded sender on one topic.
  struct ReplayedWriter {
    std::unique_ptr<Publisher> publisher;
    Clock::time_point made, period;
    int in_period = 0;
    bool awaited = false;        // a reader is there, or none came
    Bytes last;                  // of RunInfo
    ReplayedLog* log = nullptr;  // of the record played last
  };
  struct Next {
    const Topic* topic = nullptr;  // that every service reads
    Key sender;
    std::int64_t position = 0;  // nanoseconds
    std::vector<Topic> to;      // on which it goes out
    std::size_t published = 0;  // topics of `to`
  };
  /// Reads one kind of what is sent to a recorded service now.
  struct Inbox {
    std::unique_ptr<Subscription> subscription;
    std::function<void()> handle;  // taken_
  };

  std::optional<McapMessage> read();
  bool fetch();
  ReplayedWriter& writer(const Topic& topic, const Key& sender);
  void open_inboxes(const std::string& session, const std::string& service);
  bool must_wait(ReplayedWriter& writer, Clock::time_point now);
  template <class Record>
  void keep(ReplayedWriter& writer, Record& record, Clock::time_point now);
  void play(ReplayedWriter& writer, Clock::time_point now);
  void hear();
  void on_acknowledgement(const Topic& records);
  void on_request(const ChunkStore& chunks);
  void send_again(Clock::time_point now);
  bool settled(Clock::time_point now);

  Middleware& middleware_;
  const ReplayOptions options_;
  ReplayClock clock_;
  std::map<std::string, const Topic*> topics_;  // to be played
  std::vector<Topic> all_;
  std::set<std::pair<std::string, std::string>> services_;  // recorded: session and id
  std::vector<Inbox> inboxes_;
  std::size_t files_opened_ = 0;
  std::unique_ptr<McapReader> reader_;
  std::optional<Next> next_;
  Bytes bytes_;  // of next_
  RecordingClock recorded_;
  std::optional<Clock::time_point> held_since_, begun_;  // begun_: the first message was to be played
  std::map<std::tuple<std::string, std::string, std::uint64_t>, ReplayedWriter> writers_;  // by topic and sender
  std::set<std::string> heard_;                                                            // topics with a reader
  std::map<std::tuple<std::string, Key, std::uint64_t>, ReplayedLog> logs_;  // by topic, sender and stream
  std::optional<Clock::time_point> first_record_, over_;
  bool acknowledged_ = false;  // a recorder has acknowledged
  ChunkStore maps_{topic_of<msg::RouteMapChunk>()}, streets_{topic_of<msg::StreetsChunk>()},
      pictures_{topic_of<msg::ImageChunk>()};
  Clock::time_point due_, quiet_since_, next_state_;
  ReplayFigures figures_;
  Bytes taken_;
  msg::EpisodeStat episode_;
  msg::TrainingStat stat_;
};

}  // namespace citylearn
