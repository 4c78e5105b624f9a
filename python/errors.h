// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/util/error.h"

namespace citylearn::python {

/// Python's TypeError: a keyword argument is unknown.
struct UnknownOption : Error {
  using Error::Error;
};
/// Python's TimeoutError: an env_service did not come or did not answer in time.
struct ServiceMissing : Error {
  using Error::Error;
};
/// Python's ConnectionError: an env_service is there and does not work for us (any more).
struct ServiceLost : Error {
  using Error::Error;
};

}  // namespace citylearn::python
