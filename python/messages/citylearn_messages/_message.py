# SPDX-License-Identifier: Apache-2.0
"""CDR of messages. The wheel cyclonedds would take each number of a sequence by itself; here a sequence is an array.array,
which NumPy takes as it is (numpy.asarray). Mostly the texts and sequences of a message are as long as those of an
earlier one of its kind: then one struct reads or writes all of it. A learner spends most of its time here."""

from __future__ import annotations

import dataclasses
import struct
from array import array
from functools import lru_cache
from operator import itemgetter
from typing import NamedTuple, get_args

from cyclonedds.idl import IdlStruct, types

CODES = {bool: "?", types.uint8: "B", types.int32: "i", types.uint32: "I", types.int64: "q", types.uint64: "Q",
         types.float32: "f", types.float64: "d"}
ORDERS = "><"  # by the second byte of the encapsulation
HEAD = 4  # bytes of the encapsulation: alignment counts from behind them
READ_LENGTH = [struct.Struct(order + "I").unpack_from for order in ORDERS]
MAX_STRUCTS = 256
FAULTS = ValueError, TypeError, AttributeError, OverflowError, struct.error


def bounded(bound):
    """Returns the default of a sequence with at most so many entries."""
    return dataclasses.field(default_factory=list, metadata={"bound": bound})


@lru_cache(256)
def text(value, bound):
    """Returns the length, the bytes and the end of a text."""
    data = value.encode()
    if len(data) > bound or 0 in data:
        raise ValueError(f"has {len(data)} bytes; a text has at most {bound}, none of them 0")
    return len(data) + 1, data, 0


def sequence(values, code, bound):
    """Returns the length and the bytes of a sequence."""
    if len(values) > bound:
        raise ValueError(f"has {len(values)} entries, may have {bound}")
    if not isinstance(values, array) or values.typecode != code:
        values = array(code, values)
    return len(values), values.tobytes()


class Field(NamedTuple):
    """A number, or a text or sequence, which have a bound, somewhere in a message."""
    at: int  # among the values of a struct, a length first
    path: str
    where: str  # for errors
    values: str  # expression for the values of the message `m`
    code: str  # of a number; "" is a text
    bound: int = 0


