// SPDX-License-Identifier: Apache-2.0
// compose/keystore, and the checks of what it makes: enforced or refused with one line that names the file, never half.
#include "core/dds/security.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cctype>
#include <filesystem>
#include <map>
#include <regex>
#include <set>

#include "core/util/error.h"
#include "core/wire/messages.h"
#include "tests/paths.h"
#include "tests/support/options.h"
#include "tests/support/processes/keystore.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

/// Returns the complaint of --security about a folder; empty when it accepts it.
std::string complaint(const std::string& folder, const std::string& id = "env-1") {
  return error_of([&] {
    const std::string path = internal::check_security(folder, id);
    EXPECT_EQ(path, fs::canonical(folder).string());
  });
}

void expect_complaint(const std::string& folder, const std::string& file, const std::string& text,
                      const std::string& id = "env-1") {
  const std::string line = complaint(folder, id);
  EXPECT_TRUE(line.starts_with(fs::canonical(folder).string() + "/" + file + ": ")) << line;
  EXPECT_TRUE(holds(line, text));
}

void replace(const std::string& from, const std::string& to) {
  fs::copy_file(from, to, fs::copy_options::overwrite_existing);
}

class Keys : public ::testing::Test {
 protected:
  std::string add(const std::string& kind = "env_service", const std::string& id = "env-1",
                  const std::string& until = "1 month") {
    return store_.add(kind, id, until);
  }
  Keystore store_;
};

TEST_F(Keys, OfTheKeystoreAreTaken) {
  EXPECT_EQ(complaint(add()), "");
  EXPECT_EQ(complaint(add("actor", std::string(64, 'x')), std::string(64, 'x')), "");
  const auto mode = [](const std::string& path) {
    struct stat about {};
    EXPECT_EQ(stat(path.c_str(), &about), 0) << path;
    return about.st_mode & 0777u;
  };
  EXPECT_EQ(mode(store_.of("env-1/key.pem")), 0600u);
  EXPECT_EQ(mode(store_.of("authority")), 0700u);
  EXPECT_EQ(mode(store_.of("authority/identity_ca.key")), 0600u);
  EXPECT_EQ(mode(store_.of("authority/permissions_ca.key")), 0600u);
}

TEST_F(Keys, WhatIsMissingOrDamagedIsNamed) {
  EXPECT_TRUE(contains(complaint(store_.of("nobody")), "is not a folder"));
  const std::string folder = add();
  for (const std::string name :
       {"identity_ca.pem", "permissions_ca.pem", "governance.p7s", "permissions.p7s", "cert.pem", "key.pem"}) {
    const std::string file = folder + "/" + name, text = contents(file);
    fs::remove(file);
    expect_complaint(folder, name, "is missing");
    for (const std::string& damage : {std::string(), text.substr(0, text.size() / 2), std::string(2 << 20, 'x')}) {
      make_file(file, damage);
      if (name == "key.pem") fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
      expect_complaint(folder, name, "");
    }
    make_file(file, text);
    EXPECT_EQ(complaint(folder), "") << name;
  }
}

TEST_F(Keys, AKeyThatOthersCanReadIsRefused) {
  const std::string folder = add();
  for (const fs::perms mode : {fs::perms::group_read, fs::perms::others_read, fs::perms::others_write}) {
    fs::permissions(folder + "/key.pem", fs::perms::owner_read | mode);
    expect_complaint(folder, "key.pem", "others than its owner can read it");
  }
}

TEST_F(Keys, MustBeValidNow) {
  add("env_service", "env-1", "1 day ago");
  expect_complaint(store_.of("env-1"), "cert.pem", "expired on ");
  store_.expect({"add", store_.of(""), "env_service", "env-2", "--from", "2 days", "--until", "3 days"});
  expect_complaint(store_.of("env-2"), "cert.pem", "is not valid before ", "env-2");
  // A certificate of longer life than the permissions beside it.
  const std::string folder = add("env_service", "env-3");
  add("env_service", "env-4", "1 hour ago");
  std::string permissions = contents(store_.of("env-4/permissions.p7s"));
  permissions = permissions.substr(permissions.find("<?xml"));
  permissions = permissions.substr(0, permissions.find("</dds>") + 6);
  permissions.replace(permissions.find("env-4"), 5, "env-3");
  make_file(store_.folder() / "document", permissions);
  store_.sign(store_.folder() / "document", folder + "/permissions.p7s");
  expect_complaint(folder, "permissions.p7s", "expired on ", "env-3");
}

