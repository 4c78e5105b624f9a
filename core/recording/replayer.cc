// SPDX-License-Identifier: Apache-2.0
#include "core/recording/replayer.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "core/exchange/timing.h"
#include "core/recording/wire_header.h"

namespace citylearn {
namespace {

constexpr int kMessagesPerPoll = 256;  // messages that one poll() plays at most

// A writer keeps few messages for readers that are behind (core/dds/middleware.h). So it is given time: these many of
// them within kReplayPeriod, half of what it keeps.
int most_in_period(Profile profile) {
  switch (profile) {
    case Profile::kState:
      return kMessagesPerPoll;  // the newest alone counts
    case Profile::kCommand:
      return 32;
    case Profile::kDurable:
      return 128;
    case Profile::kRos2:
    case Profile::kRos2Reliable:
      break;  // not recorded
  }
  return 1;
}

constexpr std::size_t kMaxUnacknowledged = 128;  // records of a log
constexpr int kResendBatch = 32;
constexpr std::size_t kMaxReplayedWriters = 4096;
constexpr std::size_t kMaxInboxes = 4096;

bool is(const Topic& topic, const Topic& other) { return topic.name == other.name; }

}  // namespace

std::vector<std::string> watched_topics() {
  return {topic_of<msg::ServiceStatus>().name, topic_of<msg::TraversalInfo>().name, topic_of<msg::RunInfo>().name,
          topic_of<msg::TrainingStat>().name,  topic_of<msg::EpisodeStat>().name,   topic_of<msg::Scene>().name,
          topic_of<msg::RouteMapChunk>().name, topic_of<msg::ImageChunk>().name};
}

double replay_speed(const std::string& text) {
  if (text == "max") return 0;
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value) || value <= 0)
    throw Error("is neither a number above 0 nor max", "--speed " + text);
  return value;
}

Replayer::Replayer(Middleware& middleware, const ReplayOptions& options)
    : middleware_(middleware), options_(options), clock_(options.begin()), all_(all_topics()) {
  if (options_.files.empty()) throw Error("there is nothing to be replayed", "", "name a recording");
  for (const std::string& given : options_.topics.empty() ? watched_topics() : options_.topics) {
    const std::string name = given.starts_with("citylearn/") ? given : "citylearn/" + given;
    const auto known = std::find_if(all_.begin(), all_.end(), [&](const Topic& topic) { return topic.name == name; });
    if (known == all_.end()) throw Error("unknown topic", "--topics " + given, "idl/ lists them");
    topics_[name] = &*known;
  }
  for (const std::string& file : options_.files) McapReader check(file);
  due_ = quiet_since_ = next_state_ = Clock::now();
}

// What comes.

void Replayer::hear() {
  const auto take = [this](Subscription& from, auto handle) {
    while (from.take(taken_)) try {
        handle();
      } catch (const Error&) {
        continue;  // not a message for us
      }
  };
  for (const auto& [service, inbox] : inboxes_) {
    take(*inbox.episode_acknowledgements, [this] { on_acknowledgement(topic_of<msg::EpisodeStat>()); });
    take(*inbox.training_acknowledgements, [this] { on_acknowledgement(topic_of<msg::TrainingStat>()); });
    take(*inbox.map_requests, [this] { on_chunk_request<msg::RouteMapRequest>(); });
    take(*inbox.image_requests, [this] { on_chunk_request<msg::ImageRequest>(); });
  }
}

/// Creates readers for what is sent to a recorded service from now on.
void Replayer::open_inbox(const std::string& session, const std::string& sender) {
  const std::string key = session + "/" + sender;
  if (inboxes_.size() >= kMaxInboxes || inboxes_.contains(key)) return;
  const auto subscribe = [&](const Topic& topic) {
    return middleware_.create_subscription(topic_at(topic, session, sender));
  };
  inboxes_[key] = {subscribe(topic_of<msg::EpisodeAcknowledgement>()),
                   subscribe(topic_of<msg::TrainingAcknowledgement>()), subscribe(topic_of<msg::RouteMapRequest>()),
                   subscribe(topic_of<msg::ImageRequest>())};
}

void Replayer::on_acknowledgement(const Topic& records) {
  msg::EpisodeAcknowledgement message;  // those of all logs have the same bytes
  decode(std::span<const std::byte>(taken_), message);
  acknowledged_ = true;
  const auto found =
      logs_.find({records.name, Key(message.writer().c_str(), message.writer_incarnation()), message.stream()});
  if (found == logs_.end()) return;
  ReplayedLog& replayed = found->second;
  const auto lacks = std::find_if(replayed.waiting.begin(), replayed.waiting.end(),
                                  [&](const auto& entry) { return entry.first > message.number(); });
  message.number() = replayed.log.acknowledged() + static_cast<std::uint64_t>(lacks - replayed.waiting.begin());
  const Clock::time_point now = Clock::now();
  if (replayed.log.acknowledge(message, now) == LogSender::Acknowledged::kYes) replayed.given_up = false;
  if (replayed.waiting.size() == replayed.log.kept()) return;
  while (replayed.waiting.size() > replayed.log.kept()) replayed.waiting.pop_front();
  replayed.progress = quiet_since_ = now;
}

