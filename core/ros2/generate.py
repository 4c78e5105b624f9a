#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what this folder needs of msg/PACKAGE/TYPE.msg and srv/PACKAGE/TYPE.srv: generate.py FOLDER FILE ...

FOLDER/ros2.h has all types under the names that ROS 2 gives them on DDS: sensor_msgs/msg/Image is
sensor_msgs::msg::dds_::Image_, and std_srvs/srv/SetBool is called by std_srvs::srv::dds_::SetBool_Request_ and answered
by SetBool_Response_ (create_type_name() of ROS 2's rmw_fastrtps and rmw_cyclonedds). FOLDER/ros2_types.inc has
CITYLEARN_ROS2_TYPE(PACKAGE, KIND, TYPE, HASH, SERVICE_HASH, SCHEMA) for each type, where KIND is msg or srv, SCHEMA its
definition with all that it includes, as MCAP wants it (https://mcap.dev/spec/registry, ros2msg), HASH ROS 2's from Iron
on (REP 2016), and SERVICE_HASH that of the service, or "". FOLDER/ros2_fields.h has visit(), which names a message's
fields in the order of the wire.

The files have the fields and constants of ROS 2 Humble's common_interfaces and rcl_interfaces, as far as they are
needed. int8 becomes octet: older IDL knows no signed one, and on the wire both are one byte.
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
# type_description_interfaces/msg/FieldType: these, 48 more of an array, 96 of a sequence with a
# bound, 144 of one without.
TYPE_IDS = {name: number for number, name in enumerate("nested int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 "
                                                       "float64".split(), 1)} | {"bool": 15, "string": 17}
FIELD = re.compile(r"([a-zA-Z][\w/]*)(\[\d*\])?\s+([a-z]\w*)(\s|$)")


# What a service's events begin with (service_msgs); they count in its hash alone.
EVENT_INFO = "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number\n"


def full_name(kind):
    return kind if kind in NUMBERS or kind.count("/") != 1 else kind.replace("/", "/msg/")


class Type:
    def __init__(self, package, kind, name, text="", fields=()):
        self.package, self.kind, self.name, self.text = package, kind, name, text
        self.service_hash, self.fields = "", list(fields)  # type, array, name
        for line in text.splitlines():
            if not line or re.match(r"\w+ [A-Z_]+=", line):  # a constant is not on the wire
                continue
            field = FIELD.match(line)
            if not field:
                sys.exit(f"{package}/{kind}/{name}: cannot read '{line}'")
            kind_of_field, array, field_name = field.group(1, 2, 3)
            if kind_of_field not in NUMBERS and "/" not in kind_of_field:
                kind_of_field = f"{package}/{kind_of_field}"
            self.fields.append((full_name(kind_of_field), array or "", field_name))
        self.dds = f"{package}::{kind}::dds_::{name}_"

    def includes(self, types):
        """Returns the names of all types in this one, each before those that include it."""
        names = []
        for kind, _, _ in self.fields:
            if kind not in NUMBERS:
                names += [name for name in types[kind].includes(types) + [kind] if name not in names]
        return names

    def schema(self, types):
        parts = [f"{'=' * 80}\nMSG: {name.replace('/msg/', '/')}\n{types[name].text}" for name in self.includes(types)]
        return "".join([self.text] + parts)

    def description(self):
        arrays = {"": 0, "[]": 144, "[<=1]": 96}
        fields = [{"name": name, "type": {
            "type_id": TYPE_IDS.get(kind, TYPE_IDS["nested"]) + arrays.get(array, 48),
            "capacity": int(array.strip("[<=]") or 0), "string_capacity": 0,
            "nested_type_name": "" if kind in NUMBERS else kind}} for kind, array, name in self.fields]
        return {"type_name": f"{self.package}/{self.kind}/{self.name}", "fields": fields}

    def hash(self, types):
        referenced = sorted((types[name].description() for name in self.includes(types)), key=lambda one: one["type_name"])
        text = json.dumps({"type_description": self.description(), "referenced_type_descriptions": referenced})
        return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"

    def cpp(self):
        def member(kind, array):
            number = NUMBERS.get(kind)
            one = CPP.get(number) or ("std::string" if number else "{}::{}::dds_::{}_".format(*kind.split("/")))
            if array:
                return (f"std::vector<{one}>" if array == "[]" else f"std::array<{one}, {array[1:-1]}>"), False
            return one, number in CPP
        fields = {name: member(kind, array) for kind, array, name in self.fields}
        return "\n".join([f"namespace {self.package}::{self.kind}::dds_ {{", *class_of(f"{self.name}_", fields), "}", ""])

    def visit(self):
        def way(kind, array):
            return "" if kind in NUMBERS else ".sequence" if array else ".nested"
        fields = "".join(f'\n  visitor{way(kind, array)}("{name}", message.{name}());' for kind, array, name in self.fields)
        return (f"template <class Message, class Visitor>\n"
                f"  requires std::same_as<std::remove_const_t<Message>, {self.dds}>\n"
                f"void visit(Message& message, Visitor& visitor) {{{fields}\n}}\n")


def types_of(path):
    """Returns the types of a file: a message, or the request and the response of a service."""
    package, kind, text = path.parent.name, path.parent.parent.name, path.read_text(encoding="utf-8")
    if kind == "msg":
        return [Type(package, kind, path.stem, text)]
    return [Type(package, kind, f"{path.stem}_{part}", half) for part, half in zip(("Request", "Response"), text.split("---\n"))]


def service_hash(request, response, types):
    """Returns the hash of a service: of its request, its response and its event, which both may be part of."""
    name = request.name.removesuffix("_Request")
    parts = [f"{request.package}/srv/{one.name}" for one in (request, response)]
    event, info = f"{request.package}/srv/{name}_Event", "service_msgs/msg/ServiceEventInfo"
    known = types | {info: Type("service_msgs", "msg", "ServiceEventInfo", EVENT_INFO), event: Type(
        request.package, "srv", f"{name}_Event", fields=[(info, "", "info"), (parts[0], "[<=1]", "request"), (parts[1], "[<=1]", "response")])}
    fields = [(kind, "", f"{part}_message") for kind, part in zip([*parts, event], ("request", "response", "event"))]
    return Type(request.package, "srv", name, fields=fields).hash(known)


folder, files = Path(sys.argv[1]), sys.argv[2:]
halves = [types_of(Path(file)) for file in files]
types = {f"{one.package}/{one.kind}/{one.name}": one for half in halves for one in half}
for half in halves:
    if len(half) == 2:
        half[0].service_hash = half[1].service_hash = service_hash(*half, types)
order = []
for name, one in sorted(types.items()):
    order += [each for each in one.includes(types) + [name] if each not in order]
(folder / "ros2.h").write_text("#pragma once\n" + "".join(
    f"#include <{name}>\n" for name in ("array", "cstdint", "string", "utility", "vector")) + "".join(
        types[name].cpp() for name in order), encoding="utf-8")
(folder / "ros2_types.inc").write_text("".join(
    f'CITYLEARN_ROS2_TYPE({types[name].package}, {types[name].kind}, {types[name].name}, "{types[name].hash(types)}",\n'
    f'                    "{types[name].service_hash}", R"MSG({types[name].schema(types)})MSG")\n'
    for name in order), encoding="utf-8")
(folder / "ros2_fields.h").write_text("#pragma once\n#include <concepts>\n#include <type_traits>\n#include \"ros2/ros2.h\"\nnamespace citylearn {\n" + "".join(
    types[name].visit() for name in order) + "}  // namespace citylearn\n", encoding="utf-8")
