// SPDX-License-Identifier: Apache-2.0
// ros2_node DOMAIN SECONDS PREFIX [default]: what a node of ROS 2 is on the wire, without ROS 2: types made by Debian's
// rosidl from their definitions, and Cyclone DDS's C interface. It subscribes to what the bridge sends of one agent and
// prints a line of JSON for each message, until it has heard some of each or SECONDS are over. With `default`,
// Cyclone's own settings hold (CYCLONEDDS_URI; multicast), else those of rmw_cyclonedds for this machine alone.
//
// Names and qualities are those of ROS 2's sources: "rt/" before the topic, PACKAGE::msg::dds_::TYPE_, and
// rmw_qos_profile_default (reliable, volatile, keep last 10) or rmw_qos_profile_sensor_data (best effort, volatile,
// keep last 5) of rmw/include/rmw/qos_profiles.h.
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geometry_msgs/msg/PoseStamped.h"
#include "geometry_msgs/msg/Twist.h"
#include "sensor_msgs/msg/CompressedImage.h"
#include "sensor_msgs/msg/NavSatFix.h"
#include "std_msgs/msg/Float32.h"
#include "std_msgs/msg/UInt8.h"

enum { kWanted = 10 };  // messages of each topic

static void fail(const char* what, dds_return_t code) {
  fprintf(stderr, "ros2_node: cannot %s: %s\n", what, dds_strretcode(-code));
  exit(1);
}

static dds_entity_t require(dds_return_t result, const char* what) {
  if (result < 0) fail(what, result);
  return result;
}

// One subscription.
typedef struct Subscription {
  const char* name;  // below the prefix
  const dds_topic_descriptor_t* type;
  bool sensor_data;  // else the default qualities
  void (*print)(const void* message);
  dds_entity_t reader;
  int heard;
} Subscription;

static void print_image(const void* message) {
  const sensor_msgs_msg_dds__CompressedImage_* image = message;
  printf(",\"sec\":%d,\"nanosec\":%u,\"frame_id\":\"%s\",\"format\":\"%s\",\"data\":\"", image->header.stamp.sec,
         image->header.stamp.nanosec, image->header.frame_id, image->format);
  for (uint32_t i = 0; i < image->data._length; ++i) printf("%02x", image->data._buffer[i]);
  printf("\"");
}

static void print_pose(const void* message) {
  const geometry_msgs_msg_dds__PoseStamped_* pose = message;
  printf(",\"sec\":%d,\"nanosec\":%u,\"frame_id\":\"%s\",\"x\":%.9g,\"y\":%.9g,\"w\":%.9g", pose->header.stamp.sec,
         pose->header.stamp.nanosec, pose->header.frame_id, pose->pose.position.x, pose->pose.position.y,
         pose->pose.orientation.w);
}

static void print_fix(const void* message) {
  const sensor_msgs_msg_dds__NavSatFix_* fix = message;
  printf(",\"sec\":%d,\"nanosec\":%u,\"frame_id\":\"%s\",\"latitude\":%.17g,\"longitude\":%.17g", fix->header.stamp.sec,
         fix->header.stamp.nanosec, fix->header.frame_id, fix->latitude, fix->longitude);
}

static void print_twist(const void* message) {
  const geometry_msgs_msg_dds__Twist_* twist = message;
  printf(",\"x\":%.9g,\"z\":%.9g", twist->linear.x, twist->angular.z);
}

static void print_byte(const void* message) {
  printf(",\"data\":%u", ((const std_msgs_msg_dds__UInt8_*)message)->data);
}

static void print_float(const void* message) {
  printf(",\"data\":%.9g", (double)((const std_msgs_msg_dds__Float32_*)message)->data);
}

static dds_entity_t subscribe(dds_entity_t participant, const char* prefix, const Subscription* subscription) {
  char name[256];
  snprintf(name, sizeof name, "rt%s/%s", prefix, subscription->name);
  const dds_entity_t topic =
      require(dds_create_topic(participant, subscription->type, name, NULL, NULL), "create a topic");
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, subscription->sensor_data ? DDS_RELIABILITY_BEST_EFFORT : DDS_RELIABILITY_RELIABLE,
                       DDS_MSECS(100));
  dds_qset_durability(qos, DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, subscription->sensor_data ? 5 : 10);
  const dds_entity_t reader = require(dds_create_reader(participant, topic, qos, NULL), "create a reader");
  dds_delete_qos(qos);
  return reader;
}

