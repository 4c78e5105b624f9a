// SPDX-License-Identifier: Apache-2.0
#include "core/files/json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::string nested(std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); }

std::string parse_refusal(const std::string& text) {
  return error_of([&] { parse_json(text, "a.json", "fetch it again"); });
}

TEST(ParseJson, ReadsWhatIsOrdinary) {
  EXPECT_EQ(parse_json(R"({"a": [1, "]}[{\"\\", null]})", "a.json"), nlohmann::json({{"a", {1, "]}[{\"\\", nullptr}}}));
  EXPECT_EQ(parse_json(nested(kMaxJsonDepth), "a.json").dump(), nested(kMaxJsonDepth));
  EXPECT_EQ(parse_json(R"(["[[\"[[", ")" + std::string(1000, '[') + R"("])", "a.json").size(), 2u);
  EXPECT_EQ(parse_json(R"({"a": 1, "b": {"a": 2, "c": 3}})", "a.json", "", {"a"}).dump(), R"({"b":{"c":3}})");
}

TEST(ParseJson, SaysWhatIsWrong) {
  EXPECT_EQ(parse_refusal(nested(kMaxJsonDepth + 1)), "a.json: nests more than 64 levels deep (fetch it again)");
  EXPECT_EQ(parse_refusal(std::string(8'000'000, '[')), parse_refusal(nested(65)));
  EXPECT_EQ(parse_refusal(R"("\\)" + std::string(100, '{')),
            "a.json: is not JSON: broken at byte 104 (fetch it again)");
  EXPECT_EQ(parse_refusal("[1,"), "a.json: is not JSON: broken at byte 4 (fetch it again)");
  EXPECT_EQ(parse_refusal("[1e999]"), "a.json: holds a number that is too large (fetch it again)");
  for (const std::string& text : {nested(65), std::string("[1,"), std::string(), std::string("[1e999]")})
    EXPECT_TRUE(parse_json_or_null(text).is_null()) << text;
  EXPECT_EQ(parse_json_or_null("[1]").dump(), "[1]");
}

}  // namespace
}  // namespace citylearn::testing
