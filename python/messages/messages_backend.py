# SPDX-License-Identifier: Apache-2.0
"""Makes the wheel citylearn-messages for pip (PEP 517), from idl/ and the folder citylearn_messages alone."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
IDL = HERE.parents[1] / "idl"
sys.path[:0] = [str(HERE.parent), str(IDL)]
import backend
import python_messages


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    definitions = sorted(IDL.glob("*.idl"))
    files = {f"citylearn_messages/{path.name}": path.read_bytes() for path in sorted((HERE / "citylearn_messages").glob("*.py"))}
    files |= {f"citylearn_messages/idl/{path.name}": path.read_bytes() for path in definitions}
    files["citylearn_messages/_types.py"] = python_messages.source(map(str, definitions)).encode()
    return backend.write_wheel(wheel_directory, "citylearn-messages", "py3-none-any", files,
                               "Summary: The messages of CityLearn over DDS", "Requires-Python: >=3.10", "Requires-Dist: cyclonedds>=11.0.1")
