// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

using namespace std::chrono_literals;  // in no narrower scope, where it would hide string literals

/// Every interval and time-out of the wire, and what must hold between them. A test (tests/unit/house/timing_test.cc)
/// refuses any others in the folders that speak on the wire.
namespace citylearn {

// Presence.
inline constexpr auto kHeartbeat = 1s;   ///< between two sendings of a state: ServiceStatus, TraversalInfo, RunInfo
inline constexpr auto kSilence = 3s;     ///< a process that is not heard for so long counts as gone
inline constexpr auto kHandover = 2s;    ///< a rival that alone was heard for so long takes over the id
inline constexpr auto kTwinGrace = 10s;  ///< since its start, in which a process ends if an older one has its id
inline constexpr auto kStartTolerance = 100ms;  ///< starts no further apart count as simultaneous
inline constexpr auto kWriterLifetime = 10s;    ///< a writer to one receiver is deleted when unused for so long
inline constexpr auto kFlushTimeout = 500ms;    ///< at the end, for readers to confirm the last messages

// Commands.
inline constexpr auto kCommandResend = 50ms, kCommandResendMax = 1000ms;  ///< first and longest interval; it doubles
inline constexpr auto kAlarmDelay = 5s;      ///< settings that are not confirmed for so long raise an alarm
inline constexpr auto kCommandGiveUp = 30s;  ///< for settings and assignments to be confirmed, before they are given up
inline constexpr auto kObeysOther = 1s;  ///< since settings went out, in which an env_service may still obey another
inline constexpr auto kReleaseGiveUp = 10s;     ///< for an env_service to confirm to an actor that it is idle
inline constexpr auto kReleaseTimeout = 500ms;  ///< likewise to a policy_service that ends
inline constexpr auto kRefusalInterval = 1s;    ///< between looks for env_services that need an alarm

// Logs.
inline constexpr auto kLogResend = 200ms,
                      kLogResendMax = 2000ms;      ///< first and longest interval between repetitions; it doubles
inline constexpr auto kLogHurried = 50ms;          ///< first such interval of a sender that ends
inline constexpr auto kAcknowledge = 1s;           ///< between two acknowledgements that say the same
inline constexpr auto kAcknowledgeGather = 100ms;  ///< at least, between two acknowledgements of a policy_service
inline constexpr auto kCommitGather = 50ms;        ///< for which an episode waits for others, to share a transaction
inline constexpr auto kCommitRetry = 1s;           ///< until a write that the disk refused is tried again
inline constexpr auto kLinger = 6s;                ///< at the end, for live recorders to acknowledge episodes
inline constexpr auto kLingerUnheard = 500ms;      ///< likewise where no live recorder is known

// Objects: until missing chunks are requested again.
inline constexpr auto kObjectRetry = 300ms, kDashboardRetry = 500ms, kParametersRetry = 50ms;
inline constexpr auto kObjectCrossing = 200ms;  ///< a chunk sent so shortly before its request is not sent again
inline constexpr auto kOldParameters = 1s;      ///< for which old parameters are kept after a request for them
inline constexpr auto kFeaturesTimeout = 10s;   ///< for an actor to get the next chunk of features

// Learner and actors.
inline constexpr auto kActorSettle = 1s;  ///< for actors to tell a new learner what they serve, before it assigns more
inline constexpr auto kAssignInterval = 100ms;      ///< between two divisions of the env_services
inline constexpr auto kEndContestTimeout = 1500ms;  ///< for the true learner to contradict a forged end of the training
inline constexpr auto kLastStatusTimeout = 500ms;   ///< for a learner to confirm an actor's last status
inline constexpr auto kDismiss = 5s;                ///< for actors to release their env_services at the end
inline constexpr auto kPythonIdle = 500ms;          ///< between looks at the wire while a Python program makes no step
inline constexpr auto kPythonRelease = 2s;          ///< for env_services to confirm to it that they are idle

// Encoders.
inline constexpr auto kEncoderSettle = 1s;      ///< for others to say what they encode
inline constexpr auto kEncoderJoin = 200ms;     ///< for others to hear of one that joins, before it begins a block
inline constexpr auto kPresentInterval = 20ms;  ///< between two statuses whose only news is frames
inline constexpr auto kMaxUnserved = 6s;  ///< without a completed TraversalInfo, before another encoder takes over
inline constexpr auto kEncoderBusyInterval = 5ms;  ///< between looks at what the background threads have done

// What people see: Scenes, requests of pictures, updates of the page.
inline constexpr auto kSceneInterval = 100ms, kPictureInterval = 100ms, kLiveUpdate = 100ms, kServicesUpdate = 250ms;
inline constexpr auto kDashboardTurn = 5ms;    ///< of a dashboard at least: a wake-up costs more than an episode
inline constexpr auto kPauseMax = 2s;          ///< longest pause between two pictures that are fetched in spare time
inline constexpr auto kRunSilence = 5s;        ///< a run without a RunInfo for so long is lost; long updates delay one
inline constexpr auto kBridgePictures = 10ms;  ///< between two requests of pictures for ROS 2; most are cached

// Replay.
inline constexpr auto kReplayPeriod = 20ms;     ///< in which half a writer's history may go out
inline constexpr auto kReplayTimeout = 2000ms;  ///< for readers to come, and to acknowledge
inline constexpr auto kReplayQuiet = 1500ms;    ///< at the end, without a message of a reader: all have everything
inline constexpr auto kReplayEnd = 30s;         ///< the longest wait at the end
inline constexpr auto kReplayPoll = 5ms;        ///< between two looks at whether readers go on
inline constexpr auto kTopicSearch = 20ms;      ///< between two looks of a recorder for new topics

// Ranks.
inline constexpr auto kRankHeartbeat = 250ms, kRankSilence = 1500ms;
inline constexpr auto kRankRepeat = 100ms;   ///< between two statuses of a rank that waits for others
inline constexpr auto kRankSettle = 700ms;   ///< for ranks that lost a coordinator to come to the next one
inline constexpr auto kRankStart = 60s;      ///< for all ranks to come at the start
inline constexpr auto kRankPaused = 1000ms;  ///< a turn of the loop this long means that the process was suspended
inline constexpr auto kGlooConnect = 300ms;  ///< gloo waits five times as long for all connections of a call
inline constexpr auto kGlooReceive = 1500ms;

inline constexpr auto kStopCheckInterval = 50ms;  ///< at most, between two looks of a loop at what is due

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
