// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/parameter_requester.h"

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

constexpr int kMaxUnansweredRequests = 20;  // in a row, after which the version is given up

}  // namespace

void ParameterRequester::request_missing(ParameterAssembly& parameters) {
  const auto missing = parameters.missing();
  const Clock::time_point now = Clock::now();
  if (!missing) {
    asked_.reset();
    next_ = now + kParametersRetry;  // the next version is probably on its way
    return;
  }
  const bool known = asked_ && asked_->version == missing->version;
  const bool more = known && missing->chunks.front() > asked_->chunks.back();
  const bool late = !known && !parameters.newest();
  if (now < next_ && !more && !late) return;
  unanswered_ = known && missing->chunks == asked_->chunks ? unanswered_ + 1 : 0;
  if (unanswered_ > kMaxUnansweredRequests) {
    parameters.give_up();
    asked_.reset();
    return;
  }
  asked_ = missing;
  request_.version() = missing->version;
  request_.chunks() = missing->chunks;
  node_.publish(request_);
  next_ = now + kParametersRetry;
}

}  // namespace citylearn
