// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/parameter_fetch.h"

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

constexpr int kMaxUnansweredRequests = 20;  // in a row, after which a version is given up

/// Returns how many bytes the object of so many parameters has. They are its last field.
std::uint64_t object_bytes(const std::string& agent, std::ptrdiff_t parameters) {
  msg::Parameters object;
  object.agent() = agent;
  return encode_object(object).size() + static_cast<std::uint64_t>(parameters) * sizeof(float);
}

}  // namespace

ObjectBytes parameters_object(std::uint64_t learner_incarnation, std::uint64_t version, const std::string& agent,
                              const Vector<float>& values) {
  msg::Parameters object;
  object.agent() = agent.c_str();
  object.values().assign(values.begin(), values.end());
  return {{learner_incarnation, 0, version}, encode_object(object)};
}

ParameterFetch::ParameterFetch(const msg::LearnerInfo& info, std::ptrdiff_t parameters)
    : parameters_(parameters),
      bytes_(object_bytes(info.agent().c_str(), parameters)),
      object_({.hash = info.header().incarnation(),
               .retry = kParametersRetry,
               .most_tries = kMaxUnansweredRequests,
               .max_bytes = bytes_,
               .max_items = 1}) {
  request_.server() = info.header().sender().c_str();
}

bool ParameterFetch::expect(const msg::LearnerInfo& info) {
  if (info.total_bytes() != bytes_) return false;
  want(info.version(), false);
  return true;
}

/// Wants a version that is newer than the one that is here. `whole`: one chunk is all of it.
void ParameterFetch::want(std::uint64_t version, bool whole) {
  if ((newest_ && version <= newest_->version) || wanted_.contains(version)) return;
  if (wanted_.size() >= 2 && !whole) {
    const std::uint64_t last = *wanted_.rbegin();
    if (version < last) return;
    object_.drop(last);
    wanted_.erase(last);
  }
  if (wanted_.empty() && newest_) next_request_ = Clock::now() + kParametersRetry;
  object_.want(version);
  wanted_.insert(version);
}

bool ParameterFetch::take(const msg::ObjectChunk& chunk) {
  if (chunk.total_bytes() > 0) {
    if (chunk.total_bytes() != bytes_) return false;
    want(chunk.item(), bytes_ <= msg::MAX_CHUNK);
  }
  if (object_.take(chunk, Clock::now()) == Taken::kDamaged) return false;
  bool right = true;
  while (const auto object = object_.next()) right = finish(*object) && right;
  return right;
}

/// Takes in a version that is complete, or that the learner has forgotten. Returns false when it means nothing.
bool ParameterFetch::finish(const FetchedObject& object) {
  wanted_.erase(object.item);
  if (object.bytes.empty()) return true;
  try {
    const auto sent = decode_object<msg::Parameters>(object.bytes);
    if (static_cast<std::ptrdiff_t>(sent.values().size()) != parameters_) return false;
    newest_ = std::make_shared<VersionedParameters>(VersionedParameters{
        object.item, Eigen::Map<const Vector<float>>(sent.values().data(), static_cast<Eigen::Index>(parameters_))});
  } catch (const Error&) {
    return false;
  }
  drop_up_to(object.item);
  return true;
}

/// Wants versions no longer that are as old as this one.
void ParameterFetch::drop_up_to(std::uint64_t version) {
  while (!wanted_.empty() && *wanted_.begin() <= version) {
    object_.drop(*wanted_.begin());
    wanted_.erase(wanted_.begin());
  }
}

void ParameterFetch::request_missing(Node& node) {
  const Clock::time_point now = Clock::now();
  if (now < next_request_ || wanted_.empty()) return;
  if (object_.gave_up(now)) drop_up_to(*wanted_.begin());
  if (object_.ask(now, request_)) node.publish(request_);
}

}  // namespace citylearn
