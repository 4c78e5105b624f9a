// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace citylearn {

/// Does pieces of some work at once, on the caller's thread and on threads of its own. These start when there is first
/// something for them to do, and look out for more for kMinWork before they sleep. What a piece computes must not
/// depend on which thread does it, nor when. Used by one thread.
class WorkerPool {
 public:
  /// The least work of a thread that is woken, seconds: waking one and waiting for it takes a good part of that.
  static constexpr double kMinWork = 50e-6;
  /// How long a piece of some kind of work takes, as run() has measured it so far.
  class PieceTime {
   public:
    /// Takes in a measurement. It at most doubles the time: the thread may have been interrupted meanwhile.
    void measure(double seconds) { seconds_ = seconds_ > 0 ? std::min(seconds, 2 * seconds_) : seconds; }
    /// Returns how many threads, `most` at most, get kMinWork each of so many pieces; 1 when nothing was measured.
    int threads(int pieces, int most) const;

   private:
    double seconds_ = 0;
  };

  /// Uses at most so many threads, the caller's included; 0: as many as available_processors(). With 1 there is no
  /// other thread.
  explicit WorkerPool(int threads = 0);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  int threads() const { return threads_; }
  /// Calls work(0) to work(count - 1) and returns when all have returned. When one throws, those that have not begun
  /// are left out and the exception is rethrown here. Throws Error when the system starts no further thread. Allocates
  /// nothing once the threads run. With `time`, which it keeps up to date, it wakes only as many threads as get
  /// kMinWork each; without it all.
  void run(int count, const std::function<void(int)>& work, PieceTime* time = nullptr);

 private:
  void start_helpers(int count);
  void help();
  int take_pieces(std::unique_lock<std::mutex>& lock);
  template <class Ready>
  void wait(std::unique_lock<std::mutex>& lock, std::condition_variable& sign, const Ready& ready);

  const int threads_;
  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  // Of the present work; changed under mutex_.
  const std::function<void(int)>* work_ = nullptr;
  std::atomic<int> next_ = 0, count_ = 0, running_ = 0;  // pieces
  std::exception_ptr failure_;
  std::atomic<bool> stop_ = false;
};

/// Returns where part `part` of `parts` begins when `total` things are divided evenly; part `parts` begins at the end.
inline std::size_t begin_of_part(std::size_t total, std::size_t part, std::size_t parts) {
  return (total * part + parts - 1) / parts;
}

}  // namespace citylearn
