# SPDX-License-Identifier: Apache-2.0
"""How fast does citylearn learn beside PPO in JAX? peers.py BUILD PYTHON [ROUNDS]; README.md says more."""

import csv
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

BUILD, PYTHON, ROUNDS, STEPS = Path(sys.argv[1]).resolve(), sys.argv[2], int((sys.argv[3:] or [5])[0]), 163840
sys.path[:0] = [str(BUILD / "python"), str(Path(__file__).resolve().parents[2] / "tests/support")]

import citylearn
from domain import own_domain

PLACE = ["--middleware=cyclonedds", f"--domain={own_domain()}", "--interface=lo", "--log-level=error"]
WITHOUT = [f"--{name}=0" for name in ("trainer-noise-episode", "trainer-noise-frame", "trainer-noise-place",
                                      "ppo-localisation", "ppo-orientation")]


def drawn_features():
    """Returns what is seen at each of 128 places, (N, D), from a walk."""
    env = citylearn.VectorEnv(agents=256, services=4, synthetic_images=0, synthetic_frames=128)
    observation, infos = env.reset(seed=1)
    features = np.full((128, observation["features"].shape[1]), np.nan, np.float32)
    while np.isnan(features).any():
        features[infos["position"]] = observation["features"]
        observation, *_, infos = env.step(env.action_space.sample())
    return features


def ours(math, seed, folder):
    """Returns steps a second, and seconds until training's SPL was .9."""
    subprocess.run([BUILD / "policy_service/policy_service", "--agent=features", "--train=summer", "--evaluate=summer",
                    "--tasks=1", f"--math={math}", f"--seed={seed}", f"--steps={STEPS}", f"--output={folder}/run",
                    "--overwrite", *WITHOUT, *PLACE], check=True, capture_output=True)
    with open(f"{folder}/run/metrics.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return (STEPS / float(rows[-1]["wall"]),
            next((float(row["wall"]) for row in rows if float(row["spl"] or 0) >= 0.9), None))


def jax(seed, folder):
    """Returns what ours() does."""
    said = json.loads(subprocess.run([PYTHON, Path(__file__).with_name("jax_ppo.py"), f"{folder}/features.npy",
                                      str(STEPS), str(seed)], check=True, capture_output=True).stdout)
    return said["steps/s"], said["seconds to SPL .9"]


def main():
    figures = {"onednn": [], "onednn_bfloat16": [], "JAX": []}
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/features.npy", drawn_features())
        service = subprocess.Popen([BUILD / "env_service/env_service", "--synthetic-images=0", "--synthetic-frames=128",
                                    "--agents=32", *PLACE])
        for seed in range(1, ROUNDS + 1):
            for name, values in figures.items():
                values.append(jax(seed, folder) if name == "JAX" else ours(name, seed, folder))
        service.terminate()
        service.wait()
    for name, values in figures.items():
        ratio = statistics.median(rate / peer for (rate, _), (peer, _) in zip(values, figures["JAX"]))
        rate = statistics.median(rate for rate, _ in values)
        print(f"{name:<16} {rate:>9,.0f} steps/s, {ratio:.2f} x JAX; s to SPL .9: "
              + " ".join("-" if reached is None else f"{reached:.1f}" for _, reached in values))


if __name__ == "__main__":
    main()
