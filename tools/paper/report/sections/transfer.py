# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a policy on a second route."""

from charts import Chart
from estimates import fixed
from policies import Policy, is_worse
from study import BLIND, MEAN_OF_SEEDS, MEANS, TRIALS, UNADAPTED, Policies, Study

SMOOTHING = 0.5  # these trainings have few updates
UNCHANGED = "unchanged, no training"
SCRATCH = "trained from scratch"


def render(study: Study) -> None:
    frames, recordings = study.policies[0].data["frames"], study.recordings
    quick = " Quick: half of the recommended steps on the first route, a quarter on the second."
    study.page.text(
        f"An agent is trained on places 0 to {frames - 1} of '{recordings.train}' and moved to places {frames} to "
        f"{2 * frames - 1}, another stretch of the {study.kind} recordings that it has "
        "never seen: without more training; trained there with all its parameters or with some modules frozen (their "
        "tensors do not change by a bit); and, for comparison, one that begins there with random parameters. All learn "
        "by relabelling, on the second route with at most the same number of steps. place_filter is given the places "
        "of its route, so on the second one only that knowledge is exchanged; features has to learn what each place "
        f"looks like; the rest of it is memory (LSTM) and heads.{quick if study.inputs.quick else ''}")
    controls = {label: policy for label, policy in study.points[0].items() if not policy.learns}
    agents: dict[str, Policies] = {}
    for policy in study.policies:
        if policy.learns:
            agents.setdefault(policy.data["policy"], {})[policy.data["variant"]] = policy
        else:
            policy.cells.update(agent=policy.label, variant="learns nothing")
    for name, variants in agents.items():
        draw(study, name, variants, controls)
    study.tried("transfer", f"On the second route after training there, on each traversal: {MEANS}.",
                ["agent", "variant", *TRIALS], recordings.names)
    study.trained("transfer-training",
                  f"Training on the second route, '{recordings.train}': episodes until the last 100 of them have "
                  "SPL 0.95 (95 % interval over the seeds that got there).",
                  ["agent", "variant", "seeds", "episodes to SPL 0.95", "seeds that reached it",
                   ("episodes in total", "episodes"), "steps"],
                  [policy for policy in study.policies if policy.data["variant"] != UNCHANGED])
    for variants in agents.values():
        remarks(study, variants, controls)


def draw(study: Study, name: str, variants: Policies, controls: Policies) -> None:
    train = study.recordings.train
    lines = [policy.curve(variant, "spl", SMOOTHING) for variant, policy in variants.items() if variant != UNCHANGED]
    label = variants[UNCHANGED].label
    chart = Chart(f"{label} on the second route", "episodes on the second route", "SPL", lines, y_limits=(0, 1),
                  height=300)
    study.draw_training(f"transfer-{name}",
                        f" ('{train}'): SPL of the episodes of training there, smoothed by {fixed(SMOOTHING, 1)}, "
                        f"{MEAN_OF_SEEDS}; dashed: what does not train there.", chart,
                        {name: policy.trials(train).spl.mean
                         for name, policy in {UNCHANGED: variants[UNCHANGED], **controls}.items()})


def remarks(study: Study, variants: Policies, controls: Policies) -> None:
    train, page = study.recordings.train, study.page
    blind, sequence_filter = (controls[name].trials(train).spl for name in (BLIND, UNADAPTED))
    as_is = variants[UNCHANGED].trials(train).spl
    label, spl = variants[UNCHANGED].label, f" (SPL {fixed(as_is.mean, 3)})"
    if as_is.mean <= blind.mean:
        page.remark(f"{label}: without more training it is lost on the second route{spl}: a policy that never "
                    f"looks has {fixed(blind.mean, 3)}.")
    elif is_worse(as_is, sequence_filter):
        page.remark(f"{label}: without more training it is worse on the second route{spl} than the sequence "
                    f"filter, {fixed(sequence_filter.mean, 3)}.")
    for variant, policy in variants.items():
        if variant != UNCHANGED:
            study.remark_failed(", {variant}", [policy])
            if policy.trainings:
                compare(study, policy, variants[SCRATCH])


def compare(study: Study, policy: Policy, scratch: Policy) -> None:
    """Remarks where a training does not get there, or beginning with what was learned was no use."""
    who, count = f"{policy.label}, {policy.data['variant']}", len(policy.trainings)
    train, page, there, anew = study.recordings.train, study.page, policy.reached(), scratch.reached()
    if there.n < count:
        page.remark(f"{who}: {count - there.n} of {count} seeds did not reach SPL 0.95 on the second route within "
                    "these steps.")
    if policy is scratch or not anew.n:
        return
    if not there.n or there.mean >= anew.mean:
        episodes = f"{fixed(there.mean, 0)} episodes" if there.n else "not reached"
        page.remark(f"{who}: beginning with what was learned on the first route did not shorten the way to SPL "
                    f"0.95 ({episodes}; trained from scratch: {fixed(anew.mean, 0)}).")
    end, scratch_spl = policy.trials(train).spl, scratch.trials(train).spl
    if is_worse(end, scratch_spl):
        page.remark(f"{who}: ends worse (SPL {fixed(end.mean, 3)}) than training from scratch "
                    f"({fixed(scratch_spl.mean, 3)}).")
