// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/roster_thread.h"

#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "core/exchange/timing.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/machine.h"
#include "core/util/text.h"
#include "core/util/version.h"
#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

std::string incarnation_of(int rank) {
  return std::to_string(rank) + "-" + std::to_string(process_number()) + "-" +
         std::to_string(microseconds_since_epoch());
}

}  // namespace

Roster::Thread::Thread(const RosterOptions& options)
    : options_(options),
      incarnation_(incarnation_of(options.rank)),
      rendezvous_(parse_rank_address(options.rendezvous, "--rendezvous")),
      own_{local_host_towards(rendezvous_), 0},
      listener_(listen_at(own_)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      coordinator_(incarnation_, [this](int connection, const Json* message) {
        const auto found = accepted_.find(connection);
        if (found == accepted_.end()) return;
        if (message)
          found->second.stream.send(*message);
        else
          found->second.closing = true;
      }) {
  if (!listener_) throw Error("cannot listen at " + own_.host, "ranks");
  last_turn_ = Clock::now();
  thread_ = std::thread([this] { run(); });
}

Roster::Thread::~Thread() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  ::eventfd_write(wake_.get(), 1);
  thread_.join();
}

// For the other thread.

Roster::Thread::Json Roster::Thread::ask(Json question, const std::string& answer, const std::function<void()>& idle) {
  std::unique_lock lock(mutex_);
  answer_.reset();
  question_ = std::move(question);
  outbox_.push_back(Json());  // the question
  ::eventfd_write(wake_.get(), 1);
  while (!failure_) {
    if (answer_ && answer_->at("type") == answer) return *std::exchange(answer_, std::nullopt);
    changed_.wait_for(lock, kStopCheckInterval);
    if (!idle) continue;
    lock.unlock();
    idle();
    lock.lock();
  }
  throw Error(failure_->first, "rank " + std::to_string(options_.rank), failure_->second);
}

void Roster::Thread::tell(const Json& message) {
  const std::lock_guard lock(mutex_);
  outbox_.push_back(message);
  ::eventfd_write(wake_.get(), 1);
}

bool Roster::Thread::stored(std::uint64_t meeting, const std::string& key, Clock::time_point deadline,
                            std::vector<char>& value) {
  std::unique_lock lock(mutex_);
  const auto here = [&] { return store_meeting_ == meeting && store_.contains(key); };
  if (!changed_.wait_until(lock, deadline, here)) return false;
  value = store_.at(key);
  return true;
}

void Roster::Thread::leave() {
  const std::lock_guard lock(mutex_);
  leaving_ = true;
  ::eventfd_write(wake_.get(), 1);
}

// For its own thread.

void Roster::Thread::run() {
  while (true) {
    wait_for_sockets();
    const Clock::time_point now = Clock::now();
    if (now - std::exchange(last_turn_, now) > kRankPaused) {
      coordinator_.reset_silence_timers(now);
      heard_ = now;
    }
    std::deque<Json> outbox;
    {
      const std::lock_guard lock(mutex_);
      if (stop_) break;
      std::swap(outbox, outbox_);
      if (leaving_ && !left_) {
        left_ = true;
        if (link_ && is_member_) link_->send({{"type", "leave"}});
        is_member_ = false;
        front_ = OwnedSocket();
      }
    }
    for (const Json& message : outbox) {
      if (message.is_null())
        resend();
      else if (link_ && is_member_)
        link_->send(message);
    }
    open_front(now);
    serve(now);
    coordinate(now);
    follow(now);
  }
  for (auto& [connection, accepted] : accepted_) accepted.stream.flush();
  if (link_) link_->flush();
}