/// Answers a request for recorded maps or pictures.
template <class Request>
void Replayer::on_chunk_request() {
  Request request;
  decode(std::span<const std::byte>(taken_), request);
  chunks_.answer(topic_of<Request>(), request, [this](const Topic& topic, const msg::Header& from, const Bytes& bytes) {
    writer(topic, topic, {from.sender().c_str(), from.incarnation()}).publisher->publish(bytes);
    ++figures_.repeated;
  });
}

void Replayer::send_again(Clock::time_point now) {
  for (auto& [key, replayed] : logs_) {
    if (replayed.waiting.empty()) continue;
    if (now - replayed.progress >= kReplayTimeout) {
      const char* record =
          std::get<std::string>(key) == topic_of<msg::EpisodeStat>().name ? "episode " : "training figures ";
      for (const std::string& recorder : replayed.log.lacking())
        figures_.remarks.push_back(recorder + " has not recorded " + record +
                                   std::to_string(replayed.waiting.front().first) + " of '" + std::get<Key>(key).first +
                                   "' and is not waited for any more");
      replayed.waiting.clear();
      replayed.log = LogSender(LogOptions(), {}, replayed.log.last() + 1);
      replayed.given_up = true;
      continue;
    }
    for (int count = 0; count < kResendBatch; ++count) {
      const auto next = replayed.log.next(now);
      if (!next) break;
      replayed.publisher->publish(replayed.waiting[next->number - replayed.log.acknowledged() - 1].second);
      ++figures_.repeated;
    }
  }
}

// What goes out.

/// Opens the next file. Returns false when there is no further one.
bool Replayer::open() {
  if (reader_ && !reader_->missing().empty()) figures_.remarks.push_back(reader_->path() + ": " + reader_->missing());
  if (recorded_.leaps() > 0)
    figures_.remarks.push_back(reader_->path() + ": its clock leaps " + std::to_string(recorded_.leaps()) +
                               " times; a leap ahead is played as 10 s, one back as none");
  recorded_.begin_file();
  reader_.reset();
  if (files_opened_ == options_.files.size()) return false;
  reader_ = std::make_unique<McapReader>(options_.files[files_opened_++]);
  return true;
}

/// Reads the next message to be played into next_ and bytes_. Returns false when there is none.
bool Replayer::fetch() {
  while (true) {
    if (!reader_ && !open()) return false;
    std::optional<McapMessage> message;
    while ((message = reader_->next())) {
      recorded_.follow(message->log_time);
      figures_.seconds = 1e-9 * static_cast<double>(recorded_.length());
      const McapChannel& channel = *message->channel;
      const auto topic = topics_.find(channel.topic);
      if (topic == topics_.end()) {
        if (!channel.topic.starts_with("citylearn/")) ++figures_.skipped["topic " + channel.topic + " is none of ours"];
        continue;
      }
      if (channel.encoding != "cdr" || channel.type != topic->second->type) {
        ++figures_.skipped["topic " + channel.topic + " has '" + channel.type + "' as '" + channel.encoding +
                           "' instead of '" + topic->second->type + "' as 'cdr'"];
        continue;
      }
      const auto header = header_of(message->data);
      if (!header || message->data.size() > topic->second->largest) {
        ++figures_.skipped["topic " + channel.topic + ": not readable"];
        continue;
      }
      if (header->protocol != msg::PROTOCOL) {
        ++figures_
              .skipped["of protocol " + std::to_string(header->protocol) + ", not " + std::to_string(msg::PROTOCOL)];
        continue;
      }
      if (options_.session.empty() || !with_session(message->data, options_.session, bytes_))
        bytes_.assign(message->data.begin(), message->data.end());
      const std::string session = options_.session.empty() ? header->session : options_.session;
      next_ = Next{topic->second, {header->sender, header->incarnation}, session, recorded_.position(), {}};
      // What cannot be decoded is played to all as it is: what it was then, it is now.
      try {
        next_->to = topics_of(*next_->topic, bytes_);
      } catch (const Error&) {
        next_->to = {*next_->topic};
      }
      return true;
    }
    if (!open()) return false;
  }
}

Replayer::ReplayedWriter& Replayer::writer(const Topic& all, const Topic& topic, const Key& sender) {
  auto key = std::make_tuple(topic.name, sender.first, sender.second);
  // No system has so many. Beyond them the senders of a topic share a writer.
  if (writers_.size() >= kMaxReplayedWriters && !writers_.contains(key)) key = {topic.name, "", 0};
  ReplayedWriter& writer = writers_[key];
  if (!writer.publisher) {
    writer.topic = &all;
    writer.publisher = middleware_.create_publisher(topic);
    writer.made = writer.period = Clock::now();
  }
  return writer;
}

