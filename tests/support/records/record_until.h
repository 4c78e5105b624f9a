// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>

#include "dashboard/store/recorder.h"

namespace citylearn::testing {

template <class Message>
void hand_on(Node& node, Recorder& recorder) {
  Message message;
  while (node.take(message)) recorder.on_message(message);
}

/// Records until stop() is true, as a dashboard without a page does. Ends the recorder.
template <class Stop>
void record_until(Node& node, Recorder& recorder, const Stop& stop) {
  while (!stop()) {
    node.wait(std::min(recorder.due(), Clock::now() + std::chrono::milliseconds(100)));
    hand_on<msg::ServiceStatus>(node, recorder);
    hand_on<msg::TraversalInfo>(node, recorder);
    hand_on<msg::RunInfo>(node, recorder);
    hand_on<msg::TrainingStat>(node, recorder);
    recorder.poll();
  }
  recorder.finish(false);
}

}  // namespace citylearn::testing
