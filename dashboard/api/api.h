// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "dashboard/http/answer.h"
#include "dashboard/live/live_view.h"
#include "dashboard/store/store.h"
#include "dashboard/store/store_reader.h"

namespace citylearn {

/// Answers the page's requests (docs/reference/dashboard-api.md) from the store and from the live services. May be used
/// by several threads at once; each gets a connection to the store of its own. A wrong request gets an answer that says
/// what is wrong.
class Api {
 public:
  struct Options {
    std::string vendor, session;           ///< of the dashboard's node
    std::uint32_t domain = 0;              ///< likewise
    std::function<bool()> recording;       ///< whether episodes reach the store now; unset: they do
    double silence = kRunSilence.count();  ///< seconds without news after which a run counts as lost
    /// A recording is played. Only heartbeats of its policy_service then say whether a run goes on, as it may be slow.
    bool replays = false;
  };
  /// `store` and `live` must outlive it. `live` may be null: then no service is shown as alive.
  Api(const Options& options, Store& store, LiveView* live);
  ~Api();

  Answer answer(const Query& query);

  /// Returns what GET /api/runs answers, for the live topic `runs`.
  nlohmann::json runs();

 private:
  /// A reader of the store for the time of one answer.
  class BorrowedReader {
   public:
    explicit BorrowedReader(Api& api);
    ~BorrowedReader();
    StoreReader* operator->() { return reader_.get(); }

   private:
    Api& api_;
    std::unique_ptr<StoreReader> reader_;
    int unwinding_;
  };
  Answer about();
  Answer services();
  Answer events(const Query& query);
  Answer map(const Query& query);
  Answer frame(const Query& query);
  Answer answer_run(const Query& query);
  Answer run(const RunRow& row);
  Answer remove(const std::string& name);
  Answer training(const RunRow& row, const Query& query);
  Answer episodes(const RunRow& row, const Query& query);
  Answer evaluations(const RunRow& row);
  Answer episode(const Query& query);
  nlohmann::json run_json(const RunRow& row);

  const Options options_;
  Store& store_;
  LiveView* const live_;

  std::mutex mutex_;
  std::vector<std::unique_ptr<StoreReader>> readers_;  // those not in use
  struct Figures {
    std::uint64_t episodes = 0;
    std::int64_t newest = 0;
    nlohmann::json figures;
  };
  std::map<std::pair<std::int64_t, EvaluationKey>, Figures>
      evaluations_;  // by row of `runs`; valid until episodes are added
};

}  // namespace citylearn