TEST_F(Keys, MustFitTogether) {
  Keystore other;
  const std::string folder = add(), neighbour = add("env_service", "env-2"),
                    foreign = other.add("env_service", "env-1");
  const std::map<std::string, std::pair<std::string, std::string>> cases = {
      {foreign + "/cert.pem", {"cert.pem", "does not stand for it"}},
      {foreign + "/identity_ca.pem", {"cert.pem", "does not stand for it"}},
      {neighbour + "/key.pem", {"key.pem", "is not the key of cert.pem"}},
      {foreign + "/permissions.p7s", {"permissions.p7s", "has not signed it"}},
      {foreign + "/governance.p7s", {"governance.p7s", "has not signed it"}},
      {foreign + "/permissions_ca.pem", {"governance.p7s", "has not signed it"}},
      {neighbour + "/permissions.p7s", {"permissions.p7s", "is for 'CN=env-2'"}},
      {store_.of("authority/governance.xml"), {"governance.p7s", "is not signed"}}};
  for (const auto& [from, expected] : cases) {
    const std::string name = from.ends_with(".xml") ? "governance.p7s" : fs::path(from).filename().string();
    const std::string before = contents(folder + "/" + name);
    replace(from, folder + "/" + name);
    expect_complaint(folder, expected.first, expected.second);
    make_file(folder + "/" + name, before);
  }
  expect_complaint(folder, "cert.pem", "is that of 'env-1', this service is 'env-2'", "env-2");
  std::string changed = contents(folder + "/permissions.p7s");
  changed.replace(changed.find("citylearn/scene"), 15, "citylearn/other");
  make_file(folder + "/permissions.p7s", changed);
  expect_complaint(folder, "permissions.p7s", "has not signed it");
}

TEST_F(Keys, AGovernanceThatProtectsHalfIsRefused) {
  const std::string folder = add(), whole = contents(store_.of("authority/governance.xml"));
  const std::map<std::string, std::string> weaker = {
      {"<allow_unauthenticated_participants>false", "<allow_unauthenticated_participants>true"},
      {"<enable_join_access_control>true", "<enable_join_access_control>false"},
      {"<enable_write_access_control>true", "<enable_write_access_control>false"},
      {"<discovery_protection_kind>ENCRYPT", "<discovery_protection_kind>NONE"},
      {"<rtps_protection_kind>SIGN", "<rtps_protection_kind>NONE"},
      {"<metadata_protection_kind>ENCRYPT", "<metadata_protection_kind>SIGN"}};
  for (const auto& [from, to] : weaker) {
    std::string text = whole;
    ASSERT_NE(text.find(from), std::string::npos) << from;
    text.replace(text.find(from), from.size(), to);
    make_file(store_.folder() / "document", text);
    store_.sign(store_.folder() / "document", folder + "/governance.p7s");
    expect_complaint(folder, "governance.p7s", "must be ");
  }
}

TEST_F(Keys, ThatWereRevokedAreRefused) {
  const std::string folder = add(), kept = store_.folder() / "kept";
  fs::copy(folder, kept);
  const std::string neighbour = add("env_service", "env-2");
  store_.expect({"revoke", store_.of(""), "env-1"});
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_EQ(complaint(neighbour, "env-2"), "");
  EXPECT_EQ(complaint(kept), "") << "its own list is old: the others keep it out";
  replace(neighbour + "/crl.pem", kept + "/crl.pem");
  expect_complaint(kept, "cert.pem", "revoked");
}

TEST_F(Keys, AreRenewedAndNeverOverwritten) {
  const std::string folder = add(), before = contents(folder + "/key.pem");
  const auto refused = [&](std::vector<std::string> arguments, const std::string& text) {
    const auto [status, said] = store_.run(std::move(arguments));
    EXPECT_EQ(status, 1);
    EXPECT_TRUE(contains(said, text));
  };
  refused({"create", store_.of("")}, "nothing is overwritten");
  refused({"add", store_.of(""), "env_service", "env-1"}, "nothing is overwritten");
  refused({"add", store_.of(""), "spy", "env-2"}, "unknown kind 'spy'; there are: env_service encoder_service");
  for (const std::string kind : {".*", "env_service\n<grant/>"})  // becomes a part of the permissions
    refused({"add", store_.of(""), kind, "env-2"}, "unknown kind '" + kind + "'");
  refused({"add", store_.of(""), "actor", "../up"}, "an id has");
  refused({"add", store_.of(""), "actor", "authority"}, "is a folder of the keystore itself");
  refused({"add", store_.of("env-1"), "actor", "a"}, "is no keystore");
  refused({"add", store_.of(""), "actor", "a", "--until", "whenever"}, "is no date");
  refused({"renew", store_.of(""), "nobody"}, "has no service 'nobody'");
  EXPECT_EQ(contents(folder + "/key.pem"), before);
  store_.expect({"renew", store_.of(""), "env-1"});
  EXPECT_NE(contents(folder + "/key.pem"), before);
  EXPECT_EQ(complaint(folder), "");
  EXPECT_TRUE(contains(store_.run({"list", store_.of("")}).second, "env_service      env-1"));
}

