// SPDX-License-Identifier: Apache-2.0
// The rule for names, and texts in tables.
#include "core/util/name.h"

#include <gtest/gtest.h>

#include "core/files/csv.h"

namespace citylearn::testing {
namespace {

TEST(Name, IsOfFewCharacters) {
  for (const char* good : {"a", "env-summer", "2014-12-09-13-21-02", "A.b_C-9", ".a", "-"})
    EXPECT_EQ(name_problem(good), "");
  EXPECT_EQ(name_problem(std::string(64, 'x')), "");
  for (const char* bad :
       {"", ".", "..", "...", " ", "a b", "a,b", "a\nb", "a/b", "\xC3\xA9", "=1+1", "<b>", "'", "%2F", "a\x7F"})
    EXPECT_EQ(name_problem(bad),
              "'" + std::string(bad) + "' must be 1 to 64 of the characters A-Z a-z 0-9 . _ -, not dots alone");
  EXPECT_NE(name_problem(std::string(65, 'x')), "");
}

TEST(Name, IsMadeOfWhatARecordingIsCalled) {
  EXPECT_EQ(name_from("my drive, day 2"), "my_drive__day_2");
  EXPECT_EQ(name_from("summer"), "summer");
  EXPECT_EQ(name_from("\xC3\xA9t\xC3\xA9"), "__t__");
  EXPECT_EQ(name_problem(name_from(std::string(100, '/'))), "");
}

TEST(Csv, FieldsComeBackAsTheyWere) {
  const std::vector<std::string> fields = {"plain", "", "a,b", "say \"hi\"", "two\nlines", "\"", ",", "7"};
  std::string record;
  for (const std::string& field : fields) record += (record.empty() ? "" : ",") + csv_field(field);
  EXPECT_EQ(record, "plain,,\"a,b\",\"say \"\"hi\"\"\",\"two\nlines\",\"\"\"\",\",\",7");
  EXPECT_EQ(csv_fields(record), fields);
}

}  // namespace
}  // namespace citylearn::testing
