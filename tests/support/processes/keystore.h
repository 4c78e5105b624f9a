// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/paths.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {

/// A keystore made by compose/keystore, gone when the test ends. All in it is valid from ten days ago on.
class Keystore {
 public:
  Keystore() { expect({"create", folder_ / "keys", "--from", "10 days ago"}); }
  /// Folder of a new service.
  std::string add(const std::string& kind, const std::string& id, const std::string& until = "1 month") {
    expect({"add", folder_ / "keys", kind, id, "--from", "9 days ago", "--until", until});
    return of(id);
  }
  std::string of(const std::string& id) const { return folder_ / ("keys/" + id); }

  /// Runs compose/keystore; its exit status and what it says.
  std::pair<int, std::string> run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), CITYLEARN_SOURCE_DIR "/compose/keystore");
    return command(arguments);
  }
  void expect(const std::vector<std::string>& arguments) {
    const auto [status, said] = run(arguments);
    if (status != 0) throw Error("keystore " + arguments[0] + ": " + said);
  }
  /// Lets openssl sign a document as the permissions authority of this keystore.
  void sign(const std::string& document, const std::string& out) {
    const std::string authority = of("authority/permissions_ca");
    const auto [status, said] = command({"/usr/bin/openssl", "smime", "-sign", "-text", "-in", document, "-out", out,
                                         "-signer", authority + ".pem", "-inkey", authority + ".key"});
    if (status != 0) throw Error("openssl: " + said);
  }
  const Folder& folder() const { return folder_; }

 private:
  std::pair<int, std::string> command(const std::vector<std::string>& arguments) {
    Service program(arguments, folder_ / "said");
    const int status = program.wait(std::chrono::seconds(60)).value_or(-1);
    return {status, program.output()};
  }
  Folder folder_;
};

}  // namespace citylearn::testing
