// SPDX-License-Identifier: Apache-2.0
// The documents: links lead somewhere, pages named in code and comments exist, the README stays short.
#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/paths.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

const fs::path kDocumentsRoot = CITYLEARN_SOURCE_DIR;

/// Our text files, without what is generated or installed.
std::vector<fs::path> text_files() {
  const std::set<std::string> skipped = {".git", "build", "node_modules", "dist", "runs", "seeds"};
  const std::set<std::string> others = {".png", ".jpg", ".svg", ".html", ".csv"};
  std::vector<fs::path> found;
  for (auto entry = fs::recursive_directory_iterator(kDocumentsRoot); entry != fs::end(entry); ++entry) {
    if (entry->is_directory() && skipped.count(entry->path().filename())) entry.disable_recursion_pending();
    if (entry->is_regular_file() && !others.count(entry->path().extension())) found.push_back(entry->path());
  }
  return found;
}

/// The anchors of a page's headings, as web pages of repositories make them.
std::set<std::string> anchors(const std::string& page) {
  std::set<std::string> found;
  const std::regex heading("(?:^|\n)#+ ([^\n]+)");
  for (std::sregex_iterator match(page.begin(), page.end(), heading), end; match != end; ++match) {
    std::string anchor;
    for (const char c : match->str(1))
      if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == ' ')
        anchor += c == ' ' ? '-' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    found.insert(anchor);
  }
  return found;
}

TEST(Documents, LinksLeadSomewhere) {
  const std::regex link(R"(\]\(([^)\s#]*)(#[^)\s]*)?\))");
  for (const fs::path& file : text_files()) {
    if (file.extension() != ".md") continue;
    const std::string page = contents(file);
    for (std::sregex_iterator match(page.begin(), page.end(), link), end; match != end; ++match) {
      if (match->str(1).find(':') != std::string::npos) continue;  // another site
      const fs::path target = match->length(1) ? file.parent_path() / match->str(1) : file;
      EXPECT_TRUE(fs::exists(target)) << file << ": " << match->str();
      if (!match->length(2) || target.extension() != ".md") continue;
      EXPECT_TRUE(anchors(contents(target)).count(match->str(2).substr(1))) << file << ": " << match->str();
    }
  }
}

TEST(Documents, NamedPagesExist) {
  const std::regex page(R"((?:^|[^\w./-])(docs/[\w./-]*\.md))");
  for (const fs::path& file : text_files()) {
    const std::string text = contents(file);
    for (std::sregex_iterator match(text.begin(), text.end(), page), end; match != end; ++match)
      EXPECT_TRUE(fs::exists(kDocumentsRoot / match->str(1))) << file << ": " << match->str(1);
  }
}

TEST(Documents, TheReadmeStaysShort) { EXPECT_LE(occurrences(contents(kDocumentsRoot / "README.md"), "\n"), 150); }

}  // namespace
}  // namespace citylearn::testing