class Codec:
    """Reads and writes messages of a kind. Threads may use it side by side."""

    def __init__(self, kind):
        self.kind, self.fields, self.names, self.fixed, self.count = kind, [], dict(globals()), [0, 1], 2
        self.make = self.function("v", self.add(kind, "m", ""))
        self.values = self.function("m", f"(0, 1, {', '.join(field.values for field in self.fields)})")
        self.fixed_of = itemgetter(*self.fixed)  # a struct fits where these are alike: order, lengths, ends of texts
        self.structs = {}  # by these
        self.last = self.fit(1, lambda field, _: not field.code)  # read with

    def function(self, argument, expression):
        return eval(f"lambda {argument}: {expression}", self.names)  # pylint: disable=eval-used

    def add(self, kind, path, where):
        """Adds the fields of a message that stands at `path`. Returns the expression that makes it of a struct's values `v`."""
        parts = []
        for field in dataclasses.fields(kind):
            parts.append(self.add_field(field, f"{path}.{field.name}", f"{where}{kind.__name__}.{field.name}"))
        self.names[kind.__name__] = kind
        return f"{kind.__name__}({', '.join(parts)})"

    def add_field(self, field, path, where):
        kind, annotation, at = field.type, next(iter(get_args(field.type)[1:]), None), self.count
        if field.metadata:
            code, bound = CODES[annotation.subtype], field.metadata["bound"]
            values = f"*(sequence({path}, '{code}', {bound}) if len({path}) else (0, b''))"
            self.fields.append(Field(at, path, where, values, code, bound))
            self.fixed, self.count = [*self.fixed, at], at + 2
            return f"array('{code}', v[{at + 1}])"
        if isinstance(annotation, types.bounded_str):
            self.fields.append(Field(at, path, where, f"*text({path}, {annotation.max_length})", "", annotation.max_length))
            self.fixed, self.count = [*self.fixed, at, at + 2], at + 3
            return f"v[{at + 1}].decode()"
        if kind not in CODES and issubclass(kind, IdlStruct):
            return self.add(kind, path, f"{where}: ")
        self.count += 1
        if kind in CODES:
            self.fields.append(Field(at, path, where, path, CODES[kind]))
            return f"v[{at}]"
        self.fields.append(Field(at, path, where, f"getattr({path}, 'value', {path})", "I"))
        self.names[kind.__name__] = kind
        return f"{kind.__name__}(v[{at}])"

    def fit(self, order, length_of, end=float("inf")):
        """Makes and returns the struct for messages with these lengths: length_of(field, at) returns that of the text or
        sequence that stands at this byte. Raises ValueError that names a field which has none, or goes beyond `end`."""
        pattern, at, fixed = f"{ORDERS[order]}BB2x", HEAD, [0, order]
        for field in self.fields:
            try:
                size, length = struct.calcsize(field.code or "I"), 1
                if field.bound:
                    pattern, at = f"{pattern}{-at % 4}xI", at + -at % 4 + 4
                    length = length_of(field, at - 4)
                    fixed += [length] if field.code else [length, 0]
                if not field.code:
                    pattern, at = f"{pattern}{length - 1}sB", at + length
                elif length:
                    gap, size = (HEAD - at) % size, length * size
                    pattern, at = f"{pattern}{gap}x" + (f"{size}s" if field.bound else field.code), at + gap + size
                else:
                    pattern += "0s"
                if at > end:
                    raise ValueError("is cut off")
            except FAULTS as error:
                raise ValueError(f"{field.where}: {error}") from None
        if len(self.structs) == MAX_STRUCTS:
            self.structs = {}
        made = self.structs[tuple(fixed)] = struct.Struct(pattern)
        return made

    def read(self, data):
        """Returns the message of these bytes. Raises ValueError that names the field."""
        def length_of(field, at):
            length, = READ_LENGTH[data[1]](data, at)
            if not field.code:
                value = data[at + 4:at + 4 + length]
                if value[-1:] != b"\0" or len(value) > field.bound + 1:
                    raise ValueError("is not a text of CDR within its bound")
                value.decode()
            elif length > field.bound:
                raise ValueError(f"has {length} entries, may have {field.bound}")
            return length

        last = self.last  # its lengths are right up to the first one that differs, and all of them if no other does
        values = last.unpack_from(data.ljust(last.size, b"\0"))
        fixed = self.fixed_of(values)
        fitting = self.structs.get(fixed)
        if fitting is not last or len(data) < last.size:
            if not fitting or len(data) < fitting.size or self.fixed_of(values := fitting.unpack_from(data)) != fixed:
                fitting = self.fit(data[1], length_of, len(data))
                values = fitting.unpack_from(data)
        self.last = fitting
        try:
            message = self.make(values)
        except ValueError as error:
            self.fit(data[1], length_of, len(data))
            raise ValueError(f"{self.kind.__name__}: {error}") from None
        if data[1] == 0:
            for field in self.fields:
                if field.bound and field.code:
                    self.function("m", field.path)(message).byteswap()
        return message

    def write(self, message):
        """Returns the bytes of a message. Raises ValueError that names the field."""
        try:
            values = self.values(message)
            fitting = self.structs.get(self.fixed_of(values)) or self.fit(1, lambda field, _: values[field.at])
            return fitting.pack(*values)
        except FAULTS as error:
            for field in self.fields:
                try:
                    values = self.function("m", f"({field.values},)")(message)
                    if not field.bound:
                        struct.pack(field.code, *values)
                except FAULTS as wrong:
                    raise ValueError(f"{field.where}: {wrong}") from None
            raise ValueError(f"{self.kind.__name__}: {error}") from None


class Message(IdlStruct):
    """A message: its bytes are CDR, little endian, as docs/how-to/write-a-peer.md says."""

    def serialize(self, buffer=None, endianness=None, use_version_2=None):
        """Returns the message's bytes. Raises ValueError that names the field."""
        return self._codec().write(self)

    @classmethod
    def deserialize(cls, data, has_header=True, use_version_2=None):
        """Returns the message of these bytes, of either order. Raises ValueError that names the field."""
        if len(data) < HEAD or data[0] or data[1] > 1:
            raise ValueError(f"{cls.__name__}: does not begin as CDR does: {bytes(data[:4]).hex()}")
        return cls._codec().read(bytes(data))

    @classmethod
    def _codec(cls):
        if "_made" not in cls.__dict__:
            cls._made = Codec(cls)
        return cls._made
