// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/live.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <charconv>

#include "core/exchange/timing.h"
#include "core/task/training_figures.h"
#include "dashboard/live/json.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "payloads are copied as they are");

constexpr std::size_t kMaxRequested = 64, kMaxHosted = 4096, kMaxRuns = 4096, kMaxScenes = 256;

std::string source_of(const msg::Header& header) {
  return std::string(header.sender().c_str()) + "@" + header.session().c_str();
}

const char* name_of(msg::Mode mode) {
  return mode == msg::TRAIN ? "train" : mode == msg::EVALUATE ? "evaluate" : "idle";
}

}  // namespace

Live::Live(Node& node, Hub& hub, const Options& options)
    : node_(node), hub_(hub), options_(options), maps_(node), pictures_(node, options.pictures) {}

// Messages.

void Live::on_message(const msg::ServiceStatus& status) {
  std::vector<Event> news;
  {
    const std::lock_guard lock(mutex_);
    services_.on_message(status, options_.clock(), news);
  }
  services_changed_ = true;
  report(news);
}

void Live::on_message(const msg::TraversalInfo& info) {
  const Environment environment(info.header().session().c_str(), info.header().sender().c_str());
  const std::lock_guard lock(mutex_);
  HostedTraversal& hosted = hosted_[environment];
  if (hosted.process.hear(info.header().incarnation(), options_.clock()) == Incumbent::Heard::kOther) return;
  hosted.row = row_of(info);
  if (hosted_.size() <= kMaxHosted) return;
  const auto dead = std::find_if(hosted_.begin(), hosted_.end(), [this](const auto& entry) {
    return !services_.is_alive(entry.first.first, entry.first.second);
  });
  hosted_.erase(dead == hosted_.end() ? hosted_.begin() : dead);
}

void Live::on_message(const msg::RunInfo& info) {
  if (runs_.size() >= kMaxRuns) runs_.clear();  // each that goes on is repeated within a second
  runs_[{Sender(info.header()), info.run_id()}] = run_id(info);
}

void Live::on_message(const msg::TrainingStat& stat) {
  const auto run = runs_.find({Sender(stat.header()), stat.log().stream()});
  if (run == runs_.end()) return;
  const std::string topic = "training:" + run->second;
  if (!watched_.contains(topic)) return;
  Rows& rows = rows_[topic];
  for (const TrainingFigure& figure : training_figures()) rows.values.push_back(figure.value(stat));
  ++rows.count;
  due_ = std::min(due_, next_rows_);
}

void Live::publish(const Event& event) {
  hub_.publish("events", Json::object(), bytes_of(text_of(event_json(event))), Hub::Merge::kEach);
}

void Live::report(const std::vector<Event>& events) {
  for (const Event& event : events) {
    publish(event);
    try {
      if (on_event) {
        on_event(event);
        continue;
      }
    } catch (const Error& error) {  // a full disk, perhaps: then it is kept here only
      spdlog::debug("an event is not recorded: {}", error.what());
    }
    const std::lock_guard lock(mutex_);
    events_.push_front(event);
    if (events_.size() > options_.most_events) events_.pop_back();
  }
}

// Periodic work.

void Live::poll() {
  const Clock::time_point now = Clock::now();
  std::vector<Event> news;
  due_ = now + kLiveUpdate;
  {
    const std::lock_guard lock(mutex_);
    services_changed_ = services_.poll(options_.clock(), news) || services_changed_;
    start_requested_fetches();
    maps_.poll(now);
    due_ = std::min(due_, maps_.due());
  }
  report(news);
  if (now >= next_update_) update_watched_topics();
  if (services_changed_ && now >= next_services_) publish_services();
  while (reads_scenes_ && node_.take(scene_)) {
    const std::string source = source_of(scene_.header());
    if (scenes_.size() >= kMaxScenes && !scenes_.contains(source)) scenes_.clear();
    scenes_[source] = scene_;
    publish_scene(scene_);
  }
  pictures_.poll(now);
  publish_pictures();
  if (now >= next_rows_) publish_training();
  due_ = std::min(due_, pictures_.due());
}

/// Starts the fetches that threads of the API asked for. Called under the lock.
void Live::start_requested_fetches() {
  for (const auto& [hash, host] : maps_asked_)
    if (const auto hosted = hosted_.find(host); hosted != hosted_.end()) maps_.fetch(hosted->second.row, host.first);
  maps_asked_.clear();
  for (const auto& [key, host] : frames_asked_) {
    pictures_.fetch(key, {host.first, host.second});
    frames_coming_.insert(key);
  }
  frames_asked_.clear();
  std::erase_if(frames_coming_, [this](const PictureKey& key) { return !pictures_.fetching(key); });
}

