// SPDX-License-Identifier: Apache-2.0
#include "core/dds/security.h"

#include <dlfcn.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509.h>
#include <openssl/x509_vfy.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>

#include "core/util/error.h"
#include "core/util/wall_clock.h"

namespace citylearn::internal {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIdentityAuthority = "identity_ca.pem";
constexpr const char* kPermissionsAuthority = "permissions_ca.pem";
constexpr const char* kGovernance = "governance.p7s";
constexpr const char* kPermissions = "permissions.p7s";
constexpr const char* kCertificate = "cert.pem";
constexpr const char* kKey = "key.pem";
constexpr const char* kRevoked = "crl.pem";

constexpr std::uintmax_t kMaxDocumentBytes = 1 << 20;   // bytes of a file
constexpr std::time_t kExpiryWarning = 14 * 24 * 3600;  // seconds before a certificate's end, from which on we warn
constexpr std::size_t kMaxLoggedLines = 100;            // different lines within kSecurityLogInterval
constexpr const char* kRenew = "compose/keystore renew makes a new one";

template <class Type, void (*free)(Type*)>
struct Free {
  void operator()(Type* object) const { free(object); }
};
template <class Type, void (*free)(Type*)>
using Owner = std::unique_ptr<Type, Free<Type, free>>;

void free_bio(BIO* bio) { BIO_free_all(bio); }
using Bio = Owner<BIO, free_bio>;
using Certificate = Owner<X509, X509_free>;
using Revoked = Owner<X509_CRL, X509_CRL_free>;
using Key = Owner<EVP_PKEY, EVP_PKEY_free>;
using Store = Owner<X509_STORE, X509_STORE_free>;
using Verification = Owner<X509_STORE_CTX, X509_STORE_CTX_free>;
using Signed = Owner<PKCS7, PKCS7_free>;

/// A file of the folder: its path for messages, and what is in it.
struct File {
  std::string path, text;
  Bio bio() const { return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))); }
};

