// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include <fstream>

#include "dashboard/api/api.h"
#include "dashboard/http/access.h"
#include "dashboard/http/target.h"
#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/records.h"

namespace citylearn::fuzz {
namespace {

const std::string kToken = "0123456789abcdef-token", kElsewhere = "what lies beside the folder that is shown";

/// A dashboard without its sockets: a store with a run, and who may ask.
struct Dashboard {
  Dashboard() {
    write(folder / "token", kToken + "\n");
    ::chmod((folder / "token").c_str(), 0600);
    write(folder / "similarity-elsewhere.png", kElsewhere);
    store.record(testing::run_info());
    store.describe(testing::traversal_info());
    store.record(testing::training_stats(1, 20));
    store.record(testing::episodes(1, 20));
    for (std::uint32_t index = 0; index < 4; ++index)
      store.record(std::vector{testing::task(100 + index, index, index > 0)});
  }
  static void write(const std::string& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

  const testing::Folder folder;
  Store store{[this] {
    Store::Options options;
    options.path = folder / "dashboard.sqlite";
    return options;
  }()};
  Api api{[this] {
            Api::Options options;
            options.session = "demo";
            return options;
          }(),
          store, nullptr};
  Access access{[this] {
    Access::Options options;
    options.address = "127.0.0.1";
    options.port = 8080;
    options.token_file = folder / "token";
    options.allow = {"gpu7.example.org"};
    return options;
  }()};
};

bool has(std::string_view text, std::string_view part) { return text.find(part) != text.npos; }

}  // namespace

bool web_request(Input input) {
  static Dashboard dashboard;
  // A line each: target, Host, Origin, Authorization, Cookie. The rest is a message.
  std::string_view rest(reinterpret_cast<const char*>(input.data()), input.size());
  const auto line = [&rest] {
    const std::size_t end = rest.find('\n');
    const std::string_view first = rest.substr(0, end);
    rest.remove_prefix(end == rest.npos ? rest.size() : end + 1);
    return first;
  };
  const std::string_view text = line();
  Access::Request who;
  for (std::string_view* field : {&who.host, &who.origin, &who.authorization, &who.cookie}) *field = line();

  const auto stranger = dashboard.access.foreign(who);
  require(!stranger || !stranger->empty(), "a stranger is told why");
  require(stranger || !who.host.empty(), "who calls us calls us something");
  const std::string cookie = dashboard.access.cookie();
  const std::string secret = cookie.substr(0, cookie.find(';'));
  require(!dashboard.access.allows(who) || has(who.authorization, kToken) || has(who.cookie, secret),
          "only who says a secret knows one");

  if (const auto topics = parse_watch(std::string(rest))) {
    require(topics->size() <= 64, "few topics");
    for (const std::string& topic : *topics) require(topic.size() <= 512, "short topics");
  }

  const auto target = parse_target(text);
  if (!target) return false;
  require(target->path.starts_with('/') && target->path.find_first_of("?#") == target->path.npos, "a path");
  require(!target->segments.empty(), "a path has a segment");
  for (const std::string& segment : target->segments) require(is_utf8(segment), "segments are UTF-8");
  for (const auto& [name, value] : target->parameters) require(is_utf8(name) && is_utf8(value), "so are parameters");
  if (target->segments[0] != "api") return false;
  const Query query{"GET", {target->segments.begin() + 1, target->segments.end()}, target->parameters};
  const Answer answer = dashboard.api.answer(query);
  require(answer.status >= 200 && answer.status < 600 && answer.status != 500, "no fault of ours");
  require(!has(answer.body, kElsewhere), "nothing from elsewhere");
  if (answer.type != "application/json") return answer.status < 300;
  const auto json = nlohmann::json::parse(answer.body, nullptr, false);
  require(json.is_object(), "JSON says it");
  require(answer.status < 400 || (json.contains("error") && !json["error"].get<std::string>().empty()),
          "an error says what");
  return answer.status < 300;
}

}  // namespace citylearn::fuzz
