# SPDX-License-Identifier: Apache-2.0
"""Makes C types of ROS 2's definitions with Debian's rosidl and Cyclone's idlc: rosidl_types.py MSG_FOLDER FOLDER IDLC.

rosidl_adapter turns PACKAGE/TYPE.msg into IDL. The structs then get the names that they have on DDS, as
rosidl_generator_dds_idl does it: sensor_msgs::msg::Image becomes sensor_msgs::msg::dds_::Image_.
"""
import re
import subprocess
import sys
from pathlib import Path

from rosidl_adapter.msg import convert_msg_to_idl

definitions, output, idlc = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve(), sys.argv[3]
files = []
for definition in sorted(definitions.glob("*/*.msg")):
    folder = output / definition.parent.name / "msg"
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{definition.stem}.idl"
    convert_msg_to_idl(definition.parent, definition.parent.name, Path(definition.name), folder)
    text = file.read_text()
    text = re.sub(r"\b(\w+)::msg::(\w+)", r"\1::msg::dds_::\2_", text)
    text = re.sub(r"( +)struct (\w+) \{(.*?)\n\1\};", r"\1module dds_ {\n\1struct \2_ {\3\n\1};\n\1};", text,
                  flags=re.S)
    # Each file names its array types in the package's module, where two files that are included together collide.
    for kind, name, size in re.findall(r"typedef (\w+) (\w+)\[(\d+)\];", text):
        text = re.sub(rf"typedef {kind} {name}\[{size}\];", "", text)
        text = re.sub(rf"\b{name} (\w+);", rf"{kind} \1[{size}];", text)
    guard = f"{definition.parent.name}_{definition.stem}_idl"  # one file may include another by several ways
    file.write_text(f"#ifndef {guard}\n#define {guard}\n{text}\n#endif\n")
    files.append(file)
for file in files:
    subprocess.run([idlc, "-Wno-implicit-extensibility", "-I", output, "-o", file.parent, file], check=True)
