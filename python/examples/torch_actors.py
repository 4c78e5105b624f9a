# SPDX-License-Identifier: Apache-2.0
"""Trains actors of policy_service, which are C++, by PPO in PyTorch: torch_actors.py [OPTION=VALUE ...]

Options are those of citylearn.Trajectories: agent=baseline (or features), frames=64, steps=200000, output=runs/torch.
Start env_services and actors (policy_service --role actor) beside it."""

import sys

import citylearn
import torch
import torch.nn.functional as F

CLIP, VALUE_WEIGHT, ENTROPY, GRADIENT_NORM = 0.2, 0.5, 0.02, 0.5
# What policy_service recommends for the networks: see policy_service --list.
RECOMMENDED = {
    "baseline": dict(steps=220_000, rate=1e-3, gamma=0.9, decay=0.9, epochs=3, minibatch=4, place=0),
    "features": dict(steps=360_000, rate=1.5e-3, gamma=0.93, decay=0.8, epochs=2, minibatch=8, place=3),
}


def forward(source, parameters, batch):
    """The network of policy_service/network/lstm.h: returns logits (L, B, 3), values (L, B) and estimates of place and
    way to the goal (L, B, 2)."""
    goal = batch["goal"] / source.frames - 0.5
    if source.agent == "baseline":
        sensed = source.values["scale"] * torch.stack([batch["position"] / source.frames - 0.5, goal], -1)
    else:
        sensed = torch.cat([source.values["scale"] * batch["features"], source.values["goal-scale"] * goal[..., None]],
                           -1)
    embedded = F.linear(sensed, parameters["sensors.weight"], parameters["sensors.bias"][:, 0]).relu()
    previous = F.one_hot(batch["previous_action"].long(), 4)[..., :3]
    entering = F.linear(torch.cat([embedded, previous, 1 - batch["action_mask"]], -1), parameters["lstm.input"],
                        parameters["lstm.bias"][:, 0])
    h, c = batch["state"].chunk(2, 1)
    outputs = []
    for step, goes_on in zip(entering, 1 - batch["first"].float()[..., None]):
        gates = step + F.linear(h * goes_on, parameters["lstm.recurrent"])
        enter, forget, leave, candidate = gates.chunk(4, 1)
        c = forget.sigmoid() * c * goes_on + enter.sigmoid() * candidate.tanh()
        h = leave.sigmoid() * c.tanh()
        outputs.append(h)
    h = torch.stack(outputs)
    heads = F.linear(h, parameters["heads.weight"], parameters["heads.bias"][:, 0])
    logits = heads[..., :3].masked_fill(batch["action_mask"] == 0, -1e9)
    return logits, heads[..., 3], F.linear(h, parameters["auxiliary.weight"], parameters["auxiliary.bias"][:, 0])


def loss_of(source, parameters, batch, entropy_weight, place_weight):
    logits, values, estimates = forward(source, parameters, batch)
    distribution = torch.distributions.Categorical(logits=logits)
    ratio = (distribution.log_prob(batch["action"].long()) - batch["log_probability"]).exp()
    policy = -torch.min(ratio * batch["advantage"], ratio.clamp(1 - CLIP, 1 + CLIP) * batch["advantage"]).mean()
    value = 0.5 * (values - batch["target"]).square().mean()
    # Training knows where agents are; to say so is a second task, which deployed agents leave out.
    place = 4 * (batch["position"] / source.frames - 0.5)
    way = 2 * ((batch["goal"] - batch["position"]) / 8).tanh()
    located, oriented = (estimates - torch.stack([place, way], -1)).square().mean((0, 1))
    entropy = distribution.entropy().mean()
    figures = {"policy_loss": policy.item(), "value_loss": value.item(), "entropy": entropy.item()}
    return policy + VALUE_WEIGHT * value + place_weight * located + oriented - entropy_weight * entropy, figures


def print_progress(source):
    progress = source.progress
    print(f"{progress['steps']:,} steps  SPL {progress['spl']:.3f}  {source.actors} actors", flush=True)


def main():
    given = dict(argument.partition("=")[::2] for argument in sys.argv[1:])
    numbers = {name: int(text) for name, text in given.items() if text.isdigit()}
    options = {"agent": "baseline", **given, **numbers}
    if options["agent"] not in RECOMMENDED:
        sys.exit(f"torch_actors.py: agent={options['agent']} must be one of {', '.join(RECOMMENDED)}")
    chosen = RECOMMENDED[options["agent"]]
    steps = options.setdefault("steps", chosen["steps"])
    torch.manual_seed(options.get("seed", 1))
    torch.set_num_threads(1)
    with citylearn.Trajectories(**options) as source:
        parameters = {name: torch.tensor(values, requires_grad=True) for name, values in source.parameters.items()}
        optimizer = torch.optim.Adam(parameters.values(), eps=1e-5)
        for update, batch in enumerate(source):
            if update % 10 == 0:
                print_progress(source)
            advantage, target = batch.advantages(chosen["gamma"], chosen["decay"])
            whole = {name: torch.from_numpy(getattr(batch, name)) for name in (
                "features", "goal", "position", "previous_action", "action_mask", "first", "action", "log_probability")}
            whole["advantage"] = torch.from_numpy((advantage - advantage.mean()) / (advantage.std() + 1e-8))
            whole["target"] = torch.from_numpy(target)
            state = torch.from_numpy(batch.state)
            left = max(0.0, 1 - source.progress["steps"] / steps)
            optimizer.param_groups[0]["lr"] = chosen["rate"] * max(left, 0.01)
            for _ in range(chosen["epochs"]):
                for agents in torch.randperm(len(state)).split(chosen["minibatch"]):
                    part = {name: values[:, agents] for name, values in whole.items()}
                    loss, figures = loss_of(source, parameters, {**part, "state": state[agents]}, ENTROPY * left,
                                            chosen["place"])
                    optimizer.zero_grad()
                    loss.backward()
                    torch.nn.utils.clip_grad_norm_(parameters.values(), GRADIENT_NORM)
                    optimizer.step()
            source.publish(parameters, **figures, learning_rate=optimizer.param_groups[0]["lr"])
        print_progress(source)


if __name__ == "__main__":
    main()
