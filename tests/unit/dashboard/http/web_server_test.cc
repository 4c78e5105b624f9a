// SPDX-License-Identifier: Apache-2.0
// The parts of the web server that need no network.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "dashboard/http/access.h"
#include "dashboard/http/connections.h"
#include "dashboard/http/page.h"
#include "dashboard/http/target.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(Target, IsTakenApartBeforeItIsDecoded) {
  const auto target = parse_target("/api/runs/demo%2Fpolicy%2F1/training?columns=reward%2Cspl&x=wall+time&&empty=");
  ASSERT_TRUE(target);
  EXPECT_EQ(target->segments, (std::vector<std::string>{"api", "runs", "demo/policy/1", "training"}));
  EXPECT_EQ(target->parameters,
            (std::map<std::string, std::string>{{"columns", "reward,spl"}, {"x", "wall time"}, {"empty", ""}}));
  EXPECT_EQ(target->path, "/api/runs/demo%2Fpolicy%2F1/training");
  EXPECT_EQ(parse_target("/")->segments, std::vector<std::string>{""});
  EXPECT_EQ(parse_target("/a+b%20c")->segments, std::vector<std::string>{"a+b c"});
  EXPECT_EQ(parse_target("/?a=1&b=2&a=2")->repeated, "a");
}

TEST(Target, RefusesWhatIsNoPath) {
  for (const std::string text : {"", "*", "api", "http://localhost/api", "/%", "/%2", "/%zz", "/%00", "/?a=%00", "/%ff",
                                 "/%c0%af", "/%ed%a0%80", "/%f4%90%80%80", "/?%e2%82"})
    EXPECT_FALSE(parse_target(text)) << text;
  EXPECT_FALSE(parse_target(std::string("/a\0b", 4)));
}

TEST(PageFiles, AreOnlyThoseOfTheFolder) {
  const Folder folder;
  make_file(folder / "secret", "secret");
  make_file(folder / "page/index.html", "<p>");
  make_file(folder / "page/assets/index-a1B2c3_4.js", "let x;");
  make_file(folder / "page/assets/index-a1B2c3_4.js.gz", "compressed");
  make_file(folder / "page/assets/plain.css", "p {}");
  std::filesystem::create_symlink("../secret", folder / "page/link");
  const Page page(folder / "page");
  ASSERT_NE(page.find("/"), nullptr);
  EXPECT_EQ(page.find("/"), page.find("/index.html"));
  EXPECT_EQ(page.find("/")->type, "text/html; charset=utf-8");
  EXPECT_FALSE(page.find("/")->hashed);
  const Page::File* script = page.find("/assets/index-a1B2c3_4.js");
  ASSERT_NE(script, nullptr);
  EXPECT_TRUE(script->hashed);
  EXPECT_EQ(script->compressed, "compressed");
  EXPECT_NE(script->tag, page.find("/")->tag);
  EXPECT_FALSE(page.find("/assets/plain.css")->hashed);
  for (const std::string path : {"", "/link", "/../secret", "/assets/../index.html", "//index.html", "/assets",
                                 "/assets/index-a1B2c3_4.js.gz", "/index.html/"})
    EXPECT_EQ(page.find(path), nullptr) << path;
  EXPECT_TRUE(Page(folder / "none").empty());
  EXPECT_TRUE(Page().empty());
}

Access::Options on(const std::string& address, const std::string& token_file = "") {
  return {address, 8080, token_file, {"Gpu7.example.org"}, false};
}

