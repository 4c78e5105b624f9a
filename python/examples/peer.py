# SPDX-License-Identifier: Apache-2.0
"""Walks the shortest path on an env_service over DDS, without a build of CityLearn: peer.py --help"""
import argparse
import sys
import time

from citylearn_messages import FLAG_IDLE, Mode, Peer, ReaderState, SettingsId

parser = argparse.ArgumentParser()
for name, default in {"session": "default", "domain": 0, "traversal": "summer", "frames": 128, "tasks": 200}.items():
    parser.add_argument(f"--{name}", type=type(default), default=default)
options = parser.parse_args()


def choose(seen):
    """Returns an action for each agent: 0 stays, 1 goes on, 2 goes back."""
    return [1 if goal > place else 2 if goal < place else 0 for place, goal in zip(seen.position, seen.goal)]


with Peer("python", session=options.session, domain=options.domain) as peer:
    infos, info, heard = peer.reader("TraversalInfo"), None, time.monotonic()
    while not info:
        if time.monotonic() > heard + 30:
            sys.exit(f"no env_service on '{options.traversal}' within 30 s: is it in this session and domain?")
        peer.wait(1)
        info = next((one for one in infos() if one.traversal == options.traversal), None)
    env, incarnation = info.header.sender, info.header.incarnation
    observations, episodes = peer.reader("Observation", env), peer.reader("EpisodeStat")
    command, act, acknowledge = (peer.writer(name, env) for name in ("TaskSettings", "Action", "EpisodeAcknowledgement"))
    settings, spl, recorded, step, ended = SettingsId(peer.incarnation, 1), [], 0, 0, False
    heard, resend, acknowledged = time.monotonic(), 0, 0
    while not ended or len(spl) < options.tasks:
        now = time.monotonic()
        if step == 0 and now > resend + 0.1:
            command.write(environment=env, settings=settings, task_mode=Mode.EVALUATE, frames=options.frames, seed=1,
                          max_steps=options.frames, tasks=options.tasks, policy="shortest_path", by_reference=True)
            resend = now
        if now > acknowledged + 0.1:  # more often than need be, so that its end is noticed soon
            if now > heard + 10 or any(one.header.sender == env and one.header.incarnation != incarnation for one in infos()):
                sys.exit(f"{env} was started again, or has not answered for 10 s: its log says why")
            acknowledge.write(writer=env, writer_incarnation=incarnation, number=recorded, state=ReaderState.READS)
            acknowledged = now
        peer.wait(0.05)
        for seen in observations():
            if seen.settings == settings and seen.step in (step, step - 1):  # one may come again: then the answer was lost
                if seen.step == step:
                    heard, begun, step = now, begun if step else now, step + 1
                    answer = {"environment": env, "environment_incarnation": incarnation, "settings": settings, "step": seen.step,
                              "choice": choose(seen)}
                act.write(**answer)
                ended = all(flags & FLAG_IDLE for flags in seen.flags)
        for one in episodes():
            if one.header.sender == env and one.log.number == max(recorded + 1, one.log.first):
                recorded = one.log.number
                if one.settings == settings:
                    spl.append(one.completed * one.shortest / max(one.steps, one.shortest))
    command.write(environment=env, settings=SettingsId(peer.incarnation, 2), task_mode=Mode.IDLE)
    acknowledge.write(writer=env, writer_incarnation=incarnation, number=recorded, state=ReaderState.LEAVES)
    print(f"SPL {sum(spl) / len(spl):.3f} of {len(spl)} tasks, {info.agents * step / (now - begun):.0f} steps/s")
