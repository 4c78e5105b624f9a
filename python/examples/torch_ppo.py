# SPDX-License-Identifier: Apache-2.0
"""Trains an agent by PPO (Schulman et al., 2017) in PyTorch, in one process, and evaluates it: torch_ppo.py --help

One file from top to bottom, after CleanRL's manner. The agent sees a frame's features and the goal; the network has no
memory. It also learns to say where it stands, which training knows and a deployed agent does not."""

import argparse
import time

import citylearn
import numpy as np
import torch
from torch import nn


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0],
                                     formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--frames", type=int, default=128, help="places of the route")
    parser.add_argument("--evaluate", default="summer,fall,winter", help="traversals to evaluate on; summer is learned")
    parser.add_argument("--tasks", type=int, default=1000, help="evaluation tasks on each")
    parser.add_argument("--steps", type=int, default=400_000, help="environment steps of the training")
    parser.add_argument("--stop-when", type=float, default=0.97, help="mean SPL of 500 episodes that ends it earlier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--agents", type=int, default=64)
    parser.add_argument("--segment", type=int, default=64, help="steps of each agent between updates")
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--minibatch", type=int, default=512)
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="at the start; it falls to 0")
    parser.add_argument("--gamma", type=float, default=0.93, help="discount a step")
    parser.add_argument("--gae-lambda", type=float, default=0.8)
    parser.add_argument("--step-cost", type=float, default=0.05, help="of a step that leads no nearer, to the learner")
    parser.add_argument("--clip", type=float, default=0.2)
    parser.add_argument("--entropy", type=float, default=0.01)
    parser.add_argument("--value-weight", type=float, default=0.5)
    parser.add_argument("--place-weight", type=float, default=1.0, help="of the loss of the estimated place")
    parser.add_argument("--noise", type=float, default=0.3, help="on features in training, relative to their length")
    parser.add_argument("--threads", type=int, default=1, help="of torch")
    return parser.parse_args()


