#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what this folder needs of msg/PACKAGE/TYPE.msg: generate.py FOLDER FILE.msg ...

FOLDER/ros2.h has all types under the names that ROS 2 gives them on DDS: sensor_msgs/msg/Image is
sensor_msgs::msg::dds_::Image_ (create_type_name() of ROS 2's rmw_fastrtps and rmw_cyclonedds). FOLDER/ros2_types.inc
has CITYLEARN_ROS2_TYPE(PACKAGE, TYPE, HASH, SCHEMA) for each type, where SCHEMA is its definition with all that it
includes, as MCAP wants it (https://mcap.dev/spec/registry, ros2msg), and HASH is ROS 2's from Iron on (REP 2016).
FOLDER/ros2_fields.h has visit(), which names a message's fields in the order of the wire.

msg/ has the fields and constants of ROS 2 Humble's common_interfaces and rcl_interfaces, as far as they are needed.
int8 becomes octet: older IDL knows no signed one, and on the wire both are one byte.
"""
import hashlib
import json
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "idl"))
from classes import NUMBERS as CPP, class_of  # noqa: E402

NUMBERS = {"bool": "boolean", "int8": "octet", "uint8": "octet", "int16": "short", "uint16": "unsigned short",
           "int32": "long", "uint32": "unsigned long", "int64": "long long", "uint64": "unsigned long long",
           "float32": "float", "float64": "double", "string": "string"}
# type_description_interfaces/msg/FieldType: these, 48 more of an array, 144 more of a sequence without a bound.
TYPE_IDS = {name: number for number, name in enumerate("nested int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 "
                                                       "float64".split(), 1)} | {"bool": 15, "string": 17}
FIELD = re.compile(r"([a-zA-Z][\w/]*)(\[\d*\])?\s+([a-z]\w*)(\s|$)")


class Type:
    def __init__(self, path):
        self.package, self.name, self.text = path.parent.name, path.stem, path.read_text(encoding="utf-8")
        self.fields = []  # type, array, name
        for line in self.text.splitlines():
            if not line or re.match(r"\w+ [A-Z_]+=", line):  # a constant is not on the wire
                continue
            field = FIELD.match(line)
            if not field:
                sys.exit(f"{path}: cannot read '{line}'")
            kind, array, name = field.group(1, 2, 3)
            if kind not in NUMBERS and "/" not in kind:
                kind = f"{self.package}/{kind}"
            self.fields.append((kind, array or "", name))

    def includes(self, types):
        """Returns the names of all types in this one, each before those that include it."""
        names = []
        for kind, _, _ in self.fields:
            if kind not in NUMBERS:
                names += [name for name in types[kind].includes(types) + [kind] if name not in names]
        return names

    def schema(self, types):
        parts = [f"{'=' * 80}\nMSG: {name}\n{types[name].text}" for name in self.includes(types)]
        return "".join([self.text] + parts)

    def description(self):
        fields = [{"name": name, "type": {
            "type_id": TYPE_IDS.get(kind, TYPE_IDS["nested"]) + (144 if array == "[]" else 48 if array else 0),
            "capacity": int(array[1:-1] or 0) if array else 0, "string_capacity": 0,
            "nested_type_name": "" if kind in NUMBERS else kind.replace("/", "/msg/")}} for kind, array, name in self.fields]
        return {"type_name": f"{self.package}/msg/{self.name}", "fields": fields}

    def hash(self, types):
        referenced = sorted((types[name].description() for name in self.includes(types)), key=lambda one: one["type_name"])
        text = json.dumps({"type_description": self.description(), "referenced_type_descriptions": referenced})
        return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"

    def cpp(self):
        def member(kind, array):
            number = NUMBERS.get(kind)
            one = CPP.get(number) or ("std::string" if number else "{}::msg::dds_::{}_".format(*kind.split("/")))
            if array:
                return (f"std::vector<{one}>" if array == "[]" else f"std::array<{one}, {array[1:-1]}>"), False
            return one, number in CPP
        fields = {name: member(kind, array) for kind, array, name in self.fields}
        return "\n".join([f"namespace {self.package}::msg::dds_ {{", *class_of(f"{self.name}_", fields), "}", ""])

    def visit(self):
        fields = "".join(f'\n  visitor{"" if kind in NUMBERS else ".nested"}("{name}", message.{name}());'
                         for kind, _, name in self.fields)
        return (f"template <class Message, class Visitor>\n"
                f"  requires std::same_as<std::remove_const_t<Message>, {self.package}::msg::dds_::{self.name}_>\n"
                f"void visit(Message& message, Visitor& visitor) {{{fields}\n}}\n")


folder, files = Path(sys.argv[1]), sys.argv[2:]
types = {f"{one.package}/{one.name}": one for one in (Type(Path(file)) for file in files)}
order = []
for name, one in sorted(types.items()):
    order += [each for each in one.includes(types) + [name] if each not in order]
(folder / "ros2.h").write_text("#pragma once\n" + "".join(
    f"#include <{name}>\n" for name in ("array", "cstdint", "string", "utility", "vector")) + "".join(
        types[name].cpp() for name in order), encoding="utf-8")
(folder / "ros2_types.inc").write_text("".join(
    f'CITYLEARN_ROS2_TYPE({types[name].package}, {types[name].name}, "{types[name].hash(types)}",\n'
    f'                    R"MSG({types[name].schema(types)})MSG")\n'
    for name in order), encoding="utf-8")
(folder / "ros2_fields.h").write_text("#pragma once\n#include <concepts>\n#include <type_traits>\n#include \"ros2/ros2.h\"\nnamespace citylearn {\n" + "".join(
    types[name].visit() for name in order) + "}  // namespace citylearn\n", encoding="utf-8")
