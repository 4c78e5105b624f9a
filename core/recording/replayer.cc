// SPDX-License-Identifier: Apache-2.0
#include "core/recording/replayer.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/exchange/timing.h"
#include "core/recording/wire_header.h"

namespace citylearn {
namespace {

constexpr int kMessagesPerPoll = 256;  // messages that one poll() plays at most

// A writer keeps few messages for readers that are behind (core/dds/middleware.h). So it is given time: these many of
// them within kReplayPeriod, half of what it keeps.
int most_in_period(Profile profile) {
  if (profile == Profile::kState) return kMessagesPerPoll;  // the newest alone counts
  return profile == Profile::kCommand ? 32 : 128;
}

constexpr std::size_t kMaxUnacknowledged = 128;  // records of a log
constexpr int kResendBatch = 32;
constexpr std::size_t kMaxReplayedWriters = 4096;
constexpr std::size_t kMaxServices = 4096;

}  // namespace

std::vector<std::string> watched_topics() {
  return {topic_of<msg::ServiceStatus>().name, topic_of<msg::TraversalInfo>().name, topic_of<msg::RunInfo>().name,
          topic_of<msg::TrainingStat>().name,  topic_of<msg::EpisodeStat>().name,   topic_of<msg::Scene>().name,
          topic_of<msg::RouteMapChunk>().name, topic_of<msg::StreetsChunk>().name,  topic_of<msg::ImageChunk>().name};
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
    : middleware_(middleware), options_(options), clock_(options.speed), all_(all_topics()) {
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
  for (auto& [subscription, handle] : inboxes_)
    while (subscription->take(taken_)) try {
        handle();
      } catch (const Error&) {
        continue;  // not a message for us
      }
}

/// Creates readers for what is sent to a recorded service from now on.
void Replayer::open_inboxes(const std::string& session, const std::string& service) {
  if (services_.size() >= kMaxServices || !services_.emplace(session, service).second) return;
  const auto open = [&](const Topic& topic, std::function<void()> handle) {
    inboxes_.push_back({middleware_.create_subscription(topic_at(topic, session, service)), std::move(handle)});
  };
  open(topic_of<msg::EpisodeAcknowledgement>(), [this] { on_acknowledgement(topic_of<msg::EpisodeStat>()); });
  open(topic_of<msg::TrainingAcknowledgement>(), [this] { on_acknowledgement(topic_of<msg::TrainingStat>()); });
  open(topic_of<msg::RouteMapRequest>(), [this] { on_request(maps_); });
  open(topic_of<msg::StreetsRequest>(), [this] { on_request(streets_); });
  open(topic_of<msg::ImageRequest>(), [this] { on_request(pictures_); });
}

void Replayer::on_acknowledgement(const Topic& records) {
  msg::EpisodeAcknowledgement message;  // those of all logs have the same bytes
  decode(std::span<const std::byte>(taken_), message);
  acknowledged_ = true;
  const auto found =
      logs_.find({records.name, Key(message.writer().c_str(), message.writer_incarnation()), message.stream()});
  if (found == logs_.end()) return;
  ReplayedLog& replayed = found->second;
  const auto lacks = replayed.waiting.upper_bound(message.number());
  message.number() =
      replayed.log.acknowledged() + static_cast<std::uint64_t>(std::distance(replayed.waiting.begin(), lacks));
  const Clock::time_point now = Clock::now();
  if (replayed.log.acknowledge(message, now) == LogSender::Acknowledged::kYes) replayed.given_up = false;
  if (replayed.waiting.size() > replayed.log.kept()) replayed.progress = quiet_since_ = now;
  while (replayed.waiting.size() > replayed.log.kept()) replayed.waiting.erase(replayed.waiting.begin());
}

void Replayer::on_request(const ChunkStore& chunks) {
  msg::ImageRequest request;  // those of all objects have the same bytes
  decode(std::span<const std::byte>(taken_), request);
  chunks.answer(request, [this](const Topic& topic, const msg::ObjectChunk& chunk, const Bytes& bytes) {
    const msg::Header& from = chunk.header();
    writer(topic, {from.sender().c_str(), from.incarnation()}).publisher->publish(bytes);
    ++figures_.repeated;
  });
}

void Replayer::send_again(Clock::time_point now) {
  for (auto& [key, replayed] : logs_) {
    if (replayed.waiting.empty()) continue;
    if (now - replayed.progress >= kReplayTimeout) {
      const auto& [topic, sender, stream] = key;
      const char* record = topic == topic_of<msg::EpisodeStat>().name ? "episode " : "training figures ";
      for (const std::string& recorder : replayed.log.lacking())
        figures_.remarks.push_back(recorder + " has not recorded " + record +
                                   std::to_string(replayed.waiting.begin()->first) + " of '" + sender.first +
                                   "' and is not waited for any more");
      replayed.waiting.clear();
      replayed.log = LogSender(LogOptions());
      replayed.given_up = true;
    }
    for (int count = 0; count < kResendBatch; ++count) {
      const auto next = replayed.log.next(now);
      if (!next) break;
      const auto place = static_cast<std::ptrdiff_t>(next->number - replayed.log.acknowledged() - 1);
      replayed.publisher->publish(std::next(replayed.waiting.begin(), place)->second);
      ++figures_.repeated;
    }
  }
}

// What goes out.

/// Returns the next message of the files; nothing at their end.
std::optional<McapMessage> Replayer::read() {
  while (true) {
    if (reader_) {
      if (auto message = reader_->next()) return message;
      if (!reader_->missing().empty()) figures_.remarks.push_back(reader_->path() + ": " + reader_->missing());
      if (recorded_.leaps() > 0)
        figures_.remarks.push_back(reader_->path() + ": its clock leaps " + std::to_string(recorded_.leaps()) +
                                   " times; a leap ahead is played as 10 s, one back as none");
      reader_.reset();
    }
    if (files_opened_ == options_.files.size()) return std::nullopt;
    recorded_.begin_file();
    reader_ = std::make_unique<McapReader>(options_.files[files_opened_++]);
  }
}

/// Reads the next message to be played into next_ and bytes_. Returns false when there is none.
bool Replayer::fetch() {
  while (const std::optional<McapMessage> message = read()) {
    recorded_.follow(message->log_time);
    figures_.seconds = 1e-9 * static_cast<double>(recorded_.length());
    const McapChannel& channel = *message->channel;
    const auto topic = topics_.find(channel.topic);
    if (topic == topics_.end() && channel.topic.starts_with("citylearn/")) continue;
    const auto header = header_of(message->data);
    std::string fault;
    if (topic == topics_.end())
      fault = "topic " + channel.topic + " is none of ours";
    else if (channel.encoding != "cdr" || channel.type != topic->second->type)
      fault = "topic " + channel.topic + " has '" + channel.type + "' as '" + channel.encoding + "' instead of '" +
              topic->second->type + "' as 'cdr'";
    else if (!header || message->data.size() > topic->second->largest)
      fault = "topic " + channel.topic + ": not readable";
    else if (header->protocol != msg::PROTOCOL)
      fault = "of protocol " + std::to_string(header->protocol) + ", not " + std::to_string(msg::PROTOCOL);
    if (!fault.empty()) {
      ++figures_.skipped[fault];
      continue;
    }
    if (options_.session.empty() || !with_session(message->data, options_.session, bytes_))
      bytes_.assign(message->data.begin(), message->data.end());
    open_inboxes(options_.session.empty() ? header->session : options_.session, header->sender);
    next_ = Next{topic->second, {header->sender, header->incarnation}, recorded_.position(), {}};
    // What cannot be decoded is played to all as it is: what it was then, it is now.
    try {
      next_->to = topics_of(*next_->topic, bytes_);
    } catch (const Error&) {
      next_->to = {*next_->topic};
    }
    return true;
  }
  return false;
}

Replayer::ReplayedWriter& Replayer::writer(const Topic& topic, const Key& sender) {
  auto key = std::make_tuple(topic.name, sender.first, sender.second);
  // No system has so many. Beyond them the senders of a topic share a writer.
  if (writers_.size() >= kMaxReplayedWriters && !writers_.contains(key)) key = {topic.name, "", 0};
  ReplayedWriter& writer = writers_[key];
  if (!writer.publisher) {
    writer.publisher = middleware_.create_publisher(topic);
    writer.made = writer.period = Clock::now();
  }
  return writer;
}

/// Returns whether the next message would be too much for the readers.
bool Replayer::must_wait(ReplayedWriter& writer, Clock::time_point now) {
  const Topic& topic = *next_->topic;
  if (!writer.awaited) {
    // A writer keeps little for a reader that comes late, so one is waited for where every reader needs all.
    if (writer.publisher->matched() > 0)
      heard_.insert(topic.name);
    else if (topic.profile != Profile::kState &&
             now - (heard_.contains(topic.name) ? writer.made : *begun_) < kReplayTimeout)
      return true;
    writer.awaited = true;
  }
  if (now - writer.period >= kReplayPeriod) {
    writer.period = now;
    writer.in_period = 0;
  }
  return writer.in_period >= most_in_period(topic.profile) ||
         (writer.log && writer.log->waiting.size() >= kMaxUnacknowledged);
}

/// Keeps the next record until it is acknowledged. `first` of it says what the sender had at that time: here it becomes
/// what the recording has, from its first record on, and the present recorders lack.
template <class Record>
void Replayer::keep(ReplayedWriter& writer, Record& record, Clock::time_point now) {
  decode(std::span<const std::byte>(bytes_), record);
  msg::LogPosition& position = record.log();
  const std::uint64_t number = position.number();
  writer.log = &logs_[{next_->topic->name, next_->sender, position.stream()}];
  ReplayedLog& replayed = *writer.log;
  replayed.publisher = writer.publisher.get();
  if (replayed.begin == 0) replayed.begin = number;
  std::uint64_t first = std::max(position.first(), std::min(replayed.begin, number));
  if (!replayed.waiting.empty()) first = std::min(first, replayed.waiting.begin()->first);
  if (std::exchange(position.first(), first) != first) encode(record, bytes_);
  if (!first_record_) first_record_ = now;
  // Without a recorder that acknowledges, none is waited for.
  if (replayed.given_up || (!acknowledged_ && now - *first_record_ > kReplayTimeout)) return;
  if (replayed.waiting.empty()) replayed.progress = now;
  if (number == 0 || !replayed.waiting.emplace(number, bytes_).second) return;
  replayed.log.add();
  replayed.log.next(now);  // it goes out
}

void Replayer::play(ReplayedWriter& writer, Clock::time_point now) {
  const std::string& topic = next_->topic->name;
  // What cannot be decoded is played as it is: what it was then, it is now.
  try {
    if (topic == topic_of<msg::EpisodeStat>().name)
      keep(writer, episode_, now);
    else if (topic == topic_of<msg::TrainingStat>().name)
      keep(writer, stat_, now);
    else if (topic == topic_of<msg::RunInfo>().name)
      writer.last = bytes_;
  } catch (const Error&) {
  }
  writer.publisher->publish(bytes_);
  ++writer.in_period;
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
      held_since_.reset();
      return true;
    }
    if (!begun_) begun_ = now;
    if (!maps_.keep(*next_->topic, bytes_) && !streets_.keep(*next_->topic, bytes_) &&
        !pictures_.keep(*next_->topic, bytes_)) {
      ReplayedWriter& to = writer(next_->to.at(next_->published), next_->sender);
      if (must_wait(to, now)) {
        if (!held_since_) held_since_ = now;
        due_ = now + kReplayPoll;
        return true;
      }
      if (held_since_) clock_.delay(now - *held_since_);
      held_since_.reset();
      play(to, now);
      now = Clock::now();
      if (++next_->published < next_->to.size()) continue;
    }
    ++figures_.played[next_->topic->name];
    figures_.bytes += bytes_.size();
    next_.reset();
  }
  return true;
}

}  // namespace citylearn