class Agent(nn.Module):
    """features (B, D), goal (B,) and allowed actions (B, 3) -> logits (B, 3), value (B,), place (B,)"""

    def __init__(self, features, frames, hidden=256):
        super().__init__()
        self.frames = frames
        self.see = nn.Sequential(nn.Linear(features, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.place = nn.Linear(hidden, 1)
        self.think = nn.Sequential(nn.Linear(hidden + 2, hidden), nn.ReLU())
        self.policy, self.value = nn.Linear(hidden, 3), nn.Linear(hidden, 1)
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.orthogonal_(module.weight, 0.01 if module is self.policy else 2**0.5)
                nn.init.zeros_(module.bias)

    def forward(self, features, goal, allowed):
        seen = self.see(8 * features)  # of unit length, so that each number is small
        place, goal = self.place(seen), 16 * (goal[:, None] / self.frames - 0.5)
        thought = self.think(torch.cat([seen, goal, (goal - place).tanh()], 1))
        logits = self.policy(thought).masked_fill(~allowed, -1e9)
        return logits, self.value(thought)[:, 0], place[:, 0]


def tensors(observation, noise=0.0):
    """Returns what the agent sees as tensors."""
    features = torch.from_numpy(observation["features"])
    length = features.norm(dim=1, keepdim=True) / features.shape[1]**0.5
    features = features + noise * length * torch.randn_like(features)
    return features, torch.from_numpy(observation["goal"]), torch.from_numpy(observation["action_mask"]) != 0


def advantages_of(rewards, values, terminated, truncated, final_values, last_value, gamma, gae_lambda):
    """Returns generalised advantage estimates; all are (L, B). A truncated episode goes on with its final value."""
    advantages, following, carried = torch.zeros_like(rewards), last_value, torch.zeros_like(last_value)
    for t in reversed(range(len(rewards))):
        ended = terminated[t] | truncated[t]
        following = torch.where(ended, truncated[t] * final_values[t], following)
        carried = ~ended * carried
        advantages[t] = carried = rewards[t] + gamma * following - values[t] + gamma * gae_lambda * carried
        following = values[t]
    return advantages


def train(args):
    torch.manual_seed(args.seed)
    torch.set_num_threads(args.threads)
    world = {"synthetic_images": 0, "synthetic_frames": args.frames, "frames": args.frames}
    env = citylearn.VectorEnv(agents=args.agents, autoreset_mode="SameStep", **world)
    agent = Agent(env.single_observation_space["features"].shape[0], args.frames)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)
    observation, infos = env.reset(seed=args.seed)
    spl, steps, updates, begin = [], 0, args.steps // (args.segment * args.agents), time.time()

    for update in range(1, updates + 1):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1 - (update - 1) / updates)
        # Collect a segment of each agent.
        rows = []
        for _ in range(args.segment):
            seen = tensors(observation, args.noise)
            position = torch.from_numpy(infos["position"])
            with torch.no_grad():
                logits, value, _ = agent(*seen)
            chosen = torch.distributions.Categorical(logits=logits)
            action = chosen.sample()
            observation, reward, terminated, truncated, infos = env.step(action.numpy())
            reward = torch.from_numpy(np.where(reward < 0, -args.step_cost, reward)).float()
            final_value = torch.zeros_like(value)
            if truncated.any():  # the same place still, but the old goal
                last = [infos["final_obs"][i] for i in np.flatnonzero(truncated)]
                final = tensors({name: np.stack([each[name] for each in last]) for name in observation})
                with torch.no_grad():
                    final_value[torch.from_numpy(truncated)] = agent(*final)[1]
            if "final_info" in infos:
                spl += list(infos["final_info"]["spl"][infos["_final_info"]])
            rows.append((*seen, position, action, chosen.log_prob(action), value, reward,
                         torch.from_numpy(terminated), torch.from_numpy(truncated), final_value))
        steps += args.segment * args.agents
        features, goal, allowed, position, action, old, value, reward, terminated, truncated, final_value = (
            torch.stack(column) for column in zip(*rows))
        with torch.no_grad():
            last_value = agent(*tensors(observation))[1]
        advantage = advantages_of(reward, value, terminated, truncated, final_value, last_value, args.gamma,
                                  args.gae_lambda)
        batch = [column.flatten(0, 1) for column in (features, goal, allowed, position, action, old, advantage,
                                                     advantage + value)]

        # Learn from it.
        for _ in range(args.epochs):
            for chosen in torch.randperm(len(batch[0])).split(args.minibatch):
                features, goal, allowed, position, action, old, advantage, target = (column[chosen] for column in batch)
                logits, value, place = agent(features, goal, allowed)
                distribution = torch.distributions.Categorical(logits=logits)
                ratio = (distribution.log_prob(action) - old).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                clipped = ratio.clamp(1 - args.clip, 1 + args.clip)
                policy_loss = -torch.min(ratio * advantage, clipped * advantage).mean()
                value_loss = 0.5 * (value - target).square().mean()
                place_loss = (place - 16 * (position / args.frames - 0.5)).square().mean()
                entropy = distribution.entropy().mean()
                loss = (policy_loss + args.value_weight * value_loss + args.place_weight * place_loss
                        - args.entropy * entropy)
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        recent = np.mean(spl[-500:]) if spl else np.nan
        if update % 5 == 0 or update == updates:
            print(f"{steps:,} steps  {steps / (time.time() - begin):,.0f} steps/s  SPL {recent:.3f}  "
                  f"entropy {entropy.item():.3f}  place {place_loss.item():.3f}", flush=True)
        if len(spl) >= 500 and recent >= args.stop_when:
            break
    return agent, world


def main():
    args = arguments()
    agent, world = train(args)

    def act(observation, _):
        with torch.no_grad():
            return torch.distributions.Categorical(logits=agent(*tensors(observation))[0]).sample().numpy()

    print(citylearn.evaluate(act, traversals=args.evaluate.split(","), controls=["blind"], tasks=args.tasks,
                             name="torch_ppo", **world))


if __name__ == "__main__":
    main()
