// SPDX-License-Identifier: Apache-2.0
#include "core/wire/rejections.h"

#include <spdlog/spdlog.h>

namespace citylearn {
namespace {

constexpr std::size_t kMaxLoggedKinds = 64;

}  // namespace

void Rejections::add(const msg::Header& header, const std::string& kind, const std::string& detail) {
  ++node_.traffic.rejected;
  if (logged_.size() < kMaxLoggedKinds && logged_.insert(kind).second)
    spdlog::warn("rejected {} from '{}'{}{} (more of the kind are counted, not logged)", kind, header.sender().c_str(),
                 detail.empty() ? "" : ": ", detail);
}

}  // namespace citylearn
