// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/gloo_group.h"

#include <arpa/inet.h>
#include <gloo/allgatherv.h>
#include <gloo/allreduce.h>
#include <gloo/math.h>
#include <gloo/rendezvous/context.h>
#include <gloo/rendezvous/store.h>
#include <gloo/transport/tcp/device.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <csignal>
#include <exception>
#include <utility>

#include "core/exchange/timing.h"
#include "core/util/types.h"

namespace citylearn {
namespace {

std::vector<std::uint64_t> incarnations_of(const RankCall& call) {
  std::vector<std::uint64_t> all;
  for (const RankCall::Member& member : call.members) all.push_back(member.incarnation);
  return all;
}

/// Returns the caller's place among the members.
std::size_t place_in(const RankCall& call, std::uint64_t incarnation) {
  const std::vector<std::uint64_t> all = incarnations_of(call);
  return static_cast<std::size_t>(std::find(all.begin(), all.end(), incarnation) - all.begin());
}

/// The store through which gloo's ranks exchange addresses before they are connected: each sets the key that is its
/// place. Other keys have host names, by which gloo counts those of one host; the transport over TCP does not use that.
class RankStore : public gloo::rendezvous::Store {
 public:
  RankStore(RankNode& node, const RankCall& call) : node_(node), call_(call) {}

  void set(const std::string& key, const std::vector<char>& data) override {
    if (is_place(key)) node_.set_connection(data);
  }
  std::vector<char> get(const std::string& key) override {
    if (!is_place(key)) return {};
    std::vector<char> address = node_.connection_of(call_.members.at(std::stoul(key)).incarnation);
    if (address.empty()) throw RankLost("no address came from a rank");
    return address;
  }
  void wait(const std::vector<std::string>& keys) override {
    for (const std::string& key : keys) get(key);
  }
  void wait(const std::vector<std::string>& keys, const std::chrono::milliseconds& /*timeout*/) override { wait(keys); }

 private:
  static bool is_place(const std::string& key) { return key.find_first_not_of("0123456789") == key.npos; }

  RankNode& node_;
  const RankCall& call_;
};

}  // namespace

/// gloo's connections among the members of a call.
class GlooGroup::Connections {
 public:
  Connections(RankNode& node, const RankCall& call, const std::string& interface)
      : context_(std::make_shared<gloo::rendezvous::Context>(static_cast<int>(place_in(call, node.incarnation())),
                                                             static_cast<int>(call.members.size()))) {
    gloo::transport::tcp::attr attributes;
    in_addr address{};
    (inet_pton(AF_INET, interface.c_str(), &address) == 1 ? attributes.hostname : attributes.iface) = interface;
    auto device = gloo::transport::tcp::CreateDevice(attributes);
    RankStore store(node, call);
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
  /// Returns the texts of all members.
  std::vector<std::string> gather(std::string text) {
    const auto count = static_cast<std::size_t>(context_->size);
    std::vector<std::uint64_t> sizes(count);
    std::uint64_t own = text.size();
    gather(&own, sizes.data(), std::vector<std::size_t>(count, 1));
    std::uint64_t total = 0;
    for (const std::uint64_t size : sizes) {
      if (size > kMaxNews) throw RankLost("the news of a rank are too long");
      total += size;
    }
    std::string all(total, '\0');
    gather(text.data(), all.data(), {sizes.begin(), sizes.end()});
    std::vector<std::string> texts;
    std::size_t begin = 0;
    for (const std::uint64_t size : sizes) texts.push_back(all.substr(std::exchange(begin, begin + size), size));
    return texts;
  }

 private:
  static constexpr std::uint64_t kMaxNews = 16 << 20;  ///< bytes
  template <class T>
  void gather(T* own, T* all, std::vector<std::size_t> counts) {
    gloo::AllgathervOptions options(context_);
    options.setInput(own, counts[static_cast<std::size_t>(context_->rank)]);
    options.setOutput(all, std::move(counts));
    gloo::allgatherv(options);
  }

  std::shared_ptr<gloo::rendezvous::Context> context_;
};

GlooGroup::GlooGroup(const RankOptions& options, std::function<void()> idle)
    : idle_(std::move(idle)), interface_(options.node.middleware.interfaces.front()), node_(options) {
  std::signal(SIGPIPE, SIG_IGN);  // gloo writes to connections that may be over
}

GlooGroup::~GlooGroup() = default;

template <class Use>
void GlooGroup::with_connections(Use use) {
  try {
    if (!connections_) {
      connections_ = std::make_unique<Connections>(node_, call_, interface_);
      connected_ = call_.id;
      members_ = incarnations_of(call_);
    }
    use(*connections_);
  } catch (const std::exception& problem) {
    connections_.reset();
    connected_ = 0;
    throw RankLost(problem.what());
  }
}

RankMeeting GlooGroup::meet(const RankArrival& arrival) {
  while (true) {
    call_ = node_.arrive(arrival.updates, connected_, idle_);
    if (call_.connected == 0 || call_.connected != connected_ || incarnations_of(call_) != members_) {
      connections_.reset();
      connected_ = 0;
    }
    RankMeeting meeting;
    meeting.mine = place_in(call_, node_.incarnation());
    for (const RankCall::Member& member : call_.members)
      meeting.members.push_back({member.rank, member.updates, member.newcomer, ""});
    meeting.leader = RankMeeting::leader_of(meeting.members);
    std::vector<std::string> news = {arrival.news}, progress = {arrival.progress};
    try {
      if (call_.members.size() > 1)
        with_connections([&](Connections& all) {
          news = all.gather(arrival.news);
          progress = all.gather(meeting.mine == meeting.leader ? arrival.progress : "");
        });
    } catch (const RankLost& lost) {
      spdlog::debug("the ranks' news did not come: {}", lost.what());
      node_.vote(false, idle_);
      continue;
    }
    for (std::size_t i = 0; i < news.size(); ++i) meeting.members[i].news = std::move(news[i]);
    meeting.progress = std::move(progress[meeting.leader]);
    return meeting;
  }
}

void GlooGroup::sum(std::span<float> values) {
  with_connections([&](Connections& all) { all.sum(values); });
}

bool GlooGroup::agree(bool succeeded) { return node_.vote(succeeded, idle_); }

void GlooGroup::leave() { node_.leave(); }

}  // namespace citylearn
