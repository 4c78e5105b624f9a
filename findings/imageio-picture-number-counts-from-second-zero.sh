#!/usr/bin/env bash
# imageio 2.38.1 with its PyAV plugin: one would expect imread(film, index=i) to be the i-th picture of imiter(film). In
# a film of constant rate it is the picture that is shown i / rate seconds after second 0. Films that begin later, as
# pieces of a recording that keep its clock and films whose sound comes first, give their first picture for all i up to
# their begin, then pictures too early by as much, and never the last ones. constant_framerate=False, which is slow,
# mends it.
# It hurts those who fetch the pictures of single places of a drive: all are of other places, without a word.
# Seen at 10 pictures a second, for i = 0 10 20 30 40: MP4 from 0 s right, MP4 and Matroska from 2 s 0 0 0 10 20.
# Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet imageio==2.38.1 av==18.1.0 numpy==2.4.6
venv/bin/python - <<'END'
import sys
import av
import imageio.v3 as imageio
import numpy as np

def number(pixels):  # picture k is grey 4 k + 8
    return round((float(pixels.mean()) - 8) / 4)

places, seen = range(0, 50, 10), []
for name, begin in ("zero.mp4", 0), ("later.mp4", 20), ("later.mkv", 20):
    with av.open(name, "w") as film:
        stream = film.add_stream("libx264", rate=10, options={"g": "20", "bf": "0", "threads": "1"})
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        for k in range(60):
            grey = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 4 * k + 8, np.uint8), format="rgb24")
            grey.pts = begin + k
            film.mux(stream.encode(grey))
        film.mux(stream.encode())
    in_order = [number(picture) for picture in imageio.imiter(name, plugin="pyav")]
    by_index = [number(imageio.imread(name, plugin="pyav", index=i)) for i in places]
    mended = [number(imageio.imread(name, plugin="pyav", index=i, constant_framerate=False)) for i in places]
    print("imageio 2.38.1,", name, len(in_order), "pictures; of", *places, "by index", *by_index, "mended", *mended)
    seen.append(by_index)
    if in_order != list(range(60)) or mended != list(places):
        sys.exit("pictures in order or without a constant rate have changed")
sys.exit(seen != [[0, 10, 20, 30, 40], [0, 0, 0, 10, 20], [0, 0, 0, 10, 20]])
END
