# SPDX-License-Identifier: Apache-2.0
"""Datasets of LeRobot, in and out: samples that lerobot wrote, made ones, and what lerobot reads of ours where it is installed."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from support import BUILD, SOURCE, ClearErrors

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import citylearn
from citylearn import _native, lerobot

SAMPLES = SOURCE.parent / "shared/data/formats/drives-2026"
FRONT = "observation.images.front"


def picture_of(number):
    """A picture that shows a number: 16 bits in columns of 8."""
    bits = np.repeat([255 * (number >> bit & 1) for bit in range(16)], 8)
    return np.repeat(np.repeat(bits[None, :, None], 32, 0), 3, 2).astype(np.uint8)


def number_of(picture, begin=0, width=8, bits=16):
    rows = picture[-12:-4].mean(axis=(0, 2))
    return sum(int(rows[begin + width * bit + 2:begin + width * (bit + 1) - 2].mean() > 127) << bit for bit in range(bits))


class Datasets(ClearErrors):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))

    def shown(self, name, **code):
        """Returns the numbers that a recording's pictures show where env_services read it."""
        recording = _native.Recording({"data": str(self.folder / "out"), "traversal": name, "reference": name, "dimension": "2"})
        return [number_of(recording.picture(frame), **code) for frame in range(recording.frames)]

    def write_film(self, path, numbers, fps, **options):
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(path), "w") as output:
            stream = output.add_stream("libx264", rate=fps, options={"preset": "ultrafast", **options})
            stream.width, stream.height, stream.pix_fmt = 128, 32, "yuv420p"
            for time, number in enumerate(numbers):
                frame = av.VideoFrame.from_ndarray(picture_of(number), format="rgb24")
                frame.pts = time
                output.mux(stream.encode(frame))
            output.mux(stream.encode(None))

    def write_set(self, episodes, fps=10, dtype="video"):
        """Writes a set's tables. `episodes`: length, film and first frame in it of each. Position k is (48 + k, 11 - k)."""
        info = {"codebase_version": "v3.0", "fps": fps, "total_episodes": len(episodes), "data_path": lerobot.DATA, "features": {
            FRONT: {"dtype": dtype, "shape": [32, 128, 3], "names": None},
            "fix": {"dtype": "float64", "shape": [2], "names": {"longitude": 1, "latitude": 0}}}}
        (self.folder / "set/meta/episodes/chunk-000").mkdir(parents=True)
        (self.folder / "set/data/chunk-000").mkdir(parents=True)
        (self.folder / "set/meta/info.json").write_text(json.dumps(info))
        pq.write_table(pa.Table.from_pylist([{
            "episode_index": i, "tasks": ["there", f"back {i}"], "length": length, "data/chunk_index": 0, "data/file_index": 0,
            f"videos/{FRONT}/chunk_index": film // 2, f"videos/{FRONT}/file_index": film % 2,
            f"videos/{FRONT}/from_timestamp": first / fps} for i, (length, film, first) in enumerate(episodes)]),
            self.folder / "set/meta/episodes/chunk-000/file-000.parquet")
        rows = [{"episode_index": i, "frame_index": k, "fix": [48.0 + k, 11.0 - k] if k != 1 else [np.nan, np.nan],
                 "timestamp": np.float32(k / fps)} for i, (length, *_) in enumerate(episodes) for k in range(length)]
        if dtype == "image":
            self.write_film(self.folder / "film.mkv", range(len(rows)), fps)
            with av.open(str(self.folder / "film.mkv")) as film:
                for row, frame in zip(rows, film.decode(video=0)):
                    row[FRONT] = {"bytes": lerobot._png(av, frame), "path": None}
        pq.write_table(pa.Table.from_pylist(rows[::-1]), self.folder / "set/data/chunk-000/file-000.parquet")

    def film(self, number):
        return self.folder / "set" / lerobot.FILM.format(video_key=FRONT, chunk_index=number // 2, file_index=number % 2)

    def extract(self, source=None, **options):
        return lerobot.extract_recordings(source or self.folder / "set", self.folder / "out", **options)

    @unittest.skipUnless(SAMPLES.exists(), "the samples that lerobot wrote are not there")
    def test_samples_of_lerobot(self):
        for name in "lerobot", "lerobot-h264":  # AV1 and H.264
            with self.subTest(name):
                done = subprocess.run([sys.executable, "-m", "citylearn.lerobot", SAMPLES / name, self.folder / "out", "--position",
                                       "east,north"], capture_output=True, text=True, check=False)
                self.assertEqual((done.stdout, done.stderr), ("episode_000000: drive north\nepisode_000001: come back\n", ""))
                code = {"begin": 4, "width": 12, "bits": 10}  # of the samples' own pictures
                self.assertEqual(self.shown("episode_000000", **code), list(range(20)))
                self.assertEqual(self.shown("episode_000001", **code), list(range(20, 35)))
                for episode, north in (0, [2.0 * k for k in range(20)]), (1, [38 - 2.0 * k for k in range(15)]):
                    self.assertEqual((self.folder / f"out/episode_{episode:06d}.poses.csv").read_text(),
                                     "x,y\n" + "".join(f"0.0,{metres}\n" for metres in north))
                info = subprocess.run([BUILD / "tools/data/citylearn_data", "info", self.folder / "out"], capture_output=True,
                                      text=True, check=True).stdout
                self.assertEqual(re.findall(r"(\d+) +(\d+) +2.00 ", info), [("20", "38"), ("15", "28")])
                subprocess.run(["rm", "-r", self.folder / "out"], check=True)

    def test_episodes_in_two_films_and_among_frames_of_others(self):
        self.write_set([(6, 0, 0), (12, 0, 6), (7, 0, 18), (5, 2, 0)])
        # Key frames at 0, 7, 14 ..., so that episodes 1 and 2 begin between them.
        self.write_film(self.film(0), range(24), 10)
        self.write_film(self.film(2), range(100, 105), 10)
        self.expect(ValueError, "has 24 frames, but frames 18..24 are episode_000002 by meta/episodes", self.extract)
        self.write_film(self.film(0), range(27), 10, g="7", bf="2", preset="medium")
        tasks = self.extract(position="latitude,longitude")
        self.assertEqual(tasks["episode_000003"], "there; back 3")
        self.assertEqual([(self.folder / f"out/{name}").is_dir() for name in tasks], [False, True, True, False])
        for name, numbers in zip(tasks, (range(6), range(6, 18), range(18, 25), range(100, 105))):
            self.assertEqual(self.shown(name), list(numbers))
        self.assertEqual((self.folder / "out/episode_000003.poses.csv").read_text(),
                         "lat,lon\n48.0,11.0\n,\n50.0,9.0\n51.0,8.0\n52.0,7.0\n")

    def test_films_with_b_frames_are_cut_where_they_can_be(self):
        self.write_set([(7, 0, 0), (14, 0, 7), (7, 0, 21)])
        self.write_film(self.film(0), range(28), 10, g="7", keyint_min="7", bf="3", preset="medium", sc_threshold="0")
        tasks = self.extract()
        self.assertEqual([each.name for each in sorted((self.folder / "out").iterdir())], [f"{name}.mp4" for name in tasks])
        for name, numbers in zip(tasks, (range(7), range(7, 21), range(21, 28))):
            self.assertEqual(self.shown(name), list(numbers))

    def test_an_episode_beyond_1024_seconds(self):
        self.write_set([(30740, 0, 0), (20, 0, 30740)], fps=30)
        self.write_film(self.film(0), range(30760), 30, g="20")
        self.extract()
        self.assertEqual(self.shown("episode_000001"), list(range(30740, 30760)))

    def test_pictures_in_tables(self):
        self.write_set([(3, 0, 0), (4, 0, 3)], dtype="image")
        self.extract()
        self.assertEqual(self.shown("episode_000000") + self.shown("episode_000001"), list(range(7)))

    def test_what_is_wrong_is_told_in_a_line(self):
        self.write_set([(6, 0, 0)])
        self.expect(ValueError, r"file-000.mp4: cannot be copied \(.*No such file.*\); download the dataset with its videos", self.extract)
        self.write_film(self.film(0), range(6), 5)
        self.expect(ValueError, "frame 1 is at 0.200 s, but meta/info.json says 10 frames a second", self.extract)
        self.expect(FileExistsError, "is there already; name a new folder", lerobot.extract_recordings, self.folder / "set", self.folder)
        table = self.folder / "set/data/chunk-000/file-000.parquet"
        pq.write_table(pq.read_table(table)[1:], table)
        self.expect(ValueError, "has 5 frames of episode 0, which has 6 by meta/episodes", self.extract)
        table.write_bytes(b"PAR1" + bytes(99))
        self.expect(ValueError, "file-000.parquet: cannot be read", self.extract)
        (self.folder / "set/meta/episodes/chunk-000/file-000.parquet").unlink()
        self.expect(ValueError, "has not each of 1 episodes once", self.extract)
        self.assertEqual([each.name for each in self.folder.iterdir()], ["set"])


class Walks(ClearErrors):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))

    def rows(self):
        return pq.read_table(self.folder / "walks/data/chunk-000/file-000.parquet")

    def test_two_places_of_features(self):
        """Every agent goes on, from place 0 to its goal 1, or from place 1 off the route until the limit of 3 steps."""
        env = citylearn.VectorEnv(synthetic_images=0, synthetic_frames=40, synthetic_dimension=16, frames=2, max_steps=3, agents=3)
        lerobot.write_dataset(self.folder / "walks", env, lambda seen, starts: np.ones(3, int), episodes=7, fps=4)
        table = self.rows()
        self.assertEqual(str(table.schema.field("observation.features").type), "fixed_size_list<element: float>[16]")
        self.assertEqual([str(table.schema.field(name).type) for name in ("action", "next.done")], ["float", "bool"])
        episodes = [[row for row in table.to_pylist() if row["episode_index"] == episode] for episode in range(7)]
        self.assertEqual([row["index"] for row in table.to_pylist()], list(range(len(table))))
        for rows in episodes:
            position, goal = rows[0]["observation.state"]
            told = [(row["action"], round(row["next.reward"], 4), row["next.done"], row["next.success"], row["timestamp"]) for row in rows]
            self.assertEqual(told, [(1, 1, True, True, 0)] if (position, goal) == (0, 1) else
                             [(0, -.3333, False, False, 0), (0, -.3333, False, False, .25), (0, -.3333, True, False, .5)])
        self.assertEqual({len(rows) for rows in episodes}, {1, 3})
        stats = json.loads((self.folder / "walks/meta/stats.json").read_text())
        self.assertEqual(stats["next.success"]["mean"], [sum(len(rows) == 1 for rows in episodes) / len(table)])
        self.assertEqual((stats["action"]["max"], stats["action"]["count"]), ([1], [len(table)]))

    def test_pictures_come_back(self):
        env = citylearn.VectorEnv(traversal="fall", synthetic_frames=24, frames="2:14", max_steps=9, agents=2, render_mode="rgb_array",
                                  dimension=4)
        lerobot.write_dataset(self.folder / "walks", env, lambda seen, starts: np.where(starts, 2, 1), episodes=3, seed=5)
        table, statistics = self.rows(), json.loads((self.folder / "walks/meta/stats.json").read_text())
        lerobot.extract_recordings(self.folder / "walks", self.folder / "out", position="observation.state:position")
        true, sums = _native.Recording({"traversal": "fall", "synthetic_frames": "24", "dimension": "4"}), []
        for episode in range(3):
            name = f"episode_{episode:06d}"
            film = _native.Recording({"data": str(self.folder / "out"), "traversal": name, "reference": name, "dimension": "2"})
            places = [int(row["observation.state"][0]) for row in table.to_pylist() if row["episode_index"] == episode]
            self.assertEqual((self.folder / f"out/{name}.poses.csv").read_text().split(), ["metres", *(f"{at}.0" for at in places)])
            for frame, place in enumerate(places):
                picture = true.picture(2 + place).astype(float)
                self.assertLess(np.abs(film.picture(frame) - picture).mean(), 6)
                sums.append(picture[..., ::-1].mean((0, 1)) / 255)
        np.testing.assert_allclose(np.ravel(statistics[FRONT]["mean"]), np.mean(sums, 0), atol=1e-9)

        if not importlib.util.find_spec("lerobot"):
            return
        os.environ["HF_HUB_OFFLINE"] = "1"
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
        read = LeRobotDataset("citylearn/walks", root=self.folder / "walks")
        self.assertEqual((len(read), read.num_episodes), (len(table), 3))
        for row, own in zip(read, table.to_pylist()):
            self.assertEqual(row["task"], "go to the goal")
            for name in "observation.features", "observation.state", "action", "next.reward", "next.done", "next.success":
                self.assertEqual(row[name].tolist(), own[name])
            picture = true.picture(2 + int(own["observation.state"][0]))[..., ::-1]
            self.assertLess(np.abs(255 * row[FRONT].numpy().transpose(1, 2, 0) - picture).mean(), 6)


if __name__ == "__main__":
    unittest.main()
