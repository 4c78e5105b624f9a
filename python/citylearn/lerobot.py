# SPDX-License-Identifier: Apache-2.0
"""Datasets of LeRobot (v3.0): makes recordings of their episodes, and such a dataset of what agents do. Needs pyarrow and
PyAV (pip install pyarrow av)."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

CONVERTER = "python3 -m lerobot.datasets.v30.convert_dataset_v21_to_v30 --push-to-hub=false --repo-id=NAME --root"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FILM = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
CAMERA, CHUNK = "observation.images.front", 1000  # films a folder
QUANTILES = {"q01": .01, "q10": .1, "q50": .5, "q90": .9, "q99": .99}


def extract_recordings(dataset: Any, folder: Any, *, camera: str | None = None, position: str | None = None) -> dict[str, str]:
    """Makes a folder of recordings of a LeRobot dataset's episodes. Each is a film, episode_000000.mp4, whose frames are
    copied; or pictures, if the film cannot be cut where the episode begins, or if tables hold pictures. Returns their tasks.

    folder: must not be there yet. It appears when it is complete.
    camera: needed where there are several.
    position: two names of a feature's values, "east,north" in metres or "latitude,longitude" in degrees, or one, metres
      along the route, for episode_000000.poses.csv; "FEATURE:NAMES" where several features have them.
    Raises FileNotFoundError, FileExistsError, ImportError or ValueError with one line that says what to do.
    """
    dataset = Path(dataset)
    info = _read_info(dataset)
    camera = _camera_of(info["features"], camera, dataset)
    feature, columns, header = _position_of(info["features"], position, dataset) if position else (None, [], "")
    av, parquet = _modules("av", "pyarrow.parquet")
    is_film, places = info["features"][camera]["dtype"] == "video", ("chunk_index", "file_index")
    wanted = ["episode_index", "length", "tasks", *(f"data/{each}" for each in places)]
    if is_film:
        wanted += [f"videos/{camera}/{each}" for each in (*places, "from_timestamp")]
    episodes = sorted((row for path in (dataset / "meta/episodes").glob("*/*.parquet") for row in _read(parquet, path, wanted)),
                      key=lambda row: row["episode_index"])
    if not episodes or [row["episode_index"] for row in episodes] != list(range(info["total_episodes"])):
        raise ValueError(f"{dataset}/meta/episodes: has not each of {info['total_episodes']} episodes once; download it again")
    tasks, film = {}, None
    with _new_folder(folder) as new:
        for number, row in enumerate(episodes):
            to, length = new / f"episode_{number:06d}", row["length"]
            path = dataset / info["data_path"].format(**{each: row[f"data/{each}"] for each in places})
            wanted = ["frame_index", *{each for each in (feature, None if is_film else camera) if each}]
            rows = sorted(_read(parquet, path, wanted, [("episode_index", "==", number)]), key=lambda row: row["frame_index"])
            if [each["frame_index"] for each in rows] != list(range(length)):
                raise ValueError(f"{path}: has {len(rows)} frames of episode {number}, which has {length} by meta/episodes; "
                                 "download it again")
            if is_film:
                path = dataset / info["video_path"].format(
                    video_key=camera, **{each: row[f"videos/{camera}/{each}"] for each in places})
                try:
                    film = film if film and film.path == path else _Film(av, path, info["fps"])
                    film.cut(round(row[f"videos/{camera}/from_timestamp"] * info["fps"]), length, to)
                except (av.FFmpegError, IndexError) as error:
                    raise ValueError(f"{path}: cannot be copied ({_line(error)}); download the dataset with its videos") from None
            else:
                _write_pictures(to, (each[camera]["bytes"] for each in rows), path)
            if feature:
                values = np.array([each[feature] for each in rows], info["features"][feature]["dtype"]).reshape(length, -1)
                lines = (",".join("" if np.isnan(value) else str(value) for value in each) for each in values[:, columns])
                to.with_suffix(".poses.csv").write_text("\n".join([header, *lines, ""]))
            tasks[to.name] = "; ".join(row["tasks"] or [])
    return tasks


class _Film:
    """A film of a dataset, in which several episodes follow one another. Frames are counted as they are shown."""

    def __init__(self, av: Any, path: Path, fps: float):
        self.path, self._av = path, av
        self._container = av.open(str(path))
        self._stream = self._container.streams.video[0]
        packets = [packet for packet in self._container.demux(self._stream) if packet.pts is not None]
        self._pts, self._dts = [packet.pts for packet in packets], [packet.dts for packet in packets]
        self._keys = [packet.is_keyframe for packet in packets]
        self._shown = sorted((i for i, packet in enumerate(packets) if not packet.is_discard), key=self._pts.__getitem__)
        for number, i in enumerate(self._shown):
            time = float((self._pts[i] - self._pts[self._shown[0]]) * self._stream.time_base)
            if abs(time * fps - number) >= .5:
                raise ValueError(f"{path}: frame {number} is at {time:.3f} s, but meta/info.json says {fps} frames a second")

    def cut(self, first: int, length: int, to: Path) -> None:
        """Copies frames from `first` on into a film, or decodes them into pictures if they need others before them."""
        shown = self._shown[first:first + length]
        if first < 0 or len(shown) < length:
            raise ValueError(f"{self.path}: has {len(self._shown)} frames, but frames {first}..{first + length - 1} are "
                             f"{to.name} by meta/episodes; download it again")
        begin, start = min(shown), self._pts[shown[0]]
        times = {self._pts[i] for i in shown}
        if begin != shown[0] or not self._keys[begin] or max(shown) - begin + 1 != length:
            key = max(i for i in range(begin + 1) if i == 0 or self._keys[i] and self._pts[i] <= start)
            frames = (frame for packet in self._packets(key) for frame in packet.decode() if frame.pts in times)
            decoded = _write_pictures(to, (_png(self._av, frame) for _, frame in zip(shown, frames)), self.path)
            return self._check_count(decoded, length, to)
        with self._av.open(f"{to}.mp4", "w") as output:
            stream = output.add_stream_from_template(self._stream, opaque=True)  # else it needs an encoder of the name
            for _, packet in zip(shown, (packet for packet in self._packets(begin) if packet.pts in times)):
                packet.pts, packet.dts, packet.stream = packet.pts - start, packet.dts - start, stream
                output.mux(packet)
        with self._av.open(f"{to}.mp4") as copy:
            copy.streams.video[0].thread_type = "AUTO"
            self._check_count(sum(1 for _ in copy.decode(video=0)), length, to)

    def _check_count(self, decoded: int, length: int, to: Path) -> None:
        if decoded != length:  # readers would leave these frames out, and so shift those behind them
            raise ValueError(f"{self.path}: {decoded} of {length} frames of {to.name} can be decoded; download it again")

    def _packets(self, key: int) -> Iterator[Any]:
        """Yields packets in the file's order, from the key frame or from one before it on."""
        for time in self._dts[key], self._dts[0]:
            self._container.seek(time, stream=self._stream)
            packets = self._container.demux(self._stream)
            head = next(packets)
            if self._pts.index(head.pts) <= key:
                break
        yield head
        yield from packets


