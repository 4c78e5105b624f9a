// SPDX-License-Identifier: Apache-2.0
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "core/exchange/timing.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/env_client/env_client.h"
#include "python/env_group.h"
#include "python/errors.h"

namespace citylearn::python {
namespace {

std::string seconds_text(double seconds) { return std::to_string(static_cast<int>(seconds)) + " s"; }

/// A thread answers the wire between calls, so that env_services do not take this process for gone while Python learns.
class RemoteGroup : public EnvGroup {
 public:
  RemoteGroup(const RemoteOptions& options, const Interrupt& interrupt)
      : options_(options), node_(options.node), final_status_(node_), client_(node_) {
    client_.require({.traversals = {options.traversal}, .feature_dimension = {}, .streets = {}, .learned = {}});
    client_.decide = [this](EnvHandle& env, const msg::Observation& seen, std::vector<std::uint8_t>&) {
      for (std::size_t i = 0; i < envs_.size(); ++i)
        if (envs_[i] == &env) seen_[i] = seen;
      return false;  // send() answers
    };
    // Without it env_services keep a million episodes, and then report that the oldest are lost.
    client_.finished = [this](EnvHandle& env, const msg::EpisodeStat& episode) {
      if (episode.log().number() > env.acknowledged) client_.acknowledge(env, episode.log().number());
    };
    client_.begin_recording();
    node_.report(msg::WAITING, "waiting for env_services");
    await_services(interrupt);
    seen_.resize(envs_.size());
    shape_.traversal = options.traversal;
    shape_.features = static_cast<int>(envs_.front()->info.feature_dimension());
    shape_.traversal_frames = static_cast<int>(envs_.front()->info.frames());
    shape_.streets = {envs_.front()->streets, envs_.front()->info.streets_hash()};
    for (const EnvHandle* env : envs_)
      shape_.agents += shape_.service_agents.emplace_back(static_cast<int>(env->info.agents()));
    node_.report(msg::RUNNING, "driven by Python");
    idle_ = std::jthread([this](const std::stop_token& stop) { answer_wire(stop); });
  }

  ~RemoteGroup() override {
    idle_ = {};
    try {
      release();
    } catch (const Error&) {  // they notice that this process is silent
    }
  }

  const Shape& shape() const override { return shape_; }

  void reset(const msg::TaskSettings& settings, const Seeds& seeds) override {
    const std::lock_guard lock(mutex_);
    msg::TaskSettings own = settings;
    first_frame_ = settings.first_frame();
    for (std::size_t i = 0; i < envs_.size(); ++i) {
      if (!seeds[i]) continue;
      own.seed() = *seeds[i];
      client_.command(*envs_[i], own);
    }
  }

  void send(std::span<const std::uint8_t> actions) override {
    const std::lock_guard lock(mutex_);
    for (EnvHandle* env : envs_) {
      const std::size_t agents = env->info.agents();
      check(*env);
      if (env->waiting) client_.answer(*env, {actions.begin(), actions.begin() + static_cast<std::ptrdiff_t>(agents)});
      actions = actions.subspan(agents);
    }
  }

  void receive(const Batch& batch, const Interrupt& interrupt) override {
    const std::lock_guard lock(mutex_);
    const Clock::time_point since = Clock::now();
    for (EnvHandle* env : envs_)
      while (!env->waiting) {
        check(*env);
        if (seconds_since(since) > options_.wait)
          throw ServiceMissing(
              (env->alive() ? "has not answered for " : "has been silent for ") + seconds_text(options_.wait),
              "env_service '" + env->id + "'", "start it again, then call reset()");
        client_.spin(Clock::now() + kStopCheckInterval);
        interrupt();
      }
    std::size_t row = 0;
    const auto dimension = static_cast<std::size_t>(shape_.features);
    for (const msg::Observation& seen : seen_) {
      write_rows(seen, first_frame_, dimension, row, batch,
                 [&](std::size_t agent) { return seen.features().data() + agent * dimension; });
      row += seen.goal().size();
    }
  }

 private:
  /// Fills envs_ with the first of the traversal's env_services that are free.
  void await_services(const Interrupt& interrupt) {
    const Clock::time_point since = Clock::now();
    while (true) {
      std::string found;
      envs_.clear();
      for (const auto& [id, env] : client_.envs()) {
        found += (found.empty() ? "" : ", ") + id + " on " + env->traversal();
        const std::string other = client_.other_policy(*env);
        if (!env->refusal.empty()) found += ", which " + env->refusal;
        if (!other.empty()) found += ", which works for '" + other + "'";
        if (env->traversal() == options_.traversal && env->usable() && other.empty()) envs_.push_back(env.get());
      }
      for (const auto& [id, traversal] : client_.services().unencoded())
        found += (found.empty() ? "" : ", ") + id + " on " + traversal + ", whose images wait for an encoder_service";
      if (envs_.size() >= static_cast<std::size_t>(options_.services)) break;
      if (seconds_since(since) > options_.wait)
        throw ServiceMissing(std::to_string(envs_.size()) + " of " + std::to_string(options_.services) +
                                 " env_services on '" + options_.traversal + "' within " + seconds_text(options_.wait) +
                                 " (" + (found.empty() ? "none was found" : "found: " + found) + ")",
                             "",
                             "same session '" + options_.node.session + "', domain " +
                                 std::to_string(options_.node.middleware.domain) + " and interface there?");
      client_.spin(Clock::now() + kStopCheckInterval);
      interrupt();
    }
    envs_.resize(static_cast<std::size_t>(options_.services));
  }

  /// Throws what keeps an env_service from going on.
  void check(const EnvHandle& env) {
    if (failure_) std::rethrow_exception(failure_);
    const std::string where = "env_service '" + env.id + "'";
    if (!env.refusal.empty()) throw ServiceLost("is not used: " + env.refusal, where);
    if (env.lost()) throw ServiceLost("works for another policy_service", where);
    if (!env.commands()) throw ServiceLost("was restarted", where, "call reset()");
  }

  void answer_wire(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, stop, kPythonIdle, [&stop] { return stop.stop_requested(); })) {
      try {
        client_.spin(Clock::now());
      } catch (...) {
        failure_ = std::current_exception();
        return;
      }
    }
  }

  void release() {
    msg::TaskSettings idle;
    idle.task_mode() = msg::IDLE;
    for (EnvHandle* env : envs_) client_.command(*env, idle);
    const Clock::time_point until = Clock::now() + kPythonRelease;
    for (const EnvHandle* env : envs_)
      while (!env->in_force() && env->alive() && Clock::now() < until) client_.spin(until);
    client_.end_recording();
  }

  const RemoteOptions options_;
  Node node_;
  const FinalStatusGuard final_status_;
  EnvClient client_;
  std::vector<EnvHandle*> envs_;
  std::vector<msg::Observation> seen_;  // by environment: the one that waits
  Shape shape_;
  std::uint32_t first_frame_ = 0;
  std::exception_ptr failure_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::jthread idle_;
};

}  // namespace

std::unique_ptr<EnvGroup> make_remote_group(const RemoteOptions& options, const EnvGroup::Interrupt& interrupt) {
  return std::make_unique<RemoteGroup>(options, interrupt);
}

}  // namespace citylearn::python
