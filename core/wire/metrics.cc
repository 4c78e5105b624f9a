// SPDX-License-Identifier: Apache-2.0
#include "core/wire/metrics.h"

#include <arpa/inet.h>
#include <civetweb.h>
#include <spdlog/spdlog.h>

#include <array>
#include <charconv>
#include <map>
#include <mutex>
#include <optional>

#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "core/util/version.h"
#include "core/wire/message_fields.h"
#include "core/wire/presence.h"
#include "core/wire/service_state.h"

namespace citylearn {
namespace {

/// Appends families of metrics to a text in Prometheus' format.
class Exposition {
 public:
  void family(const std::string& name, const std::string& help) {
    name_ = name;
    text += "# HELP " + name + " " + help + "\n# TYPE " + name + (name.ends_with("_total") ? " counter\n" : " gauge\n");
  }
  /// `labels`: "" or "{a=\"b\"}".
  void sample(double value, const std::string& labels = "") { text += fmt::format("{}{} {}\n", name_, labels, value); }
  void single(const std::string& name, const std::string& help, double value) {
    family(name, help);
    sample(value);
  }

  std::string text;

 private:
  std::string name_;
};

std::string escaped(const std::string& label) {
  std::string text;
  for (const char c : label) text += c == '\n' ? "\\n" : c == '"' || c == '\\' ? std::string{'\\', c} : std::string{c};
  return text;
}

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

/// An HTTP server whose clients, however slow or hostile, keep only its own few threads busy.
class Metrics::Server {
 public:
  Server(const Metrics& metrics, const std::string& address) : metrics_(metrics) {
    const std::string full = address.find(':') == std::string::npos ? "127.0.0.1:" + address : address;
    const char* options[] = {
        "listening_ports",  full.c_str(), "num_threads", "4", "enable_keep_alive", "no", "request_timeout_ms", "2000",
        "max_request_size", "4096",       nullptr};
    mg_callbacks callbacks{};
    callbacks.begin_request = [](mg_connection* connection) {
      return static_cast<Server*>(mg_get_request_info(connection)->user_data)->answer(connection);
    };
    callbacks.log_message = [](const mg_connection*, const char* text) {
      spdlog::debug("metrics: {}", text);
      return 1;
    };
    mg_init_data init{&callbacks, this, options};
    std::array<char, 256> why{};
    mg_error_data error{nullptr, why.data(), why.size()};
    mg_init_library(0);
    context_ = mg_start2(&init, &error);
    if (!context_)
      throw Error(std::string("cannot listen: ") + why.data(), "--metrics " + full,
                  "choose a free port and an address of this host");
    mg_server_port port{};
    mg_get_server_ports(context_, 1, &port);
    spdlog::info("metrics: http://{}:{}/metrics", full.substr(0, full.find(':')), port.port);
  }
  ~Server() { mg_stop(context_); }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

 private:
  /// Answers every request itself, so that the library serves no files. Returns the status.
  int answer(mg_connection* connection) const {
    const mg_request_info& request = *mg_get_request_info(connection);
    const std::string_view method = request.request_method, path = request.local_uri;
    if (method != "GET" && method != "HEAD") return send(connection, 405, "Method Not Allowed", "use GET\n");
    if (path == "/metrics")
      return send(connection, 200, "OK", metrics_.text(), "text/plain; version=0.0.4; charset=utf-8");
    if (path != "/healthz" && path != "/livez")
      return send(connection, 404, "Not Found", "use /metrics, /healthz or /livez\n");
    const std::string problem = metrics_.problem(path == "/healthz");
    return problem.empty() ? send(connection, 200, "OK", "ok\n")
                           : send(connection, 503, "Service Unavailable", problem + "\n");
  }

  static int send(mg_connection* connection, int status, const char* reason, const std::string& body,
                  const char* type = "text/plain; charset=utf-8") {
    const bool head = std::string_view(mg_get_request_info(connection)->request_method) == "HEAD";
    const std::string reply = fmt::format(
        "HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nCache-Control: no-store\r\nConnection: "
        "close\r\n\r\n{}",
        status, reason, type, body.size(), head ? "" : body);
    mg_write(connection, reply.data(), reply.size());
    return status;
  }

  const Metrics& metrics_;
  mg_context* context_ = nullptr;
};

std::string metrics_address_problem(const std::string& text) {
  if (text.empty()) return "";
  const std::size_t colon = text.find(':'), begin = colon == std::string::npos ? 0 : colon + 1;
  in_addr address{};
  std::uint16_t port = 0;
  const auto [end, error] = std::from_chars(text.data() + begin, text.data() + text.size(), port);
  if (error == std::errc() && end == text.data() + text.size() &&
      (begin == 0 || inet_pton(AF_INET, text.substr(0, colon).c_str(), &address) == 1))
    return "";
  return "'" + text + "' is not [ADDRESS:]PORT, an IPv4 address and a port up to 65535, as 9464 or 0.0.0.0:9464";
}

Metrics::Metrics(const std::string& address) : values_(std::make_unique<Values>()) {
  if (const std::string problem = metrics_address_problem(address); !problem.empty()) throw Error(problem, "--metrics");
  if (!address.empty()) server_ = std::make_unique<Server>(*this, address);
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
    const auto label = [](const char* name, const std::string& value) {
      return std::string(name) + "=\"" + escaped(value) + "\"";
    };
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
  return all.text;
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