def _write_pictures(folder: Path, pictures: Iterator[bytes | None], source: Path) -> int:
    """Writes pictures into a new folder. Returns their number."""
    folder.mkdir()
    number = -1
    for number, picture in enumerate(pictures):
        if not picture:
            raise ValueError(f"{source}: picture {number} of {folder.name} is not in the table; write it with its pictures")
        (folder / f"{number:06d}.{'jpg' if picture.startswith(bytes([255, 216])) else 'png'}").write_bytes(picture)
    return number + 1


def _png(av: Any, frame: Any) -> bytes:
    codec = av.CodecContext.create("png", "w")
    codec.width, codec.height, codec.pix_fmt, codec.time_base = frame.width, frame.height, "rgb24", Fraction(1)
    return b"".join(bytes(packet) for packet in [*codec.encode(frame.reformat(format="rgb24")), *codec.encode(None)])


def _read_info(dataset: Path) -> dict[str, Any]:
    path = dataset / "meta/info.json"
    if not path.exists():
        raise FileNotFoundError(f"{dataset}: is not a dataset of LeRobot, as it has no meta/info.json")
    try:
        info = json.loads(path.read_text())
        if (version := info["codebase_version"])[:3] == "v3.":
            if not info["fps"] > 0 or not all({"dtype", "shape"} <= feature.keys() for feature in info["features"].values()):
                raise ValueError("fps or features")
            return {name: info[name] for name in ("fps", "features", "total_episodes")} | {
                "data_path": info["data_path"], "video_path": info.get("video_path") or FILM}
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path}: is cut short or not LeRobot's ({_line(error)}); download it again") from None
    raise ValueError(f"{dataset}: is of LeRobot's version {version}, of which v3.0 is read; lerobot 0.4 converts v2.1: "
                     f"{CONVERTER}={dataset}")


