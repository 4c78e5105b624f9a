# SPDX-License-Identifier: Apache-2.0
"""A checkpoint has the same figures wherever it is evaluated: in the demo that trained it, on services, in Python and as
an exported file, for each kind of data. What does not fit is refused in one line."""

import json
import os
import struct
import subprocess
import tempfile
import unittest
from pathlib import Path

from support import BUILD, SOURCE, with_header
from domain import own_domain

import numpy as np

import citylearn

FRAMES, RECORDED, TASKS = 40, 60, 200
WIDTH, HEIGHT = 64, 48
LOOKS = ("summer", "winter")


def picture(look, place):
    """Returns blocks of colours, rows from the top, RGB. Places differ little, and each look has noise of its own."""
    def colours(seed, most):
        return np.random.default_rng(seed).integers(0, most, (6, 8, 3))

    blocks = colours(0, 120) + colours(1 + place, 25) + colours([LOOKS.index(look), place], 60)
    return np.kron(blocks, np.ones((HEIGHT // 6, WIDTH // 8, 1))).astype(np.uint8)


def write_pictures(folder, name):
    for look in LOOKS:
        (folder / look).mkdir()
        for place in range(RECORDED):
            header = f"P6 {WIDTH} {HEIGHT} 255\n".encode()
            (folder / look / name(place)).write_bytes(header + picture(look, place).tobytes())


def write_films(folder):
    """Writes AVI files of uncompressed pictures."""
    def chunk(name, body):
        return name + struct.pack("<I", len(body)) + body

    size = WIDTH * HEIGHT * 3
    format_ = struct.pack("<IiiHHIIiiII", 40, WIDTH, HEIGHT, 1, 24, 0, size, 0, 0, 0, 0)
    stream = struct.pack("<4s4sIHHIIIIIIIIhhhh", b"vids", b"DIB ", 0, 0, 0, 0, 1, 25, 0, RECORDED, size, 0, 0, 0, 0, WIDTH,
                         HEIGHT)
    header = struct.pack("<14I", 40000, size * 25, 0, 0x10, RECORDED, 0, 1, size, WIDTH, HEIGHT, 0, 0, 0, 0)
    for look in LOOKS:
        frames = [chunk(b"00db", picture(look, place)[::-1, :, ::-1].tobytes()) for place in range(RECORDED)]
        index = b"".join(b"00db" + struct.pack("<III", 0x10, 4 + i * (size + 8), size) for i in range(RECORDED))
        streams = chunk(b"LIST", b"strl" + chunk(b"strh", stream) + chunk(b"strf", format_))
        body = chunk(b"LIST", b"hdrl" + chunk(b"avih", header) + streams) + chunk(b"LIST", b"movi" + b"".join(frames))
        (folder / f"{look}.avi").write_bytes(chunk(b"RIFF", b"AVI " + body + chunk(b"idx1", index)))


def write_features(folder):
    for look in LOOKS:
        rows = [picture(look, place)[::8, ::8, 0].ravel() / 255 for place in range(RECORDED)]
        np.savetxt(folder / f"{look}.csv", rows, fmt="%.5f", delimiter=",")


KINDS = {
    "drawn city": None,
    "imperfect drawn city": None,
    "pictures": lambda folder: write_pictures(folder, "{:03}.ppm".format),
    "films": write_films,
    "features": write_features,
    "@utm@": lambda folder: write_pictures(folder, lambda place: f"@{500000 + 3 * place}.00@4000000.00@17@T@{place:03}@.ppm"),
}


class SameFigures(unittest.TestCase):
    def figures(self, kind):
        """Trains in a demo on the first frames. Returns SPL by where it is evaluated and traversal."""
        folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        (folder / "data").mkdir()
        data = ["--synthetic-frames", str(RECORDED)]
        found = {"synthetic_frames": RECORDED}
        self.named = ""
        if KINDS[kind]:
            KINDS[kind](folder / "data")
            data = ["--data", str(folder / "data")]
            found = {"data": folder / "data"}
        if kind.startswith("imperfect"):
            data += ["--slip", "0.1", "--dropped-frames", "0.05", "--kidnappings=1"]
            found |= {"slip": 0.1, "dropped_frames": 0.05, "kidnappings": 1}
            self.named = "-slip0.1-drop0.05-kidnap1"
        else:
            data += ["--slip", "0"]
        self.environment = {**os.environ, "CITYLEARN_BUILD": str(BUILD), "CITYLEARN_RUNS": str(folder / "runs"),
                            "XDG_CACHE_HOME": str(folder / "cache"), "CITYLEARN_DOMAIN": str(own_domain())}
        os.environ["XDG_CACHE_HOME"] = self.environment["XDG_CACHE_HOME"]
        self.folder = folder
        frames = f"0:{FRAMES}"
        demo = ["demo", *data, "--frames", frames, "--evaluate", ",".join(LOOKS), "--steps", "2048", "--tasks", str(TASKS),
                "--controls", "blind", "--no-dashboard", "--no-wait", "--output", str(folder / "run")]
        self.call([SOURCE / "run", *demo], 0)
        figures = {"demo": json.loads((folder / "run/summary.json").read_text())["evaluate"]}
        checkpoint = max((folder / "run/checkpoints").glob("checkpoint-*.clk"), key=lambda path: path.stat().st_mtime)

        refused = self.on_services(checkpoint, data, "as_in_the_readme", 1)
        self.assertRegex(refused, rf"env_service 'env-\w+' on '\w+{self.named}', for {checkpoint}: has .*--frames {frames}")
        self.assertNotIn("Train longer", refused)
        self.on_services(checkpoint, [*data, "--frames", frames], "services", 0)
        figures["services"] = json.loads((folder / "services/summary.json").read_text())["evaluate"]

        model = folder / "agent.onnx"
        self.call([BUILD / "tools/export/citylearn_export", "--checkpoint", checkpoint, "--output", model], 0)
        # As services leave it that were started by hand: it knows hashes alone.
        by_hand = with_header(checkpoint, lambda header: header["data"].update(source={}), "by_hand.clk")
        for where, file, more in (("Python", checkpoint, {}), ("exported", model, {}), ("by hand", by_hand, found)):
            scores = citylearn.evaluate(citylearn.load_policy(file), traversals=LOOKS, tasks=TASKS, **more)
            figures[where] = {traversal: {"spl": score.spl} for (_, traversal), score in scores.items()}
        return {where: {look: round(scores[look + self.named]["spl"], 9) for look in LOOKS}
                for where, scores in figures.items()}

    def call(self, command, status):
        done = subprocess.run(command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                              timeout=200, check=False)
        self.assertEqual(done.returncode, status, done.stdout)
        return done.stdout

    def on_services(self, checkpoint, data, output, status):
        """Evaluates on services that are started by hand, and returns what the policy_service printed."""
        services = [subprocess.Popen([BUILD / "env_service/env_service", *data, f"--traversal={look}", "--linger=0",
                                      f"--id=env-{look}", "--log-level=warn"], env=self.environment)
                    for look in LOOKS]
        services.append(subprocess.Popen([BUILD / "encoder_service/encoder_service", f"--reference=summer{self.named}",
                                          "--log-level=warn"], env=self.environment))
        try:
            return self.call([BUILD / "policy_service/policy_service", "--mode=evaluate", f"--checkpoint={checkpoint}",
                              f"--evaluate={','.join(look + self.named for look in LOOKS)}", f"--tasks={TASKS}",
                              "--controls=blind", "--wait=60", f"--output={self.folder / output}"], status)
        finally:
            for service in services:
                service.terminate()
            for service in services:
                service.wait()

    def test_each_kind_of_data(self):
        for kind in KINDS:
            with self.subTest(kind=kind):
                figures = self.figures(kind)
                print(kind, figures, flush=True)
                for where, scores in figures.items():
                    self.assertEqual(scores, figures["demo"], where)


if __name__ == "__main__":
    unittest.main()
