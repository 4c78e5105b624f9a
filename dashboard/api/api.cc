// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/api.h"

#include <sys/stat.h>

#include <algorithm>
#include <exception>

#include "core/util/text.h"
#include "core/util/version.h"
#include "dashboard/api/parameters.h"
#include "dashboard/live/json.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxIdleReaders = 16;

std::uint64_t file_bytes(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
}

Answer coming() {
  Answer answer = error_answer(503, "is being fetched: ask again in a second");
  answer.headers.emplace_back("Retry-After", "1");
  return answer;
}

}  // namespace

Api::BorrowedReader::BorrowedReader(Api& api) : api_(api), unwinding_(std::uncaught_exceptions()) {
  {
    std::lock_guard lock(api_.mutex_);
    if (!api_.readers_.empty()) {
      reader_ = std::move(api_.readers_.back());
      api_.readers_.pop_back();
    }
  }
  if (!reader_) reader_ = std::make_unique<StoreReader>(api_.store_.path());
}

Api::BorrowedReader::~BorrowedReader() {
  // A reader that failed may stand in the middle of its rows.
  if (std::uncaught_exceptions() > unwinding_) return;
  std::lock_guard lock(api_.mutex_);
  if (api_.readers_.size() < kMaxIdleReaders) api_.readers_.push_back(std::move(reader_));
}

Api::Api(const Options& options, Store& store, LiveView* live) : options_(options), store_(store), live_(live) {}
Api::~Api() = default;

Answer Api::answer(const Query& query) {
  try {
    const std::string first = query.path.empty() ? "" : query.path[0];
    const std::size_t depth = query.path.size();
    std::vector<std::string> methods = {"GET"};
    if (first == "runs" && depth == 2) methods = {"GET", "DELETE"};
    if (std::find(methods.begin(), methods.end(), query.method) == methods.end()) {
      Answer answer = error_answer(405, "method " + query.method + " is not possible here");
      answer.headers.emplace_back("Allow", joined(methods));
      return answer;
    }
    if (first == "runs" && depth == 1) {
      allow_only(query, {});
      return json_answer(runs());
    }
    if (first == "runs" && (depth == 2 || depth == 3)) return answer_run(query);
    if (first == "episodes" && depth == 2) return episode(query);
    if (first == "services" && depth == 1) return services();
    if (first == "events" && depth == 1) return events(query);
    if (first == "map" && depth == 2) return map(query);
    if (first == "frames" && depth == 3) return frame(query);
    if (first == "about" && depth == 1) return about();
    not_found("there is nothing of this name (docs/reference/dashboard-api.md lists what there is)");
  } catch (RequestError& error) {
    return std::move(error.answer);
  } catch (const Error& error) {
    return error_answer(503, error.what());
  }
}

Answer Api::services() {
  if (live_) return json_answer(live_->services());
  return json_answer({{"now", seconds_since_epoch()}, {"services", Json::array()}});
}

Answer Api::events(const Query& query) {
  allow_only(query, {"limit"});
  const auto limit = static_cast<std::size_t>(number_parameter<int>(query, "limit", 1, 10000).value_or(200));
  Json all = live_ ? live_->events(limit) : Json::array();
  for (const Event& event : store_.events(limit)) {
    Json one = event_json(event);
    if (std::find(all.begin(), all.end(), one) == all.end()) all.push_back(std::move(one));
  }
  std::stable_sort(all.begin(), all.end(), [](const Json& a, const Json& b) { return a["time"] > b["time"]; });
  if (all.size() > limit) all.erase(all.begin() + static_cast<std::ptrdiff_t>(limit), all.end());
  return json_answer({{"events", std::move(all)}});
}

Answer Api::map(const Query& query) {
  allow_only(query, {"first", "last", "points"});
  const std::uint64_t hash = parsed_hash(query.path[1]);
  MapPart part;
  part.first = number_parameter(query, "first", 0u, part.last).value_or(part.first);
  part.last = number_parameter(query, "last", part.first, part.last).value_or(part.last);
  part.points = number_parameter(query, "points", 2u, 1u << 16).value_or(part.points);
  const LiveView::Map map = live_ ? live_->map(hash) : LiveView::Map();
  if (map.readiness == LiveView::Readiness::kHere) return json_answer(map_json(hash, *map.map, part));
  BorrowedReader reader(*this);
  if (const auto stored = reader->map(hash)) return json_answer(map_json(hash, *stored, part));
  if (map.readiness == LiveView::Readiness::kComing) return coming();
  not_found("no env_service that is there hosts " + query.path[1] + ", and no map of it is stored");
}

Answer Api::frame(const Query& query) {
  allow_only(query, {"nearest"});
  const bool nearest = flag_parameter(query, "nearest").value_or(false);
  const std::uint64_t hash = parsed_hash(query.path[1]);
  const auto index = parsed<std::uint32_t>(query.path[2]);
  if (!index) throw RequestError(400, "a frame is named by its index, a number; '" + query.path[2] + "' is none");
  LiveView::Picture picture = live_ ? live_->frame(hash, *index) : LiveView::Picture();
  if (picture.readiness == LiveView::Readiness::kComing) return coming();
  std::uint32_t frame = *index;
  if (picture.readiness == LiveView::Readiness::kNone) {
    BorrowedReader reader(*this);
    auto stored = reader->picture(hash, *index);
    if (!stored || (stored->frame != *index && !nearest))
      not_found("no env_service that is there has a picture of frame " + query.path[2] + " of " + query.path[1] +
                ", and none is stored");
    frame = stored->frame;
    picture.type = std::move(stored->picture.type);
    picture.bytes = std::move(stored->picture.bytes);
  }
  Answer answer;
  answer.type = std::move(picture.type);
  answer.body = std::move(picture.bytes);
  // A stored picture is smaller than what an env_service has, which may come back.
  const bool stored = picture.readiness == LiveView::Readiness::kNone;
  answer.headers.emplace_back("Cache-Control", stored ? "no-store" : "private, max-age=31536000, immutable");
  answer.headers.emplace_back("X-Frame", std::to_string(frame));
  return answer;
}

Answer Api::about() {
  BorrowedReader reader(*this);
  const std::string& path = store_.path();
  return json_answer(
      {{"version", version()},
       {"vendor", options_.vendor},
       {"session", options_.session},
       {"domain", options_.domain},
       {"store",
        {{"file", path}, {"bytes", file_bytes(path) + file_bytes(path + "-wal")}, {"episodes", reader->episodes()}}},
       {"recording", !options_.recording || options_.recording()}});
}

}  // namespace citylearn