def _camera_of(features: dict[str, Any], camera: str | None, dataset: Path) -> str:
    cameras = [name for name, feature in features.items() if feature["dtype"] in ("video", "image")]
    chosen = [name for name in cameras if camera in (None, name, name.split(".")[-1])]
    if len(chosen) != 1:
        told = f"no camera '{camera}'" if camera else "several cameras" if cameras else "no pictures"
        raise ValueError(f"{dataset}: has {told}" + (f"; camera is one of {', '.join(cameras)}" if cameras else ""))
    return chosen[0]


def _position_of(features: dict[str, Any], position: str, dataset: Path) -> tuple[str, list[int], str]:
    """Returns a feature, the indexes of its values that are places, and the header that these have in poses.csv."""
    *chosen, text = position.rsplit(":", 1)
    names, known = [name.strip() for name in text.split(",")], {}
    for name, feature in features.items():
        own = feature.get("names") or [name]
        if isinstance(own, dict):  # of lists, or of each name's index
            own = sum(own.values(), []) if isinstance(next(iter(own.values())), list) else sorted(own, key=own.get)
        if feature["dtype"].startswith(("float", "int")) and feature["shape"] == [len(own)]:
            known[name] = own
    fit = [name for name, own in known.items() if {*names} <= {*own} and chosen in ([], [name])]
    header = {1: "metres", 2: "x,y"}.get(len(names))
    if len(fit) != 1 or not header:
        there = "; ".join(f"{name}:{','.join(own)}" for name, own in known.items())
        raise ValueError(f"{dataset}: position '{position}' is not one or two names of one feature; there are {there}")
    if [name[:3].lower() for name in names] == ["lat", "lon"]:
        header = "lat,lon"
    return fit[0], [known[fit[0]].index(name) for name in names], header


def _read(parquet: Any, path: Path, columns: list[str], filters: Any = None) -> list[dict[str, Any]]:
    """Returns the rows of a table."""
    try:
        return parquet.read_table(path, columns=columns, filters=filters).to_pylist()
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read ({_line(error)}); download it again") from None


def _modules(*names: str) -> list[Any]:
    """Imports what the package does not depend on."""
    try:
        modules = {name: importlib.import_module(name) for name in names}
        if "av" in modules and int(modules["av"].__version__.split(".")[0]) < 15:
            raise ImportError(f"PyAV {modules['av'].__version__} is older than 15")
    except ImportError as error:
        raise ImportError(f"{error}; install it: pip install --upgrade pyarrow av") from None
    return list(modules.values())


