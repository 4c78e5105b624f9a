// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "dashboard/playback/moment.h"

namespace citylearn {

/// A link that was copied from the page's address line.
struct PageLink {
  std::string fragment;          ///< "#/route?run=demo%2Fpolicy%2F1%2F5&at=3000"
  std::optional<Moment> moment;  ///< nothing where it names no moment of a run
};

/// Returns whether a value of --open is a link rather than a file.
bool is_link(const std::string& text);

/// Throws Error when the text is not a link to the page, or its moment cannot be read.
PageLink parse_page_link(const std::string& text);

}  // namespace citylearn
