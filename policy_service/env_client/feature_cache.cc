// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/feature_cache.h"

#include <algorithm>

#include "policy_service/env_client/env_requirements.h"

namespace citylearn {

std::shared_ptr<RouteFeatures> FeatureCache::want(const msg::TraversalInfo& info, std::uint32_t first,
                                                  std::uint32_t count) {
  const std::string where = "traversal '" + info.traversal().to_string() + "'";
  if (info.feature_dimension() == 0)
    throw Error("has no features", where, "choose another agent, or a traversal with features");
  if (const std::string wrong = route_misfit(info, first, count); !wrong.empty())
    throw Error(wrong, where, "choose fewer --frames");
  const std::string encoder = info.encoder().c_str();
  const auto holds = [&](const std::shared_ptr<RouteFeatures>& route) {
    const Transfer::What& what = route->transfer.what();
    return what.hash == info.hash() && what.dimension == info.feature_dimension() && route->encoder == encoder &&
           what.first <= first && first + count <= what.first + what.count;
  };
  auto found = std::find_if(routes_.begin(), routes_.end(), holds);
  if (found == routes_.end()) {
    const Transfer::What what{info.hash(), info.frames(), info.feature_dimension(), first, count};
    routes_.push_back(std::make_shared<RouteFeatures>(what));
    routes_.back()->encoder = encoder;
    routes_.back()->progress = Clock::now();
  } else {
    std::rotate(found, found + 1, routes_.end());
  }
  std::shared_ptr<RouteFeatures> wanted = routes_.back();
  forget();
  return wanted;
}

/// Drops what is not in use: at once where it is not complete, else the oldest ones beyond what is kept.
void FeatureCache::forget() {
  std::size_t kept = 0;
  for (auto route = routes_.rbegin(); route != routes_.rend(); ++route) {
    if (route->use_count() > 1) continue;
    const std::size_t bytes = (*route)->transfer.features.size() * sizeof(float);
    if ((*route)->complete() && kept + bytes <= kept_)
      kept += bytes;
    else
      route->reset();
  }
  std::erase(routes_, nullptr);
}

void FeatureCache::ask(RouteFeatures& route, const std::string& environment) {
  if (!route.transfer.ask(Clock::now(), request_)) return;
  request_.server() = environment.c_str();
  node_.publish(request_);
}

bool FeatureCache::take(const msg::TraversalChunk& chunk, bool trusted) {
  bool right = true;
  for (const auto& route : routes_) {
    if (!trusted) {
      right = right && !route->transfer.wants(chunk);
      continue;
    }
    const Taken taken = route->transfer.take(chunk);
    if (taken == Taken::kYes) route->progress = Clock::now();
    if (taken == Taken::kDamaged) right = false;
  }
  return right;
}

}  // namespace citylearn