void Live::update_watched_topics() {
  next_update_ = Clock::now() + kLiveUpdate;
  const std::vector<std::string> list = hub_.watched();
  std::set<std::string> now(list.begin(), list.end());
  if (now == watched_) return;
  const std::set<std::string> before = std::exchange(watched_, std::move(now));
  const auto begins = [](const std::string& text, const std::string& start) { return text.rfind(start, 0) == 0; };
  std::erase_if(panels_, [this](const auto& panel) { return !watched_.contains(panel.first); });
  bool scenes = false;
  for (const std::string& topic : watched_) {
    const bool picture = begins(topic, "picture:"), fresh = !before.contains(topic);
    scenes = scenes || picture || begins(topic, "scene:");
    if (picture && fresh) {
      const std::size_t colon = topic.rfind(':');
      PicturePanel panel;
      panel.source = topic.substr(8, std::max<std::size_t>(colon, 8) - 8);
      const char* end = topic.data() + topic.size();
      const auto [last, error] = std::from_chars(topic.data() + colon + 1, end, panel.agent);
      if (error == std::errc() && last == end && colon > 8) panels_[topic] = panel;
    }
    if (fresh && begins(topic, "scene:"))
      if (const auto scene = scenes_.find(topic.substr(6)); scene != scenes_.end()) publish_scene(scene->second);
  }
  if (watched_.contains("services") && !before.contains("services")) next_services_ = {}, services_changed_ = true;
  std::erase_if(rows_, [this](const auto& rows) { return !watched_.contains(rows.first); });
  // An env_service sends scenes only while they have a reader.
  if (scenes == reads_scenes_) return;
  reads_scenes_ = scenes;
  scenes ? node_.create_reader<msg::Scene>() : node_.delete_reader_at<msg::Scene>("");
  if (!scenes) scenes_.clear();
}

void Live::publish_services() {
  services_changed_ = false;
  next_services_ = Clock::now() + kServicesUpdate;
  if (watched_.contains("services"))
    hub_.publish("services", Json::object(), bytes_of(text_of(services())), Hub::Merge::kReplace);
}

void Live::publish_scene(const msg::Scene& scene) {
  const std::string topic = "scene:" + source_of(scene.header());
  if (!watched_.contains(topic)) return;
  std::vector<std::uint32_t> numbers;
  for (const auto* field : {&scene.frame(), &scene.position(), &scene.start(), &scene.goal(), &scene.steps()})
    numbers.insert(numbers.end(), field->begin(), field->end());
  numbers.insert(numbers.end(), scene.flags().begin(), scene.flags().end());
  const msg::Belief& belief = scene.belief();
  numbers.insert(numbers.end(), belief.likely().begin(), belief.likely().end());
  for (const auto* field : {&belief.probability(), &belief.entropy(), &belief.lost()})
    for (const float number : *field) numbers.push_back(std::bit_cast<std::uint32_t>(number));
  hub_.publish(topic,
               {{"traversal", scene.traversal().c_str()},
                {"hash", hash_text(scene.traversal_hash())},
                {"first_frame", scene.first_frame()},
                {"frames", scene.frames()},
                {"step", scene.step()},
                {"mode", name_of(scene.task_mode())},
                {"policy", scene.policy().c_str()},
                {"agents", scene.frame().size()},
                {"likely", scene.belief().lost().empty() ? 0 : msg::LIKELY_PLACES}},
               bytes_of(numbers), Hub::Merge::kReplace);
}

/// Shows in each panel what its agent sees. While that picture is fetched, shows the one that was fetched before it.
void Live::publish_pictures() {
  for (auto& [topic, panel] : panels_) {
    const auto found = scenes_.find(panel.source);
    if (found == scenes_.end() || panel.agent >= found->second.frame().size()) continue;
    const msg::Scene& scene = found->second;
    const Environment environment(scene.header().session().c_str(), scene.header().sender().c_str());
    {
      const std::lock_guard lock(mutex_);
      const auto hosted = hosted_.find(environment);
      if (hosted == hosted_.end() || !hosted->second.row.images) continue;
    }
    const PictureKey seen{scene.traversal_hash(), scene.frame()[panel.agent]};
    PictureKey key = seen;
    auto picture = panel.shown == seen ? nullptr : pictures_.find(seen);
    if (!picture && panel.coming && panel.shown != seen) {
      key = *panel.coming;
      picture = pictures_.find(key);
      if (picture || !pictures_.fetching(key)) panel.coming.reset();
    }
    if (picture) {
      panel.shown = key;
      if (!picture->bytes.empty())
        hub_.publish(topic, {{"hash", hash_text(key.hash)}, {"frame", key.frame}, {"type", picture->type}},
                     bytes_of(picture->bytes), Hub::Merge::kReplace);
    }
    if (panel.shown == seen || panel.coming) continue;
    panel.coming = seen;
    pictures_.fetch(seen, {environment.first, environment.second});
  }
}

