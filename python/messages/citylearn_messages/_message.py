# SPDX-License-Identifier: Apache-2.0
"""CDR of messages. The wheel cyclonedds would take each number of a sequence by itself; here a sequence is an array.array, which
NumPy takes as it is (numpy.asarray), and is read and written as a whole."""

from __future__ import annotations

import dataclasses
import struct
from array import array
from typing import get_args

from cyclonedds.idl import IdlEnum, IdlStruct, types

CODES = {bool: "?", types.uint8: "B", types.int32: "i", types.uint32: "I", types.int64: "q", types.uint64: "Q",
         types.float32: "f", types.float64: "d"}
ORDERS = "><"  # by the second byte of the encapsulation
LENGTHS = [struct.Struct(order + "I") for order in ORDERS]


def bounded(bound):
    """Returns the default of a sequence with at most so many entries."""
    return dataclasses.field(default_factory=list, metadata={"bound": bound})


def align(data, size):
    data.extend(bytes(-len(data) % size))


class Number:
    def __init__(self, code, enum=None):
        self.codes, self.enum = [struct.Struct(order + code) for order in ORDERS], enum
        self.size = self.codes[0].size

    def read(self, data, at, order):
        at += -at % self.size
        value, = self.codes[order].unpack_from(data, at)
        return self.enum(value) if self.enum else value, at + self.size

    def write(self, data, value):
        align(data, self.size)
        data += self.codes[1].pack(value.value if isinstance(value, IdlEnum) else value)


class Text:
    def __init__(self, bound):
        self.bound = bound

    def read(self, data, at, order):
        at += -at % 4
        end = at + 4 + LENGTHS[order].unpack_from(data, at)[0]
        text = bytes(data[at + 4:end])
        if text[-1:] != b"\0" or len(text) > self.bound + 1:
            raise ValueError("is not a text of CDR within its bound")
        return text[:-1].decode(), end

    def write(self, data, value):
        text = value.encode()
        if len(text) > self.bound or 0 in text:
            raise ValueError(f"has {len(text)} bytes; a text has at most {self.bound}, none of them 0")
        align(data, 4)
        data += LENGTHS[1].pack(len(text) + 1) + text + b"\0"


class Sequence:
    def __init__(self, code, bound):
        self.code, self.bound, self.size = code, bound, struct.calcsize(code)

    def read(self, data, at, order):
        at += -at % 4
        count, = LENGTHS[order].unpack_from(data, at)
        at += 4
        if count > self.bound:
            raise ValueError(f"has {count} entries, may have {self.bound}")
        at += -at % self.size if count else 0
        values = array(self.code)
        values.frombytes(data[at:at + count * self.size])
        if len(values) != count:
            raise ValueError("is cut off")
        if order == 0:
            values.byteswap()
        return values, at + count * self.size

    def write(self, data, value):
        if len(value) > self.bound:
            raise ValueError(f"has {len(value)} entries, may have {self.bound}")
        align(data, 4)
        data += LENGTHS[1].pack(len(value))
        if len(value):
            align(data, self.size)
            data += value if isinstance(value, array) and value.typecode == self.code else array(self.code, value)


class Struct:
    def __init__(self, kind):
        self.kind = kind
        self.fields = [(field.name, codec(field.type, field.metadata)) for field in dataclasses.fields(kind)]

    def read(self, data, at, order):
        values = []
        for name, field in self.fields:
            try:
                value, at = field.read(data, at, order)
            except (ValueError, struct.error) as error:
                raise ValueError(f"{self.kind.__name__}.{name}: {error}") from None
            values.append(value)
        return self.kind(*values), at

    def write(self, data, value):
        for name, field in self.fields:
            try:
                field.write(data, getattr(value, name))
            except (ValueError, TypeError, AttributeError, OverflowError, struct.error) as error:
                raise ValueError(f"{self.kind.__name__}.{name}: {error}") from None


def codec(kind, metadata):
    annotation = next(iter(get_args(kind)[1:]), None)
    if metadata:
        return Sequence(CODES[annotation.subtype], metadata["bound"])
    if isinstance(annotation, types.bounded_str):
        return Text(annotation.max_length)
    if kind in CODES:
        return Number(CODES[kind])
    return Struct(kind) if issubclass(kind, IdlStruct) else Number("I", kind)


class Message(IdlStruct):
    """A message: its bytes are CDR, little endian, as docs/how-to/write-a-peer.md says."""

    def serialize(self, buffer=None, endianness=None, use_version_2=None):
        """Returns the message's bytes. Raises ValueError that names the field."""
        data = bytearray()
        self._codec().write(data, self)
        return b"\0\1\0\0" + data

    @classmethod
    def deserialize(cls, data, has_header=True, use_version_2=None):
        """Returns the message of these bytes, of either order. Raises ValueError that names the field."""
        if len(data) < 4 or data[0] or data[1] > 1:
            raise ValueError(f"{cls.__name__}: does not begin as CDR does: {bytes(data[:4]).hex()}")
        return cls._codec().read(memoryview(data)[4:], 0, data[1])[0]

    @classmethod
    def _codec(cls):
        if "_made" not in cls.__dict__:
            cls._made = Struct(cls)
        return cls._made
