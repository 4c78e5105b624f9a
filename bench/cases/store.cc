// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <thread>
#include <vector>

#include "bench/cases/cases.h"
#include "core/util/error.h"
#include "dashboard/api/api.h"
#include "dashboard/store/recorder.h"
#include "tests/support/options.h"
#include "tests/support/records/records.h"

namespace citylearn::bench {
namespace {

using namespace citylearn::testing;

constexpr std::uint64_t kUpdates = 200'000;

template <class Work>
double median_seconds(const Work& work) {
  std::vector<double> times;
  for (int i = 0; i < 7; ++i) times.push_back(seconds(work));
  return median(times);
}

/// Returns the episodes per second that a plain file takes, each batch synchronised before the next.
double plain_rate(const std::string& path, std::uint64_t total, std::size_t batch, std::size_t bytes) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (file < 0) throw Error("cannot be written", path);
  const std::string text(batch * bytes, 'x');
  bool written = true;
  const double time = seconds([&] {
    for (std::uint64_t done = 0; done < total; done += batch)
      written = written && ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                ::fdatasync(file) == 0;
  });
  ::close(file);
  ::unlink(path.c_str());
  if (!written) throw Error("cannot be written", path);
  return static_cast<double>(total) / time;
}

void recording(const std::string& folder, std::uint64_t total) {
  std::printf("%8s %14s %14s %14s\n", "batch", "episodes/s", "plain file", "of plain file");
  for (const std::size_t batch : {32, 256, 2000}) {
    Store store({folder + "/record-" + std::to_string(batch) + ".sqlite"});
    store.record(run_info());
    const std::uint64_t count = std::min<std::uint64_t>(total, 2000 * batch) / batch * batch;
    const std::vector<msg::EpisodeStat> all = episodes(1, count);
    const double time = seconds([&] {
      for (std::size_t begin = 0; begin < all.size(); begin += batch)
        if (store.record(std::span(all).subspan(begin, batch)) != batch) throw Error("not all were recorded");
    });
    const double rate = static_cast<double>(count) / time;
    const std::size_t bytes = std::filesystem::file_size(store.path()) / count;
    const double plain = plain_rate(folder + "/plain", count, batch, bytes);
    std::printf("%8zu %14.0f %14.0f %14.2f\n", batch, rate, plain, rate / plain);
    record_figure({.name = "recorded by " + std::to_string(batch) + " at once", .value = rate, .unit = "episodes/s"});
    std::fflush(stdout);
  }
}

/// Returns the episodes per second of an env_service with many unrecorded ones. A writer's depth of them is sent ahead.
double catching_up(const std::string& folder, const std::string& middleware, std::uint64_t total) {
  const auto node_options = [&](const std::string& service, const std::string& id) {
    return NodeOptions{middleware_options(middleware, 214), service, id, "demo"};
  };
  constexpr std::uint64_t kWindow = 256;
  std::atomic<bool> failed = false;
  Store store({folder + "/catching-up-" + middleware + ".sqlite"});
  double time = 0;
  std::thread environment([&] {
    Node node(node_options("env_service", "env-summer"));
    node.create_writer<msg::EpisodeStat>();
    node.create_reader<msg::EpisodeAcknowledgement>();
    node.report(msg::RUNNING, "sends episodes");
    std::uint64_t sent = 0, acknowledged = 0;
    const Clock::time_point deadline = Clock::now() + std::chrono::minutes(5);
    msg::EpisodeAcknowledgement message;
    const auto listen = [&](std::chrono::milliseconds patience) {
      const bool heard = node.wait(Clock::now() + patience);
      while (node.take(message))
        if (message.writer_incarnation() == node.incarnation())
          acknowledged = std::max<std::uint64_t>(acknowledged, message.number());
      return heard;
    };
    while (node.readers<msg::EpisodeStat>() == 0 && Clock::now() < deadline) listen(std::chrono::milliseconds(10));
    time = seconds([&] {
      while (acknowledged < total && Clock::now() < deadline) {
        while (sent < std::min(total, acknowledged + kWindow)) {
          msg::EpisodeStat stat = episode(++sent);
          node.publish(stat);
        }
        if (!listen(std::chrono::milliseconds(500))) sent = acknowledged;  // some were lost
      }
    });
    failed = acknowledged < total;
  });
  {
    Node node(node_options("dashboard", "dashboard"));
    Recorder recorder(node, store);
    while (recorder.recorded() < total && !failed) {
      node.wait(std::min(recorder.due(), Clock::now() + std::chrono::milliseconds(100)));
      recorder.poll();
    }
    environment.join();
  }
  if (failed) throw Error("not all episodes were acknowledged", middleware);
  return static_cast<double>(total) / time;
}

void opening(const std::string& folder) {
  Store store({folder + "/open.sqlite"});
  store.record(run_info(kUpdates));
  for (std::uint64_t first = 1; first <= kUpdates; first += 2000) store.record(training_stats(first, first + 1999));
  std::vector<msg::EpisodeStat> some = episodes(1, 50'000);
  for (std::uint64_t number = 50'001; number <= 90'000; ++number) {
    const std::uint64_t index = number - 50'001;
    some.push_back(task(number, static_cast<std::uint32_t>(index % 2000), index % 7 != 0));
    some.back().update(index / 2000 * 100);
  }
  for (std::size_t begin = 0; begin < some.size(); begin += 2000) store.record(std::span(some).subspan(begin, 2000));
  const std::string id = run_id(run_info());

  Api api(Api::Options(), store, nullptr);
  std::size_t bytes = 0;
  const auto ask = [&](const std::vector<std::string>& rest, const std::map<std::string, std::string>& parameters) {
    Query query;
    query.path = {"runs", id};
    query.path.insert(query.path.end(), rest.begin(), rest.end());
    query.parameters = parameters;
    const Answer answer = api.answer(query);
    if (answer.status != 200) throw Error(answer.body);
    bytes = answer.body.size();
  };
  StoreReader reader(store.path());
  const std::int64_t run = reader.run(id)->id;
  double sum = 0;
  const double plain =
      median_seconds([&] { reader.training(run, [&](std::span<const double> row) { sum += row[6]; }); });
  std::printf("\n%-46s %10s %12s %16s\n", "of a run of 200,000 updates, 90,000 episodes", "ms", "bytes",
              "of every row");
  const auto print = [&](const char* what, double time) {
    std::printf("%-46s %10.1f %12zu %16.2f\n", what, 1e3 * time, bytes, time / plain);
    record_figure({.name = what, .value = 1e3 * time, .unit = "ms", .better = Better::kLower});
    std::fflush(stdout);
  };
  print("every row, one column (reference)", plain);
  const std::map<std::string, std::string> chart = {
      {"columns", "reward,spl,policy_loss,entropy,approx_kl"}, {"x", "steps"}, {"points", "2000"}};
  print("training, 5 columns over steps, 2,000 points", median_seconds([&] { ask({"training"}, chart); }));
  print("the run itself", median_seconds([&] { ask({}, {}); }));
  print("newest 100 episodes", median_seconds([&] { ask({"episodes"}, {}); }));
  print("worst 100 tasks", median_seconds([&] { ask({"episodes"}, {{"evaluation", "1"}, {"order", "worst"}}); }));
  print("20 evaluations of 2,000 tasks, first time", seconds([&] { ask({"evaluations"}, {}); }));
  print("the same again", median_seconds([&] { ask({"evaluations"}, {}); }));
  print("training.csv", median_seconds([&] { ask({"training.csv"}, {}); }));
  print("episodes.csv", median_seconds([&] { ask({"episodes.csv"}, {}); }));
}

}  // namespace

Measure store(CLI::App& command) {
  const auto total = std::make_shared<std::uint64_t>(100'000);
  const auto given = std::make_shared<std::string>();
  command.add_option("episodes", *total, "episodes to record");
  command.add_option("--folder", *given, "where the files go; a temporary one by default");
  return [=] {
    const Folder temporary;
    const std::string folder = given->empty() ? temporary.path() : *given;
    recording(folder, *total);
    std::printf("\n%-16s %14s\n", "over", "episodes/s");
    for (const std::string middleware : {"inprocess", "cyclonedds", "fastdds"}) {
      const double rate = catching_up(folder, middleware, *total);
      std::printf("%-16s %14.0f\n", middleware.c_str(), rate);
      record_figure({.name = "recorded over " + middleware, .value = rate, .unit = "episodes/s"});
    }
    opening(folder);
  };
}

}  // namespace citylearn::bench
