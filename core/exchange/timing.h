// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

using namespace std::chrono_literals;  // in no narrower scope, where it would hide string literals

/// Every interval and time-out of the wire, and what must hold between them. A test of the house refuses others in the
/// folders that speak on the wire (tests/unit/house/timing_test.cc).
namespace citylearn {

// Presence.
inline constexpr auto kHeartbeat = 1s;   ///< between two values of a state: status, announcement, report
inline constexpr auto kSilence = 3s;     ///< without a word after which a process counts as gone
inline constexpr auto kHandover = 2s;    ///< in which a rival is heard and the incumbent is not, before it takes over
inline constexpr auto kTwinGrace = 10s;  ///< since its start in which a process gives way to another of its id
inline constexpr auto kStartTolerance = 100ms;  ///< between two starts that count as one
inline constexpr auto kWriterLifetime = 10s;    ///< without a message after which a writer to one receiver is deleted
inline constexpr auto kFlushTimeout = 500ms;    ///< at the end, for readers to take the last messages

// Commands.
inline constexpr auto kCommandResend = 50ms, kCommandResendMax = 1000ms;  ///< it doubles each time
inline constexpr auto kAlarmDelay = 5s;      ///< for settings to be confirmed before an alarm says they are not
inline constexpr auto kCommandGiveUp = 30s;  ///< for settings and assignments to be confirmed, or refused
inline constexpr auto kObeysOther = 1s;  ///< since settings went out, in which an env_service may still obey another
inline constexpr auto kReleaseGiveUp = 10s;     ///< for an env_service to confirm that it is idle
inline constexpr auto kReleaseTimeout = 500ms;  ///< likewise at the end of a policy_service
inline constexpr auto kRefusalInterval = 1s;    ///< between checks of whether refused env_services may be used

// Logs.
inline constexpr auto kLogResend = 200ms, kLogResendMax = 2000ms;  ///< it doubles each time
inline constexpr auto kLogHurried = 50ms;                          ///< first interval of a sender that ends
inline constexpr auto kAcknowledge = 1s;                           ///< between two acknowledgements that say the same
inline constexpr auto kAcknowledgeGather = 100ms;                  ///< between two acknowledgements of a policy_service
inline constexpr auto kCommitGather = 50ms;    ///< in which an episode waits for others of its transaction
inline constexpr auto kCommitRetry = 1s;       ///< after the disk failed
inline constexpr auto kLinger = 6s;            ///< at the end, for recorders that live to acknowledge episodes
inline constexpr auto kLingerUnheard = 500ms;  ///< likewise for recorders that were never heard

// Objects: until missing chunks are requested again.
inline constexpr auto kObjectRetry = 300ms, kDashboardRetry = 500ms, kParametersRetry = 50ms;
inline constexpr auto kObjectCrossing = 200ms;  ///< since a chunk was sent, in which a request for it crossed it
inline constexpr auto kOldParameters = 1s;      ///< since a request for old parameters, in which they are kept
inline constexpr auto kFeaturesTimeout = 10s;   ///< without a chunk, of an actor

// Learner and actors.
inline constexpr auto kActorSettle = 1s;            ///< for actors to say what they serve before any gets more
inline constexpr auto kAssignInterval = 100ms;      ///< between two divisions of the env_services
inline constexpr auto kEndContestTimeout = 1500ms;  ///< for a learner to deny an end of the training in its name
inline constexpr auto kLastStatusTimeout = 500ms;   ///< for a learner to confirm an actor's last status
inline constexpr auto kDismiss = 5s;                ///< for actors to release their env_services at the end
inline constexpr auto kPythonIdle = 500ms;          ///< between two answers of a Python program that does not step
inline constexpr auto kPythonRelease = 2s;          ///< for env_services to confirm that it lets them go

// Encoders.
inline constexpr auto kEncoderSettle = 1s;      ///< for others to say what they encode
inline constexpr auto kEncoderJoin = 200ms;     ///< for others to hear of one that joins, before it begins a block
inline constexpr auto kPresentInterval = 20ms;  ///< between statuses that tell of new frames only
inline constexpr auto kMaxUnserved = 6s;        ///< without a completed TraversalInfo, though the encoder_service lives
inline constexpr auto kEncoderBusyInterval = 5ms;  ///< between looks at what the background threads have done

// What people see.
inline constexpr auto kSceneInterval = 100ms, kPictureInterval = 100ms, kLiveUpdate = 100ms, kServicesUpdate = 250ms;
inline constexpr auto kPauseMax = 2s;          ///< between two pictures that are fetched in spare time
inline constexpr auto kRunSilence = 5s;        ///< without a RunInfo; a long update delays one
inline constexpr auto kBridgePictures = 10ms;  ///< between two pictures for ROS 2; the cache has most

// Replay.
inline constexpr auto kReplayPeriod = 20ms;     ///< in which half a writer's history may go out
inline constexpr auto kReplayTimeout = 2000ms;  ///< for readers that do not come or acknowledge
inline constexpr auto kReplayQuiet = 1500ms;    ///< without news of readers at the end: all of them have all
inline constexpr auto kReplayEnd = 30s;         ///< at most, at the end
inline constexpr auto kReplayProgress = 30s;    ///< for a learner to accept trajectories; an update may be long
inline constexpr auto kReplayPoll = 5ms;        ///< between two looks at whether readers go on
inline constexpr auto kTopicSearch = 20ms;      ///< between two looks of a recording for new topics

// Ranks.
inline constexpr auto kRankHeartbeat = 250ms, kRankSilence = 1500ms;
inline constexpr auto kRankRepeat = 100ms;   ///< between two statuses of a rank that waits for others
inline constexpr auto kRankSettle = 700ms;   ///< for ranks that lost a coordinator to come to the next one
inline constexpr auto kRankStart = 60s;      ///< for all ranks to come at the start
inline constexpr auto kRankPaused = 1000ms;  ///< a turn this long means that the process stood still
inline constexpr auto kGlooConnect = 300ms;  ///< gloo waits five times as long for all connections of a call
inline constexpr auto kGlooReceive = 1500ms;

inline constexpr auto kStopCheckInterval =
    50ms;  ///< at most, between two looks of a loop at what is due and whether to stop

static_assert(2 * kHeartbeat < kSilence && kHeartbeat < kHandover && kHandover < kSilence);
static_assert(kWriterLifetime > kSilence && kTwinGrace > kSilence && kRunSilence > kSilence);
static_assert(kMaxUnserved > kSilence + kHandover && kLinger > kSilence + kHandover);
static_assert(kCommandResend < kObeysOther && kCommandResendMax < kSilence);
static_assert(kAlarmDelay < kCommandGiveUp && kFeaturesTimeout > kSilence);
static_assert(kCommitGather < kLogResend && kLogResendMax < kSilence);
static_assert(2 * kAcknowledge < kSilence && kAcknowledge < kReplayQuiet);
static_assert(kObjectCrossing < kObjectRetry && kObjectRetry <= kDashboardRetry,
              "what is lost is sent at the first retry");
static_assert(kEncoderSettle >= kHeartbeat && kActorSettle >= kHeartbeat && kEndContestTimeout > kHeartbeat);
static_assert(kPresentInterval < kEncoderJoin && kEncoderJoin < kEncoderSettle);
static_assert(2 * kRankHeartbeat < kRankSilence && kRankRepeat < kRankHeartbeat && kRankPaused < kRankSilence);
static_assert(5 * kGlooConnect <= kRankSilence && kGlooReceive <= kRankSilence);
static_assert(kRankSilence + kRankSettle + 4 * kRankRepeat < 3s, "ranks go on within 3 s without one that is lost");
static_assert(kStopCheckInterval <= kCommandResend, "loops drive what is resent");

}  // namespace citylearn
