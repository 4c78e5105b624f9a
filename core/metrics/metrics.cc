// SPDX-License-Identifier: Apache-2.0
#include "core/metrics/metrics.h"

#include <spdlog/fmt/fmt.h>

#include <map>
#include <mutex>
#include <optional>

#include "core/exchange/presence.h"
#include "core/exchange/service_state.h"
#include "core/metrics/exposition.h"
#include "core/metrics/metrics_server.h"
#include "core/task/training_figures.h"
#include "core/util/version.h"
#include "idl/message_fields.h"

namespace citylearn {
namespace {

/// Returns the name of a figure, with the base unit that Prometheus asks for.
std::string training_metric(const TrainingFigure& figure) {
  return std::string("citylearn_training_") + figure.name + (std::string_view(figure.unit) == "s" ? "_seconds" : "");
}

}  // namespace

struct Metrics::Values {
  std::mutex mutex;
  Clock::time_point heartbeat{};
  std::optional<msg::ServiceStatus> status;
  std::optional<msg::TrainingStat> stat;
  std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> queues;  // length and capacity
};

Metrics::Metrics(const std::string& address) : values_(std::make_unique<Values>()) {
  if (!address.empty()) server_ = std::make_unique<MetricsServer>(*this, address);
}

Metrics::~Metrics() = default;

void Metrics::set(const msg::ServiceStatus& status) {
  const std::lock_guard lock(values_->mutex);
  values_->heartbeat = Clock::now();
  values_->status = status;
}

void Metrics::set(const msg::TrainingStat& stat) {
  const std::lock_guard lock(values_->mutex);
  values_->stat = stat;
}

void Metrics::set_queue(const std::string& name, std::uint64_t length, std::uint64_t capacity) {
  const std::lock_guard lock(values_->mutex);
  values_->queues[name] = {length, capacity};
}

std::string Metrics::text() const {
  const std::lock_guard lock(values_->mutex);
  Exposition all;
  if (values_->status) {
    const msg::ServiceStatus& status = *values_->status;
    const auto label = [](const char* name, const std::string& value) { return metric_label(name, value); };
    all.family("citylearn_info", "The service; always 1.");
    all.sample(1, "{" + label("service", status.service().c_str()) + "," +
                      label("id", status.header().sender().c_str()) + "," +
                      label("session", status.header().session().c_str()) + "," + label("host", status.host().c_str()) +
                      "," + label("middleware", status.middleware().c_str()) + "," + label("version", version()) + "}");
    all.family("citylearn_state", "1 for the state that the service is in.");
    for (const msg::State state : {msg::STARTING, msg::WAITING, msg::RUNNING, msg::STOPPING, msg::FAILED})
      all.sample(state == status.service_state(), "{" + label("state", name_of(state)) + "}");
    all.single("citylearn_alarm", "1 while the service has a problem, which /healthz names.",
               status.alarm().size() > 0);
    all.single("citylearn_heartbeat_age_seconds", "Since the main loop last published a heartbeat.",
               seconds_since(values_->heartbeat));
    visit_metrics(status, [&all](const char* name, const char* help, auto value) {
      all.single(name, help, static_cast<double>(value));
    });
  }
  if (!values_->queues.empty()) {
    const auto of_each = [&](const char* name, const char* help, auto member) {
      all.family(name, help);
      for (const auto& [queue, size] : values_->queues)
        all.sample(static_cast<double>(size.*member), "{queue=\"" + queue + "\"}");
    };
    using Size = std::pair<std::uint64_t, std::uint64_t>;
    of_each("citylearn_queue_length", "What waits in the queue.", &Size::first);
    of_each("citylearn_queue_capacity", "What the queue may hold.", &Size::second);
  }
  if (values_->stat)
    for (const TrainingFigure& figure : training_figures())
      all.single(training_metric(figure), *figure.help ? std::string(figure.title) + ": " + figure.help : figure.title,
                 figure.value(*values_->stat));
  return all.text();
}

std::string Metrics::problem(bool alarms) const {
  const std::lock_guard lock(values_->mutex);
  if (!values_->status) return "starting";
  const msg::ServiceStatus& status = *values_->status;
  if (const double age = seconds_since(values_->heartbeat); age >= std::chrono::duration<double>(kSilence).count())
    return fmt::format("no heartbeat for {:.0f} s: the main loop stands", age);
  if (status.service_state() == msg::FAILED) return std::string("failed: ") + status.activity().c_str();
  return alarms ? status.alarm().c_str() : "";
}

}  // namespace citylearn
