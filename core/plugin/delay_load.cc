// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>

namespace citylearn {
namespace {

/// A function of a shared library, as cmake/delay_load.py lays it out.
struct DelayedFunction {
  void* address;  ///< where its stub jumps to
  const char* library;
  const char* name;
};

}  // namespace

/// Loads the library if that has not been done, lets the stub jump to the function, and returns its address. Any thread
/// may call it. Ends the program where the library is missing, as the dynamic linker does at a program's start.
extern "C" void* citylearn_load_function(DelayedFunction* function) {
  void* const library = dlopen(function->library, RTLD_LAZY | RTLD_LOCAL);
  void* const found = library ? dlsym(library, function->name) : nullptr;
  if (!found) {
    std::fprintf(stderr, "%s: %s (install the package that has this library)\n", program_invocation_short_name,
                 dlerror());
    std::_Exit(127);
  }
  std::atomic_ref(function->address).store(found, std::memory_order_relaxed);
  return found;
}

}  // namespace citylearn
