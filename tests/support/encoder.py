# SPDX-License-Identifier: Apache-2.0
"""An encoder for the tests: means of patches, without their mean."""

import os
import time
from pathlib import Path

import citylearn

LOG = Path(__file__ + ".log")


def encode(pictures):
    if LOG.exists():  # the test reads what came, and when it comes
        with LOG.open("a") as log:
            log.write(f"{os.getpid()} {len(pictures)}\n")
        time.sleep(0.01 * len(pictures))
    patches = pictures.reshape(len(pictures), 8, 4, 16, 4, 3).mean((2, 4)).reshape(len(pictures), -1)
    return (patches - patches.mean(1, keepdims=True)).astype("float32")


citylearn.serve_encoder(encode, size=(64, 32))
