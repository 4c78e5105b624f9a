// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback/page_link.h"

#include <gtest/gtest.h>

#include "core/util/error.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(PageLink, NamesAMoment) {
  EXPECT_TRUE(is_link("https://host/#/route"));
  EXPECT_FALSE(is_link("runs/http.mcap"));
  const std::string fragment = "#/route?run=demo%2Fpolicy%2F1%2F5&at=3000";
  const PageLink link = parse_page_link("http://127.0.0.1:8080/" + fragment);
  EXPECT_EQ(link.fragment, fragment);
  ASSERT_TRUE(link.moment);
  EXPECT_EQ(link.moment->run, "demo/policy/1/5");
  EXPECT_EQ(link.moment->axis, "steps");
  EXPECT_EQ(link.moment->at, 3000);
  const PageLink curves = parse_page_link("http://h/login?once=5#/training?runs=a%2Fb%2F1%2F2&x=wall&at=1.25");
  ASSERT_TRUE(curves.moment);
  EXPECT_EQ(curves.moment->run, "a/b/1/2");
  EXPECT_EQ(curves.moment->axis, "wall");
  EXPECT_EQ(curves.moment->at, 1.25);
}

TEST(PageLink, MayNameNoMoment) {
  EXPECT_FALSE(parse_page_link("http://h/#/overview").moment);
  EXPECT_FALSE(parse_page_link("http://h/#/training?runs=a").moment);
}

TEST(PageLink, IsRefusedInOneLine) {
  const auto refused = [](const std::string& link, const std::string& naming) {
    try {
      parse_page_link(link);
      ADD_FAILURE() << link;
    } catch (const Error& error) {
      EXPECT_TRUE(contains(error.what(), naming)) << error.what();
      EXPECT_TRUE(contains(error.what(), "--open " + link.substr(0, 10))) << error.what();
    }
  };
  refused("http://h/", "is not a link to the dashboard's page");
  refused("http://h/#/route?run=%ZZ", "is not a link to the dashboard's page");
  refused("http://h/#/route?run=a b", "is not a link to the dashboard's page");
  for (const char* at : {"x", "-1", "3000x", "nan", "inf"})
    refused("http://h/#/route?run=a&at=" + std::string(at), "at=" + std::string(at) + " is not a number from 0 on");
  refused("http://h/#/route?at=5", "its moment names no run");
  refused("http://h/#/route?run=a&at=5&x=miles", "x=miles is not one of update, steps, episodes, wall");
}

}  // namespace
}  // namespace citylearn::testing
