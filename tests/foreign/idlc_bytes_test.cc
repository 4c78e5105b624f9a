// SPDX-License-Identifier: Apache-2.0
// The bytes of our messages, against those that Cyclone DDS writes with the C types that its own compiler makes of
// idl/.
#include <dds/dds.h>
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/support/options.h"
#include "tests/support/records/samples.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kBytesDomain = 107;

/// Returns what Cyclone DDS's compiler made of a type of idl/, or a null pointer.
const dds_topic_descriptor_t* descriptor_of(const std::string& type) {
  const std::string name = type.substr(type.rfind(':') + 1);
  return static_cast<const dds_topic_descriptor_t*>(dlsym(RTLD_DEFAULT, ("citylearn_msg_" + name + "_desc").c_str()));
}

/// Takes typed samples of one topic and writes them to another one, as another program would.
class Echo {
 public:
  Echo(const std::string& from, const std::string& to, const dds_topic_descriptor_t& type)
      : participant_(dds_create_participant(kBytesDomain, nullptr, nullptr)) {
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    const auto topic = [&](const std::string& name) {
      return dds_create_topic(participant_, &type, name.c_str(), qos, nullptr);
    };
    reader_ = dds_create_reader(participant_, topic(from), qos, nullptr);
    writer_ = dds_create_writer(participant_, topic(to), qos, nullptr);
    dds_delete_qos(qos);
  }
  ~Echo() { dds_delete(participant_); }
  /// Returns whether there was one.
  bool pass_on() {
    void* sample = nullptr;
    dds_sample_info_t info;
    if (dds_take(reader_, &sample, &info, 1, 1) != 1) return false;
    const bool written = info.valid_data && dds_write(writer_, sample) == DDS_RETCODE_OK;
    dds_return_loan(reader_, &sample, 1);
    return written;
  }

 private:
  const dds_entity_t participant_;
  dds_entity_t reader_, writer_;
};

TEST(IdlcBytes, AreThoseOfEveryMessage) {
  const auto middleware = create_middleware(middleware_options("cyclonedds", kBytesDomain));
  for_each_message([&]<class Message>() {
    Topic to = topic_of<Message>(), from = to;
    to.name += "/to";
    from.name += "/from";
    const dds_topic_descriptor_t* const type = descriptor_of(to.type);
    ASSERT_TRUE(type) << to.type;
    const auto publisher = middleware->create_publisher(to);
    const auto subscription = middleware->create_subscription(from);
    Echo echo(to.name, from.name, *type);
    for (const Size size : {Size::kMin, Size::kTypical, Size::kMax}) {
      const Bytes sent = encoded(sample_of<Message>(size));
      publisher->publish(sent);
      Bytes received;
      ASSERT_TRUE(eventually(*middleware, [&] { return echo.pass_on(); })) << to.type;
      ASSERT_TRUE(eventually(*middleware, [&] { return subscription->take(received); })) << to.type;
      ASSERT_LE(received.size() - sent.size(), 3u) << to.type;  // padded to multiples of 4
      received.resize(sent.size());
      received[3] = std::byte{0};  // says how many bytes that is
      EXPECT_TRUE(received == sent) << to.type << ", size " << static_cast<int>(size);
    }
  });
}

}  // namespace
}  // namespace citylearn::testing
