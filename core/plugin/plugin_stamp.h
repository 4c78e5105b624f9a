// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/plugin/plugin_interface.h"  // generated: CITYLEARN_INTERFACE, a hash of all that a plug-in includes of ours

// What program and plug-in must have in common, as one line of text. Literals, so that the mark and what follows it
// stand together in a plug-in's file.
#ifdef __clang__
#define CITYLEARN_COMPILER "clang++ " __clang_version__
#else
#define CITYLEARN_COMPILER "g++ " __VERSION__
#endif
#if defined(__AVX512F__)  // Eigen's alignment follows it
#define CITYLEARN_INSTRUCTIONS "AVX-512"
#elif defined(__AVX__)
#define CITYLEARN_INSTRUCTIONS "AVX"
#else
#define CITYLEARN_INSTRUCTIONS "no AVX"
#endif
#define CITYLEARN_BUILD "interface " CITYLEARN_INTERFACE ", " CITYLEARN_COMPILER ", " CITYLEARN_INSTRUCTIONS
#define CITYLEARN_PLUGIN_MARK "citylearn plug-in: "