TEST(Security, IsEnforcedOrRefused) {
  const auto start_error = [](const std::string& middleware, std::uint32_t domain) -> std::string {
    MiddlewareOptions options = middleware_options(middleware, domain);
    options.security = "/nowhere";
    return error_of([&] { create_middleware(options); });
  };
  EXPECT_TRUE(contains(start_error("inprocess", 0), "no wire to protect"));
  EXPECT_TRUE(contains(start_error("lossy:inprocess", 0), "no wire to protect"));
  for (const std::string vendor : {"cyclonedds", "fastdds"}) {
    EXPECT_TRUE(contains(start_error(vendor, 0), "'/nowhere' is not a folder"));
    EXPECT_EQ(start_error(vendor, 231), "domain: must be 0..230 with --security");
  }
}

TEST(Keystore, IsCleanShell) {
  if (!fs::exists("/usr/bin/shellcheck")) GTEST_SKIP() << "needs shellcheck";
  const Folder folder;
  Service check({"/usr/bin/shellcheck", CITYLEARN_SOURCE_DIR "/compose/keystore"}, folder / "said");
  EXPECT_EQ(check.wait(seconds(60)).value_or(-1), 0) << check.output();
}

TEST(Security, LinesOfTheVendorsAreExplained) {
  EXPECT_EQ(internal::explain_security("Cannot allocate"), std::nullopt);
  const auto line = internal::explain_security("Begin handshake reply failed: Certificate\nnot valid: subject: /CN=x");
  ASSERT_TRUE(line.has_value());
  EXPECT_EQ(line->find('\n'), std::string::npos);
  EXPECT_EQ(line->rfind("security: refused a participant", 0), 0u) << *line;
  const auto release = internal::explain_security(
      "Error validating remote permissions for a.b (Remote participant PermissionsCA algorithm differs from local)");
  EXPECT_NE(release.value_or("").find("another release of Fast DDS"), std::string::npos);
}

// --- compose/permissions against what the services do
// ----------------------------------------------------------------------------------------

using Topics = std::set<std::string>;
struct Rights {
  Topics publishes, reads;
};

std::map<std::string, Rights> granted() {
  std::map<std::string, Rights> all;
  for (const std::string& line : lines_of(contents(CITYLEARN_SOURCE_DIR "/compose/permissions"))) {
    std::istringstream words(line);
    std::string kind, does, topic;
    if (!(words >> kind) || kind[0] == '#') continue;
    words >> does;
    EXPECT_TRUE(does == "publishes" || does == "reads") << line;
    while (words >> topic) (does == "reads" ? all[kind].reads : all[kind].publishes).insert("citylearn/" + topic);
  }
  return all;
}

/// Topic of a message named in the sources.
std::string topic_named(const std::string& message) {
  std::string name = "citylearn/";
  for (const char c : message) {
    if (std::isupper(c) && !name.ends_with('/')) name += '_';
    name += static_cast<char>(std::tolower(c));
  }
  for (const Topic& topic : all_topics())
    if (topic.name == name) return name;
  return "";
}

/// Text of a source, or of all sources below a folder.
std::string text_of(const std::string& path) {
  const fs::path source = fs::path(CITYLEARN_SOURCE_DIR) / path;
  if (!fs::is_directory(source)) return contents(source);
  std::string text;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(source))
    if (entry.path().extension() == ".cc" || entry.path().extension() == ".h") text += contents(entry.path());
  return text;
}

