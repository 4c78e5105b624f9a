// SPDX-License-Identifier: Apache-2.0
// Preloaded into security_peer, this makes it a participant that does not keep to the rules it has signed:
//   CITYLEARN_CLOCK=-172800  lives two days ago, so that it takes its own expired certificate for valid;
//   CITYLEARN_LAWLESS=1      its vendor does not check what its own permissions allow, as a changed one would not.
// What then stops it is the other side alone.
#include <dds/dds.h>
#include <dds/security/dds_security_api_access_control.h>
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

struct ddsi_domaingv;

namespace {

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

time_t shift() {
  static const char* const seconds = std::getenv("CITYLEARN_CLOCK");
  return seconds ? std::atol(seconds) : 0;
}

bool lawless() { return std::getenv("CITYLEARN_LAWLESS") != nullptr; }

using Begin = int(const char*, void**, ddsi_domaingv*);
using End = int(void*);

std::string true_library;  // Cyclone's access control, which init_access_control below stands before

}  // namespace

// --- The clock
// -------------------------------------------------------------------------------------------------------------

extern "C" time_t time(time_t* out) noexcept {
  static const auto real = next<time_t(time_t*)>("time");
  const time_t now = real(nullptr) + shift();
  if (out) *out = now;
  return now;
}

extern "C" int clock_gettime(clockid_t clock, timespec* out) noexcept {
  static const auto real = next<int(clockid_t, timespec*)>("clock_gettime");
  const int status = real(clock, out);
  if (status == 0 && clock == CLOCK_REALTIME) out->tv_sec += shift();
  return status;
}

extern "C" int gettimeofday(timeval* out, void* zone) noexcept {
  static const auto real = next<int(timeval*, void*)>("gettimeofday");
  const int status = real(out, zone);
  if (status == 0) out->tv_sec += shift();
  return status;
}

// --- Fast DDS: stands before the library's own methods
// -----------------------------------------------------------------------------------------------------

#if __has_include(<fastrtps/utils/IPLocator.h>)
namespace eprosima::fastrtps::rtps::security {  // of release 2
#else
namespace eprosima::fastdds::rtps::security {
#endif

class Handle;
class SecurityException;

class Permissions {
 public:
  bool check_create_datawriter(const Handle&, std::uint32_t, const std::string&, const std::vector<std::string>&,
                               SecurityException&);
  bool check_create_datareader(const Handle&, std::uint32_t, const std::string&, const std::vector<std::string>&,
                               SecurityException&);
};

bool Permissions::check_create_datawriter(const Handle&, std::uint32_t, const std::string&,
                                          const std::vector<std::string>&, SecurityException&) {
  return true;
}
bool Permissions::check_create_datareader(const Handle&, std::uint32_t, const std::string&,
                                          const std::vector<std::string>&, SecurityException&) {
  return true;
}

}  // namespace eprosima::fastrtps::rtps::security

// --- Cyclone DDS: names itself as the plug-in for access control, and hands on all but three questions
// ---------------------------------------------------------------------------

extern "C" void dds_qset_prop(dds_qos_t* qos, const char* name, const char* value) {
  static const auto real = next<void(dds_qos_t*, const char*, const char*)>("dds_qset_prop");
  if (lawless() && std::strcmp(name, "dds.sec.access.library.path") == 0) {
    true_library = value;
    Dl_info self{};
    dladdr(reinterpret_cast<const void*>(&lawless), &self);
    value = self.dli_fname;
  }
  real(qos, name, value);
}

extern "C" int init_access_control(const char* argument, void** context, ddsi_domaingv* domain) {
  void* const library = dlopen(true_library.c_str(), RTLD_NOW);
  const auto real = reinterpret_cast<Begin*>(library ? dlsym(library, "init_access_control") : nullptr);
  if (!real || real(argument, context, domain) != 0) return -1;
  auto* const control = static_cast<dds_security_access_control*>(*context);
  control->check_create_datawriter = [](auto...) -> DDS_Security_boolean { return true; };
  control->check_create_datareader = [](auto...) -> DDS_Security_boolean { return true; };
  control->check_create_topic = [](auto...) -> DDS_Security_boolean { return true; };
  return 0;
}

extern "C" int finalize_access_control(void* context) {
  void* const library = dlopen(true_library.c_str(), RTLD_NOW);
  const auto real = reinterpret_cast<End*>(library ? dlsym(library, "finalize_access_control") : nullptr);
  return real ? real(context) : -1;
}
