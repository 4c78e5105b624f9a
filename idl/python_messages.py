# SPDX-License-Identifier: Apache-2.0
"""Writes the messages of idl/ as classes for the wheel cyclonedds: the source of citylearn_messages/_types.py."""
import re

from generate import Idl

NAMES = {"octet": "types.uint8", "boolean": "bool", "long": "types.int32", "unsigned long": "types.uint32",
         "long long": "types.int64", "unsigned long long": "types.uint64", "float": "types.float32", "double": "types.float64"}
MAX_BOUND = 65535  # of a sequence that cyclonedds can describe; ours is checked all the same


def field_of(idl, name, type_):
    """Returns the lines of a field: its type and default."""
    if found := re.fullmatch(r"string<(\d+)>", type_):
        return f'    {name}: types.bounded_str[{found[1]}] = ""'
    if found := re.fullmatch(r"sequence<(.*), (\w+)>", type_):
        bound = idl.constants[found[2]]
        kind = f"{NAMES[found[1]]}, {bound}" if bound <= MAX_BOUND else NAMES[found[1]]
        return f"    {name}: types.sequence[{kind}] = bounded({bound})"
    if type_ in idl.structs:
        return f"    {name}: {type_} = field(default_factory={type_})"
    if type_ in idl.enums:
        return f"    {name}: {type_} = {type_}(0)"
    if type_ == "protocol":
        return f"    {name}: types.uint32 = PROTOCOL"
    return f"    {name}: {NAMES[type_]} = {'False' if type_ == 'boolean' else '0.0' if type_ in ('float', 'double') else '0'}"


def source(paths):
    """Returns the module's text."""
    idl = Idl()
    for path in paths:
        idl.read(path)
    lines = ['"""Made by idl/python_messages.py."""', "from dataclasses import dataclass, field", "",
             "from cyclonedds.idl import IdlEnum, types", "", "from ._message import Message, bounded", ""]
    lines += [f"{name} = {value}" for name, value in idl.constants.items()]
    text = "\n".join(line for file in idl.files.values() for line in file)
    for name in idl.enums:
        values = re.search(rf"enum {name} : std::uint32_t {{(.*?)}}", text)[1].replace(",", " ").split()
        lines += ["", "", f'class {name}(IdlEnum, typename="citylearn.msg.{name}", default="{values[0]}"):',
                  *(f"    {value} = {number}" for number, value in enumerate(values))]
    for struct in idl.structs.values():
        lines += ["", "", "@dataclass", f'class {struct.name}(Message, typename="citylearn.msg.{struct.name}"):',
                  *(field_of(idl, name, type_) for name, type_ in struct.fields.items())]
    lines += ["", "", "TOPICS = {  # by name: class, topic, quality of service",
              *(f'    "{name}": ({struct.name}, "{topic}", "{profile}"),' for name, struct, topic, profile in idl.topics()), "}", ""]
    return "\n".join(lines)
