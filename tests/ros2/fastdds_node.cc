// SPDX-License-Identifier: Apache-2.0
// ros2_fastdds_node DOMAIN SECONDS PREFIX: a node as rmw_fastrtps makes one: Fast DDS with its own settings (multicast,
// shared memory). Ends with 0 once it has heard ten pictures as sensor data (rmw_qos_profile_sensor_data) and ten
// commands in the default qualities (rmw_qos_profile_default).
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <iostream>
#include <string>

#include "core/dds/middleware_fastdds_type.h"
#include "core/ros2/messages.h"
#include "ros2/ros2.h"

namespace {

namespace dds = citylearn::fast::dds;
using CompressedImage = sensor_msgs::msg::dds_::CompressedImage_;
using Twist = geometry_msgs::msg::dds_::Twist_;

/// One subscription.
template <class Message>
class Subscription {
 public:
  Subscription(dds::DomainParticipant& participant, const std::string& topic, bool sensor_data) {
    constexpr std::size_t kMaxBytes = 1 << 24;
    dds::TypeSupport type(new citylearn::fast::RawType(citylearn::ros2_type_of<Message>().dds, kMaxBytes));
    type.register_type(&participant);
    dds::DataReaderQos qos;
    qos.reliability().kind = sensor_data ? dds::BEST_EFFORT_RELIABILITY_QOS : dds::RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = dds::VOLATILE_DURABILITY_QOS;
    qos.history().kind = dds::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = sensor_data ? 5 : 10;
    qos.endpoint().history_memory_policy = citylearn::fast::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    dds::Topic* const made = participant.create_topic("rt" + topic, type.get_type_name(), dds::TOPIC_QOS_DEFAULT);
    reader_ = participant.create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT)->create_datareader(made, qos);
  }
  /// Returns how many there were so far.
  int take() {
    citylearn::Bytes bytes;
    citylearn::fast::Raw raw{{}, &bytes};
    dds::SampleInfo info;
    Message message;
    while (citylearn::fast::is_ok(reader_->take_next_sample(&raw, &info)))
      if (info.valid_data && citylearn::decode_ros2(bytes, message) && is_right(message)) ++heard_;
    return heard_;
  }
  bool wait() { return reader_->wait_for_unread_message(citylearn::fast::Duration(0.05L)); }

 private:
  static bool is_right(const CompressedImage& image) {
    return image.format() == "jpeg" && image.data().size() > 2 && image.data()[0] == 0xFF && image.data()[1] == 0xD8;
  }
  static bool is_right(const Twist& twist) { return twist.linear().x() != 0; }

  dds::DataReader* reader_;
  int heard_ = 0;
};

bool hears_enough(std::uint32_t domain, int seconds, const std::string& prefix) {
  dds::DomainParticipant* const participant =
      dds::DomainParticipantFactory::get_instance()->create_participant(domain, dds::PARTICIPANT_QOS_DEFAULT);
  Subscription<CompressedImage> images(*participant, prefix + "/image/compressed", true);
  Subscription<Twist> commands(*participant, prefix + "/cmd_vel", false);
  std::cout << "subscribed" << std::endl;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
  bool enough = false;
  while (!enough && std::chrono::steady_clock::now() < end) {
    images.wait();
    const int pictures = images.take(), twists = commands.take();
    enough = pictures >= 10 && twists >= 10;
    if (enough) std::cout << pictures << " pictures, " << twists << " commands" << std::endl;
  }
  return enough;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  return hears_enough(static_cast<std::uint32_t>(std::stoi(argv[1])), std::stoi(argv[2]), argv[3]) ? 0 : 1;
}
