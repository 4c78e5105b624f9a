// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/worker_pool.h"

#include <algorithm>
#include <chrono>
#include <system_error>
#include <utility>

#include "core/util/error.h"
#include "core/util/processors.h"

namespace citylearn {

WorkerPool::WorkerPool(int threads) : threads_(threads > 0 ? threads : available_processors()) {}

WorkerPool::~WorkerPool() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

int WorkerPool::PieceTime::threads(int pieces, int most) const {
  const double worth = seconds_ * pieces / kMinWork;
  return worth < most ? std::max(1, static_cast<int>(worth)) : most;
}

void WorkerPool::run(int count, const std::function<void(int)>& work, PieceTime* time) {
  const int most = std::min(count, threads_);
  if (most < 2) {
    for (int piece = 0; piece < count; ++piece) work(piece);
    return;
  }
  const int helpers = (time ? time->threads(count, most) : most) - 1;
  start_helpers(helpers);
  const auto begin = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  work_ = &work;
  next_ = 0;
  count_ = count;
  for (int i = 0; i < helpers; ++i) wake_.notify_one();
  const int mine = take_pieces(lock);
  if (time && mine > 0)
    time->measure(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / mine);
  wait(lock, done_, [this] { return running_ == 0; });
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void WorkerPool::start_helpers(int count) {
  try {
    while (static_cast<int>(helpers_.size()) < count) helpers_.emplace_back([this] { help(); });
  } catch (const std::system_error& error) {
    throw Error("cannot start thread " + std::to_string(helpers_.size() + 2) + ": " + error.what(), "--threads",
                "use fewer, or raise the limit of processes");
  }
}

void WorkerPool::help() {
  std::unique_lock lock(mutex_);
  while (true) {
    wait(lock, wake_, [this] { return stop_ || next_ < count_; });
    if (stop_) return;
    take_pieces(lock);
    if (running_ == 0) done_.notify_one();
  }
}

/// Waits until something is ready: first awake, because sleeping and being woken takes as long as many a piece does.
template <class Ready>
void WorkerPool::wait(std::unique_lock<std::mutex>& lock, std::condition_variable& sign, const Ready& ready) {
  using Clock = std::chrono::steady_clock;
  lock.unlock();
  const auto until = Clock::now() + std::chrono::duration<double>(kMinWork);
  while (!ready() && Clock::now() < until) {
  }
  lock.lock();
  sign.wait(lock, ready);
}

/// Does pieces until none is left to begin, and returns how many. The lock is open while a piece is done.
int WorkerPool::take_pieces(std::unique_lock<std::mutex>& lock) {
  int done = 0;
  for (; next_ < count_; ++done) {
    const int piece = next_++;
    ++running_;
    lock.unlock();
    std::exception_ptr failure;
    try {
      (*work_)(piece);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    --running_;
    if (!failure) continue;
    if (!failure_) failure_ = failure;
    next_ = count_.load();
  }
  return done;
}

}  // namespace citylearn
