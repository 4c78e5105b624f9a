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

#include "core/wire/node.h"
#include "dashboard/http/hub.h"
#include "dashboard/live/live_view.h"
#include "dashboard/live/maps.h"
#include "dashboard/live/pictures.h"
#include "dashboard/live/service_list.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// What is going on now: hears the services of one run or of all, tells the hub's clients what they watch (services,
/// events, training, scenes, pictures), and answers the API. The methods of LiveView may be used by any thread; all
/// others belong to the thread of the node.
class Live : public LiveView {
 public:
  struct Options {
    Pictures::Options pictures;
    std::size_t most_events = 1000;  ///< kept of those that nobody took
  };
  /// `node` and `hub` must outlive it.
  Live(Node& node, Hub& hub, const Options& options);
  Live(Node& node, Hub& hub) : Live(node, hub, Options()) {}

  /// Takes what Live noticed itself (a service lost, back ...) to the store. One that it throws for, and all without
  /// it, are kept here.
  std::function<void(const Event&)> told;

  // Whoever takes these from the node hands them on. Scenes, maps and pictures Live takes itself.
  void hear(const msg::ServiceStatus& status);
  void hear(const msg::TraversalInfo& info);
  void hear(const msg::RunInfo& info);
  void hear(const msg::TrainingStat& stat);
  /// Of the recorder: to those who watch events.
  void show(const Event& event);

  /// Does what there is to do: to be called whenever something may have come, and at due().
  void turn();
  Clock::time_point due() const { return due_; }

  nlohmann::json services() override;
  nlohmann::json events(std::size_t limit) override;
  nlohmann::json traversals(const std::string& run) override;
  Map map(std::uint64_t hash) override;
  Picture frame(std::uint64_t hash, std::uint32_t index) override;

 private:
  using Environment = std::pair<std::string, std::string>;  // run and id
  struct Hosted {
    std::uint64_t incarnation = 0, hash = 0;
    std::uint32_t frames = 0;
    bool images = false;
    std::uint32_t agents = 0;
    std::string dataset, traversal, condition;
  };
  /// What an agent sees, for a picture topic that is watched.
  struct Panel {
    std::string source;  ///< "ENV@RUN"
    std::size_t agent = 0;
    std::optional<PictureKey> shown, coming;
  };

  void tell(const std::vector<Event>& events);
  void take_requests();
  void look_who_watches();
  void show_services();
  void show_scene(const msg::Scene& scene);
  void show_pictures();
  void show_rows();
  std::optional<Environment> host_of(std::uint64_t hash, bool images, std::uint32_t frame) const;

  Node& node_;
  Hub& hub_;
  const Options options_;

  mutable std::mutex mutex_;  // of all up to the next empty line
  ServiceList services_;
  std::deque<Event> events_;
  std::map<Environment, Hosted> hosted_;
  Maps maps_;
  std::map<std::uint64_t, Environment> maps_asked_;  // by the API, until take_requests()
  std::map<PictureKey, Environment> frames_asked_;   // likewise
  std::set<PictureKey> frames_coming_;               // what became of them

  Pictures pictures_;
  std::set<std::string> watched_;
  std::map<std::string, Panel> panels_;  // by topic
  bool hears_scenes_ = false;
  std::map<std::string, msg::Scene> scenes_;                      // the newest, by "ENV@RUN", while somebody watches
  std::map<std::pair<Sender, std::uint64_t>, std::string> runs_;  // ID by policy_service and job
  struct Rows {
    std::size_t count = 0;
    std::vector<double> values;
  };
  std::map<std::string, Rows> rows_;  // of training topics, to be sent
  bool services_changed_ = false;
  Clock::time_point due_{}, next_services_{}, next_look_{}, next_rows_{};
  msg::Scene scene_;
};

}  // namespace citylearn
