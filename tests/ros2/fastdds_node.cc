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

#include "ros2/ros2PubSubTypes.h"

namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::types::ReturnCode_t;

/// One subscription.
template <class Type>
class Subscription {
 public:
  Subscription(dds::DomainParticipant& participant, const std::string& topic, bool sensor_data) {
    dds::TypeSupport type(new Type());
    type.register_type(&participant);
    dds::DataReaderQos qos;
    qos.reliability().kind = sensor_data ? dds::BEST_EFFORT_RELIABILITY_QOS : dds::RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = dds::VOLATILE_DURABILITY_QOS;
    qos.history().kind = dds::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = sensor_data ? 5 : 10;
    qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    dds::Topic* const made = participant.create_topic("rt" + topic, type.get_type_name(), dds::TOPIC_QOS_DEFAULT);
    reader_ = participant.create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT)->create_datareader(made, qos);
  }
  /// Returns how many there were so far.
  int take() {
    typename Type::type message;
    dds::SampleInfo info;
    while (reader_->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data && is_right(message)) ++heard_;
    return heard_;
  }
  bool wait() { return reader_->wait_for_unread_message(Duration_t(0.05L)); }

 private:
  static bool is_right(const sensor_msgs::msg::dds_::CompressedImage_& image) {
    return image.format() == "jpeg" && image.data().size() > 2 && image.data()[0] == 0xFF && image.data()[1] == 0xD8;
  }
  static bool is_right(const geometry_msgs::msg::dds_::Twist_& twist) { return twist.linear().x() != 0; }

  dds::DataReader* reader_;
  int heard_ = 0;
};

bool hears_enough(std::uint32_t domain, int seconds, const std::string& prefix) {
  dds::DomainParticipant* const participant =
      dds::DomainParticipantFactory::get_instance()->create_participant(domain, dds::PARTICIPANT_QOS_DEFAULT);
  Subscription<sensor_msgs::msg::dds_::CompressedImage_PubSubType> images(*participant, prefix + "/image/compressed",
                                                                          true);
  Subscription<geometry_msgs::msg::dds_::Twist_PubSubType> commands(*participant, prefix + "/cmd_vel", false);
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
