# SPDX-License-Identifier: Apache-2.0
"""What the verdict of a demo says of recordings that do not fit the one trained on: for each a reason that is right."""

import os
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

from support import BUILD, SOURCE
from domain import own_domain

import numpy as np

FRAMES, WIDTH, HEIGHT, STRIDE = 100, 64, 48, 6
PAIRS, OTHER, CHANGED, ALIKE, NONE = ("The pairs are wrong there", "No part of it looks like the training's",
                                      "The frames differ too much", "Places look alike there", "^$")


def drive(seed=1):
    """Returns 2 FRAMES pictures (rows from the top) of a camera that passes the blocks of a street, large and small."""
    rng = np.random.default_rng(seed)
    street = sum(np.kron(rng.integers(0, 100, (HEIGHT // size, (2 * FRAMES * STRIDE + WIDTH) // size)), np.ones((size, size)))
                 for size in (4, 16))
    return np.array([street[:, STRIDE * i:STRIDE * i + WIDTH] for i in range(2 * FRAMES)])


STREET = drive()
AGAIN = 0.6 * STREET + 30 + np.random.default_rng(2).integers(0, 20, STREET.shape)  # in another light, with noise
HERE = AGAIN[:FRAMES]
# The recordings, and which reasons are right; none where the agent may find its way.
RECORDINGS = {
    "train": (STREET[:FRAMES], NONE),
    "fitting": (HERE, NONE),
    "faster_and_slower": (AGAIN[(FRAMES * np.linspace(0, 1, FRAMES) ** 1.6).astype(int)], PAIRS),
    "reversed": (HERE[::-1], PAIRS),
    "shifted": (AGAIN[20:FRAMES + 20], PAIRS),
    "every_second": (AGAIN[:2 * FRAMES:2], PAIRS),
    "other_street": (drive(3)[:FRAMES], OTHER),
    "one_picture": (HERE[[50] * FRAMES], f"{OTHER}|{ALIKE}"),
    "mirrored": (HERE[:, :, ::-1], f"{OTHER}|{CHANGED}|{NONE}"),
    "upside_down": (HERE[:, ::-1], f"{OTHER}|{CHANGED}"),
    "half_black": (HERE * (np.arange(WIDTH) < WIDTH // 2), f"{CHANGED}|{NONE}"),
    "black_frames": (HERE * (np.arange(FRAMES) % 2)[:, None, None], f"{ALIKE}|{CHANGED}|{NONE}"),
    "underexposed": (HERE // 16, f"{CHANGED}|{NONE}"),
    "passed_twice": (HERE[np.arange(FRAMES) % 50], f"{PAIRS}|{ALIKE}"),
    "cropped": (HERE[:, HEIGHT // 4:, WIDTH // 4:].repeat(2, 1).repeat(2, 2)[:, :HEIGHT, :WIDTH], f"{CHANGED}|{OTHER}|{NONE}"),
}


class IllFitting(unittest.TestCase):
    def test_reasons_are_right(self):
        folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        for name, (pictures, _) in RECORDINGS.items():
            (folder / "data" / name).mkdir(parents=True)
            for i, picture in enumerate(pictures.astype(np.uint8)):
                (folder / "data" / name / f"{i:03}.pgm").write_bytes(f"P5 {WIDTH} {HEIGHT} 255\n".encode() + picture.tobytes())
        environment = {**os.environ, "CITYLEARN_BUILD": str(BUILD), "CITYLEARN_RUNS": str(folder / "runs"),
                       "XDG_CACHE_HOME": str(folder / "cache"), "CITYLEARN_DOMAIN": str(own_domain())}
        done = subprocess.run([SOURCE / "run", "demo", "--data", folder / "data", "--train", "train", "--steps", "30000", "--tasks",
                               "300", "--no-dashboard", "--no-wait", "--output", folder / "run"], env=environment, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=280, check=False)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertNotIn("Train longer", done.stdout)
        self.assertNotIn("does not use what it sees", done.stdout)
        said = " ".join(done.stdout[done.stdout.index("\nplace_filter "):done.stdout.index("\nLearning gained")].split())
        reasons = {}
        for names, reason in re.findall(r"place_filter [^(]* in ([^(]*?) \(SPL [^)]*\)\.(.*?)(?=place_filter|$)", said):
            reasons |= dict.fromkeys(names.removesuffix(", where it trained").split(", "), reason.strip())
        self.assertEqual(reasons.keys(), RECORDINGS.keys(), said)
        for name, (_, right) in RECORDINGS.items():
            with self.subTest(recording=name):
                self.assertRegex(reasons[name], right, done.stdout)


if __name__ == "__main__":
    unittest.main()
