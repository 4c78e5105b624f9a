// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/rank_node.h"

#include <spdlog/spdlog.h>

#include <condition_variable>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>

#include "core/util/error.h"
#include "core/util/machine.h"
#include "core/util/text.h"
#include "core/wire/messenger.h"

namespace citylearn {
namespace {

/// The session of all ranks: their services have sessions of their own.
constexpr const char* kRankSession = "ranks";

/// The rank on the wire. Its certificate, if any, is that of its service.
NodeOptions rank_options(const RankOptions& options) {
  NodeOptions node = options.node;
  node.middleware.participant = node.id;
  node.session = kRankSession;
  node.id = "rank-" + std::to_string(options.rank);
  return node;
}

}  // namespace

/// Both threads use it under `mutex_`; the thread of the ranks alone waits for messages.
class RankNode::Impl : public Messenger {
 public:
  explicit Impl(const RankOptions& options)
      : Messenger(rank_options(options)),
        options_(options),
        membership_({options.rank, options.ranks, host_name(), options.identity}, incarnation(), Clock::now()) {
    create_writer<msg::RankStatus>();
    create_reader<msg::RankStatus>();
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

  /// Lets `change` change the membership. Then waits until `result` returns something.
  template <class Change, class Result>
  auto wait_for(Change change, Result result, Clock::time_point deadline, const Idle& idle) {
    std::unique_lock lock(mutex_);
    change(membership_);
    go_on();
    while (true) {
      if (auto found = result(membership_)) return *found;
      if (!membership_.refusal().empty())
        throw Error(membership_.refusal(), "rank " + std::to_string(options_.rank),
                    "start all ranks alike, each rank once");
      if (Clock::now() >= deadline) {
        const auto missing = membership_.missing();
        std::vector<std::string> names;
        for (const int rank : missing) names.push_back(std::to_string(rank));
        if (!missing.empty())
          throw Error("of " + std::to_string(options_.ranks) + " ranks, these did not come within " +
                          std::to_string(options_.patience.count() / 1000) + " s: " + joined(names),
                      "rank " + std::to_string(options_.rank),
                      "start them with the same --ranks-domain and with --peers that name all hosts, or lower --ranks");
      }
      changed_.wait_for(lock, kStopCheckInterval);
      if (!idle) continue;
      lock.unlock();
      idle();
      lock.lock();
    }
  }
  template <class Change>
  void set(Change change) {
    const std::lock_guard lock(mutex_);
    change(membership_);
    go_on();
  }

  /// Returns until when others may be missing: only at the start.
  Clock::time_point first_deadline() const { return start_ + options_.patience; }

 private:
  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      middleware_->wait(Clock::now() + kStopCheckInterval);
      const std::lock_guard lock(mutex_);
      for (const std::string& line : middleware_->discovery().faults()) spdlog::error("ranks: {}", line);
      try {
        msg::RankStatus status;
        while (take(status)) membership_.take(status, Clock::now());
        go_on();
      } catch (const Error& error) {
        spdlog::error("ranks: {}", error.what());
      }
      changed_.notify_all();
    }
  }
  /// Does what is due, and says what has changed.
  void go_on() {
    const Clock::time_point now = Clock::now();
    membership_.tick(now);
    msg::RankStatus status = membership_.status();
    status.header(sent_.header());
    if (status == sent_ && now < next_) return;
    next_ = now + (status.phase() == msg::LEARNING ? kRankHeartbeat : kRankRepeat);
    publish(status);
    sent_ = std::move(status);
  }

  const RankOptions options_;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;
  std::condition_variable changed_;
  RankMembership membership_;
  msg::RankStatus sent_;
  Clock::time_point next_{};
  std::jthread thread_;
};

RankNode::RankNode(const RankOptions& options) : impl_(std::make_unique<Impl>(options)) {}

RankNode::~RankNode() = default;

std::uint64_t RankNode::incarnation() const { return impl_->incarnation(); }

RankCall RankNode::arrive(std::uint64_t updates, std::uint64_t connected, const Idle& idle) {
  return impl_->wait_for([&](RankMembership& ranks) { ranks.arrive(updates, connected); },
                         [](const RankMembership& ranks) { return ranks.call(); },
                         std::exchange(was_called_, true) ? Clock::time_point::max() : impl_->first_deadline(), idle);
}

bool RankNode::vote(bool yes, const Idle& idle) {
  return impl_->wait_for([&](RankMembership& ranks) { ranks.vote(yes); },
                         [](const RankMembership& ranks) { return ranks.decision(); }, Clock::time_point::max(), idle);
}

void RankNode::set_connection(const std::vector<char>& address) {
  impl_->set([&](RankMembership& ranks) { ranks.set_connection(address); });
}

std::vector<char> RankNode::connection_of(std::uint64_t incarnation) {
  const Clock::time_point deadline = Clock::now() + kGlooReceive;
  return impl_->wait_for([](RankMembership&) {},
                         [&](const RankMembership& ranks) -> std::optional<std::vector<char>> {
                           if (const auto* address = ranks.connection_of(incarnation))
                             return std::vector<char>(address->begin(), address->end());
                           if (ranks.all_here() && Clock::now() < deadline) return {};
                           return std::vector<char>();
                         },
                         Clock::time_point::max(), nullptr);
}

void RankNode::leave() {
  impl_->set([](RankMembership& ranks) { ranks.leave(); });
}

}  // namespace citylearn
