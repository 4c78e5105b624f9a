// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <string>

namespace citylearn::testing {

/// Records what this process logs while the object lives.
class Log {
 public:
  Log() : sink_(std::make_shared<Sink>()), before_(spdlog::default_logger()) {
    spdlog::set_default_logger(std::make_shared<spdlog::logger>("test", sink_));
  }
  ~Log() { spdlog::set_default_logger(before_); }
  void add(const std::string& line) { sink_->add(line + "\n"); }
  std::string text() const { return sink_->text(); }
  long lines() const {
    const std::string all = text();
    return std::count(all.begin(), all.end(), '\n');
  }
  bool has(const std::string& part) const { return text().find(part) != std::string::npos; }

 private:
  class Sink : public spdlog::sinks::base_sink<std::mutex> {
   public:
    void add(const std::string& line) {
      std::lock_guard lock(mutex_);
      text_ += line;
    }
    std::string text() {
      std::lock_guard lock(mutex_);
      return text_;
    }

   private:
    void sink_it_(const spdlog::details::log_msg& message) override {
      text_.append(message.payload.data(), message.payload.size());
      text_ += '\n';
    }
    void flush_() override {}
    std::string text_;
  };
  const std::shared_ptr<Sink> sink_;
  const std::shared_ptr<spdlog::logger> before_;
};

}  // namespace citylearn::testing
