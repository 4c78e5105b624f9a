// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/exchange/incumbent.h"
#include "core/wire/node.h"
#include "dashboard/http/hub.h"
#include "dashboard/live/live_view.h"
#include "dashboard/live/maps.h"
#include "dashboard/live/pictures.h"
#include "dashboard/live/route_source.h"
#include "dashboard/live/service_list.h"
#include "dashboard/store/rows.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Shows what goes on now: takes the messages of one session or of all, publishes to the hub's clients the topics that
/// they watch (services, events, training, scenes, pictures), and answers the API. The methods of LiveView may be used
/// by any thread; all others belong to the thread of the node.
class Live : public LiveView, public RouteSource {
 public:
  struct Options {
    Pictures::Options pictures;
    std::size_t most_events = 1000;  ///< kept of those that on_event did not take
    /// Tells whether a service is silent; of a recording, its own clock. Called by any thread.
    std::function<Clock::time_point()> clock = Clock::now;
  };
  /// `node` and `hub` must outlive it.
  Live(Node& node, Hub& hub, const Options& options);
  Live(Node& node, Hub& hub) : Live(node, hub, Options()) {}

  /// Called for what Live noticed itself (a service lost, back ...), to put it into the store. Events for which it
  /// throws, and all when it is unset, are kept here.
  std::function<void(const Event&)> on_event;

  // The loop that takes these from the node passes them on. Live takes scenes, maps and pictures itself.
  void on_message(const msg::ServiceStatus& status);
  void on_message(const msg::TraversalInfo& info);
  void on_message(const msg::RunInfo& info);
  void on_message(const msg::TrainingStat& stat);
  /// Sends an event to the clients that watch events.
  void publish(const Event& event);

  /// Does what is due. Call it when a message may have arrived, and at due().
  void poll();
  Clock::time_point due() const { return due_; }

  nlohmann::json services() override;
  nlohmann::json events(std::size_t limit) override;
  std::optional<bool> alive(const std::string& session, const std::string& id) override;
  nlohmann::json traversals(const std::string& session) override;
  Map map(std::uint64_t hash) override;
  Picture frame(std::uint64_t hash, std::uint32_t index) override;

  std::vector<TraversalRow> hosted() override;
  std::shared_ptr<const RouteMap> route_map(std::uint64_t hash) override;
  SparePicture spare_picture(const PictureKey& key) override;

 private:
  using Environment = std::pair<std::string, std::string>;  // session and id
  struct HostedTraversal {
    Incumbent process;
    TraversalRow row;
  };
  /// A watched picture topic: what one agent sees.
  struct PicturePanel {
    std::string source;  ///< "ENV@SESSION"
    std::size_t agent = 0;
    std::optional<PictureKey> shown, coming;
  };

  void report(const std::vector<Event>& events);
  void start_requested_fetches();
  void update_watched_topics();
  void publish_services();
  void publish_scene(const msg::Scene& scene);
  void publish_pictures();
  void publish_training();
  std::optional<Environment> host_of(std::uint64_t hash, bool images, std::uint32_t frame) const;

  Node& node_;
  Hub& hub_;
  const Options options_;

  mutable std::mutex mutex_;  // of all up to the next empty line
  ServiceList services_;
  std::deque<Event> events_;
  std::map<Environment, HostedTraversal> hosted_;
  Maps maps_;
  std::map<std::uint64_t, Environment> maps_asked_;  // by the API, until start_requested_fetches()
  std::map<PictureKey, Environment> frames_asked_;   // likewise
  std::set<PictureKey> frames_coming_;               // those being fetched

  Pictures pictures_;
  std::set<std::string> watched_;
  std::map<std::string, PicturePanel> panels_;  // by topic
  bool reads_scenes_ = false;
  std::map<std::string, msg::Scene> scenes_;  // the newest, by "ENV@SESSION", while a client watches
  std::map<std::pair<Sender, std::uint64_t>, std::string> runs_;  // ID by policy_service and run_id
  struct Rows {
    std::size_t count = 0;
    std::vector<double> values;
  };
  std::map<std::string, Rows> rows_;  // of training topics, to be sent
  bool services_changed_ = false;
  Clock::time_point due_{}, next_services_{}, next_update_{}, next_rows_{};
  msg::Scene scene_;
};

}  // namespace citylearn
