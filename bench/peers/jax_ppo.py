# SPDX-License-Identifier: Apache-2.0
"""PPO with an LSTM that is one jitted program of JAX, environment and all: jax_ppo.py FEATURES.npy STEPS SEED

The network, its task and PPO's settings are those of the agent `features` without noise and without losses for places.
Prints a line of JSON: agent-steps a second without compiling, and seconds until training's SPL was .9."""
import json
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import optax

AGENTS, LENGTH, SEQUENCE, EPOCHS, MINIBATCH = 32, 64, 32, 2, 8
GAMMA, LAMBDA, CLIP, ENTROPY, RATE, STEP_COST = 0.93, 0.8, 0.2, 0.02, 1.5e-3, 0.05
HIDDEN, CELLS, ACTIONS = 512, 256, 3

features = jnp.asarray(np.load(sys.argv[1]), jnp.float32)
steps, seed = int(sys.argv[2]), int(sys.argv[3])
PLACES, WIDTH = features.shape
updates = steps // (AGENTS * LENGTH)


def entering(p, x, extra):
    x = jax.nn.relu(x @ p["sensors"] + p["sensors_bias"])
    return jnp.concatenate([x, extra], -1) @ p["lstm"] + p["lstm_bias"]


def cell(p, carry, seen):
    (h, c), (enters, first) = carry, seen
    h, c = (jnp.where(first[:, None], 0, one) for one in (h, c))
    enter, forget, leave, candidate = jnp.split(enters + h @ p["recurrent"], 4, 1)
    c = jax.nn.sigmoid(forget) * c + jax.nn.sigmoid(enter) * jnp.tanh(candidate)
    h = jax.nn.sigmoid(leave) * jnp.tanh(c)
    return (h, c), h


def heads(p, h, extra):
    """Returns logits of allowed actions and values."""
    both = h @ p["heads"] + p["heads_bias"]
    return both[..., :ACTIONS] - 1e9 * extra[..., ACTIONS:], both[..., ACTIONS]


def one_step(p, state, seen):
    x, extra, first = seen
    state, h = cell(p, state, (entering(p, x, extra), first))
    return state, heads(p, h, extra)


def initial(key):
    def matrix(key, rows, columns, gain):
        return gain * jax.nn.initializers.orthogonal()(key, (rows, columns))

    keys = jax.random.split(key, 4)
    return {"sensors": matrix(keys[0], WIDTH + 1, HIDDEN, 2**0.5), "sensors_bias": jnp.zeros(HIDDEN),
            "lstm": matrix(keys[1], HIDDEN + 2 * ACTIONS, 4 * CELLS, 1),
            "recurrent": matrix(keys[3], CELLS, 4 * CELLS, 1),
            "lstm_bias": jnp.zeros(4 * CELLS).at[CELLS:2 * CELLS].set(1),
            "heads": matrix(keys[2], CELLS, ACTIONS + 1, 0.01), "heads_bias": jnp.zeros(ACTIONS + 1)}


def observe(world):
    place, goal = world["place"], world["goal"]
    forbidden = jnp.stack([jnp.zeros(AGENTS), place == PLACES - 1, place == 0], 1)
    x = jnp.concatenate([8 * features[place], 16 * (goal / PLACES - 0.5)[:, None]], 1)
    return x, jnp.concatenate([jax.nn.one_hot(world["previous"], ACTIONS), forbidden], 1), world["first"]


def act(world, action, key):
    """Does the actions; whose episode ends gets another goal. Returns the world, rewards, ends and SPL of those."""
    place = world["place"] + jnp.array([0, 1, -1])[action]
    distance, taken = jnp.abs(world["goal"] - place), world["taken"] + 1
    reached = distance == 0
    ended = reached | (taken >= PLACES)
    reward = jnp.where(reached, 1, jnp.where(distance < world["nearest"], 0, -STEP_COST))
    drawn = jax.random.randint(key, (AGENTS,), 0, PLACES - 1)
    goal = jnp.where(ended, drawn + (drawn >= place), world["goal"])
    away = jnp.abs(goal - place)
    spl = jnp.where(reached, world["fewest"] / jnp.maximum(taken, world["fewest"]), 0)
    return {"place": place, "goal": goal, "previous": jnp.where(ended, ACTIONS, action), "first": ended,
            "taken": jnp.where(ended, 0, taken), "fewest": jnp.where(ended, away, world["fewest"]),
            "nearest": jnp.where(ended, away, jnp.minimum(distance, world["nearest"]))}, reward, ended, spl