void Live::publish_training() {
  next_rows_ = Clock::now() + kLiveUpdate;
  for (auto& [topic, rows] : rows_) {
    if (rows.count == 0) continue;
    Json columns;
    for (const TrainingFigure& figure : training_figures()) columns.push_back(figure.name);
    hub_.publish(topic, {{"columns", columns}, {"rows", rows.count}}, bytes_of(rows.values), Hub::Merge::kAppend);
    rows = {};
  }
}

// LiveView, for the API.

nlohmann::json Live::services() {
  const std::lock_guard lock(mutex_);
  return services_.json(options_.clock());
}

nlohmann::json Live::events(std::size_t limit) {
  const std::lock_guard lock(mutex_);
  Json list = Json::array();
  for (const Event& event : events_) {
    if (list.size() == limit) break;
    list.push_back(event_json(event));
  }
  return list;
}

/// Returns a living env_service that hosts this traversal, with pictures if `images`.
std::optional<Live::Environment> Live::host_of(std::uint64_t hash, bool images, std::uint32_t frame) const {
  for (const auto& [environment, hosted] : hosted_)
    if (hosted.row.hash == hash && (hosted.row.images || !images) && frame < hosted.row.frames &&
        services_.is_alive(environment.first, environment.second))
      return environment;
  return std::nullopt;
}

std::optional<bool> Live::alive(const std::string& session, const std::string& id) {
  const std::lock_guard lock(mutex_);
  return services_.knows(session, id) ? std::optional(services_.is_alive(session, id)) : std::nullopt;
}

nlohmann::json Live::traversals(const std::string& session) {
  nlohmann::json list = nlohmann::json::array();
  const std::lock_guard lock(mutex_);
  for (const auto& [environment, hosted] : hosted_)
    if (environment.first == session && services_.is_alive(environment.first, environment.second))
      list.push_back(traversal_json(hosted.row));
  return list;
}

LiveView::Map Live::map(std::uint64_t hash) {
  std::shared_ptr<const RouteMap> map;
  {
    const std::lock_guard lock(mutex_);
    map = maps_.find(hash);
    if (!map) {
      if (maps_.fetching(hash)) return {Readiness::kComing};
      const auto host = host_of(hash, false, 0);
      if (!host) return {Readiness::kNone};
      if (maps_asked_.size() < kMaxRequested) maps_asked_[hash] = *host;
      return {Readiness::kComing};
    }
  }
  return {Readiness::kHere, std::move(map)};
}

std::vector<TraversalRow> Live::hosted() {
  std::map<std::uint64_t, TraversalRow> traversals;
  const std::lock_guard lock(mutex_);
  for (const auto& [environment, hosted] : hosted_)
    if (services_.is_alive(environment.first, environment.second)) traversals.try_emplace(hosted.row.hash, hosted.row);
  std::vector<TraversalRow> list;
  for (auto& [hash, row] : traversals) list.push_back(std::move(row));
  return list;
}

std::shared_ptr<const RouteMap> Live::route_map(std::uint64_t hash) {
  const std::lock_guard lock(mutex_);
  auto map = maps_.find(hash);
  const auto host = map ? std::nullopt : host_of(hash, false, 0);
  if (host) maps_.fetch(hosted_.at(*host).row, host->first);
  return map;
}

RouteSource::SparePicture Live::spare_picture(const PictureKey& key) {
  if (auto picture = pictures_.find(key)) return {std::move(picture), false};
  if (pictures_.fetching(key)) return {nullptr, true};
  const std::lock_guard lock(mutex_);
  const auto host = host_of(key.hash, true, key.frame);
  return {nullptr, host && pictures_.fetch_spare(key, {host->first, host->second},
                                                 !services_.is_working(host->first, host->second))};
}

LiveView::Picture Live::frame(std::uint64_t hash, std::uint32_t index) {
  const PictureKey key{hash, index};
  if (const auto picture = pictures_.find(key)) {
    if (picture->bytes.empty()) return {Readiness::kNone, {}, {}};
    return {Readiness::kHere, picture->type, picture->bytes};
  }
  const std::lock_guard lock(mutex_);
  if (frames_coming_.contains(key)) return {Readiness::kComing, {}, {}};
  const auto host = host_of(hash, true, index);
  if (!host) return {Readiness::kNone, {}, {}};
  if (frames_asked_.size() < kMaxRequested) frames_asked_[key] = *host;
  return {Readiness::kComing, {}, {}};
}

}  // namespace citylearn
