#!/bin/sh
# lerobot 0.4.4: the statistics that it writes into a dataset give pictures a standard deviation of about 0, because
# RunningQuantileStats squares them as uint8, which wraps at 256. Policies that normalise by mean and deviation then
# divide by next to nothing. The mean is right; the same numbers as float64 have the right deviation.
# Installs lerobot without what else it needs (the file uses numpy alone) and measures random pixels. Status 1: changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.2.6
"$folder/venv/bin/pip" install --quiet --no-deps lerobot==0.4.4
"$folder/venv/bin/python" - "$folder" <<'END'
import importlib.metadata
import sys
import types
import numpy as np

print("lerobot", importlib.metadata.version("lerobot"))
path = next(file for file in importlib.metadata.files("lerobot") if str(file).endswith("datasets/compute_stats.py"))
images = types.ModuleType("lerobot.datasets.utils")  # what it imports to read files, which is not used here
images.load_image_as_numpy = None
sys.modules["lerobot.datasets.utils"] = images
code = compile(path.locate().read_text(), str(path), "exec")
stats = {"__name__": "compute_stats"}
exec(code, stats)

pixels = np.random.default_rng(1).integers(0, 256, (10_000, 3), np.uint8)
seen = []
for values in (pixels, pixels.astype(np.float64)):
    running = stats["RunningQuantileStats"]()
    running.update(values)
    told = running.get_statistics()
    seen.append((float(told["mean"][0]), float(told["std"][0])))
    print(values.dtype, "-> mean %.1f, deviation %.1f" % seen[-1], "| numpy: deviation %.1f" % values[:, 0].std())
(mean, deviation), (right_mean, right) = seen
sys.exit(not (abs(mean - right_mean) < 0.1 and deviation < 1 and abs(right - pixels[:, 0].std()) < 0.1))
END
