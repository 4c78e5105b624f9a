#!/usr/bin/env bash
# pyquaternion 0.9.9, by which nuScenes' tools and many others hold the poses of cars: the help of yaw_pitch_roll says
# "intrinsic Tait-Bryan angles following the z-y'-x'' convention", so one would expect a car's heading, climb and bank.
# The angles are those of x-y'-z'', the same axes in the other order, as a formula further down in that help has it.
# They are the car's own only on flat ground or with one angle alone, as in the first tests that one makes.
# It hurts those who learn from headings and slopes: a car that climbs by 10 degrees towards +y "rolls" by -10, and in
# a banked bend the heading is off too.
# Seen for (yaw, pitch, roll) of (90, 10, 0): (90, 0, -10); of (40, 20, 10): (39.2, 21.7, -5.2). SciPy 1.17.1 gives both
# back as "ZYX". Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyquaternion==0.9.9 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import math
import sys
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation

def degrees(angles):
    return tuple(round(float(angle), 1) + 0 for angle in angles)

seen = []
for yaw, pitch, roll in ((90, 0, 0), (0, 10, 0), (90, 10, 0), (40, 20, 10)):
    turn = (Quaternion(axis=(0, 0, 1), degrees=yaw) * Quaternion(axis=(0, 1, 0), degrees=pitch)
            * Quaternion(axis=(1, 0, 0), degrees=roll))
    ahead = turn.rotate((1, 0, 0))
    told = degrees(map(math.degrees, turn.yaw_pitch_roll))
    by_scipy = degrees(Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_euler("ZYX", degrees=True))
    heading = round(math.degrees(math.atan2(ahead[1], ahead[0])), 1)
    print("set", (yaw, pitch, roll), "pyquaternion", told, "SciPy", by_scipy, "heading of the nose", heading)
    seen.append((told, by_scipy == (yaw, pitch, roll) and heading == yaw))
told = Quaternion.yaw_pitch_roll.__doc__
sys.exit("z-y'-x''" not in told or seen != [((90, 0, 0), True), ((0, 10, 0), True), ((90, 0, -10), True),
                                            ((39.2, 21.7, -5.2), True)])
END
