# SPDX-License-Identifier: Apache-2.0
"""Python projects that tests and benchmarks use where they are at hand."""

import os
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]


def missing(folders=(), modules=()):
    """Makes folders of other projects importable, from $CITYLEARN_PEERS_SOURCE or shared/peers beside the sources.
    Returns what is missing, of them or of modules: one line, or None."""
    parent = Path(os.environ.get("CITYLEARN_PEERS_SOURCE", SOURCE.parent / "shared/peers"))
    for name in folders:
        if not (parent / name).is_dir():
            return f"{parent / name} is missing"
        sys.path.append(str(parent / name))
    for name in modules:
        try:
            __import__(name)
        except ImportError as error:
            return str(error)
    return None
