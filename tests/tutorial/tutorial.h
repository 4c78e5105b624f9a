// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/files.h"

namespace citylearn::testing {

/// Follows a page of docs/tutorials to the letter: its files are written into a folder of their own, its commands run.
class Tutorial : public ::testing::Test {
 protected:
  /// `page` is the name of its file, without ".md".
  explicit Tutorial(const std::string& page);

  /// Writes all files and runs all commands; fails unless each succeeds and there are so many files.
  void follow(int files);
  /// Returns the number of which the page says "SAID at least NUMBER", whatever its line breaks; fails when it does
  /// not.
  double promised(const std::string& said) const;
  /// Expects the SPL that the page promises in the summary.json of runs/first: on the traversal `trained` ("an SPL of")
  /// and on `other` (`other_said`), where the blind control has less. Returns the summary.
  nlohmann::json expect_promised_spl(const std::string& trained, const std::string& other,
                                     const std::string& other_said) const;
  /// Expects that the page's last step copies `file` into `folder`, that this is where plug-ins such as `neighbour`
  /// are, and that `cmake` (a CMakeLists.txt) takes it from there by the pattern `glob`.
  void expect_home(const std::string& file, const std::string& folder, const std::string& neighbour,
                   const std::string& cmake, const std::string& glob) const;

  const std::string page_;
  const Folder folder_;
  const std::string workplace_;  ///< the reader's folder
  std::string output_;           ///< what the commands printed
};

}  // namespace citylearn::testing
