#!/usr/bin/env bash
# KITTI's drives have scans missing: 2011_09_26_drive_0009_sync lacks the laser scans 177 to 180. One would expect
# pykitti 0.3.1 to say so, as scan i is the file named i. It lists the files that are there and takes the i-th: behind
# the gap get_velo(i) is the scan of a later picture, while get_cam0(i) and oxts[i] are right, and only the last indices
# raise IndexError. `frames=[...]`, with which one would leave the gap out, picks from that list by place too. It hurts
# those who learn or measure depth and places from pictures and scans that they take to be of one moment.
# Seen of five frames without scan 2: scans 0 1 3 4 for pictures 0 to 3, and with frames=[1, 3] scans 1 4. Needs
# python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet pykitti==0.3.1 opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'END'
import sys
from pathlib import Path
import numpy as np
import pykitti
from PIL import Image

day = Path("kitti/2011_09_26")
drive = day / "2011_09_26_drive_0009_sync"
for name in ("image_00/data", "velodyne_points/data", "oxts/data"):
    (drive / name).mkdir(parents=True)
unit = "1 0 0 0 1 0 0 0 1"
for name in ("velo_to_cam", "imu_to_velo"):
    (day / f"calib_{name}.txt").write_text(f"R: {unit}\nT: 0 0 0\n")
cameras = (f"P_rect_0{k}: 1 0 0 0 0 1 0 0 0 0 1 0\nR_rect_0{k}: {unit}\n" for k in range(4))
(day / "calib_cam_to_cam.txt").write_text("".join(cameras))
times = (f"2011-09-26 13:00:0{i}.000000000\n" for i in range(5))
(drive / "oxts/timestamps.txt").write_text("".join(times))
for i in range(5):  # picture i and scan i are full of i
    Image.fromarray(np.full((4, 4), i, np.uint8)).save(drive / f"image_00/data/{i:010}.png")
    (drive / f"oxts/data/{i:010}.txt").write_text("49 8.4 110" + " 0" * 22 + " 4 11 4 4 0")
    if i != 2:
        np.full((1, 4), i, np.float32).tofile(drive / f"velodyne_points/data/{i:010}.bin")
seen = []
for frames in (None, [1, 3]):
    data = pykitti.raw("kitti", "2011_09_26", "0009", frames=frames)
    count = 2 if frames else 4
    pairs = [(int(np.array(data.get_cam0(i))[0, 0]), int(data.get_velo(i)[0, 0])) for i in range(count)]
    print("pykitti 0.3.1, frames", frames, "pictures and scans:", pairs)
    seen.append(pairs)
sys.exit(seen != [[(0, 0), (1, 1), (2, 3), (3, 4)], [(1, 1), (3, 4)]])
END
