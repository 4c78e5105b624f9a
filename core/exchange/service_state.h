// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "idl/status.h"

namespace citylearn {

/// Returns "running" and so on; "running" for an unknown state too.
inline const char* name_of(msg::State state) {
  switch (state) {
    case msg::STARTING:
      return "starting";
    case msg::WAITING:
      return "waiting";
    case msg::RUNNING:
      return "running";
    case msg::STOPPING:
      return "stopping";
    case msg::FAILED:
      return "failed";
  }
  return "running";
}

}  // namespace citylearn
