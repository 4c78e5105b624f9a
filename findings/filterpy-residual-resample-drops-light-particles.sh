#!/usr/bin/env bash
# filterpy 2.0.0 has four ways to resample a particle filter, and one would expect each to draw a particle as often as
# its weight says. residual_resample() copies particle i floor(N w_i) times and draws the others by what is left, which
# is N w_i - floor(N w_i). It takes w_i - floor(N w_i): particles lighter than 1 / N get negative chances and are never
# drawn, however many of them there are. An issue of 2023 says so and is open.
# It hurts those who find a place on a route by particles: all but the heaviest guesses are gone at the first step, and
# a filter that was sent to the wrong one of two like streets does not find back.
# Seen, shares of 4,000 drawings by weights 0.1 0.2 0.3 0.4: 0 0 0.45 0.55; by the other three those of the weights.
# Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet filterpy==2.0.0 numpy==2.4.6 scipy==1.17.1
"$folder/venv/bin/python" - <<'END'
import sys
import numpy as np
from filterpy import monte_carlo

weights = np.array([0.1, 0.2, 0.3, 0.4])
seen = {}
for name in ("multinomial", "stratified", "systematic", "residual"):
    resample = getattr(monte_carlo, name + "_resample")
    drawn = np.concatenate([resample(weights) for _ in range(4000)])
    seen[name] = np.bincount(drawn, minlength=4) / len(drawn)
    print("filterpy 2.0.0", name, *seen[name].round(2))
residual = seen.pop("residual")
changed = residual[0] > 0 or residual[1] > 0 or residual[2] < 0.4
sys.exit(bool(changed or any(np.abs(shares - weights).max() > 0.03 for shares in seen.values())))
END
