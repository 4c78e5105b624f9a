# SPDX-License-Identifier: Apache-2.0
"""Lets a person walk the tasks of agents by the arrow keys: walk.py [OPTION=VALUE ...]

Options are those of citylearn.Env over DDS, as traversal=winter. Start an env_service with --agents 1 and a dashboard
beside it: its page shows what one sees, the goal's view and the map, and keeps each walk as an episode."""
import curses
import sys

import citylearn

ON_STREETS = {curses.KEY_LEFT: 0, curses.KEY_UP: 1, curses.KEY_RIGHT: 2}  # the actions left, forward, right
ON_A_ROUTE = {curses.KEY_UP: 1, curses.KEY_DOWN: 2}  # next, previous


def walk(screen, env):
    observation, info = env.reset()
    walks, steps, told = [], 0, ""
    while True:
        streets = "heading" in info
        screen.erase()
        screen.addstr(0, 0, f"To place {observation['goal']}, step {steps}."
                      + (f" You look to {info['heading']:.0f} degrees." if streets else ""))
        screen.addstr(1, 0, "Keys: left, up (go on), right; q ends." if streets else "Keys: up, down; q ends.")
        screen.addstr(2, 0, told)
        key = screen.getch()
        if key == ord("q"):
            return walks
        action = (ON_STREETS if streets else ON_A_ROUTE).get(key)
        if action is None or not observation["action_mask"][action]:
            told = "That is not possible here."
            continue
        observation, _, terminated, truncated, info = env.step(action)
        steps, told = steps + 1, ""
        if terminated or truncated:
            walks.append(info["spl"])
            told = f"Reached: SPL {walks[-1]:.3f}." if terminated else "Too many steps: SPL 0."
            observation, info = env.reset()
            steps = 0


given = dict(argument.partition("=")[::2] for argument in sys.argv[1:])
walks = curses.wrapper(walk, citylearn.Env(**{"session": "default", **given}))
print(f"{len(walks)} walks" + (f", SPL {sum(walks) / len(walks):.3f}" if walks else ""))
