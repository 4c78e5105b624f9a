// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>

/// Loads a library if that has not been done, writes where its function `name` is to `address`, from which the stub of
/// cmake/delay_load.py jumps there, and returns it. Any thread may call it. Ends the program where the library is
/// missing, as the dynamic linker does at a program's start.
extern "C" void* citylearn_load_function(std::atomic<void*>& address, const char* library, const char* name) {
  void* const opened = dlopen(library, RTLD_LAZY | RTLD_LOCAL);
  void* const found = opened ? dlsym(opened, name) : nullptr;
  if (!found) {
    std::fprintf(stderr, "%s: %s (install the package that has this library)\n", program_invocation_short_name,
                 dlerror());
    std::_Exit(127);
  }
  address.store(found, std::memory_order_relaxed);
  return found;
}
