// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>
#include <unistd.h>

#include <cstring>
#include <span>
#include <vector>

#include "core/dds/middleware.h"

namespace citylearn::bench {

/// The number of a trip, in the first bytes after a sample's encapsulation.
inline std::uint32_t number_in(std::span<const std::byte> sample) {
  std::uint32_t number;
  std::memcpy(&number, sample.data() + 4, sizeof number);
  return number;
}
inline void set_number(Bytes& sample, std::uint32_t number) { std::memcpy(sample.data() + 4, &number, sizeof number); }

/// Returns whether the program that started this one has ended (testing::Child).
inline bool input_ended() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  return poll(&input, 1, 0) > 0;
}

/// Times of the trips asked for, one after another, after a tenth of them for warming up. A question unanswered for 200
/// ms is sent again.
class Trips {
 public:
  explicit Trips(int trips) : warm_(trips / 10), last_(warm_ + trips) {
    times.reserve(static_cast<std::size_t>(trips));
  }
  std::uint32_t number() const { return static_cast<std::uint32_t>(number_); }
  bool finished() const { return number_ >= last_; }
  void begin() { begin_ = Clock::now(); }
  void end() {
    if (number_ >= warm_) times.push_back(seconds_since(begin_) * 1e6);
    ++number_;
  }
  std::vector<double> times;  ///< microseconds

 private:
  int warm_, last_, number_ = 0;
  Clock::time_point begin_;
};

/// The two topics of round trips over Middleware.
struct TripTopics {
  Topic question, answer;
};

/// Answers each question until the program that started this one ends.
inline void answer_middleware(const MiddlewareOptions& options, const TripTopics& topics) {
  const auto middleware = create_middleware(options);
  Bytes question(topics.question.largest), answer(topics.answer.largest);
  answer[1] = std::byte{1};
  const auto publisher = middleware->create_publisher(topics.answer);
  const auto subscription = middleware->create_subscription(topics.question);
  while (!input_ended())
    for (const auto limit = Clock::now() + std::chrono::milliseconds(100); middleware->wait(limit);)
      while (subscription->take(question)) {
        set_number(answer, number_in(question));
        publisher->publish(answer);
      }
}

/// Returns the microseconds of so many trips to a program that answers.
inline std::vector<double> ask_middleware(const MiddlewareOptions& options, const TripTopics& topics, int count) {
  const auto middleware = create_middleware(options);
  Bytes question(topics.question.largest), answer(topics.answer.largest);
  question[1] = std::byte{1};
  const auto publisher = middleware->create_publisher(topics.question);
  const auto subscription = middleware->create_subscription(topics.answer);
  Trips trips(count);
  while (!trips.finished()) {
    set_number(question, trips.number());
    trips.begin();
    for (bool answered = false; !answered;) {
      publisher->publish(question);
      const auto limit = Clock::now() + std::chrono::milliseconds(200);
      while (!answered && middleware->wait(limit))
        while (!answered && subscription->take(answer)) answered = number_in(answer) == trips.number();
    }
    trips.end();
  }
  return trips.times;
}

}  // namespace citylearn::bench