@contextlib.contextmanager
def _new_folder(path: Any) -> Iterator[Path]:
    """Gives a folder that gets its name at the end, and that is removed after an error."""
    path = Path(path).absolute()
    if path.exists():
        raise FileExistsError(f"{path}: is there already; name a new folder")
    new = path.with_name(f".{path.name}.{os.getpid()}")
    new.mkdir(parents=True)
    try:
        yield new
        new.rename(path)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def write_dataset(folder: Any, env: Any, act: Callable[[dict[str, np.ndarray], np.ndarray], Any], *, episodes: int = 100,
                  seed: int = 1, fps: int = 10, task: str = "go to the goal") -> None:
    """Lets the agents of a VectorEnv act, and writes their episodes as a LeRobot dataset.

    folder: must not be there yet. It appears when it is complete.
    act: a function of observations and episode starts that returns actions, as ActingPolicy.
    episodes: each agent has equally many, or one more than others.
    fps: frames, which are steps, a second; a whole number, as LeRobot's tools want it.
    A row has what an agent saw, and what it then did:
      observation.images.front  the frame, if the environment has pictures and render_mode="rgb_array"
      observation.features      float32 (D,)
      observation.state         float32: position and goal, on streets heading too
      action                    float32: 0, 1 or 2 as it counts, so one that leads off the route is 0
      next.reward, next.done, next.success  of the action; an episode without success ended at the step limit
    Raises FileExistsError, ImportError or ValueError with one line that says what to do.
    """
    for name, value in ("episodes", episodes), ("fps", fps):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ValueError(f"{name} must be a whole number from 1 on, is {value!r}")
    env = env.unwrapped
    if env.autoreset_mode.value != "NextStep":
        raise ValueError(f"the environment has autoreset_mode {env.autoreset_mode.value}; make one with NextStep")
    arrow, parquet, av = _modules("pyarrow", "pyarrow.parquet", "av")
    walks, counts, meta, total, video = [], [], [], 0, {}
    with _new_folder(folder) as new:
        for number, walk in enumerate(_walks(env, act, episodes, seed)):
            length = len(walk["action"])
            row = {"episode_index": number, "tasks": [task], "length": length, "data/chunk_index": 0, "data/file_index": 0,
                   "dataset_from_index": total, "dataset_to_index": total + length, "meta/episodes/chunk_index": 0,
                   "meta/episodes/file_index": 0}
            if pictures := _pictures(env, walk.pop("frame")):
                # A film each, because times of several would exceed 1024 s, beyond which LeRobot's float32 misses frames.
                place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
                video = _write_film(av, new / FILM.format(video_key=CAMERA, **place), pictures, fps)
                place |= {"from_timestamp": 0.0, "to_timestamp": length / fps}
                row |= {f"videos/{CAMERA}/{name}": value for name, value in place.items()}
                counts.append(sum(np.stack([np.bincount(picture[..., channel].ravel(), minlength=256) for channel in range(3)])
                                  for picture in pictures))
            walk |= {"timestamp": (np.arange(length) / fps).astype(np.float32), "frame_index": np.arange(length),
                     "episode_index": np.full(length, number), "index": np.arange(total, total + length),
                     "task_index": np.zeros(length, int)}
            walks.append(walk)
            meta.append(row | {f"stats/{name}/{figure}": value for name, figures in _statistics(walk, counts[-1:]).items()
                               for figure, value in figures.items()})
            total += length
        columns = {name: np.concatenate([walk[name] for walk in walks]) for name in walks[0]}
        features = {name: {"dtype": str(values.dtype), "shape": [*values.shape[1:]] or [1], "names": None}
                    for name, values in columns.items()}
        features["observation.state"]["names"] = ["position", "goal", "heading"][:columns["observation.state"].shape[1]]
        info = {"codebase_version": "v3.0", "robot_type": "citylearn", "total_episodes": len(walks), "total_frames": total,
                "total_tasks": 1, "chunks_size": CHUNK, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": fps,
                "splits": {"train": f"0:{len(walks)}"}, "data_path": DATA, "video_path": FILM if video else None,
                "features": features | video}
        index = {"index_columns": ["task"], "column_indexes": [], "columns": [  # for pandas, which tasks are looked up by
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": kind, "metadata": None}
            for name, kind in (("task_index", "int64"), ("task", "object"))]}
        tables = {"meta/tasks.parquet": arrow.table({"task_index": [0], "task": [task]}, metadata={"pandas": json.dumps(index)}),
                  "meta/episodes/chunk-000/file-000.parquet": arrow.Table.from_pylist(meta),
                  "data/chunk-000/file-000.parquet": arrow.table({
                      name: arrow.FixedSizeListArray.from_arrays(values.ravel(), values.shape[1]) if values.ndim > 1
                      else values for name, values in columns.items()})}
        for name, table in tables.items():
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            parquet.write_table(table, new / name)
        for name, value in ("info", info), ("stats", _statistics(columns, counts)):
            (new / f"meta/{name}.json").write_text(json.dumps(value, indent=4))