File read(const fs::path& folder, const char* name) {
  File file{(folder / name).string(), ""};
  std::error_code wrong;
  if (!fs::exists(file.path, wrong)) throw Error("is missing", file.path, "compose/keystore add makes all files");
  const std::uintmax_t size = fs::is_regular_file(file.path, wrong) ? fs::file_size(file.path, wrong) : 0;
  if (wrong || size == 0 || size > kMaxDocumentBytes)
    throw Error("is not a file of 1 to " + std::to_string(kMaxDocumentBytes) + " bytes", file.path);
  std::ifstream in(file.path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  file.text = text.str();
  if (!in || file.text.empty()) throw Error(std::string("cannot be read: ") + std::strerror(errno), file.path);
  return file;
}

std::time_t seconds_of(const ASN1_TIME* time) {
  std::tm parts{};
  return ASN1_TIME_to_tm(time, &parts) == 1 ? timegm(&parts) : 0;
}

void check_times(std::time_t from, std::time_t until, const std::string& path) {
  const std::time_t now = std::time(nullptr);
  if (now < from) throw Error("is not valid before " + date_of(from), path, "is this host's clock right?");
  if (now > until) throw Error("expired on " + date_of(until), path, kRenew);
  if (until - now < kExpiryWarning) spdlog::warn("{}: expires on {} ({})", path, date_of(until), kRenew);
}

Certificate certificate_of(const File& file) {
  Certificate certificate(PEM_read_bio_X509(file.bio().get(), nullptr, nullptr, nullptr));
  if (!certificate) throw Error("is not a certificate (PEM)", file.path);
  check_times(seconds_of(X509_get0_notBefore(certificate.get())), seconds_of(X509_get0_notAfter(certificate.get())),
              file.path);
  return certificate;
}

/// Returns the name that the certificate was issued for.
std::string common_name(const Certificate& certificate) {
  char name[256] = "";
  X509_NAME_get_text_by_NID(X509_get_subject_name(certificate.get()), NID_commonName, name, sizeof name);
  return name;
}

int no_password(char*, int, int, void*) { return 0; }  // OpenSSL would ask at the terminal

Key key_of(const fs::path& folder) {
  const std::string path = (folder / kKey).string();
  struct stat about {};
  if (stat(path.c_str(), &about) == 0 && (about.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    throw Error("others than its owner can read it", path,
                "chmod 600; if others have read it, compose/keystore revoke");
  const File file = read(folder, kKey);
  Key key(PEM_read_bio_PrivateKey(file.bio().get(), nullptr, no_password, nullptr));
  if (!key) throw Error("is not a private key (PEM, without a password)", file.path);
  return key;
}

Store store_of(const Certificate& authority) {
  Store store(X509_STORE_new());
  X509_STORE_add_cert(store.get(), authority.get());
  return store;
}

void check_identity(const fs::path& folder, const std::string& participant) {
  const File file = read(folder, kCertificate);
  const File authority_file = read(folder, kIdentityAuthority);
  const Certificate authority = certificate_of(authority_file);
  const Certificate certificate = certificate_of(file);
  const Store store = store_of(authority);
  if (fs::exists(folder / kRevoked)) {
    const File list = read(folder, kRevoked);
    const Revoked revoked(PEM_read_bio_X509_CRL(list.bio().get(), nullptr, nullptr, nullptr));
    if (!revoked) throw Error("is not a list of revoked certificates (PEM)", list.path);
    X509_STORE_add_crl(store.get(), revoked.get());
    X509_STORE_set_flags(store.get(), X509_V_FLAG_CRL_CHECK);
  }
  const Verification verification(X509_STORE_CTX_new());
  X509_STORE_CTX_init(verification.get(), store.get(), certificate.get(), nullptr);
  if (X509_verify_cert(verification.get()) != 1)
    throw Error(std::string("the authority in ") + kIdentityAuthority + " does not stand for it: " +
                    X509_verify_cert_error_string(X509_STORE_CTX_get_error(verification.get())),
                file.path);
  const Key key = key_of(folder);
  if (X509_check_private_key(certificate.get(), key.get()) != 1)
    throw Error(std::string("is not the key of ") + kCertificate, (folder / kKey).string());
  if (const std::string name = common_name(certificate); name != participant)
    throw Error("is that of '" + name + "', this service is '" + participant + "'", file.path,
                "--id must be the name that the keys were made for");
}

/// Returns the content of a signed document. Throws Error when `authority` has not signed it.
std::string content_of(const File& file, const Certificate& authority) {
  BIO* apart = nullptr;
  const Signed document(SMIME_read_PKCS7(file.bio().get(), &apart));
  const Bio text(apart);
  if (!document) throw Error("is not signed (S/MIME)", file.path);
  const Store store = store_of(authority);
  const Bio out(BIO_new(BIO_s_mem()));
  if (PKCS7_verify(document.get(), nullptr, store.get(), text.get(), out.get(), 0) != 1)
    throw Error(std::string("the authority in ") + kPermissionsAuthority + " has not signed it, or not like this",
                file.path);
  char* data = nullptr;
  const long size = BIO_get_mem_data(out.get(), &data);
  return {data, static_cast<std::size_t>(size)};
}

/// Returns the values of all elements `name`, in order.
std::vector<std::string> values_of(const std::string& text, const std::string& name) {
  const std::string open = "<" + name + ">", close = "</" + name + ">";
  std::vector<std::string> values;
  for (std::size_t at = 0; (at = text.find(open, at)) != std::string::npos;) {
    const std::size_t end = text.find(close, at);
    if (end == std::string::npos) break;
    std::string value = text.substr(at + open.size(), end - at - open.size());
    value.erase(0, value.find_first_not_of(" \t\r\n"));
    value.erase(value.find_last_not_of(" \t\r\n") + 1);
    values.push_back(value);
    at = end;
  }
  return values;
}

/// Throws Error for a governance that lets strangers in or leaves data in clear.
void check_governance(const std::string& text, const std::string& path) {
  constexpr const char* kRemedy = "compose/keystore makes one that protects everything";
  const std::vector<std::string> no = {"false", "FALSE", "0"}, yes = {"true", "TRUE", "1"},
                                 encrypted = {"ENCRYPT", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION"};
  std::vector<std::string> genuine = encrypted;
  genuine.insert(genuine.begin(), {"SIGN", "SIGN_WITH_ORIGIN_AUTHENTICATION"});
  const std::vector<std::pair<std::string, std::vector<std::string>>> wanted = {
      {"allow_unauthenticated_participants", no}, {"enable_join_access_control", yes},
      {"enable_read_access_control", yes},        {"enable_write_access_control", yes},
      {"enable_discovery_protection", yes},       {"discovery_protection_kind", encrypted},
      {"liveliness_protection_kind", encrypted},  {"rtps_protection_kind", genuine},
      {"metadata_protection_kind", encrypted}};
  for (const auto& [name, allowed] : wanted) {
    const std::vector<std::string> values = values_of(text, name);
    if (values.empty()) throw Error("lacks " + name, path, kRemedy);
    for (const std::string& value : values)
      if (std::find(allowed.begin(), allowed.end(), value) == allowed.end())
        throw Error(name + " is " + value + ", must be " + allowed[0], path, kRemedy);
  }
}

std::time_t time_of(const std::string& text, const std::string& path) {
  std::tm parts{};
  const char* end = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &parts);
  if (!end || (*end != '\0' && std::strcmp(end, "Z") != 0)) throw Error("'" + text + "' is not a time in UTC", path);
  return timegm(&parts);
}

void check_permissions(const std::string& text, const std::string& participant, const std::string& path) {
  const std::vector<std::string> names = values_of(text, "subject_name"), from = values_of(text, "not_before"),
                                 until = values_of(text, "not_after");
  if (from.size() != names.size() || until.size() != names.size())
    throw Error("must say for each subject_name when it is valid: not_before, not_after", path);
  const auto own = std::find(names.begin(), names.end(), "CN=" + participant);
  if (own == names.end())
    throw Error("is for '" + (names.empty() ? "" : names[0]) + "', not for 'CN=" + participant + "'", path);
  const std::size_t index = static_cast<std::size_t>(own - names.begin());
  check_times(time_of(from[index], path), time_of(until[index], path), path);
}

void check_documents(const fs::path& folder, const std::string& participant) {
  const Certificate authority = certificate_of(read(folder, kPermissionsAuthority));
  const File governance = read(folder, kGovernance), permissions = read(folder, kPermissions);
  check_governance(content_of(governance, authority), governance.path);
  check_permissions(content_of(permissions, authority), participant, permissions.path);
}

/// Returns the folder of Cyclone's plug-ins: its library's folder, or one below with the library's name, as in Debian.
fs::path plugin_folder() {
  Dl_info library{};
  void* const symbol = dlsym(RTLD_DEFAULT, "dds_create_domain");
  if (!symbol || dladdr(symbol, &library) == 0) throw Error("cyclonedds' library is not to be found", "security");
  fs::path beside = fs::canonical(library.dli_fname).parent_path();
  const auto has_it = [](const fs::path& folder) { return fs::exists(folder / "libdds_security_auth.so"); };
  if (has_it(beside)) return beside;
  std::error_code wrong;
  for (const fs::directory_entry& entry : fs::directory_iterator(beside, wrong))
    if (entry.path().filename().string().starts_with("libddsc") && entry.is_directory(wrong) && has_it(entry.path()))
      return entry.path();
  throw Error("cyclonedds' plug-ins (libdds_security_auth.so) are not installed", "security",
              "looked beside " + std::string(library.dli_fname));
}

}  // namespace

std::string check_security(const std::string& folder, const std::string& participant) {
  std::error_code wrong;
  if (!fs::is_directory(folder, wrong))
    throw Error("'" + folder + "' is not a folder", "security", "compose/keystore add makes one for each service");
  const fs::path path = fs::canonical(folder);
  check_identity(path, participant);
  check_documents(path, participant);
  ERR_clear_error();
  return path.string();
}

std::string outdated_revocations(const std::string& folder, std::uint64_t started) {
  const std::string list = (fs::path(folder) / kRevoked).string();
  struct stat about {};
  // The time of the change on this host: a copy may keep the time of the original's last write.
  if (stat(list.c_str(), &about) != 0 || static_cast<std::uint64_t>(about.st_ctim.tv_sec) * 1'000'000 <= started)
    return "";
  return list + " has changed since this service started: restart it to keep out who was revoked since";
}

std::optional<std::string> explain_security(const std::string& message) {
  struct Meaning {
    const char* part;     // of the vendor's message
    const char* meaning;  // followed by the vendor's words
  };
  static constexpr const char* kUnsigned =
      "refused a participant whose permissions our authority has not signed, or which are not valid now";
  static constexpr const char* kInvalid =
      "refused a participant whose certificate is not valid, or of another authority";
  static constexpr const char* kNoIdentity = "refused a participant that could not show an identity";
  static constexpr const char* kNotAllowed = "refused what a participant's permissions do not allow";
  static constexpr Meaning kMeanings[] = {
      {"octet sequence to ASN1",
       "a participant of the other DDS vendor cannot show us its identity (docs/how-to/secure-a-run.md)"},
      {"PermissionsCA algorithm differs",
       "refused a participant of another release of Fast DDS (docs/how-to/secure-a-run.md)"},
      {"while validating local", "our own keys are refused"},
      {"Error validating remote permissions", kUnsigned},
      {"Could not get remote participant", kUnsigned},
      {"Certificate not valid", kInvalid},
      {"Invalidation error of certificate", kInvalid},
      {"handshake failed", kNoIdentity},
      {"handshake request failed", kNoIdentity},
      {"handshake reply failed", kNoIdentity},
      {"Error checking creation of local", "our permissions do not allow this"},
      {"Access control does not allow remote", kNotAllowed},
      {"Error checking remote", kNotAllowed},
      {"denied by default rule", kNotAllowed},
      {"found in deny_rule", kNotAllowed},
      {"No rule found for", kNotAllowed},
  };
  for (const auto& [part, meaning] : kMeanings)
    if (message.find(part) != std::string::npos)
      return std::string("security: ") + meaning + ": " + Error(message).what();
  return std::nullopt;
}

void log_security_event(const std::string& line) {
  using Clock = std::chrono::steady_clock;
  // Never destroyed: Fast DDS's log thread calls this after the end of main too.
  static std::mutex& mutex = *new std::mutex;
  static auto& logged = *new std::map<std::string, Clock::time_point>;
  {
    std::lock_guard lock(mutex);
    const Clock::time_point now = Clock::now();
    std::erase_if(logged, [&](const auto& item) { return now - item.second >= kSecurityLogInterval; });
    if (logged.size() >= kMaxLoggedLines || !logged.try_emplace(line, now).second) return;
  }
  spdlog::warn("{}", line);
}

Properties fastdds_security(const std::string& folder) {
  const std::string file = "file://" + folder + "/";
  const std::string identity = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.";
  Properties properties = {{"dds.sec.auth.plugin", "builtin.PKI-DH"},
                           {identity + "identity_ca", file + kIdentityAuthority},
                           {identity + "identity_certificate", file + kCertificate},
                           {identity + "private_key", file + kKey},
                           {"dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC"},
                           {"dds.sec.access.plugin", "builtin.Access-Permissions"},
                           {access + "permissions_ca", file + kPermissionsAuthority},
                           {access + "governance", file + kGovernance},
                           {access + "permissions", file + kPermissions}};
  if (fs::exists(fs::path(folder) / kRevoked)) properties.emplace_back(identity + "identity_crl", file + kRevoked);
  return properties;
}

Properties cyclonedds_security(const std::string& folder) {
  const fs::path plugins = plugin_folder();
  const std::string file = "file:" + folder + "/";
  Properties properties = {{"dds.sec.auth.identity_ca", file + kIdentityAuthority},
                           {"dds.sec.auth.identity_certificate", file + kCertificate},
                           {"dds.sec.auth.private_key", file + kKey},
                           {"dds.sec.access.permissions_ca", file + kPermissionsAuthority},
                           {"dds.sec.access.governance", file + kGovernance},
                           {"dds.sec.access.permissions", file + kPermissions}};
  const std::vector<std::vector<std::string>> libraries = {
      {"auth", "auth", "authentication"}, {"crypto", "crypto", "crypto"}, {"access", "ac", "access_control"}};
  for (const auto& library : libraries) {
    const std::string name = "dds.sec." + library[0] + ".library.";
    properties.emplace_back(name + "path", (plugins / ("libdds_security_" + library[1] + ".so")).string());
    properties.emplace_back(name + "init", "init_" + library[2]);
    properties.emplace_back(name + "finalize", "finalize_" + library[2]);
  }
  if (fs::exists(fs::path(folder) / kRevoked))
    properties.emplace_back("org.eclipse.cyclonedds.sec.auth.crl", file + kRevoked);
  return properties;
}

}  // namespace citylearn::internal
