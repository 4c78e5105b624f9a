// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/machine/scheduler.h"

#include <algorithm>
#include <exception>

namespace citylearn::simulation {
namespace {

constexpr Time kClockRead{100};        // what a look at the clock takes
constexpr Time kSwitch{1000};          // what a change to another task takes
thread_local Task* running = nullptr;  // the calling thread's task

}  // namespace

Scheduler::Scheduler(std::uint64_t seed) : random_({seed, 0x5C4ED}) {}

void Scheduler::end() {
  events_.clear();
  for (const auto& task : tasks_)
    if (!task->ended()) kill(*task);
  run(Time::max());
  join_ended();
}

Time Scheduler::read_clock() { return now_ += kClockRead; }

void Scheduler::at(Time time, std::function<void()> event) {
  events_.emplace(std::pair(std::max(time, now_), ++order_), std::move(event));
}

Task& Scheduler::start(std::function<void()> body) {
  join_ended();
  Task& task = *tasks_.emplace_back(std::make_unique<Task>(++order_));
  task.thread_ = std::thread([this, &task, body = std::move(body)] {
    task.turn_.acquire();
    running = &task;
    try {
      if (!task.dead_) body();
    } catch (const Killed&) {
    }
    running = nullptr;
    end_of_thread(task);
  });
  set_waiting(task, now_);
  return task;
}

void Scheduler::end_of_thread(Task& task) {
  task.state_ = Task::State::kEnded;
  hand_over(choose());
}

/// The threads of ended tasks have nothing left to do but to end. One of them may be calling this for an event.
void Scheduler::join_ended() {
  for (const auto& task : tasks_)
    if (task->ended() && task->thread_.joinable() && task->thread_.get_id() != std::this_thread::get_id())
      task->thread_.join();
}

void Scheduler::set_waiting(Task& task, Time deadline) {
  task.state_ = Task::State::kWaiting;
  task.deadline_ = deadline;
  waiting_.emplace(deadline, task.number_, &task);
}

void Scheduler::make_ready(Task& task) {
  if (task.state_ != Task::State::kWaiting) return;
  waiting_.erase({task.deadline_, task.number_, &task});
  if (task.stalled_until_ > now_ && !task.dead_) {
    set_waiting(task, task.stalled_until_);
    return;
  }
  task.state_ = Task::State::kReady;
  ready_.push_back(&task);
}

void Scheduler::wait_until(Time time) {
  Task& task = *running;
  const auto leave = [&task] {
    if (task.dead_ && std::uncaught_exceptions() == 0) throw Killed();
    return task.dead_;
  };
  if (leave()) return;
  set_waiting(task, time);
  if (Task* next = choose(); next != &task) {
    hand_over(next);
    task.turn_.acquire();
  }
  leave();
}

void Scheduler::wake(Task& task) { make_ready(task); }

void Scheduler::kill(Task& task) {
  task.dead_ = true;
  make_ready(task);
}

void Scheduler::stall(Task& task, Time until) {
  task.stalled_until_ = until;
  if (task.state_ != Task::State::kReady) return;
  std::erase(ready_, &task);
  set_waiting(task, until);
}

/// Returns the task that runs next; null when none can before the end of run().
Task* Scheduler::choose() {
  while (now_ <= until_) {
    while (!events_.empty() && events_.begin()->first.first <= now_) {
      const auto event = events_.extract(events_.begin());
      event.mapped()();
    }
    while (!waiting_.empty() && std::get<Time>(*waiting_.begin()) <= now_)
      make_ready(*std::get<Task*>(*waiting_.begin()));
    if (!ready_.empty()) {
      std::swap(ready_[random_.below(ready_.size())], ready_.back());
      Task& task = *ready_.back();
      ready_.pop_back();
      task.state_ = Task::State::kRunning;
      now_ += kSwitch;
      ++switches_;
      note(static_cast<std::uint64_t>(now_.count()));
      note(task.number_);
      return &task;
    }
    Time next = Time::max();
    if (!events_.empty()) next = events_.begin()->first.first;
    if (!waiting_.empty()) next = std::min(next, std::get<Time>(*waiting_.begin()));
    if (next == Time::max()) return nullptr;
    now_ = std::max(now_, next);
  }
  return nullptr;
}

void Scheduler::hand_over(Task* next) {
  if (next)
    next->turn_.release();
  else
    paused_.release();
}

bool Scheduler::run(Time until) {
  until_ = until;
  hand_over(choose());
  paused_.acquire();
  return std::all_of(tasks_.begin(), tasks_.end(), [](const auto& task) { return task->ended(); });
}

void Scheduler::note(std::uint64_t number) { note(&number, sizeof number); }

/// FNV-1a (Fowler, Noll and Vo), eight bytes at a time.
void Scheduler::note(const void* bytes, std::size_t count) {
  const char* at = static_cast<const char*>(bytes);
  while (count > 0) {
    std::uint64_t word = 0;
    const std::size_t part = std::min(count, sizeof word);
    std::copy_n(at, part, reinterpret_cast<char*>(&word));
    trace_ = (trace_ ^ word) * 0x100000001B3ull;
    trace_ ^= trace_ >> 32;
    at += part;
    count -= part;
  }
}

}  // namespace citylearn::simulation