// Prints what the writer offers.
static void print_writer(const Subscription* subscription) {
  dds_instance_handle_t writer = 0;
  if (dds_get_matched_publications(subscription->reader, &writer, 1) < 1) return;
  dds_builtintopic_endpoint_t* endpoint = dds_get_matched_publication_data(subscription->reader, writer);
  if (!endpoint) return;
  dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
  dds_durability_kind_t durability = DDS_DURABILITY_PERSISTENT;
  dds_duration_t blocking = 0;
  dds_qget_reliability(endpoint->qos, &reliability, &blocking);
  dds_qget_durability(endpoint->qos, &durability);
  printf("{\"writer\":\"%s\",\"type\":\"%s\",\"reliable\":%s,\"volatile\":%s}\n", endpoint->topic_name,
         endpoint->type_name, reliability == DDS_RELIABILITY_RELIABLE ? "true" : "false",
         durability == DDS_DURABILITY_VOLATILE ? "true" : "false");
  dds_builtintopic_free_endpoint(endpoint);
}

static void take(Subscription* subscription) {
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(subscription->reader, samples, &info, 1, 1) == 1) {
    if (info.valid_data) {
      if (subscription->heard++ == 0) print_writer(subscription);
      printf("{\"topic\":\"%s\",\"sensor_data\":%s", subscription->name, subscription->sensor_data ? "true" : "false");
      subscription->print(samples[0]);
      printf("}\n");
    }
    dds_return_loan(subscription->reader, samples, 1);
  }
}

int main(int argc, char** argv) {
  if (argc < 4) {
    fprintf(stderr, "usage: ros2_node DOMAIN SECONDS PREFIX [default]\n");
    return 2;
  }
  const uint32_t domain = (uint32_t)atoi(argv[1]);
  const char* local =
      "<General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/></Interfaces>"
      "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
      "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";
  if (argc < 5) require(dds_create_domain(domain, local), "enter the domain");
  const dds_entity_t participant = require(dds_create_participant(domain, NULL, NULL), "join the domain");
  Subscription all[] = {
      {"image/compressed", &sensor_msgs_msg_dds__CompressedImage__desc, true, print_image, 0, 0},
      {"image/compressed", &sensor_msgs_msg_dds__CompressedImage__desc, false, print_image, 0, 0},
      {"pose", &geometry_msgs_msg_dds__PoseStamped__desc, false, print_pose, 0, 0},
      {"goal_pose", &geometry_msgs_msg_dds__PoseStamped__desc, false, print_pose, 0, 0},
      {"fix", &sensor_msgs_msg_dds__NavSatFix__desc, true, print_fix, 0, 0},
      {"cmd_vel", &geometry_msgs_msg_dds__Twist__desc, false, print_twist, 0, 0},
      {"action", &std_msgs_msg_dds__UInt8__desc, false, print_byte, 0, 0},
      {"reward", &std_msgs_msg_dds__Float32__desc, false, print_float, 0, 0},
  };
  const size_t count = sizeof all / sizeof *all;
  const dds_entity_t waitset = require(dds_create_waitset(participant), "create a waitset");
  for (size_t i = 0; i < count; ++i) {
    all[i].reader = subscribe(participant, argv[3], &all[i]);
    const dds_entity_t condition =
        require(dds_create_readcondition(all[i].reader, DDS_ANY_STATE), "create a condition");
    require(dds_waitset_attach(waitset, condition, 0), "wait for a reader");
  }
  printf("{\"subscribed\":true}\n");
  fflush(stdout);
  const dds_time_t end = dds_time() + DDS_SECS(atoi(argv[2]));
  for (bool more = true; more && dds_time() < end;) {
    dds_waitset_wait_until(waitset, NULL, 0, end);
    more = false;
    for (size_t i = 0; i < count; ++i) {
      take(&all[i]);
      more = more || all[i].heard < kWanted;
    }
  }
  for (size_t i = 0; i < count; ++i)
    if (all[i].heard < kWanted) fprintf(stderr, "ros2_node: %d messages of %s\n", all[i].heard, all[i].name);
  dds_delete(participant);
  return 0;
}
