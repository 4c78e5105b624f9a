# SPDX-License-Identifier: Apache-2.0
"""What is wrong with datasets of LeRobot is told before their readers are asked for; tests/clients has the datasets."""

import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from support import SOURCE, ClearErrors

import citylearn
from citylearn import lerobot

FEATURES = {"observation.images.front": {"dtype": "video", "shape": [96, 128, 3], "names": None},
            "observation.images.wrist": {"dtype": "image", "shape": [96, 128, 3], "names": None},
            "observation.state": {"dtype": "float32", "shape": [2], "names": {"axes": ["east", "north"]}},
            "goal": {"dtype": "float32", "shape": [2], "names": ["east", "north"]}}
INFO = {"codebase_version": "v3.0", "fps": 10, "total_episodes": 1, "features": FEATURES, "data_path": lerobot.DATA}


class Datasets(ClearErrors):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        (self.folder / "set/meta").mkdir(parents=True)

    def extract(self, pattern, kind=ValueError, info=INFO, **options):
        (self.folder / "set/meta/info.json").write_text(info if isinstance(info, str) else json.dumps(info))
        self.expect(kind, pattern, lerobot.extract_recordings, self.folder / "set", self.folder / "out", **options)
        self.assertEqual([each.name for each in self.folder.iterdir()], ["set"])

    def test_a_folder_that_is_not_of_this_version(self):
        self.expect(FileNotFoundError, "is not a dataset of LeRobot, as it has no meta/info.json",
                    lerobot.extract_recordings, self.folder / "set", self.folder / "out")
        self.extract(r"is of LeRobot's version v2.1, of which v3.0 is read; .*convert_dataset_v21_to_v30 .*--root=/.*/set",
                     info={**INFO, "codebase_version": "v2.1"})
        self.extract("info.json: is cut short or not LeRobot's", info=json.dumps(INFO)[:99])
        self.extract("info.json: is cut short or not LeRobot's .'fps'", info={"codebase_version": "v3.0", "features": {}})

    def test_a_choice_that_is_not_there(self):
        self.extract("has several cameras; camera is one of observation.images.front, observation.images.wrist")
        self.extract("has no camera 'left'; camera is one of", camera="left")
        self.extract("has no pictures$", info={**INFO, "features": {"goal": FEATURES["goal"]}})
        for position in "up", "east,north", "east,north,up", "state:east,north", "observation.state:east,up":
            self.extract("is not one or two names of one feature; there are observation.state:east,north; goal:east,north",
                         camera="front", position=position)

    def test_missing_packages_and_wrong_uses(self):
        with mock.patch.dict(sys.modules, {"av": None}):
            self.extract("av.*; install it: pip install --upgrade pyarrow av", ImportError, camera="front")
        env = citylearn.VectorEnv(synthetic_images=0, frames=8, agents=1, autoreset_mode="SameStep")
        for pattern, options in (("has autoreset_mode SameStep; make one with NextStep", {}), ("fps must be a whole", {"fps": 29.97}),
                                 ("episodes must be a whole", {"episodes": 0})):
            self.expect(ValueError, pattern, lerobot.write_dataset, self.folder / "out", env, lambda *_: [0], **options)

    def test_the_command_needs_no_build(self):
        done = subprocess.run([sys.executable, SOURCE / "python/citylearn/lerobot.py", self.folder, self.folder / "out"],
                              capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stderr), (1, f"lerobot: {self.folder}: is not a dataset of LeRobot, as it has no "
                                                             "meta/info.json\n"))


if __name__ == "__main__":
    unittest.main()
