// SPDX-License-Identifier: Apache-2.0
// What every registered dataset promises (env_service/dataset_io/dataset.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <set>

#include "tests/support/env/env.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using DatasetEntry = DatasetRegistry::Entry;

std::vector<const DatasetEntry*> all_datasets() { return DatasetRegistry::instance().entries(); }

std::unique_ptr<Dataset> create(const DatasetEntry& entry, const std::string& folder) {
  return entry.create(Parameters(entry.name, entry.parameters, {}), folder);
}

/// Returns false for a dataset that shows something without any data, as a generated city does.
bool needs_data(const DatasetEntry& entry) {
  try {
    create(entry, "")->names();
    return false;
  } catch (const Error&) {
    return true;
  }
}

/// A folder of any other things is one of no features files: plain lists none, and so does live, which reads the same.
bool takes_any_folder(const DatasetEntry& entry) { return entry.name == "plain" || entry.name == "live"; }

std::vector<const DatasetEntry*> all_of_files() {
  std::vector<const DatasetEntry*> entries = all_datasets();
  std::erase_if(entries, [](const DatasetEntry* entry) { return !needs_data(*entry); });
  return entries;
}

class DatasetsOfFiles : public ::testing::TestWithParam<const DatasetEntry*> {};
class Datasets : public ::testing::TestWithParam<const DatasetEntry*> {};

TEST_P(Datasets, TellWhatTheyAre) {
  const DatasetEntry& entry = *GetParam();
  EXPECT_FALSE(entry.help.empty());
  EXPECT_FALSE(contains(entry.help, "\n"));
  EXPECT_TRUE(std::all_of(entry.name.begin(), entry.name.end(),
                          [](unsigned char c) { return std::islower(c) || std::isdigit(c) || c == '_'; }));
  for (const ParameterSpec& parameter : entry.parameters) EXPECT_FALSE(parameter.help.empty()) << parameter.name;
  for (const auto& [what, text] : entry.about) EXPECT_FALSE(text.empty()) << what;
}

TEST_P(DatasetsOfFiles, SayWhereTheyAreToBeHad) {
  const DatasetEntry& entry = *GetParam();
  if (takes_any_folder(entry)) return;  // nobody published it
  std::set<std::string> told;
  for (const auto& [what, text] : entry.about) told.insert(what);
  for (const char* what : {"paper", "address", "licence", "size"}) EXPECT_TRUE(told.contains(what)) << what;
}

TEST_P(Datasets, AskForDataWhenNoneAreGiven) {
  const DatasetEntry& entry = *GetParam();
  try {
    EXPECT_FALSE(create(entry, "")->names().empty());
  } catch (const Error& error) {
    EXPECT_TRUE(contains(error.what(), "--data"));
  }
}

TEST_P(DatasetsOfFiles, KnowAnEmptyFolderIsNotTheirs) {
  const DatasetEntry& entry = *GetParam();
  const Folder empty;
  for (const std::string& folder : {empty.path(), empty / "missing"}) {
    const std::unique_ptr<Dataset> dataset = create(entry, folder);
    try {
      EXPECT_TRUE(dataset->names().empty());
      EXPECT_TRUE(takes_any_folder(entry)) << "took " << folder;
    } catch (const Error& error) {
      const std::string line = error.what();
      EXPECT_TRUE(contains(line, folder));
      EXPECT_FALSE(contains(line, "\n"));
    }
    EXPECT_THROW(dataset->load("anything"), Error);
    EXPECT_THROW(dataset->load(""), Error);
    EXPECT_THROW(dataset->load("../.."), Error);
    EXPECT_THROW(dataset->matches("anything", "else"), Error);
    dataset->correspondence();
  }
}

/// A picture and a text below folders of no layout, and a file where a folder should be.
TEST_P(DatasetsOfFiles, KnowAFolderOfOtherThingsIsNotTheirs) {
  const DatasetEntry& entry = *GetParam();
  const Folder other;
  std::filesystem::create_directories(other / "letters/2014");
  std::ofstream(other / "letters/2014/to-anna.txt") << "Dear Anna";
  std::ofstream(other / "notes.md") << "# Notes";
  if (!takes_any_folder(entry)) {
    EXPECT_THROW(create(entry, other.path())->names(), Error);
  }
  EXPECT_THROW(create(entry, other / "notes.md")->names(), Error);
}

std::string name_of(const ::testing::TestParamInfo<const DatasetEntry*>& test) { return test.param->name; }
INSTANTIATE_TEST_SUITE_P(All, Datasets, ::testing::ValuesIn(all_datasets()), name_of);
INSTANTIATE_TEST_SUITE_P(All, DatasetsOfFiles, ::testing::ValuesIn(all_of_files()), name_of);

}  // namespace
}  // namespace citylearn::testing
