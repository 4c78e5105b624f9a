// SPDX-License-Identifier: Apache-2.0
// Compiled into every plug-in (cmake/Plugins.cmake): says what it was built against, for core/plugin/plugins.cc to
// read.
#include "core/plugin/plugin_stamp.h"

extern "C" {
extern const char citylearn_plugin_stamp[];
__attribute__((used)) const char citylearn_plugin_stamp[] = CITYLEARN_PLUGIN_MARK CITYLEARN_BUILD;
}
