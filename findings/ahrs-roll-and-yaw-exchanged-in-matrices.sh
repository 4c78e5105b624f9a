#!/usr/bin/env bash
# ahrs 0.4.0, attitude of robots: DCM(rpy=...) takes, by its help, an "Array with roll->pitch->yaw angles", and to_rpy()
# gives "roll-pitch-yaw angles". One would expect roll about x and yaw about z from both, and from to_rpy() what was put
# in, as Quaternion(rpy=...) and its to_angles() do. DCM takes the first angle about z and the last one about x, and
# to_rpy() gives the angles of the opposite turn: a yaw alone comes back as a roll of the other sign.
# It hurts those who turn IMU attitudes into poses: a robot that turns left lies on its side, or turns right.
# Seen, of a yaw of 0.5: the matrix turns x to x and y to z, to_rpy() gives roll -0.5 and yaw 0; the quaternion turns x
# to y and gives yaw 0.5, of which DCM(q=...) makes the right matrix, and its to_rpy() yaw -0.5. scipy 1.17.1 agrees
# with the quaternion. Use Quaternion for angles and its to_DCM() for the matrix. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ahrs==0.4.0 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import sys
import ahrs
import numpy as np
from scipy.spatial.transform import Rotation

def turn(matrix):  # axis times angle
    return tuple(float(number) for number in Rotation.from_matrix(np.array(matrix)).as_rotvec().round(3) + 0.0)

def rounded(angles):
    return tuple(float(number) for number in np.round(angles, 3) + 0.0)

yaw = [0, 0, 0.5]
matrix, quaternion = ahrs.DCM(rpy=yaw), ahrs.Quaternion(rpy=yaw)
of_quaternion = ahrs.DCM(q=np.array(quaternion))
seen = [turn(matrix), rounded(matrix.to_rpy()), turn(of_quaternion), rounded(of_quaternion.to_rpy()),
        rounded(quaternion.to_angles()), turn(Rotation.from_euler("xyz", yaw).as_matrix())]
print("turns and roll, pitch, yaw by DCM", *seen[:2], "by DCM of the quaternion", *seen[2:4],
      "angles by Quaternion", seen[4], "turn by scipy", seen[5])
sys.exit(seen != [(0.5, 0, 0), (-0.5, 0, 0), (0, 0, 0.5), (0, 0, -0.5), (0, 0, 0.5), (0, 0, 0.5)])
END
