// SPDX-License-Identifier: Apache-2.0
// Alone in its file: with each commit the compiler runs for this one only.
#include "core/util/version.h"

#ifndef CITYLEARN_VERSION
#error "the build defines CITYLEARN_VERSION"
#endif

namespace citylearn {

std::string version() { return CITYLEARN_VERSION; }

}  // namespace citylearn
