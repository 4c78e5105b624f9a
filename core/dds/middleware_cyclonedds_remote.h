// SPDX-License-Identifier: Apache-2.0
#pragma once

// What Cyclone DDS knows of another participant beyond its public API: whose it is and where it is reached. In C,
// because Cyclone's internal headers are not C++. Private to core/dds/middleware_cyclonedds.cc.

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct ddsi_sertype;

struct CycloneRemote {
  uint8_t vendor[2];      ///< RTPS vendor id
  size_t addresses;       ///< how many of address[] are set
  uint8_t address[8][4];  ///< IPv4, network order, without repetition
};

/// Looks up a participant of another process by its 16-byte GUID (network order) in the domain that `type` is
/// registered in. Returns 1, or 0 when Cyclone knows none: it left, or it is of this process. Any thread.
int cyclone_remote(const struct ddsi_sertype* type, const uint8_t guid[16], struct CycloneRemote* out);

#ifdef __cplusplus
}
#endif
