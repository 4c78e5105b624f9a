// SPDX-License-Identifier: Apache-2.0
// That services meet whatever is set is in tests/system/network/vendors_test.cc.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "core/dds/middleware_internal.h"

namespace citylearn::internal {
namespace {

std::string value(const char* name) {
  const char* found = std::getenv(name);
  return found ? found : "none";
}

class Variables : public ::testing::Test {
 protected:
  Variables() {
    setenv("ROS_DISCOVERY_SERVER", "10.0.0.1:11811", 1);
    setenv("CYCLONEDDS_URI", "file:///nowhere.xml", 1);
    unsetenv("SKIP_DEFAULT_XML_FILE");
  }
  ~Variables() override {
    unsetenv("ROS_DISCOVERY_SERVER");
    unsetenv("CYCLONEDDS_URI");
  }
};

TEST_F(Variables, AreHiddenForAWhile) {
  {
    const ForeignVariables hidden(false);
    EXPECT_EQ(value("ROS_DISCOVERY_SERVER"), "");
    EXPECT_EQ(value("CYCLONEDDS_URI"), "none");
    EXPECT_EQ(value("SKIP_DEFAULT_XML_FILE"), "1");
  }
  EXPECT_EQ(value("ROS_DISCOVERY_SERVER"), "10.0.0.1:11811");
  EXPECT_EQ(value("CYCLONEDDS_URI"), "file:///nowhere.xml");
  EXPECT_EQ(value("SKIP_DEFAULT_XML_FILE"), "none");
}

TEST_F(Variables, TheServersOfRos2HoldWhereItsNodesAreMet) {
  const ForeignVariables hidden(true);
  EXPECT_EQ(value("ROS_DISCOVERY_SERVER"), "10.0.0.1:11811");
  EXPECT_EQ(value("CYCLONEDDS_URI"), "none");
}

TEST_F(Variables, AreNamedWithWhatBecomesOfThem) {
  const std::vector<std::string> lines = ForeignVariables::found();
  EXPECT_EQ(std::count(lines.begin(), lines.end(),
                       "CYCLONEDDS_URI is set: ignored; services have --interface, --peers and --domain"),
            1);
  EXPECT_EQ(std::count_if(lines.begin(), lines.end(),
                          [](const std::string& line) { return line.starts_with("SKIP_DEFAULT_XML_FILE"); }),
            0);
}

}  // namespace
}  // namespace citylearn::internal
