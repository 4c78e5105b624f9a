// SPDX-License-Identifier: Apache-2.0
#include "core/exchange/log_sender.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "idl/common.h"

namespace citylearn {

LogSender::LogSender(const LogOptions& options, const std::vector<std::string>& required, std::uint64_t first)
    : options_(options), last_(first - 1), discarded_(last_), sent_(last_), limit_(last_) {
  for (const std::string& name : required) readers_[name].registered = true;
  for (auto& [name, reader] : readers_) reader.acknowledged = reader.sent = reader.limit = last_;
  registered_ = readers_.size();
}

template <class Log, class Visit>
void LogSender::each_reader(Log& log, Visit visit) {
  if (log.registered_ == 0 && !log.options_.keeps_all) visit(log.anonymous_reader_);
  for (auto& [name, reader] : log.readers_)
    if (reader.registered) visit(reader);
}

std::uint64_t LogSender::add() {
  ++last_;
  if (kept() > options_.capacity && !options_.keeps_all) enforce_capacity();
  return last_;
}

// Readers.

bool LogSender::Reader::hear(const msg::Header& header, Clock::time_point now) {
  const Incumbent::Heard heard = presence.hear(header.incarnation(), now);
  if (heard == Incumbent::Heard::kSuccessor) {
    order = MessageOrder();
    fresh = true;
  }
  return heard != Incumbent::Heard::kOther;
}

bool LogSender::has_room(const std::string& name, Clock::time_point now) {
  if (readers_.size() < options_.max_readers || readers_.contains(name)) return true;
  const auto gone = std::find_if(readers_.begin(), readers_.end(), [&](const auto& entry) {
    return !entry.second.registered && !entry.second.presence.here(now);
  });
  if (gone == readers_.end()) return false;
  readers_.erase(gone);
  return true;
}

LogSender::Acknowledged LogSender::acknowledge(const msg::LogAcknowledgement& acknowledgement, Clock::time_point now) {
  const msg::Header& from = acknowledgement.header();
  const std::uint64_t number = acknowledgement.number();
  if (number > last_) return Acknowledged::kImpossible;
  const std::string name = from.sender().c_str();
  if (!has_room(name, now)) return Acknowledged::kTooMany;
  Reader& reader = readers_[name];
  if (!reader.hear(from, now) || !reader.order.in_order(from, now) || (gives_credit() && number < discarded_))
    return Acknowledged::kRepeated;
  limit_ = acknowledgement.limit();
  // A log with a credit window belongs to one process, which lacks nothing that was sent before it came.
  const bool fresh = (std::exchange(reader.fresh, false) || !reader.registered) && !gives_credit();
  const bool leaves = acknowledgement.state() == msg::LEAVES;
  reader.stopping = acknowledgement.state() != msg::READS;
  if (reader.stopping) reader.presence.leave();
  const std::uint64_t has = std::max(number, discarded_);
  const bool progress = has > reader.acknowledged, loss = has < reader.acknowledged;
  if (!reader.registered) {
    if (leaves) return Acknowledged::kRepeated;
    reader.registered = true;
    ++registered_;
  }
  if (fresh || loss) reader.sent = has;
  reader.acknowledged = has;
  if (progress && gives_credit()) answer_time_ = now - reader.waits_since;
  if (fresh || loss)
    open_window(reader, options_.resend_window, now);
  else if (progress)
    open_window(reader, options_.send_window, now);
  discard_acknowledged();
  if (leaves) unregister(reader);
  return fresh || loss || progress || leaves || gives_credit() ? Acknowledged::kYes : Acknowledged::kRepeated;
}

void LogSender::force_successor(const msg::Header& header, Clock::time_point now) {
  const auto found = readers_.find(header.sender().c_str());
  if (found == readers_.end() || found->second.presence.incarnation() == header.incarnation()) return;
  found->second.presence.leave();
  found->second.hear(header, now);
}

bool LogSender::reader_expected(Clock::time_point now) const {
  return std::any_of(readers_.begin(), readers_.end(), [&](const auto& entry) {
    const Reader& reader = entry.second;
    if (!reader.registered || reader.acknowledged == last_) return false;
    // A reader that was started again a moment ago is expected too.
    return (!reader.stopping && reader.presence.here(now)) || reader.presence.has_rival(now);
  });
}

std::vector<std::string> LogSender::readers() const {
  std::vector<std::string> names;
  for (const auto& [name, reader] : readers_)
    if (reader.registered) names.push_back(name);
  return names;
}

std::vector<std::string> LogSender::lacking() const {
  std::vector<std::string> names;
  for (const auto& [name, reader] : readers_)
    if (reader.registered && reader.acknowledged < last_) names.push_back("'" + name + "'");
  return names;
}

void LogSender::unregister(Reader& reader) {
  reader.registered = false;
  reader.acknowledged = 0;
  if (--registered_ > 0) discard_acknowledged();
}

void LogSender::discard_acknowledged() {
  std::uint64_t all = last_;
  for (const auto& [name, reader] : readers_)
    if (reader.registered) all = std::min(all, reader.acknowledged);
  if (registered_ > 0 && !options_.keeps_all) discard(all);
}

void LogSender::discard(std::uint64_t up_to) {
  if (up_to <= discarded_) return;
  discarded_ = up_to;
  sent_ = std::max(sent_, discarded_);
  anonymous_reader_.acknowledged = discarded_;
  anonymous_reader_.sent = std::max(anonymous_reader_.sent, discarded_);
  anonymous_reader_.limit = std::max(anonymous_reader_.limit, anonymous_reader_.sent);
}

/// Gives up a reader that does not come before it gives up memory, or the records of the others.
void LogSender::enforce_capacity() {
  const std::string many = "more than " + std::to_string(options_.capacity) + " " + options_.records;
  while (kept() > options_.capacity && registered_ > 0) {
    auto furthest = readers_.end();
    for (auto reader = readers_.begin(); reader != readers_.end(); ++reader) {
      const auto key = [](const auto& of) {
        return std::make_tuple(of->second.acknowledged, of->second.presence.last_heard());
      };
      if (reader->second.registered && (furthest == readers_.end() || key(reader) < key(furthest))) furthest = reader;
    }
    problem_ = many + " wait for " + options_.reader + " '" + furthest->first + "': they are no longer kept for it";
    unregister(furthest->second);
  }
  if (kept() <= options_.capacity) return;
  problem_ = many + " and no " + options_.reader + ": the oldest are lost";
  discard(last_ - options_.capacity);
}

// Sending.

/// Returns the number of the last record that may be sent now.
std::uint64_t LogSender::sendable() const {
  return gives_credit() ? std::min({last_, limit_, discarded_ + options_.credit_window}) : last_;
}

/// Gives the reader a while to answer.
void LogSender::begin_wait(Reader& reader, Clock::time_point now) const {
  reader.waits_since = now;
  reader.interval = std::clamp<Clock::duration>(2 * answer_time_, kLogResend, kLogResendMax);
  reader.again = now + reader.interval;
}

/// Lets the next `window` records be on their way to the reader, which has a while to answer.
void LogSender::open_window(Reader& reader, std::uint64_t window, Clock::time_point now) const {
  reader.sent = std::max(reader.sent, reader.acknowledged);
  reader.limit = std::max(reader.sent, std::min(sent_, reader.acknowledged + window));
  begin_wait(reader, now);
}

std::optional<LogSender::Sending> LogSender::next(Clock::time_point now) {
  std::optional<Sending> found;
  if (sent_ < sendable()) {
    found = Sending{++sent_, false};
  } else {
    each_reader(*this, [&](Reader& reader) {
      if (reader.acknowledged < sent_ && now >= reader.again) {
        reader.sent = reader.acknowledged;
        reader.limit = std::min(sent_, reader.acknowledged + options_.resend_window);
        reader.interval = std::min<Clock::duration>(2 * reader.interval, kLogResendMax);
        reader.again = now + reader.interval;
      }
      if (!found && reader.sent < reader.limit) found = Sending{reader.sent + 1, true};
    });
  }
  if (!found) return found;
  // All readers hear it, so those that would have got it next have got it.
  each_reader(*this, [&](Reader& reader) {
    if (reader.sent + 1 != found->number) return;
    // The reader's wait begins now.
    if (reader.sent == reader.acknowledged && !found->again) open_window(reader, 0, now);
    ++reader.sent;
    reader.limit = std::max(reader.limit, reader.sent);
  });
  return found;
}

msg::LogPosition LogSender::position(std::uint64_t number, std::uint64_t stream) const {
  msg::LogPosition position;
  position.stream(stream);
  position.number(number);
  position.first(discarded_ + 1);
  return position;
}

Clock::time_point LogSender::due() const {
  if (sent_ < sendable()) return {};
  Clock::time_point due = Clock::time_point::max();
  each_reader(*this, [&](const Reader& reader) {
    if (reader.sent < reader.limit)
      due = {};
    else if (reader.acknowledged < sent_)
      due = std::min(due, reader.again);
  });
  return due;
}

void LogSender::hurry(Clock::time_point now) {
  each_reader(*this, [&](Reader& reader) {
    reader.interval = kLogHurried;
    reader.again = now;
  });
}

}  // namespace citylearn
