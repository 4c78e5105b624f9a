#!/usr/bin/env bash
# A sensor_msgs/Image of ROS has `step`, the length of a row in bytes, as cameras and drivers pad rows to multiples of 4
# or 64. One would expect rosbags-image 0.10.4, "the same functionality as cv_bridge", to go from row to row by it, or
# to refuse data that is too long. It takes width x height pixels from the front of the data: the padding becomes
# pixels, each row begins further to the right than the one before, and the last rows are missing.
# It hurts those who encode or recognise the pictures of a recorded drive: they are slanted, without an error, and of
# the right size. Widths that need no padding, as 640, are right.
# Seen, of rows 10 11 12 13 14, 20 to 24 and 30 to 34 in steps of 8 bytes: 10 11 12 13 14, 0 0 0 20 21, 22 23 24 0 0;
# in steps of 5 all are right. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags-image==0.10.4 rosbags==0.11.9 \
  opencv-python-headless==5.0.0.93 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import sys
import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.ROS2_JAZZY).types
header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "camera")
picture = np.array([[10 * row + column for column in range(5)] for row in (1, 2, 3)], np.uint8)
seen = {}
for step in (5, 8):
    data = np.pad(picture, ((0, 0), (0, step - 5))).ravel()
    image = types["sensor_msgs/msg/Image"](header, 3, 5, "mono8", 0, step, data)
    seen[step] = message_to_cvimage(image).tolist()
    print("rosbags-image 0.10.4, steps of", step, "bytes:", *seen[step])
slanted = [[10, 11, 12, 13, 14], [0, 0, 0, 20, 21], [22, 23, 24, 0, 0]]
sys.exit(seen != {5: picture.tolist(), 8: slanted})
END