TEST(AccessNames, HostAndOriginMustBeOurs) {
  const Access access(on("127.0.0.1"));
  for (const std::string host :
       {"localhost", "localhost:8080", "LOCALHOST:9", "127.0.0.1:8080", "[::1]:8080", "gpu7.example.org"})
    EXPECT_FALSE(access.foreign({host, "", "", ""})) << host;
  for (const std::string host : {"", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example:8080", "[::1",
                                 "10.0.0.1:8080", "localhost:80a", "localhost:8080@evil.example", "[::1]evil"})
    EXPECT_TRUE(access.foreign({host, "", "", ""})) << host;
  EXPECT_FALSE(access.foreign({"localhost:8080", "http://localhost:8080", "", ""}));
  EXPECT_FALSE(access.foreign({"gpu7.example.org", "https://gpu7.example.org", "", ""})) << "a proxy speaks TLS";
  for (const std::string origin : {"null", "http://evil.example", "http://localhost", "http://localhost:8081",
                                   "http://127.0.0.1:8080", "localhost:8080", "http://localhost:8080/"})
    EXPECT_TRUE(access.foreign({"localhost:8080", origin, "", ""})) << origin;
  Access::Options encrypted = on("127.0.0.1");
  encrypted.tls = true;
  EXPECT_TRUE(Access(encrypted).foreign({"localhost", "http://localhost", "", ""}));
}

TEST(AccessNames, WhoListensEverywhereIsCalledByAnyAddressButNotByAnyName) {
  const Folder folder;
  const Access access(on("0.0.0.0", folder / "token"));
  EXPECT_FALSE(access.foreign({"192.168.7.7:8080", "", "", ""}));
  EXPECT_TRUE(access.foreign({"evil.example", "", "", ""}));
}

TEST(AccessToken, IsMadeOnceAndOnlyForItsOwner) {
  const Folder folder;
  const std::string path = folder / "token";
  Access access(on("0.0.0.0", path));
  struct stat facts {};
  ASSERT_EQ(::stat(path.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0600u);
  const std::string token = contents(path).substr(0, 64);
  const Access again(on("0.0.0.0", path));
  for (const Access* one : {static_cast<const Access*>(&access), &again}) {
    EXPECT_TRUE(one->allows({"", "", "Bearer " + token, ""}));
    EXPECT_TRUE(one->allows({"", "", "bearer " + token, ""}));
  }
  for (const std::string& wrong : {std::string(), std::string("Bearer "), "Bearer " + token.substr(1), "Basic " + token,
                                   token, "Bearer " + token + "0", "Bearer  " + token})
    EXPECT_FALSE(access.allows({"", "", wrong, ""})) << wrong;
}

TEST(AccessToken, ALinkWorksOnceAndItsCookieFromThenOn) {
  const Folder folder;
  Access access(on("127.0.0.1", folder / "token"));
  const std::string path = access.login_path(), start = "/login?once=";
  ASSERT_EQ(path.substr(0, start.size()), start);
  const std::string code = path.substr(start.size());
  EXPECT_GE(code.size(), 32u);
  EXPECT_FALSE(access.redeem(""));
  EXPECT_FALSE(access.redeem(code + "0"));
  EXPECT_TRUE(access.redeem(code));
  EXPECT_FALSE(access.redeem(code));
  EXPECT_FALSE(access.redeem(""));
  const std::string cookie = access.cookie();
  EXPECT_TRUE(contains(cookie, "; HttpOnly; SameSite=Strict"));
  EXPECT_FALSE(contains(cookie, "Secure"));
  const std::string pair = cookie.substr(0, cookie.find(';'));
  EXPECT_TRUE(access.allows({"", "", "", pair}));
  EXPECT_TRUE(access.allows({"", "", "", "a=b; " + pair + "; c"}));
  EXPECT_FALSE(access.allows({"", "", "", pair + "0"}));
  EXPECT_FALSE(access.allows({"", "", "", "x" + pair}));
  EXPECT_FALSE(contains(cookie, contents(folder / "token").substr(0, 64)));
}

/// The message of the Error, or "" when there was none.
std::string refusal_of(const Access::Options& options) {
  return error_of([&] { const Access access(options); });
}

TEST(AccessToken, WhatIsWrongIsSaidInOneLine) {
  const Folder folder;
  EXPECT_TRUE(holds(refusal_of(on("0.0.0.0")), "--token-file"));
  EXPECT_TRUE(holds(refusal_of(on("here")), "--listen"));
  EXPECT_TRUE(holds(refusal_of(on("127.0.0.1", folder / "none/token")), folder / "none/token"));
  EXPECT_TRUE(holds(refusal_of(on("127.0.0.1", folder.path())), folder.path()));
  const std::string path = folder / "token";
  for (const std::string text : {"", "short", "0123456789 abcdef0", "0123456789abcdef\nsecond line"}) {
    std::ofstream(path) << text;
    ::chmod(path.c_str(), 0600);
    EXPECT_TRUE(holds(refusal_of(on("127.0.0.1", path)), "holds no valid token")) << text;
  }
  std::ofstream(path) << "0123456789abcdef\n";
  EXPECT_EQ(refusal_of(on("127.0.0.1", path)), "");
  ::chmod(path.c_str(), 0640);
  EXPECT_TRUE(holds(refusal_of(on("127.0.0.1", path)), "chmod 600 " + path));
}

class Visitor : public Connection {
 public:
  Visitor(Connections& all, const std::string& from, int arrived) : all_(all) {
    address = boost::asio::ip::make_address(from);
    since = Time(seconds(arrived));
    all_.add(*this);
  }
  ~Visitor() override { all_.remove(*this); }
  void close() override {
    closed = true;
    all_.remove(*this);
  }
  void tick(Time) override { ++ticks; }
  bool closed = false;
  int ticks = 0;

 private:
  Connections& all_;
};

TEST(ConnectionsTest, TheLongestIdleOfAnAddressMakesRoom) {
  Connections all(4, 2);
  const auto here = boost::asio::ip::make_address("127.0.0.1"), there = boost::asio::ip::make_address("10.0.0.1");
  Visitor first(all, "127.0.0.1", 1), second(all, "127.0.0.1", 2), other(all, "10.0.0.1", 0);
  second.idle = false;
  EXPECT_TRUE(all.admit(there));
  EXPECT_FALSE(first.closed || second.closed || other.closed) << "there was room";
  EXPECT_TRUE(all.admit(here));
  EXPECT_TRUE(first.closed) << "the older one of another address does not count";
  EXPECT_FALSE(other.closed);
  EXPECT_EQ(all.size(), 2u);
  Visitor third(all, "127.0.0.1", 3);
  third.idle = false;
  EXPECT_FALSE(all.admit(here)) << "both are busy";
  Visitor fourth(all, "10.0.0.2", 4);
  EXPECT_TRUE(all.admit(boost::asio::ip::make_address("10.0.0.3")));
  EXPECT_TRUE(other.closed) << "the longest idle of all";
}

TEST(ConnectionsTest, WhoseDeadlineHasPassedIsClosed) {
  Connections all(4, 4);
  Visitor late(all, "127.0.0.1", 1), early(all, "127.0.0.1", 1);
  late.deadline = Connection::Time(seconds(5));
  all.tick(Connection::Time(seconds(4)));
  EXPECT_EQ(late.ticks + early.ticks, 2);
  all.tick(Connection::Time(seconds(6)));
  EXPECT_TRUE(late.closed);
  EXPECT_EQ(early.ticks, 2);
  EXPECT_EQ(all.size(), 1u);
}

}  // namespace
}  // namespace citylearn::testing
