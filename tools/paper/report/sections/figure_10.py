# SPDX-License-Identifier: Apache-2.0
"""Fig. 10: one goal, by day and by night."""

from pathlib import Path
from typing import Any

from charts import PIXELS_PER_INCH, Chart, Line, limits_around
from inputs import numbers
from matplotlib.figure import Figure
from matplotlib.image import imread
from study import Study

LABEL_HEIGHT = 18  # pixels
TITLE_HEIGHT = 24


def render(study: Study) -> None:
    introduce(study)
    traversals, agents = study.data["traversals"], {policy.data["policy"]: policy for policy in study.policies}
    walks = {(agent, name): policy.trials(name).rows[0]["walk"] for agent, policy in agents.items()
             for name in traversals if policy.trainings}
    for traversal in traversals:
        draw(study, traversal, {agent: walk for (agent, where), walk in walks.items() if where == traversal})
    study.page.table("figure-10",
                     "One task and one seed each: an illustration, not a measurement (Fig. 8 and 9 have those).",
                     ["agent", "representation", "seed", "traversal", "start", "goal", "end", "steps", "shortest",
                      "reached"],
                     [row_of(study, agents[agent].data, traversal, walk)
                      for (agent, traversal), walk in walks.items()])


def introduce(study: Study) -> None:
    data, train, hard = study.data, study.recordings.train, study.data["traversals"][-1]
    pictures = ("Each strip begins at the start and ends where the episode ends, at the goal or after "
                f"{study.policies[0].data['frames']} steps; below each picture are the place and the step."
                if data["pictures"] else "Pictures are left out, as asked for (--no-strips).")
    choice = ("." if hard == "night" else
              " and is the one that the agent on features does worst on (there is no 'night').")
    study.page.text(
        "Where agents go on one task, the same for all: of the first 20 tasks of the trials after training, the one "
        f"with the longest way. {pictures} '{train}' is learned from, '{hard}' was never seen{choice} The "
        f"recordings are {study.kind}."
        + (" The given data have no pictures, so the agents of this section were trained in a drawn city."
           if data["substitute"] else ""))


def draw(study: Study, traversal: str, walks: dict[str, Any]) -> None:
    name, page = f"figure-10-{traversal}", study.page
    strips = [strip for strip in study.data["strips"] if strip["traversal"] == traversal]
    page.remove_picture(name)
    if not walks:
        return
    lines = [Line(agent, [float(step) for step in range(len(walk["frames"]))], numbers(walk["frames"]))
             for agent, walk in walks.items()]
    walk = list(walks.values())[-1]
    start, goal = walk["frames"][0], walk["goal"]
    x_limits = limits_around([0, *(line.x[-1] for line in lines)])
    y_limits = limits_around([goal, *(y for line in lines for y in line.y)])
    lines.append(Line("goal", [0, x_limits[1]], [goal, goal], dashed=True))
    lines.append(Line("shortest path", [0, abs(goal - start)], [start, goal], dashed=True))
    chart = Chart(study.title(traversal), "step", "place", lines, x_limits, y_limits, width=560,
                  height=300)
    task = f"From place {start} to place {goal} on '{traversal}'"
    if strips:
        page.picture(name, sheet_of(study.inputs.folder, strips, walks), f"{task}.")
    page.chart(f"{name}-places", chart, f"{task}: place over steps.")


def sheet_of(folder: Path, strips: list[Any], walks: dict[str, Any]) -> Figure:
    """Returns the strips one below the other, with a line of text above each and labels below the pictures."""
    pictures = [imread(folder / strip["file"]) for strip in strips]
    width = max(picture.shape[1] for picture in pictures)
    height = sum(picture.shape[0] + TITLE_HEIGHT + LABEL_HEIGHT for picture in pictures)
    figure = Figure(figsize=(width / PIXELS_PER_INCH, height / PIXELS_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    top = 0
    for strip, picture in zip(strips, pictures):
        walk = walks[strip["agent"]]
        end = "goal reached" if walk["completed"] else "goal not reached"
        title = f"{strip['agent']} on '{strip['traversal']}': {len(walk['frames']) - 1} steps, {end}"
        axes.text(0, top + TITLE_HEIGHT - 8, title)
        top += TITLE_HEIGHT
        axes.imshow(picture, extent=(0, picture.shape[1], top + picture.shape[0], top), interpolation="none")
        top += picture.shape[0] + LABEL_HEIGHT
        column = picture.shape[1] / len(strip["frames"])
        for i, (frame, step) in enumerate(zip(strip["frames"], strip["steps"])):
            at_goal = ", goal" if frame == walk["goal"] else ""
            label = f"goal {frame}" if step is None else f"{frame} at {step}{at_goal}"
            axes.text(i * column, top - 5, label, fontsize=7)
    return figure


def row_of(study: Study, agent: Any, traversal: str, walk: Any) -> list[str]:
    if not walk["completed"]:
        study.page.remark(f"{agent['policy']} did not reach the goal on '{traversal}'.")
    frames, goal = walk["frames"], walk["goal"]
    values = [agent["policy"], agent["representation"], *agent["seeds"], traversal, frames[0], goal, frames[-1],
              len(frames) - 1, abs(goal - frames[0]), "yes" if walk["completed"] else "no"]
    return [str(value) for value in values]
