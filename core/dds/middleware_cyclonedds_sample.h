// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>

#include <cstddef>
#include <cstdint>
#include <string>

// Cyclone's public C API moves samples that its own IDL compiler describes. To move CDR bytes that are ready made, we
// bring our own kind of type (ddsi_sertype) and sample (ddsi_serdata), as ROS 2's rmw_cyclonedds does.

namespace citylearn::internal {

/// A sample: this header, then its bytes (encapsulation first), padded to a multiple of 4.
struct Sample : ddsi_serdata {
  std::uint32_t size;

  std::byte* bytes() { return reinterpret_cast<std::byte*>(this + 1); }
  const std::byte* bytes() const { return reinterpret_cast<const std::byte*>(this + 1); }
};

/// Returns a sample of so many bytes, which the caller fills in. Throws std::bad_alloc.
Sample* make_sample(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size);

inline const Sample* as_sample(const ddsi_serdata* data) { return static_cast<const Sample*>(data); }

/// Cyclone DDS counts references by atomics; the last reference goes in its library, where ThreadSanitizer sees none.
void release_sample(ddsi_serdata* data);

/// Returns a type of that name, which knows nothing else.
ddsi_sertype* make_type(const std::string& name);

}  // namespace citylearn::internal
