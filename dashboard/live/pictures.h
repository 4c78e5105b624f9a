// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "core/exchange/object_fetch.h"
#include "core/exchange/timing.h"
#include "core/wire/node.h"
#include "dashboard/live/picture_cache.h"

namespace citylearn {

/// Fetches pictures of frames from env_services on request, shrinks them for the page, and caches them. find() may be
/// used by any thread, all else by the thread of the node.
class Pictures {
 public:
  struct Options {
    std::size_t most_bytes = std::size_t{64} << 20;        ///< kept
    int widest = 640;                                      ///< pixels
    std::chrono::milliseconds between = kPictureInterval;  ///< requests of pictures
    std::chrono::milliseconds patience = kDashboardRetry;  ///< until a missing chunk is requested again
    std::size_t most_waiting = 64;                         ///< beyond, the oldest are dropped
    /// Limits for pictures that nobody waits for: the pause after one, as a multiple of the time that it took, so that
    /// a working env_service spends 2 % of its time on them and an idle one 20 %; and bytes a second, on average.
    int spare_pause = 50, idle_pause = 4;
    std::size_t spare_rate = std::size_t{1} << 20;
  };
  struct Source {
    std::string session, environment;
  };
  Pictures(Node& node, const Options& options);

  std::shared_ptr<const PictureFile> find(const PictureKey& key) { return cache_.find(key); }

  /// Starts to fetch a picture unless it is here or under way. Waiting ones are taken newest and oldest by turns.
  void fetch(const PictureKey& key, const Source& source);
  /// Starts to fetch a picture that nobody waits for, of an env_service that works or is idle. Returns false, having
  /// done nothing, while any other one is fetched or the spare rate is used up.
  bool fetch_spare(const PictureKey& key, const Source& source, bool idle);
  /// Takes chunks that arrived and requests what is due.
  void poll(Clock::time_point now);
  /// Returns the time of the next request, or time_point::max().
  Clock::time_point due() const;
  /// Returns whether it is being fetched or made small.
  bool fetching(const PictureKey& key);

 private:
  struct Fetch {
    Source source;
    ObjectFetch object;
    Clock::time_point begun;
    int pause = 0;         // 0: somebody waits for it
    bool arrives = false;  // a chunk has come
  };
  void begin(const PictureKey& key, const Source& source, Clock::time_point now, int pause);
  void on_message(const msg::ImageChunk& chunk, Clock::time_point now);
  void request(Fetch& fetch, Clock::time_point now);
  void shrink_later(const PictureKey& key, const msg::Image& image);
  void shrink_all(const std::stop_token& stop);

  Node& node_;
  const Options options_;
  PictureCache cache_;
  std::deque<std::pair<PictureKey, Source>> waiting_;  // not requested yet; the newest last
  std::map<PictureKey, Fetch> fetches_;
  Clock::time_point next_{}, next_spare_{};
  bool newest_next_ = false;
  msg::ImageRequest request_;
  msg::ImageChunk chunk_;

  // The thread that makes them small.
  struct Original {
    PictureKey key;
    Bytes file;
    std::string name;
  };
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Original> originals_;  // the first one is being done
  std::jthread thread_{[this](const std::stop_token& stop) { shrink_all(stop); }};
};

}  // namespace citylearn
