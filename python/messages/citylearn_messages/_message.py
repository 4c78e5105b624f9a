# SPDX-License-Identifier: Apache-2.0
"""CDR of messages. The wheel cyclonedds would take each number of a sequence by itself; here a sequence is an array.array, which
NumPy takes as it is (numpy.asarray), and is read and written as a whole. For each message two functions are made when it is first
used, with a line for each text, sequence and run of numbers: a learner spends most of its time in them."""

from __future__ import annotations

import dataclasses
import struct
from array import array
from typing import get_args

from cyclonedds.idl import IdlEnum, IdlStruct, types

CODES = {bool: "?", types.uint8: "B", types.int32: "i", types.uint32: "I", types.int64: "q", types.uint64: "Q",
         types.float32: "f", types.float64: "d"}
ORDERS = "><"  # by the second byte of the encapsulation
HEAD = 4  # bytes of the encapsulation: alignment counts from behind them
READ_LENGTH, WRITE_LENGTH = [struct.Struct(order + "I").unpack_from for order in ORDERS], struct.Struct("<I").pack


def bounded(bound):
    """Returns the default of a sequence with at most so many entries."""
    return dataclasses.field(default_factory=list, metadata={"bound": bound})


def read_text(data, at, order, bound):
    at += -at % 4
    end = at + 4 + READ_LENGTH[order](data, at)[0]
    text = data[at + 4:end]
    if text[-1:] != b"\0" or len(text) > bound + 1:
        raise ValueError("is not a text of CDR within its bound")
    return text[:-1].decode(), end


def write_text(data, text, bound):
    text = text.encode()
    if len(text) > bound or 0 in text:
        raise ValueError(f"has {len(text)} bytes; a text has at most {bound}, none of them 0")
    data += bytes(-len(data) % 4) + WRITE_LENGTH(len(text) + 1) + text + b"\0"


def read_sequence(data, at, order, code, bound):
    at += -at % 4
    count, = READ_LENGTH[order](data, at)
    at += 4
    values = array(code)
    if count > bound:
        raise ValueError(f"has {count} entries, may have {bound}")
    if count:
        at += (HEAD - at) % values.itemsize
        end = at + count * values.itemsize
        if end > len(data):
            raise ValueError("is cut off")
        values.frombytes(data[at:end])
        at = end
        if order == 0:
            values.byteswap()
    return values, at


def write_sequence(data, values, code, bound):
    if len(values) > bound:
        raise ValueError(f"has {len(values)} entries, may have {bound}")
    data += bytes(-len(data) % 4) + WRITE_LENGTH(len(values))
    if len(values):
        if not isinstance(values, array) or values.typecode != code:
            values = array(code, values)
        data += bytes((HEAD - len(data)) % values.itemsize)
        data += values


class Codec:
    """Writes the source of the two functions of a message."""

    def __init__(self, kind):
        self.names, self.run, self.reading, self.writing = {"struct": struct}, [], [], []
        whole = self.add(kind, "m", "")
        self.end_run()
        source = ["def read(data, at, order):", *self.guarded(self.reading), f"  return {whole}",
                  "def write(m, data):", *self.guarded(self.writing)]
        exec("\n".join(source), globals() | self.names, self.names)  # pylint: disable=exec-used
        self.read, self.write = self.names["read"], self.names["write"]

    @staticmethod
    def guarded(lines):
        kinds = "(ValueError, TypeError, AttributeError, OverflowError, struct.error)"
        return ["  where = ''", "  try:", *(f"    {line}" for line in lines or ["pass"]), f"  except {kinds} as error:",
                "    raise ValueError(f'{where}: {error}') from None"]

    def name(self, value):
        name = f"v{len(self.names)}"
        self.names[name] = value
        return name

    def add(self, kind, path, where):
        """Adds the fields of a message that stands at `path`. Returns the expression that makes it."""
        parts = []
        for field in dataclasses.fields(kind):
            parts.append(self.add_field(field, f"{path}.{field.name}", f"{where}{kind.__name__}.{field.name}"))
        return f"{self.name(kind)}({', '.join(parts)})"

    def add_field(self, field, path, where):
        kind, annotation = field.type, next(iter(get_args(field.type)[1:]), None)
        if field.metadata:
            return self.call("sequence", path, where, f"'{CODES[annotation.subtype]}', {field.metadata['bound']}")
        if isinstance(annotation, types.bounded_str):
            return self.call("text", path, where, annotation.max_length)
        if kind not in CODES and issubclass(kind, IdlStruct):
            return self.add(kind, path, f"{where}: ")
        code = CODES.get(kind, "I")
        if self.run and struct.calcsize(code) > self.run[0][1]:
            self.end_run()
        variable = self.name(None)
        self.run.append((code, struct.calcsize(code), variable, path, where, kind not in CODES))
        return f"{self.name(kind)}({variable})" if kind not in CODES else variable

    def call(self, what, path, where, more):
        """Lets a text or a sequence be read and written."""
        self.end_run()
        variable, where = self.name(None), f"where = '{where}'"
        self.reading += [where, f"{variable}, at = read_{what}(data, at, order, {more})"]
        self.writing += [where, f"write_{what}(data, {path}, {more})"]
        return variable

    def end_run(self):
        """Lets numbers that follow each other be read and written together: none needs a greater alignment than the first."""
        if not self.run:
            return
        pattern, at = "", 0
        for code, size, *_ in self.run:
            pattern += "x" * (-at % size) + code
            at += -at % size + size
        size, where = self.run[0][1], f"where = '{self.run[0][4]}'"
        unpack = self.name([struct.Struct(order + pattern).unpack_from for order in ORDERS])
        pack = self.name(struct.Struct("<" + pattern).pack)
        self.reading += [where, f"at += ({HEAD} - at) % {size}",
                         f"{', '.join(variable for _, _, variable, *_ in self.run)}, = {unpack}[order](data, at)", f"at += {at}"]
        values = [f"getattr({path}, 'value', {path})" if enum else path for *_, path, _, enum in self.run]
        self.writing += [where, f"data += bytes(({HEAD} - len(data)) % {size})", "try:", f"  data += {pack}({', '.join(values)})",
                         "except struct.error:"]
        for (code, _, _, _, where, _), value in zip(self.run, values):  # which one is it?
            self.writing += [f"  where = '{where}'", f"  struct.pack('{code}', {value})"]
        self.run = []


class Message(IdlStruct):
    """A message: its bytes are CDR, little endian, as docs/how-to/write-a-peer.md says."""

    def serialize(self, buffer=None, endianness=None, use_version_2=None):
        """Returns the message's bytes. Raises ValueError that names the field."""
        data = bytearray(b"\0\1\0\0")
        self._codec().write(self, data)
        return bytes(data)

    @classmethod
    def deserialize(cls, data, has_header=True, use_version_2=None):
        """Returns the message of these bytes, of either order. Raises ValueError that names the field."""
        if len(data) < HEAD or data[0] or data[1] > 1:
            raise ValueError(f"{cls.__name__}: does not begin as CDR does: {bytes(data[:4]).hex()}")
        return cls._codec().read(bytes(data), HEAD, data[1])

    @classmethod
    def _codec(cls):
        if "_made" not in cls.__dict__:
            cls._made = Codec(cls)
        return cls._made
