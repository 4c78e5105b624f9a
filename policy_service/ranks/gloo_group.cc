// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/gloo_group.h"

#include <gloo/allreduce.h>
#include <gloo/math.h>
#include <gloo/rendezvous/context.h>
#include <gloo/rendezvous/store.h>
#include <gloo/transport/tcp/device.h>

#include <algorithm>
#include <csignal>
#include <exception>
#include <utility>

#include "core/exchange/timing.h"
#include "core/util/types.h"

namespace citylearn {
namespace {

// gloo waits five times as long for all connections of a context.

/// The store through which gloo's ranks exchange addresses before they are connected.
class RosterStore : public gloo::rendezvous::Store {
 public:
  RosterStore(Roster& roster, std::uint64_t meeting) : roster_(roster), meeting_(meeting) {}

  void set(const std::string& key, const std::vector<char>& data) override { roster_.set(meeting_, key, data); }
  std::vector<char> get(const std::string& key) override {
    std::vector<char> value;
    if (!roster_.get(meeting_, key, deadline_, value)) throw RankLost("no address came from a rank");
    return value;
  }
  void wait(const std::vector<std::string>& keys) override {
    for (const std::string& key : keys) get(key);
  }
  void wait(const std::vector<std::string>& keys, const std::chrono::milliseconds& /*timeout*/) override { wait(keys); }

 private:
  Roster& roster_;
  const std::uint64_t meeting_;
  const Clock::time_point deadline_ = Clock::now() + kGlooStore;
};

}  // namespace

/// gloo's connections among the members of a meeting.
class GlooGroup::Connections {
 public:
  Connections(Roster& roster, const RosterMeeting& meeting)
      : context_(std::make_shared<gloo::rendezvous::Context>(static_cast<int>(meeting.meeting.mine),
                                                             static_cast<int>(meeting.incarnations.size()))) {
    gloo::transport::tcp::attr attributes;
    attributes.hostname = roster.host();
    auto device = gloo::transport::tcp::CreateDevice(attributes);
    RosterStore store(roster, meeting.number);
    context_->setTimeout(kGlooConnect);
    context_->connectFullMesh(store, device);
    context_->setTimeout(kGlooReceive);
  }

  void sum(std::span<float> values) {
    gloo::AllreduceOptions options(context_);
    options.setOutput(values.data(), values.size());
    options.setReduceFunction(static_cast<void (*)(void*, const void*, const void*, std::size_t)>(&gloo::sum<float>));
    gloo::allreduce(options);
  }

 private:
  std::shared_ptr<gloo::rendezvous::Context> context_;
};

GlooGroup::GlooGroup(const RosterOptions& options, std::function<void()> idle)
    : idle_(std::move(idle)), roster_(options) {
  std::signal(SIGPIPE, SIG_IGN);  // gloo writes to connections that may be over
}

GlooGroup::~GlooGroup() = default;

RankMeeting GlooGroup::meet(const RankArrival& arrival) {
  now_ = roster_.arrive(arrival, connected_at_, idle_);
  const bool same = now_.incarnations == connected_ && std::all_of(now_.tags.begin(), now_.tags.end(), [&](auto tag) {
                      return tag != 0 && tag == connected_at_;
                    });
  if (!same) {
    connections_.reset();
    connected_at_ = 0;
  }
  return now_.meeting;
}

void GlooGroup::sum(std::span<float> values) {
  try {
    if (!connections_) {
      connections_ = std::make_unique<Connections>(roster_, now_);
      connected_at_ = now_.number;
      connected_ = now_.incarnations;
    }
    connections_->sum(values);
  } catch (const std::exception& problem) {
    connections_.reset();
    connected_at_ = 0;
    throw RankLost(problem.what());
  }
}

bool GlooGroup::agree(bool succeeded) { return roster_.vote(succeeded, idle_); }

void GlooGroup::leave() { roster_.leave(); }

}  // namespace citylearn