def loss(p, batch, entropy_weight):
    x, extra, first = batch["seen"]
    _, h = jax.lax.scan(lambda state, seen: cell(p, state, seen), batch["state"], (entering(p, x, extra), first))
    logits, values = heads(p, h, extra)
    every = jax.nn.log_softmax(logits)
    chosen = jnp.take_along_axis(every, batch["action"][..., None], -1)[..., 0]
    ratio = jnp.exp(chosen - batch["log_probability"])
    policy = -jnp.minimum(ratio * batch["advantage"], jnp.clip(ratio, 1 - CLIP, 1 + CLIP) * batch["advantage"]).mean()
    entropy = -jnp.where(every > -1e8, jnp.exp(every) * every, 0).sum(-1).mean()
    return policy + 0.25 * jnp.square(values - batch["target"]).mean() - entropy_weight * entropy


adam = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(
    optax.linear_schedule(RATE, 0, updates * EPOCHS * AGENTS * LENGTH // SEQUENCE // MINIBATCH)))


@jax.jit
def update(p, optimiser, world, state, key, number):
    def step(carry, key):
        world, state = carry
        keys, seen = jax.random.split(key), observe(world)
        after, (logits, value) = one_step(p, state, seen)
        action = jax.random.categorical(keys[0], logits)
        log_probability = jnp.take_along_axis(jax.nn.log_softmax(logits), action[:, None], 1)[:, 0]
        world, reward, ended, spl = act(world, action, keys[1])
        return (world, after), (seen, state, action, log_probability, value, reward, ended, spl)

    keys = jax.random.split(key, LENGTH + 2)
    (world, after), (seen, states, action, log_probability, value, reward, ended, spl) = jax.lax.scan(
        step, (world, state), keys[2:])
    last = one_step(p, after, observe(world))[1][1]

    def backward(carry, one):
        (advantage, following), (reward, ended, value) = carry, one
        advantage = reward + (1 - ended) * GAMMA * following - value + (1 - ended) * GAMMA * LAMBDA * advantage
        return (advantage, value), advantage

    _, advantage = jax.lax.scan(backward, (jnp.zeros(AGENTS), last), (reward, ended, value), reverse=True)
    scaled = (advantage - advantage.mean()) / (advantage.std() + 1e-8)

    def in_sequences(a):  # (LENGTH, AGENTS, ...) -> (SEQUENCE, sequences, ...)
        parts = a.reshape(LENGTH // SEQUENCE, SEQUENCE, AGENTS, *a.shape[2:]).swapaxes(0, 1)
        return parts.reshape(SEQUENCE, -1, *a.shape[2:])

    everything = {"seen": seen, "action": action, "log_probability": log_probability, "advantage": scaled,
                  "target": advantage + value}
    batch = {**jax.tree.map(in_sequences, everything), "state": jax.tree.map(in_sequences, states)}
    count = AGENTS * LENGTH // SEQUENCE
    order = jnp.concatenate([jax.random.permutation(one, count) for one in jax.random.split(keys[0], EPOCHS)])

    def learn(carry, which):
        p, optimiser = carry
        part = jax.tree.map(lambda a: a[:, which], batch)
        part["state"] = jax.tree.map(lambda a: a[0], part["state"])
        change, optimiser = adam.update(jax.grad(loss)(p, part, ENTROPY * (1 - number / updates)), optimiser, p)
        return (optax.apply_updates(p, change), optimiser), None

    (p, optimiser), _ = jax.lax.scan(learn, (p, optimiser), order.reshape(-1, MINIBATCH))
    return p, optimiser, world, after, spl.sum(), ended.sum()


def main():
    key = jax.random.key(seed)
    p = initial(jax.random.fold_in(key, 1))
    place = jax.random.randint(jax.random.fold_in(key, 2), (AGENTS,), 0, PLACES)
    goal = (place + 1 + jax.random.randint(jax.random.fold_in(key, 3), (AGENTS,), 0, PLACES - 1)) % PLACES
    away = jnp.abs(goal - place)
    world = {"place": place, "goal": goal, "previous": jnp.full(AGENTS, ACTIONS), "first": jnp.ones(AGENTS, bool),
             "taken": jnp.zeros(AGENTS, int), "nearest": away, "fewest": away}
    state, optimiser = (jnp.zeros((AGENTS, CELLS)),) * 2, adam.init(p)
    jax.block_until_ready(update(p, optimiser, world, state, key, 0))  # compiles
    begin, sums, reached = time.perf_counter(), [], None
    for number in range(updates):
        drawn = jax.random.fold_in(key, 10 + number)
        p, optimiser, world, state, spl, ended = update(p, optimiser, world, state, drawn, number)
        sums.append((float(spl), float(ended)))
        recent = np.sum(sums[-10:], 0)
        if reached is None and len(sums) >= 10 and recent[0] / max(recent[1], 1) >= 0.9:
            reached = time.perf_counter() - begin
    passed = time.perf_counter() - begin
    recent = np.sum(sums[-10:], 0)
    print(json.dumps({"steps/s": updates * AGENTS * LENGTH / passed, "seconds to SPL .9": reached,
                      "SPL": recent[0] / max(recent[1], 1)}))


main()
