// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback/page_link.h"

#include <algorithm>
#include <charconv>

#include "core/util/error.h"
#include "core/util/text.h"
#include "dashboard/http/target.h"

namespace citylearn {
namespace {

std::string shortened(const std::string& text) { return text.size() > 200 ? text.substr(0, 200) + "..." : text; }

double point_of(const std::string& text, const std::string& where) {
  double at = -1;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), at);
  if (fault != std::errc() || end != text.data() + text.size() || !(at >= 0 && at <= 1e300))
    throw Error("its moment at=" + shortened(text) + " is not a number from 0 on", where);
  return at;
}

}  // namespace

bool is_link(const std::string& text) { return text.starts_with("http://") || text.starts_with("https://"); }

PageLink parse_page_link(const std::string& text) {
  const std::string where = "--open " + shortened(text);
  const std::size_t hash = text.find("#/");
  const auto target = hash == text.npos ? std::nullopt : parse_target(text.substr(hash + 1));
  if (!target || std::any_of(text.begin(), text.end(), [](unsigned char c) { return c <= ' '; }))
    throw Error("is not a link to the dashboard's page", where,
                "copy all of the address line, such as 'http://127.0.0.1:8080/#/route?run=...&at=3000', and quote it");
  PageLink link{text.substr(hash), std::nullopt};
  const auto parameter = [&](const char* name) {
    const auto found = target->parameters.find(name);
    return found == target->parameters.end() ? "" : found->second;
  };
  const std::string at = parameter("at");
  if (at.empty()) return link;
  Moment moment{parameter("run"), parameter("x"), point_of(at, where)};
  if (moment.run.empty()) moment.run = parameter("runs");
  if (moment.run.empty()) throw Error("its moment names no run", where, "copy the link of a page that shows one run");
  if (moment.axis.empty()) moment.axis = "steps";
  if (std::find(moment_axes().begin(), moment_axes().end(), moment.axis) == moment_axes().end())
    throw Error("its axis x=" + shortened(moment.axis) + " is not one of " + joined(moment_axes()), where);
  link.moment = std::move(moment);
  return link;
}

}  // namespace citylearn