def _walks(env: Any, act: Any, episodes: int, seed: int) -> Iterator[dict[str, np.ndarray]]:
    """Yields episodes as they end: columns with a row a step, and `frame`, which the agent saw."""
    left = np.full(env.num_envs, episodes // env.num_envs)
    left[:episodes % env.num_envs] += 1  # not the first that end, which are the short ones
    rows: list[list[dict[str, Any]]] = [[] for _ in left]
    observations, infos = env.reset(seed=seed)
    starts, waits = np.ones(env.num_envs, bool), np.zeros(env.num_envs, bool)
    while left.any():
        seen, frames = observations, env._frame
        state = np.stack([infos["position"], seen["goal"], *([infos["heading"]] if "heading" in infos else [])], axis=1)
        observations, rewards, terminated, truncated, infos = env.step(act(seen, starts))
        ended = terminated | truncated
        for agent in np.flatnonzero(~waits & (left > 0)):
            rows[agent].append({
                "frame": frames[agent], "observation.features": seen["features"][agent],
                "observation.state": state[agent].astype(np.float32),
                "action": np.float32(observations["previous_action"][agent]), "next.reward": np.float32(rewards[agent]),
                "next.done": ended[agent], "next.success": terminated[agent]})
            if ended[agent]:
                columns = {name: np.stack([row[name] for row in rows[agent]]) for name in rows[agent][0]}
                yield {name: values[:, 0] if values.shape[1:] == (1,) else values for name, values in columns.items()}
                rows[agent], left[agent] = [], left[agent] - 1
        starts, waits = waits, ended  # the next step of those that ended begins their next episode


def _pictures(env: Any, frames: np.ndarray) -> list[np.ndarray]:
    """Returns the pictures of a route's frames, uint8 (H, W, 3), red first; none where the environment has none."""
    read = env._painter and env._painter._recording.picture
    if not read or read(env._route.first_frame) is None:
        return []
    return [np.ascontiguousarray(read(env._route.first_frame + int(frame))[..., ::-1]) for frame in frames]


def _write_film(av: Any, path: Path, pictures: list[np.ndarray], fps: int) -> dict[str, Any]:
    """Writes a film. Returns its feature for meta/info.json."""
    height, width, _ = pictures[0].shape
    pixels = "yuv444p" if height % 2 or width % 2 else "yuv420p"
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", rate=fps, options={"g": "2", "bf": "0", "crf": "18"})
        stream.height, stream.width, stream.pix_fmt = height, width, pixels
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = number
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    return {CAMERA: {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"], "info": {
        "video.height": height, "video.width": width, "video.codec": "h264", "video.pix_fmt": pixels, "video.fps": fps,
        "video.is_depth_map": False, "video.channels": 3, "has_audio": False}}}


def _statistics(columns: dict[str, np.ndarray], counts: list[np.ndarray]) -> dict[str, dict[str, Any]]:
    """Returns what LeRobot normalises by. `counts`: how often each channel of pictures has each value, (3, 256)."""
    found = {}
    for name, values in columns.items():
        values = values.astype(float)
        figures = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
        figures |= {figure: np.quantile(values, share, axis=0) for figure, share in QUANTILES.items()}
        found[name] = {figure: np.atleast_1d(value).tolist() for figure, value in figures.items()}
    if counts:
        shares = sum(counts) / sum(counts).sum(1, keepdims=True)
        levels, below = np.arange(256) / 255, shares.cumsum(1)
        figures = {"mean": shares @ levels, "std": np.sqrt(shares @ levels**2 - (shares @ levels)**2)}
        figures |= {figure: levels[(below < share).sum(1)] for figure, share in {**QUANTILES, "min": 1e-12, "max": 1 - 1e-9}.items()}
        found[CAMERA] = {figure: value.reshape(3, 1, 1).tolist() for figure, value in figures.items()}
    return {name: figures | {"count": [len(columns["action"])]} for name, figures in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(prog="lerobot", description="Makes recordings of a LeRobot dataset's episodes.")
    parser.add_argument("dataset", help="folder with meta/, data/ and videos/")
    parser.add_argument("folder", help="new folder, for --data; each episode is a recording")
    parser.add_argument("--camera", metavar="NAME", help="needed where there are several")
    parser.add_argument("--position", metavar="NAMES", help="values of a feature that are places: east,north in metres; "
                        "latitude,longitude in degrees; or one, metres along the route")
    try:
        for name, task in extract_recordings(**vars(parser.parse_args())).items():
            print(f"{name}: {task}")
    except (OSError, ImportError, ValueError) as error:
        raise SystemExit(f"lerobot: {error}") from None


if __name__ == "__main__":
    sys.exit(main())