/// Returns whether the next message would be too much for the readers.
bool Replayer::must_wait(ReplayedWriter& writer, Clock::time_point now) {
  if (!writer.awaited) {
    // A writer keeps little for a reader that comes late, so one is waited for where every reader needs all.
    const bool counts = writer.topic->profile == Profile::kDurable || writer.topic->profile == Profile::kCommand;
    const std::string& topic = writer.topic->name;
    if (writer.publisher->matched() > 0) {
      heard_.insert(topic);
    } else if (counts && now - (heard_.contains(topic) ? writer.made : *begun_) < kReplayTimeout) {
      return true;
    }
    writer.awaited = true;
  }
  if (now - writer.period >= kReplayPeriod) {
    writer.period = now;
    writer.in_period = 0;
  }
  return writer.in_period >= most_in_period(writer.topic->profile) ||
         (writer.log && writer.log->waiting.size() >= kMaxUnacknowledged);
}

void Replayer::publish(ReplayedWriter& writer, const Bytes& bytes) {
  writer.publisher->publish(bytes);
  ++writer.in_period;
  if (next_->published == 0) note_played(writer.topic->name, bytes.size());
}

void Replayer::note_played(const std::string& topic, std::size_t bytes) {
  ++figures_.played[topic];
  figures_.bytes += bytes;
}

/// Decodes the next record and finds its log. `first` of it says what the sender had at that time: here it becomes what
/// the recording has, from its first record on, and the present recorders lack. Returns the record's number.
template <class Record>
std::uint64_t Replayer::prepare(ReplayedWriter& writer, Record& record) {
  decode(std::span<const std::byte>(bytes_), record);
  msg::LogPosition& position = record.log();
  writer.log = &logs_[{writer.topic->name, next_->sender, position.stream()}];
  if (writer.log->begin == 0) writer.log->begin = position.number();
  std::uint64_t first = std::max(position.first(), std::min(writer.log->begin, position.number()));
  for (const auto& [number, bytes] : writer.log->waiting) first = std::min(first, number);
  if (first != position.first()) {
    position.first() = first;
    encode(record, bytes_);
  }
  return position.number();
}

/// Keeps the record until it is acknowledged.
void Replayer::keep(ReplayedWriter& writer, std::uint64_t number, Clock::time_point now) {
  if (!first_record_) first_record_ = now;
  ReplayedLog& replayed = *writer.log;
  replayed.publisher = writer.publisher.get();
  // Without a recorder that acknowledges, none is waited for.
  if (replayed.given_up || (!acknowledged_ && now - *first_record_ > kReplayTimeout)) return;
  if (replayed.waiting.empty()) replayed.progress = now;
  replayed.waiting.emplace_back(number, bytes_);
  replayed.log.add();
  replayed.log.next(now);  // it went out
}

void Replayer::play(ReplayedWriter& writer) {
  std::uint64_t number = 0;
  // What cannot be decoded is played as it is: what it was then, it is now.
  try {
    if (is(*writer.topic, topic_of<msg::EpisodeStat>()))
      number = prepare(writer, episode_);
    else if (is(*writer.topic, topic_of<msg::TrainingStat>()))
      number = prepare(writer, stat_);
    else if (is(*writer.topic, topic_of<msg::RunInfo>()))
      writer.last = bytes_;
  } catch (const Error&) {
  }
  publish(writer, bytes_);
  if (number > 0) keep(writer, number, Clock::now());
}

/// Returns whether every reader has what there was. Called after the last message.
bool Replayer::settled(Clock::time_point now) {
  if (!over_) over_ = quiet_since_ = now;
  const bool waited_for =
      std::any_of(logs_.begin(), logs_.end(), [](const auto& entry) { return !entry.second.waiting.empty(); });
  if ((!waited_for && now - quiet_since_ >= kReplayQuiet) || now - *over_ >= kReplayEnd) return true;
  // A recorder reads the figures of a run only once it has heard of it.
  if (now >= next_state_) {
    next_state_ = now + kHeartbeat;
    for (auto& [key, writer] : writers_)
      if (!writer.last.empty()) writer.publisher->publish(writer.last);
  }
  due_ = now + kReplayPoll;
  return false;
}

bool Replayer::poll() {
  hear();
  Clock::time_point now = Clock::now();
  send_again(now);
  due_ = now;  // there may be more
  for (int played = 0; played < kMessagesPerPoll; ++played) {
    if (!next_ && !fetch()) {
      clock_.end(recorded_.length());
      return !settled(now);
    }
    if (const Clock::time_point due = clock_.due(next_->position); due > now) {
      due_ = std::min(due, now + kLogResend);
      held_since_.reset();  // a pause is not a wait for readers
      return true;
    }
    if (!begun_) begun_ = now;
    open_inbox(next_->session, next_->sender.first);
    if (chunks_.keep(*next_->topic, bytes_)) {
      note_played(next_->topic->name, bytes_.size());
      next_.reset();
      continue;
    }
    ReplayedWriter& to = writer(*next_->topic, next_->to.at(next_->published), next_->sender);
    if (must_wait(to, now)) {
      if (!held_since_) held_since_ = now;
      due_ = now + kReplayPoll;
      return true;
    }
    if (held_since_) {
      clock_.delay(now - *held_since_);
      held_since_.reset();
    }
    play(to);
    if (++next_->published == next_->to.size()) next_.reset();
    now = Clock::now();
  }
  return true;
}

}  // namespace citylearn
