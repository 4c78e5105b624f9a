#!/usr/bin/env bash
# decord 0.6.0: in a film that `ffmpeg -ss 3 -c copy` cut off inside a group of pictures, which picture reader[i] is
# depends on what was read before. The film shows 30 pictures, 30 to 59 of the whole one; 10 more are stored for
# decoding and hidden by the edit list. decord counts all 40. Read in order, 0 to 29 are right and 30 to 39 repeat the
# last one. Read first of all, from the key frame at 20 on picture i is 20 + i: reader[20] is 40 instead of 50.
# PyAV 18.1.0 decodes 30. Seen: in order 30 49 50 59 59 59, alone 30 49 40 49 50 59 (for i = 0 19 20 29 30 39).
# Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet decord==0.6.0 av==18.1.0 imageio-ffmpeg==0.6.0 numpy==2.4.6
venv/bin/python - <<'END'
import subprocess
import sys
import av
import decord
import imageio_ffmpeg
import numpy as np

def number(pixels):  # picture k is grey 4 k + 8
    return round((float(pixels.mean()) - 8) / 4)

with av.open("whole.mp4", "w") as film:
    stream = film.add_stream("libx264", rate=10, options={"g": "20", "sc_threshold": "0", "threads": "1"})
    stream.width = stream.height = 64
    stream.pix_fmt = "yuv420p"
    for k in range(60):
        grey = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 4 * k + 8, np.uint8), format="rgb24")
        film.mux(stream.encode(grey))
    film.mux(stream.encode())
cut = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-ss", "3", "-i", "whole.mp4", "-c", "copy", "cut.mp4"]
subprocess.run(cut, check=True)
with av.open("cut.mp4") as film:
    shown = [number(frame.to_ndarray(format="rgb24")) for frame in film.decode(video=0)]
reader, places = decord.VideoReader("cut.mp4"), (0, 19, 20, 29, 30, 39)
count = len(reader)
ordered = [number(reader[i].asnumpy()) for i in range(count)]
alone = [number(decord.VideoReader("cut.mp4")[i].asnumpy()) for i in range(count)]
print(f"PyAV {len(shown)} pictures, decord 0.6.0 {count}; of", *places, "in order", *[ordered[i] for i in places],
      "alone", *[alone[i] for i in places])
right = list(range(30, 60))
sys.exit((shown, ordered, alone) != (right, right + [59] * 10, right[:20] + right[10:]))
END
