// SPDX-License-Identifier: Apache-2.0
#pragma once

// DDS Security (docs/how-to/secure-a-run.md): a service's folder of keys, checked before anything starts, and what the
// vendors want to know of it. Knows no vendor's headers.

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace citylearn::internal {

/// Checks the folder as compose/keystore makes it: identity_ca.pem, permissions_ca.pem, governance.p7s,
/// permissions.p7s, cert.pem and key.pem, and crl.pem where there is one. All must be there, valid now, signed by their
/// authorities and fit together; only its owner may read the key; the certificate must be that of `participant`;
/// and the governance must protect what this project promises. Throws Error that names the file. Returns the absolute
/// path.
std::string check_security(const std::string& folder, const std::string& participant);

/// Returns what is wrong, and what to do, when the folder's crl.pem has changed since the service started, in
/// microseconds since 1970: the vendors read it once. Returns an empty text when it has not.
std::string outdated_revocations(const std::string& folder, std::uint64_t started);

/// The highest domain that governance and permissions can name (DDS Security 1.1, 9.4.1.2).
inline constexpr std::uint32_t kMaxSecureDomain = 230;

/// Properties of a participant, names and values.
using Properties = std::vector<std::pair<std::string, std::string>>;

/// Returns Fast DDS's settings for a folder that has been checked.
Properties fastdds_security(const std::string& folder);

/// Returns Cyclone DDS's settings. Throws Error when its security plug-ins are not installed.
Properties cyclonedds_security(const std::string& folder);

/// Explains a vendor's own message about security in one line: which participant was refused, and why. Returns nothing
/// when the message is about something else.
std::optional<std::string> explain_security(const std::string& message);

/// Logs a line as a warning, at most once in kSecurityLogInterval: vendors repeat them. Called by any thread.
void log_security_event(const std::string& line);
inline constexpr std::chrono::seconds kSecurityLogInterval{60};

}  // namespace citylearn::internal