/// Returns the types of the messages that are declared in a text, by the names of their variables.
std::multimap<std::string, std::string> declared(const std::string& text) {
  std::multimap<std::string, std::string> types;
  const std::regex declaration(R"(\bmsg::([A-Z]\w+)&? (\w+(?:, \w+)*)\s*[;)=])"), name(R"(\w+)");
  for (std::sregex_iterator at(text.begin(), text.end(), declaration), end; at != end; ++at) {
    const std::string names = (*at)[2];
    for (std::sregex_iterator one(names.begin(), names.end(), name); one != end; ++one)
      types.emplace((*one)[0], (*at)[1]);
  }
  return types;
}

/// Returns what these sources, with their headers, read and publish through a Node.
Rights done(const std::vector<std::string>& sources) {
  Rights rights;
  const std::regex reads(R"((?:create_reader\w*|listen)<msg::(\w+)>)"), writes(R"(create_writer\w*<msg::(\w+)>)");
  const std::regex publishes(R"(\bnode_?\.(?:publish|forward)\((?:\w+(?:->|\.))*(\w+)[,)])");
  for (const std::string& source : sources) {
    const fs::path header = fs::path(source).replace_extension(".h");
    const std::string text = text_of(source);
    EXPECT_FALSE(text.empty()) << source;
    const auto each = [&](const std::regex& pattern, const auto& visit) {
      for (std::sregex_iterator at(text.begin(), text.end(), pattern), end; at != end; ++at) visit((*at)[1]);
    };
    each(reads, [&](const std::string& message) { rights.reads.insert(topic_named(message)); });
    each(writes, [&](const std::string& message) { rights.publishes.insert(topic_named(message)); });
    const auto types = declared(text + (source.ends_with(".cc") ? text_of(header) : ""));
    each(publishes, [&](const std::string& variable) {
      EXPECT_TRUE(types.contains(variable)) << source << " publishes '" << variable << "', of which type?";
      const auto [begin, end] = types.equal_range(variable);
      for (auto type = begin; type != end; ++type)
        if (const std::string topic = topic_named(type->second); !topic.empty()) rights.publishes.insert(topic);
    });
  }
  rights.publishes.insert(topic_named("ServiceStatus"));  // Node itself
  EXPECT_FALSE(rights.reads.contains("") || rights.publishes.contains(""));
  return rights;
}

void expect_rights(const std::string& kind, const Rights& expected) {
  const Rights rights = granted()[kind];
  EXPECT_EQ(rights.publishes, expected.publishes) << kind;
  EXPECT_EQ(rights.reads, expected.reads) << kind;
}

TEST(Permissions, AreWhatTheServicesDo) {
  const std::string of_envs = "policy_service/env_client/", distributed = "policy_service/distributed/";
  const std::vector<std::string> client = {of_envs};
  std::vector<std::string> policy = client, learner, actor = client;
  policy.insert(policy.end(), {"policy_service/records", "policy_service/ranks/rank_node.cc"});
  learner = policy;
  learner.push_back(distributed + "learner_server.cc");
  for (const char* source : {"actor.cc", "learner_session.cc", "parameter_fetch.cc", "trajectory_outbox.cc"})
    actor.push_back(distributed + source);
  expect_rights("env_service", done({"env_service"}));
  expect_rights("encoder_service", done({"encoder_service"}));
  expect_rights("policy_service", done(policy));
  expect_rights("learner", done(learner));
  // The client of an actor records no episodes.
  Rights acting = done(actor);
  acting.reads.erase("citylearn/episode_stat");
  acting.publishes.erase("citylearn/episode_acknowledgement");
  acting.publishes.insert("citylearn/trajectory");  // TrajectoryOutbox, from a queue
  expect_rights("actor", acting);
  expect_rights("dashboard", done({"dashboard"}));
}

TEST(Permissions, NameTopicsThatThereAre) {
  Topics known = {"citylearn/*"};
  for (const Topic& topic : all_topics()) known.insert(topic.name);
  for (const auto& [kind, rights] : granted())
    for (const Topics& topics : {rights.publishes, rights.reads})
      for (const std::string& topic : topics) EXPECT_TRUE(known.contains(topic)) << kind << ": " << topic;
}

TEST(Permissions, OnlyWhoActsMayPublishActions) {
  std::set<std::string> kinds;
  for (const auto& [kind, rights] : granted())
    if (rights.publishes.contains("citylearn/action") || rights.publishes.contains("citylearn/*")) kinds.insert(kind);
  EXPECT_EQ(kinds, (std::set<std::string>{"actor", "learner", "policy_service"}));
}

}  // namespace
}  // namespace citylearn::testing
