#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the C++ types of the messages of idl/ and what core/wire must know about them: generate.py FOLDER FILE.idl ...

Writes FOLDER/idl/NAME.h for each file (its types), FOLDER/idl/forward.h (declares each type, for light headers) and
FOLDER/idl/message_fields.h (each type's fields in the order of the wire, bounds and checks, and the list of topics).

It reads one declaration a line, and annotations that begin a comment, so that IDL compilers skip them:
  //@topic(PROFILE)    above a struct: it is a message, sent on topics of its own with this QoS profile. Behind it may stand
                       which topics: @to(FIELD): that of the service whose id is in FIELD (in a field that may be empty: of
                       all); @from: that of its sender; @from(all): that of its sender and that of all; nothing: that of all
  //@log(PROFILE)      as @topic, above a struct NAME whose second field is "LogPosition log": its messages are records. The
                       acknowledgement becomes the message NAMEAcknowledgement (without "Stat"), with topics of its own
  //@request, //@chunk, //@acknowledgement  above a struct, with @to: it is sent under other names, one for each kind of
                       object or log
  //@object            above a struct NAME: it is a kind of object. The request becomes the message NAMERequest, the chunk
                       the message NAMEChunk, with topics of their own; the struct is what an object's bytes are
  //@length(OTHER)     behind a sequence: it has as many entries as OTHER; OTHER+1: one more
  //@finite            behind a float, a double or a sequence of them: NaN and infinities are refused
  //@name              behind a string: it follows the rule for names (core/util/name.h); name(optional): or is empty
  //@protocol          behind the number that must be PROTOCOL
  //@metric(NAME)      behind a number: services export it to Prometheus as citylearn_NAME, with the comment as its help
"""
import json
import os
import re
import sys

from classes import NUMBERS as CPP, SIZES, class_of

PROFILES = ("state", "command", "durable")
ROLES = {"request": "command", "chunk": "durable", "acknowledgement": "command"}  # with their profiles
NUMBERS = "|".join(CPP)


class Struct:
    def __init__(self, name, profile, addressing, log):
        self.name, self.profile, self.addressing, self.log = name, profile, addressing, log
        self.fields, self.checks, self.metrics = {}, [], []

    def enumerator(self):
        """The enumerator of Addressing (core/wire/messages.h)."""
        note, argument = self.addressing
        return {"": "kSharedTopic", "to": "kReceiver", "from": "kSenderAndAll" if argument else "kSender"}[note]

    def receiver(self):
        """The expression for the id of the service that it is sent to."""
        note, argument = self.addressing
        return f"m.{argument}().c_str()" if note == "to" else '""'


class Idl:
    """The structs, enums and constants of the files read so far."""

    def __init__(self):
        self.structs, self.enums, self.constants, self.files = {}, {}, {}, {}  # files: lines of C++ by path

    def read(self, path):
        """Reads a file after those that it includes."""
        if path in self.files:
            return
        with open(path, encoding="utf-8") as file:
            text = file.read()
        includes = re.findall(r'^#include "(.*)"', text, re.M)
        for name in includes:
            self.read(os.path.join(os.path.dirname(path), name))
        self.lines = self.files[path] = [*map(header_of, includes), "namespace citylearn::msg {"]
        # An enum may take several lines: they become its first one.
        text = re.sub(r"enum[^}]*}", lambda enum: re.sub(r"//.*|\n", "", enum[0]) + "\n" * enum[0].count("\n"), text)
        self.open, self.profile, self.addressing, self.log = None, None, ("", ""), False
        for number, line in enumerate(text.split("\n"), 1):
            try:
                self.read_line(*re.fullmatch(r"\s*(.*?)\s*(?://(.*))?", line).groups(""))
            except ValueError as error:
                sys.exit(f"{path}:{number}: {error}")

    def read_line(self, code, comment):
        head = re.match(r"(\s*@\w*(\(.*?\))?)*", comment)[0]
        notes = re.findall(r"@(\w*)(?:\((.*?)\))?", head)
        if found := re.fullmatch(r"@final struct (\w+) \{", code):
            self.open = self.structs[found[1]] = Struct(found[1], self.profile, self.addressing, self.log)
            self.profile, self.addressing, self.log = None, ("", ""), False
        elif self.open and code == "};":
            for check in self.open.checks:
                other = re.search(r', "(\w+)"', check)
                if other and "sequence" not in self.open.fields.get(other[1], ""):
                    raise ValueError(f"{self.open.name} has no sequence '{other[1]}'")
            if self.open.profile not in (None, "object") and [*self.open.fields.values()][:1] != ["Header"]:
                raise ValueError(f"{self.open.name} has a topic, so its first field must be a Header")
            if self.open.log and [*self.open.fields.items()][1:2] != [("log", "LogPosition")]:
                raise ValueError(f"{self.open.name} is a log, so its second field must be a LogPosition 'log'")
            note, argument = self.open.addressing
            if note == "to" and self.open.fields.get(argument) != "string<64>":
                raise ValueError(f"{self.open.name} has no string<64> '{argument}'")
            self.lines += class_of(self.open.name, {name: self.cpp(type_) for name, type_ in self.open.fields.items()})
            self.open = None
        elif self.open and code:
            self.read_field(code, notes, comment[len(head):].strip())
        elif found := re.fullmatch(rf"const ({NUMBERS}) (\w+) = (.*);", code):
            self.constants[found[2]] = int(found[3], 0)
            self.lines.append(f"inline constexpr {CPP[found[1]]} {found[2]} = {found[3]};")
        elif found := re.match(r"enum (\w+) \{.*\b(\w+)\s*\}", code):
            self.enums[found[1]] = found[2]
            self.lines.append(" ".join(code.replace("{", ": std::uint32_t {", 1).rstrip(";").split()) + ";")
        elif notes:
            role, profile = notes[0]
            known = [(name, profile) for name in ("topic", "log") for profile in PROFILES]
            if (role, profile) not in (known + [(name, "") for name in (*ROLES, "object")]):
                raise ValueError(f"expected //@topic(PROFILE), PROFILE one of {', '.join(PROFILES)}, //@log(PROFILE) or //@object")
            self.profile, self.log = profile or role, role == "log"
            if notes[1:]:
                self.addressing = notes[1]
                if len(notes) > 2 or self.addressing[0] not in ("to", "from") or self.addressing[1:] not in (("",), ("all",)) and (
                        self.addressing[0] == "from"):
                    raise ValueError("expected @to(FIELD), @from or @from(all) behind @topic")
        elif not re.fullmatch(r'(#include ".*"|module citylearn \{ module msg \{|\};|;)?', code):
            raise ValueError(f"cannot read '{code}'" + (", structs must be @final" if "struct" in code else ""))

    def read_field(self, code, notes, text):
        found = re.fullmatch(r"(.*\S) (\w+);", code)
        if not found or found[2] in self.open.fields:
            raise ValueError(f"'{code}' is not a new field: TYPE NAME;")
        type_, name = found.groups()
        bounded = re.fullmatch(rf"sequence<({NUMBERS}), (\w+)>|string<\d+>", type_)
        if bounded and bounded[2] and bounded[2] not in self.constants:
            raise ValueError(f"unknown bound '{bounded[2]}'")
        if not (bounded or type_ in self.structs or type_ in self.enums or re.fullmatch(NUMBERS, type_)):
            raise ValueError(f"'{type_}' is neither a number, string<N>, sequence<NUMBER, BOUND>, enum nor struct")
        self.open.fields[name] = type_
        for note, argument in notes:
            other = re.fullmatch(r"(\w+)(\+1)?", argument)
            if note == "length" and other and "sequence" in type_:
                more = 1 if other[2] else 0
                self.open.checks.append(
                    f'check.length("{name}", m.{name}().size(), "{other[1]}", m.{other[1]}().size(), {more});')
            elif note == "finite" and re.search("float|double", type_):
                self.open.checks.append(f'check.finite("{name}", m.{name}());')
            elif note == "name" and type_.startswith("string") and argument in ("", "optional"):
                self.open.checks.append(f'check.name("{name}", m.{name}(), {"true" if argument else "false"});')
            elif note == "metric" and re.fullmatch(NUMBERS, type_) and re.fullmatch("[a-z_]+", argument) and text:
                self.open.metrics.append(f'visitor("citylearn_{argument}", {json.dumps(text)}, m.{name}());')
            elif note == "protocol" and type_ == "unsigned long":
                self.open.fields[name] = "protocol"
            else:
                raise ValueError(f"unknown annotation, or one that does not fit '{code}': //@{note}")

    def objects(self):
        return [struct for struct in self.structs.values() if struct.profile == "object"]

    def kinds(self):
        """Returns name and struct of the messages that are sent under other names than their struct's."""
        logs = [struct for struct in self.structs.values() if struct.log]
        return [(f"{kind.name.removesuffix('Stat')}{role.profile.title()}", role)
                for role in self.structs.values() if role.profile in ROLES
                for kind in (logs if role.profile == "acknowledgement" else self.objects())]

    def topics(self):
        """Returns name, struct, topic and profile of each message."""
        named = [(s.name, s, s.profile) for s in self.structs.values() if s.profile in PROFILES]
        named += [(name, role, ROLES[role.profile]) for name, role in self.kinds()]
        return [(name, struct, "citylearn/" + re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(), profile)
                for name, struct, profile in named]

    def cpp(self, type_):
        """Returns the C++ type of a field, and whether it is a number or an enum."""
        if found := re.fullmatch(r"string<(\d+)>", type_):
            return f"FixedString<{found[1]}>", False
        if found := re.fullmatch(r"sequence<(.*), \w+>", type_):
            return f"std::vector<{CPP[found[1]]}>", False
        return CPP.get(type_, "std::uint32_t" if type_ == "protocol" else type_), type_ not in self.structs

    def end(self, struct, at=0):
        """Returns where the largest struct ends in CDR when it begins `at` bytes behind the encapsulation."""
        def numbers(count, size):
            return at + -at % size + count * size
        for type_ in struct.fields.values():
            if type_ in self.structs:
                at = self.end(self.structs[type_], at)
            else:
                text, sequence = re.fullmatch(r"string<(\d+)>", type_), re.fullmatch(r"sequence<(.*), (\w+)>", type_)
                at = numbers(1, 4 if text or sequence else SIZES.get(type_, 4))
                if text:
                    at += int(text[1]) + 1
                elif sequence:
                    at = numbers(self.constants[sequence[2]], SIZES[sequence[1]])
        return at

    def checks(self, struct):
        """Its own checks, and those of the structs in it."""
        for name, type_ in struct.fields.items():
            if type_ in self.structs and [*self.checks(self.structs[type_])]:
                yield f"check_fields(m.{name}(), check);"
        yield from struct.checks

    def visits(self, struct):
        for name, type_ in struct.fields.items():
            if type_ == "protocol":
                yield f'visitor.protocol("{name}", m.{name}());'
            elif type_ in self.structs:
                yield f'visitor.nested("{name}", m.{name}());'
            elif type_ in self.enums:
                yield f'visitor.enumerator("{name}", m.{name}(), {self.enums[type_]});'
            else:
                bound = re.search(r"sequence<.*, (\w+)>", type_)
                yield f'visitor("{name}", m.{name}(){", " + bound[1] if bound else ""});'


def header_of(idl_file):
    return f'#include "idl/{os.path.basename(idl_file)[:-4]}.h"'


def write(path, *lines):
    """Writes a header, unless it has this text already, so that nothing is built again."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    text = "\n".join(["// Made by idl/generate.py.", "#pragma once", *lines, ""])
    if os.path.exists(path):
        with open(path, encoding="utf-8") as file:
            if file.read() == text:
                return
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def main(folder, *paths):
    idl = Idl()
    for path in paths:
        idl.read(path)
    structs = idl.structs.values()
    objects, kinds = idl.objects(), idl.kinds()
    write(f"{folder}/idl/forward.h", "#include <cstdint>", "namespace citylearn::msg {",
          *(f"class {name};" for name in [*(s.name for s in structs), *(name for name, _ in kinds)]), *(f"enum {name} : std::uint32_t;" for name in idl.enums), "}")
    functions = []
    for struct in structs:
        functions += ["template <class Message, class Visitor>",
                      f"  requires std::derived_from<std::remove_const_t<Message>, {struct.name}>",
                      "void visit(Message& m, Visitor& visitor) {", *idl.visits(struct), "}",
                      "template <class Check>",
                      f"void check_fields([[maybe_unused]] const {struct.name}& m, [[maybe_unused]] Check& check) {{",
                      *idl.checks(struct), "}"]
        if struct.metrics:
            functions += [f"template <class Visitor>\nvoid visit_metrics(const {struct.name}& m, Visitor visitor) {{",
                          *struct.metrics, "}"]
        if struct.profile not in (None, "object"):
            functions += [f"inline std::string receiver_of([[maybe_unused]] const {struct.name}& m) {{",
                          f"  return {struct.receiver()};", "}"]
        functions += [f'constexpr const char* type_of(const {struct.name}*) {{ return "citylearn::msg::{struct.name}"; }}',
                      f"constexpr std::size_t max_size_of(const {struct.name}*) {{ return {idl.end(struct)}; }}"]
    for path, lines in idl.files.items():
        write(f"{folder}/idl/{os.path.basename(path)[:-4]}.h", "#include <cstdint>", "#include <utility>", "#include <vector>",
              '#include "core/util/fixed_string.h"', *lines, "}")
    classes = [f"class {name} : public {role.name} {{}};" for name, role in kinds]
    write(f"{folder}/idl/objects.h", *map(header_of, idl.files), "namespace citylearn::msg {", *classes, "}")
    write(f"{folder}/idl/message_fields.h", "#include <concepts>", "#include <string>", "#include <type_traits>",
          '#include "idl/objects.h"', "namespace citylearn::msg {", *functions, "}",
          "#define CITYLEARN_OBJECTS(X) \\", *(f"  X({kind.name}) \\" for kind in objects), "",
          "#define CITYLEARN_MESSAGES(X) \\", *(f'  X({name}, "{topic}", k{profile.title()}, {struct.enumerator()}) \\'
                                            for name, struct, topic, profile in idl.topics()), "")


if __name__ == "__main__":
    main(*sys.argv[1:])
