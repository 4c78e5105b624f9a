// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

// The reference: each vendor's own API, without anything of this project between it and the exchange.

namespace roundtrip {

/// Says how samples are received: in the vendor's listener, or by a thread of ours that waits on the vendor's waitset.
enum class Mode { kListener, kWaitset };

/// One end of the exchange: writes samples of one fixed size, calls `received` with those of the other. Each sample is
/// a structure with one array of octets, what the vendor's own IDL compiler would make of it.
class Port {
 public:
  virtual ~Port() = default;
  virtual void send(std::span<const std::byte> sample) = 0;
};

struct PortOptions {
  bool asks;  ///< writes questions and reads answers, or the other way round
  Mode mode;
  std::uint32_t domain;
  std::size_t question;  ///< bytes
  std::size_t answer;    ///< bytes
  std::function<void(std::span<const std::byte>)> received;
};

std::unique_ptr<Port> open_fastdds(const PortOptions& options);
std::unique_ptr<Port> open_cyclonedds(const PortOptions& options);

}  // namespace roundtrip
