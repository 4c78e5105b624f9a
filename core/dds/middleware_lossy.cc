// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <optional>
#include <set>

#include "core/dds/middleware_internal.h"
#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn::internal {
namespace {

/// Shares of the samples written, 0..1.
struct Loss {
  double drop = 0.1;
  double repeat = 0.1;
  double reorder = 0.1;
  std::uint64_t seed = 1;
};

template <class Number>
Number parse_number(std::string_view name, std::string_view text) {
  Number number{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || end != text.data() + text.size())
    throw Error("'" + std::string(text) + "' is not a number", "middleware lossy, " + std::string(name));
  return number;
}

Loss parse(std::string_view options) {
  Loss loss;
  while (!options.empty()) {
    options.remove_prefix(1);  // the comma
    const std::string_view option = options.substr(0, options.find(','));
    options.remove_prefix(option.size());
    const std::size_t equals = option.find('=');
    const std::string_view name = option.substr(0, equals);
    const std::string_view value = equals == option.npos ? "" : option.substr(equals + 1);
    if (name == "seed") {
      loss.seed = parse_number<std::uint64_t>(name, value);
      continue;
    }
    double* share = name == "drop"      ? &loss.drop
                    : name == "repeat"  ? &loss.repeat
                    : name == "reorder" ? &loss.reorder
                                        : nullptr;
    if (!share)
      throw Error("unknown option '" + std::string(name) + "'", "middleware lossy",
                  "known: drop, repeat, reorder, seed");
    *share = parse_number<double>(name, value);
    if (!(*share >= 0 && *share <= 1))
      throw Error("must be 0..1, is " + std::string(value), "middleware lossy, " + std::string(name));
  }
  return loss;
}

class LossyPublisher;

/// The publishers alive, for the middleware to flush.
using Publishers = std::set<LossyPublisher*>;

class LossyPublisher : public Publisher {
 public:
  LossyPublisher(std::unique_ptr<Publisher> inner, const Loss& loss, std::uint64_t index,
                 std::shared_ptr<Publishers> all)
      : inner_(std::move(inner)), loss_(loss), random_{loss.seed, index}, all_(std::move(all)) {
    all_->insert(this);
  }
  ~LossyPublisher() override { all_->erase(this); }

  void publish(std::span<const std::byte> sample) override {
    // All three are drawn each time, so that one share does not change the fate of the others' samples.
    const bool drop = random_.uniform() < loss_.drop;
    const bool repeat = random_.uniform() < loss_.repeat;
    const bool hold = random_.uniform() < loss_.reorder;
    if (!drop && hold && !held_) {
      held_.emplace(sample.begin(), sample.end());
      repeat_held_ = repeat;
      return;
    }
    if (!drop) {
      inner_->publish(sample);
      if (repeat) inner_->publish(sample);
    }
    flush();
  }
  int matched() const override { return inner_->matched(); }
  Guid guid() const override { return inner_->guid(); }
  void wait_for_acknowledgments(Clock::time_point deadline) override { inner_->wait_for_acknowledgments(deadline); }

  void flush() {
    if (!held_) return;
    inner_->publish(*held_);
    if (repeat_held_) inner_->publish(*held_);
    held_.reset();
  }

 private:
  const std::unique_ptr<Publisher> inner_;
  const Loss loss_;
  Random random_;
  std::optional<Bytes> held_;  // overtaken by the next sample
  bool repeat_held_ = false;
  const std::shared_ptr<Publishers> all_;
};

class LossyMiddleware : public Middleware {
 public:
  LossyMiddleware(std::unique_ptr<Middleware> inner, const Loss& loss) : inner_(std::move(inner)), loss_(loss) {}

  std::unique_ptr<Publisher> create_publisher(const Topic& topic) override {
    return std::make_unique<LossyPublisher>(inner_->create_publisher(topic), loss_, created_++, publishers_);
  }
  std::unique_ptr<Subscription> create_subscription(const Topic& topic) override {
    return inner_->create_subscription(topic);
  }
  bool wait(Clock::time_point deadline) override {
    for (LossyPublisher* publisher : *publishers_) publisher->flush();
    return inner_->wait(deadline);
  }
  DiscoveryMonitor& discovery() override { return inner_->discovery(); }
  Guid guid() const override { return inner_->guid(); }
  std::string name() const override { return "lossy:" + inner_->name(); }

 private:
  const std::unique_ptr<Middleware> inner_;
  const Loss loss_;
  std::uint64_t created_ = 0;
  const std::shared_ptr<Publishers> publishers_ = std::make_shared<Publishers>();
};

}  // namespace

void check_lossy(const std::string& options) { parse(options); }

std::unique_ptr<Middleware> create_lossy(const std::string& options, std::unique_ptr<Middleware> inner) {
  return std::make_unique<LossyMiddleware>(std::move(inner), parse(options));
}

}  // namespace citylearn::internal