void Roster::Thread::wait_for_sockets() {
  std::vector<pollfd> all = {{wake_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
  if (front_) all.push_back({front_.get(), POLLIN, 0});
  const auto add = [&](const MessageStream& stream) {
    all.push_back({stream.descriptor(), static_cast<short>(stream.sending() ? POLLIN | POLLOUT : POLLIN), 0});
  };
  for (const auto& [connection, accepted] : accepted_) add(accepted.stream);
  if (link_) add(*link_);
  if (probe_) add(*probe_);
  ::poll(all.data(), all.size(), static_cast<int>(kStopCheckInterval.count()));
  eventfd_t none = 0;
  ::eventfd_read(wake_.get(), &none);
}

/// Every process that can listen at the rendezvous does so, one at a time, so that new ranks find the others.
void Roster::Thread::open_front(Clock::time_point now) {
  if (front_ || left_ || now < next_front_) return;
  next_front_ = now + kRankProbe;
  if (options_.rank > 0 && now - start_ < kRankPrecedence) return;
  RankAddress address = rendezvous_;
  front_ = listen_at(address);
  next_search_ = now;
}

void Roster::Thread::serve(Clock::time_point now) {
  for (const OwnedSocket* listener : {&listener_, &front_})
    while (*listener) {
      OwnedSocket socket = accept_from(*listener);
      if (!socket) break;
      accepted_.emplace(next_connection_++, Accepted{MessageStream(std::move(socket)), now, {}});
    }
  // What is over goes first: a process that stood still must know that it was left before it answers a probe.
  std::map<int, std::vector<Json>> messages;
  std::vector<int> over, open;
  for (auto& [connection, accepted] : accepted_) {
    accepted.stream.flush();
    (accepted.stream.receive(messages[connection]) ? open : over).push_back(connection);
  }
  const auto take_all = [&](int connection) {
    try {
      for (const Json& message : messages[connection]) take_first(connection, accepted_.at(connection), message, now);
    } catch (const std::exception& problem) {
      spdlog::warn("a rank's message cannot be read: {}", problem.what());
      accepted_.at(connection).closing = true;
      coordinator_.lose(connection, now);
    }
  };
  for (const int connection : over) {
    std::erase_if(messages[connection],
                  [](const Json& message) { return message.contains("type") && message["type"] == "probe"; });
    take_all(connection);
    accepted_.erase(connection);
    coordinator_.lose(connection, now);
  }
  for (const int connection : open) take_all(connection);
  answer_waiting(now);
  std::erase_if(accepted_, [](const auto& entry) { return entry.second.closing && !entry.second.stream.sending(); });
}

void Roster::Thread::take_first(int connection, Accepted& accepted, const Json& message, Clock::time_point now) {
  const std::string type = message.at("type").get<std::string>();
  if (type == "hello") {
    accepted.hello = message;
    accepted.since = now;
    accepted.takes_over = message.value("takeover", false);
  } else if (type == "probe") {
    const std::string address = message.at("address").get<std::string>();
    if (!coordinator_.serving()) {
      for (const Known& member : known_)
        if (is_member_ && member.incarnation == coordinator_incarnation_ && member.address != address)
          accepted.stream.send({{"type", "redirect"}, {"address", member.address}});
    } else if (coordinator_.yields_to(message)) {
      spdlog::info("the ranks here join those of {}", address);
      coordinator_.hand_over(address);
    } else if (address != own_.text()) {
      accepted.stream.send({{"type", "absorb"}, {"address", own_.text()}});
    }
  } else {
    coordinator_.receive(connection, message, now);
  }
}

/// A process coordinates from the moment that its own rank says hello to it.
void Roster::Thread::answer_waiting(Clock::time_point now) {
  for (const bool own : {true, false})
    for (auto& [connection, accepted] : accepted_) {
      if (!accepted.hello || own != (accepted.hello->value("incarnation", "") == incarnation_)) continue;
      if (own || coordinator_.serving()) {
        try {
          coordinator_.introduce(connection, *std::exchange(accepted.hello, std::nullopt), now);
        } catch (const std::exception& problem) {
          spdlog::warn("a rank's message cannot be read: {}", problem.what());
          accepted.closing = true;
        }
      } else if (is_member_ && (!accepted.takes_over || now - accepted.since > kRankHold)) {
        for (const Known& member : known_)
          if (member.incarnation == coordinator_incarnation_)
            accepted.stream.send({{"type", "redirect"}, {"address", member.address}});
        accepted.hello.reset();
        accepted.closing = true;
      } else if (now - accepted.since > kRankAnswer || (accepted.takes_over && known_.empty())) {
        accepted.closing = true;  // one that knows no members will not take over: who asks it tries the next
      }
    }
}

void Roster::Thread::coordinate(Clock::time_point now) {
  if (now >= next_heartbeat_) {
    next_heartbeat_ = now + kRankHeartbeat;
    coordinator_.beat();
    if (link_ && is_member_) link_->send({{"type", "alive"}});
  }
  if (!coordinator_.serving()) {
    probe_.reset();
    return;
  }
  coordinator_.tick(now);
  if (!front_) probe_others(now);
}

/// Another group may have formed at the rendezvous: the larger one takes over the other.
void Roster::Thread::probe_others(Clock::time_point now) {
  if (now >= next_probe_) {
    next_probe_ = now + kRankProbe;
    probe_.reset();
    if (OwnedSocket socket = connect_to(rendezvous_)) {
      probe_ = std::make_unique<MessageStream>(std::move(socket));
      probe_->send(coordinator_.probe(own_.text()));
    }
  }
  if (!probe_) return;
  std::vector<Json> answers;
  const bool open = probe_->receive(answers);
  for (const Json& answer : answers) {
    const std::string address = answer.value("address", ""), type = answer.value("type", "");
    if (type == "absorb") {
      spdlog::info("the ranks here join those of {}", address);
      coordinator_.hand_over(address);
    } else if (type == "redirect" && address != own_.text()) {
      if (OwnedSocket socket = connect_to(parse_rank_address(address, "ranks"))) {
        probe_ = std::make_unique<MessageStream>(std::move(socket));
        probe_->send(coordinator_.probe(own_.text()));
        return;
      }
    }
  }
  if (!open) probe_.reset();
}

void Roster::Thread::follow(Clock::time_point now) {
  if (link_) {
    std::vector<Json> messages;
    link_->flush();
    const MessageStream* const before = link_.get();
    const bool open = link_->receive(messages);
    foreign_ |= link_->foreign();
    if (!messages.empty()) heard_ = now;
    try {
      for (const Json& message : messages)
        if (link_.get() == before) take(message, now);
    } catch (const std::exception& problem) {
      spdlog::warn("the coordinator's message cannot be read: {}", problem.what());
      lost_coordinator(true);
    }
    if (link_.get() != before) return;
    if (!open)
      lost_coordinator(false);
    else if (is_member_ && now - heard_ > kRankSilence)
      lost_coordinator(true);
    else if (!is_member_ && !left_ && now > hello_deadline_)
      link_.reset();
  }
  if (!link_ && !left_) search(now);
  check_patience(now);
}

void Roster::Thread::lost_coordinator(bool silent) {
  link_.reset();
  if (!std::exchange(is_member_, false) || left_) return;
  spdlog::warn("the ranks' coordinator {}", silent ? "is silent" : "is lost");
  candidates_.clear();
  std::sort(known_.begin(), known_.end(), [](const Known& a, const Known& b) { return a.rank < b.rank; });
  for (const Known& member : known_) {
    const bool next = member.incarnation != coordinator_incarnation_;
    // Perhaps it is there and only lost this rank, which then comes back like a new one. It is asked at its own
    // address: at the rendezvous another one may listen by now, even this process.
    if (!next && !silent) candidates_.push_front({parse_rank_address(member.address, "ranks"), false});
    if (next) candidates_.push_back({parse_rank_address(member.address, "ranks"), true});
  }
  std::erase_if(known_, [&](const Known& member) { return member.incarnation == coordinator_incarnation_; });
  start_searching_ = Clock::now();
}

/// Says hello to the next process that may coordinate, or know who does.
void Roster::Thread::search(Clock::time_point now) {
  if (now - start_searching_ > options_.patience) {
    fail(foreign_ ? "what answers at " + options_.rendezvous + " is not a rank"
                  : "nobody answers at " + options_.rendezvous + " for " +
                        std::to_string(options_.patience.count() / 1000) + " s",
         "is rank 0 running, and is --rendezvous its HOST:PORT?");
    start_searching_ = now;
  }
  Candidate next{rendezvous_, false};
  if (!candidates_.empty()) {
    next = candidates_.front();
    candidates_.pop_front();
  } else if (now < next_search_) {
    return;
  } else {
    next_search_ = now + kRankSearch;
  }
  OwnedSocket socket = connect_to(next.address);
  if (!socket) return;
  link_ = std::make_unique<MessageStream>(std::move(socket));
  hello_deadline_ = now + kRankAnswer;
  Json expected = Json::array();
  for (const Known& member : known_) expected.push_back(member.incarnation);
  link_->send({{"type", "hello"},
               {"protocol", kRankProtocol},
               {"version", version()},
               {"rank", options_.rank},
               {"ranks", options_.ranks},
               {"incarnation", incarnation_},
               {"address", own_.text()},
               {"identity", parse_json(options_.identity, "identity")},
               {"takeover", next.takes_over},
               {"committed", committed_},
               {"expected", expected}});
}

void Roster::Thread::take(const Json& message, Clock::time_point now) {
  const std::string type = message.at("type").get<std::string>();
  if (type == "welcome") {
    joined(message, now);
  } else if (type == "refused") {
    fail(message.at("why").get<std::string>(), "start all ranks alike, each rank once");
    link_.reset();
    left_ = true;
  } else if (type == "redirect") {
    link_.reset();
    is_member_ = false;
    candidates_.assign(1, {parse_rank_address(message.at("address").get<std::string>(), "ranks"), false});
    start_searching_ = now;
  } else if (type == "members") {
    // A coordinator that took over does not have all yet. If it is lost too, the others still expect them.
    const Json& members = message.at("members");
    std::erase_if(known_, [&](const Known& one) {
      return !kept_ || std::any_of(members.begin(), members.end(),
                                   [&](const Json& member) { return member.at("rank").get<int>() == one.rank; });
    });
    for (const Json& member : members)
      known_.push_back({member.at("rank").get<int>(), member.at("incarnation").get<std::string>(),
                        member.at("address").get<std::string>()});
  } else if (type == "store" || type == "meeting" || type == "decision") {
    const auto meeting = message.at("meeting").get<std::uint64_t>();
    if (type == "meeting" && std::exchange(kept_, false)) {
      const Json& attendees = message.at("attendees");
      std::erase_if(known_, [&](const Known& one) {
        return std::none_of(attendees.begin(), attendees.end(), [&](const Json& attendee) {
          return attendee.at("incarnation").get<std::string>() == one.incarnation;
        });
      });
    }
    const std::lock_guard lock(mutex_);
    if (type == "meeting") {
      seen_ = store_meeting_ = meeting;
      store_.clear();
      ever_met_ = true;
    } else if (meeting != seen_) {
      return;
    } else if (type == "store") {
      const auto bytes = message.at("value").get<std::vector<int>>();
      store_[message.at("key").get<std::string>()].assign(bytes.begin(), bytes.end());
    } else if (message.at("yes").get<bool>()) {
      committed_ = seen_;
    }
    if (type != "store") {
      question_.reset();
      answer_ = message;
    }
    changed_.notify_all();
  }
}

void Roster::Thread::joined(const Json& welcome, Clock::time_point now) {
  is_member_ = true;
  heard_ = joined_ = now;
  candidates_.clear();
  coordinator_incarnation_ = welcome.at("coordinator").get<std::string>();
  kept_ = welcome.at("kept").get<bool>();
  if (!kept_) {
    committed_ = seen_ = 0;  // it comes like a new one
    const std::lock_guard lock(mutex_);
    if (question_ && question_->at("type") == "vote") {
      question_.reset();
      answer_ = Json{{"type", "decision"}, {"yes", false}};
      changed_.notify_all();
    }
  }
  resend();
}

void Roster::Thread::resend() {
  const std::lock_guard lock(mutex_);
  if (!question_ || !link_ || !is_member_) return;
  Json question = *question_;
  question["meeting"] = question["seen"] = seen_;
  question["committed"] = committed_;
  link_->send(question);
}

/// Throws Error when ranks that are missing at the start do not come in time.
void Roster::Thread::check_patience(Clock::time_point now) {
  if (ever_met_ || !is_member_ || now - start_ < options_.patience) return;
  std::set<int> missing;
  for (int rank = 0; rank < options_.ranks; ++rank) missing.insert(rank);
  for (const Known& member : known_) missing.erase(member.rank);
  if (missing.empty()) return;
  std::vector<std::string> names;
  for (const int rank : missing) names.push_back(std::to_string(rank));
  fail("of " + std::to_string(options_.ranks) + " ranks, these did not come within " +
           std::to_string(options_.patience.count() / 1000) + " s: " + citylearn::joined(names),
       "start them with the same --rendezvous, or lower --ranks");
}

void Roster::Thread::fail(const std::string& why, const std::string& remedy) {
  const std::lock_guard lock(mutex_);
  if (!failure_) failure_.emplace(why, remedy);
  changed_.notify_all();
}

}  // namespace citylearn
