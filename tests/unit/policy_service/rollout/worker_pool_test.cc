// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/worker_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "core/util/error.h"
#include "core/util/processors.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Returns the number of threads that do something at once when so many pieces wait for one another.
std::size_t threads_that_meet(WorkerPool& workers, int pieces, WorkerPool::PieceTime* time = nullptr) {
  std::mutex mutex;
  std::condition_variable met;
  std::set<std::thread::id> threads;
  const std::function<void(int)> meet = [&](int) {
    std::unique_lock lock(mutex);
    threads.insert(std::this_thread::get_id());
    met.notify_all();
    met.wait_for(lock, std::chrono::seconds(60), [&] { return static_cast<int>(threads.size()) == pieces; });
  };
  workers.run(pieces, meet, time);
  return threads.size();
}

TEST(WorkerPool, DoesEveryPieceOnce) {
  for (const int threads : {1, 2, 3, 8}) {
    WorkerPool workers(threads);
    EXPECT_EQ(workers.threads(), threads);
    for (const int count : {0, 1, 2, 5, 100}) {
      std::vector<std::atomic<int>> done(static_cast<std::size_t>(count));
      for (int round = 0; round < 20; ++round)
        workers.run(count, [&](int piece) { ++done[static_cast<std::size_t>(piece)]; });
      for (const std::atomic<int>& times : done) EXPECT_EQ(times, 20) << threads << " threads, " << count << " pieces";
    }
  }
}

TEST(WorkerPool, DoesThemAtOnce) {
  WorkerPool workers(4);
  for (const int pieces : {2, 4, 3}) EXPECT_EQ(threads_that_meet(workers, pieces), static_cast<std::size_t>(pieces));
}

TEST(WorkerPool, WakesNoThreadForLessWorkThanThat) {
  constexpr double kWork = WorkerPool::kMinWork;
  WorkerPool::PieceTime time;
  EXPECT_EQ(time.threads(100, 8), 1) << "before a measurement";
  const auto expect = [&](double measured, int pieces, int threads) {
    time.measure(measured);
    EXPECT_EQ(time.threads(pieces, 8), threads) << measured << " s, " << pieces << " pieces";
  };
  expect(0.9 * kWork, 2, 1);
  expect(1.1 * kWork, 2, 2);
  expect(1.1 * kWork, 5, 5);
  expect(1.1 * kWork, 50, 8);
  expect(0.42 * kWork, 5, 2);  // less is believed at once,
  expect(1000 * kWork, 5, 4);  // and more only when it is measured again and again
  expect(1000 * kWork, 5, 8);
}

TEST(WorkerPool, WakesThreadsOnceWorkIsWorthIt) {
  WorkerPool workers(2);
  WorkerPool::PieceTime time;
  std::set<std::thread::id> threads;
  workers.run(
      2, [&](int) { threads.insert(std::this_thread::get_id()); }, &time);
  EXPECT_EQ(threads.size(), 1u);
  time.measure(1e-3);
  while (time.threads(2, 2) < 2) time.measure(1e-3);  // it doubles each time
  EXPECT_EQ(threads_that_meet(workers, 2, &time), 2u);
}

TEST(WorkerPool, OneThreadIsTheCallers) {
  WorkerPool workers(1);
  const std::thread::id caller = std::this_thread::get_id();
  std::vector<int> order;
  workers.run(4, [&](int piece) {
    EXPECT_EQ(std::this_thread::get_id(), caller);
    order.push_back(piece);
  });
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3}));
}

TEST(WorkerPool, UsesTheProcessorsUnlessTold) { EXPECT_EQ(WorkerPool().threads(), available_processors()); }

TEST(WorkerPool, AnExceptionReachesTheCallerAndTheNextWorkIsDone) {
  for (const int threads : {1, 3}) {
    WorkerPool workers(threads);
    for (int wrong = 0; wrong < 6; ++wrong) {
      const std::string message = error_of([&] {
        workers.run(6, [&](int piece) {
          if (piece == wrong) throw Error("piece " + std::to_string(piece));
        });
      });
      EXPECT_EQ(message, "piece " + std::to_string(wrong));
      std::atomic<int> done = 0;
      workers.run(6, [&](int) { ++done; });
      EXPECT_EQ(done, 6);
    }
  }
}

TEST(WorkerPool, PartsAreEvenAndComplete) {
  for (std::size_t total = 0; total < 20; ++total)
    for (std::size_t parts = 1; parts < 9; ++parts) {
      EXPECT_EQ(begin_of_part(total, 0, parts), 0u);
      EXPECT_EQ(begin_of_part(total, parts, parts), total);
      for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t size = begin_of_part(total, part + 1, parts) - begin_of_part(total, part, parts);
        EXPECT_TRUE(size == total / parts || size == (total + parts - 1) / parts) << total << " " << parts;
      }
    }
}

}  // namespace
}  // namespace citylearn::testing
