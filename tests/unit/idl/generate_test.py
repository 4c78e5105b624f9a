#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""idl/generate.py: what it writes of a small IDL file, and how it names the mistakes in one."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM = pathlib.Path(__file__).parents[3] / "idl" / "generate.py"
GOOD = """module citylearn { module msg {
  const unsigned long MOST = 4;                 // entries
  enum Mode {
    IDLE,                                       // waits
    TRAIN
  };
  @final struct Header {
    unsigned long protocol;                     //@protocol of the sender
  };
  //@topic(state) @to(name)
  @final struct BigThing {
    Header header;
    Mode task_mode;
    string<64> name;                            //@name(optional) of the thing
    sequence<float, MOST> number;               //@finite metres
    sequence<octet, MOST> flags;                //@length(number) one for each number
    double uptime;                              //@finite @metric(uptime_seconds) seconds "alive"
  };
};
};
"""


class Generate(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def run_on(self, text):
        path = self.folder / "thing.idl"
        path.write_text(text)
        return subprocess.run([sys.executable, PROGRAM, self.folder, path], capture_output=True, text=True)

    def test_it_writes_fields_bounds_checks_and_topics(self):
        self.assertEqual(self.run_on(GOOD).returncode, 0)
        fields = (self.folder / "idl/message_fields.h").read_text()
        for line in ('visitor.protocol("protocol", m.protocol());', 'visitor.nested("header", m.header());',
                     'visitor.enumerator("task_mode", m.task_mode(), TRAIN);', 'visitor("name", m.name());',
                     'visitor("number", m.number(), MOST);', 'check.finite("number", m.number());',
                     'check.length("flags", m.flags().size(), "number", m.number().size(), 0);',
                     'check.name("name", m.name(), true);',
                     'X(BigThing, "citylearn/big_thing", kState, kReceiver)', 'return m.name().c_str();',
                     '#include "idl/objects.h"', r'visitor("citylearn_uptime_seconds", "seconds \"alive\"", m.uptime());'):
            self.assertIn(line, fields)
        forward = (self.folder / "idl/forward.h").read_text()
        self.assertIn("class BigThing;", forward)
        self.assertIn("enum Mode : std::uint32_t;", forward)

    def test_kinds_of_objects_share_two_structs_and_no_topic(self):
        text = GOOD.replace("//@topic(state)", "//@request") + """
  //@object
  @final struct SmallThing {
    double weight;                              //@finite kg
  };
"""
        self.assertEqual(self.run_on(text).returncode, 0)
        fields = (self.folder / "idl/message_fields.h").read_text()
        self.assertIn('X(SmallThingRequest, "citylearn/small_thing_request", kCommand, kReceiver)', fields)
        self.assertIn("  X(SmallThing) ", fields)
        self.assertNotIn("X(BigThing,", fields)
        self.assertIn('const BigThing*) { return "citylearn::msg::BigThing"; }', fields)
        objects = (self.folder / "idl/objects.h").read_text()
        self.assertIn("class SmallThingRequest : public BigThing {};", objects)

    def test_a_mistake_is_named_with_its_file_and_line(self):
        for before, after, line, error in (
                ("double uptime;", "double uptime, other;", 17, "is neither a number"),
                ("double uptime;", "float name;", 17, "not a new field"),
                ("double uptime;", "Other uptime;", 17, "'Other' is neither"),
                ("sequence<octet, MOST>", "sequence<octet>", 16, "is neither"),
                ("sequence<octet, MOST>", "sequence<octet, LEAST>", 16, "unknown bound 'LEAST'"),
                ("length(number)", "length(numbers)", 18, "no sequence 'numbers'"),
                ("length(number)", "length", 16, "does not fit"),
                ("//@name(optional)", "//@finite", 14, "does not fit"),
                ("//@name(optional)", "//@name(maybe)", 14, "does not fit"),
                ("//@finite", "//@finit", 15, "unknown annotation"),
                ("//@name(optional)", "//@metric(name)", 14, "does not fit"),
                ("@metric(uptime_seconds)", "@metric", 17, "does not fit"),
                ('seconds "alive"', "", 17, "does not fit"),
                ("topic(state)", "topic(fast)", 10, "one of state, command, durable"),
                ("@to(name)", "@to(number)", 18, "no string<64> 'number'"),
                ("@to(name)", "@from(some)", 10, "expected @to(FIELD), @from or @from(all)"),
                ("    Header header;\n", "", 17, "first field must be a Header"),
                ("@final struct Big", "struct Big", 11, "must be @final")):
            answer = self.run_on(GOOD.replace(before, after))
            self.assertEqual(answer.returncode, 1, after)
            self.assertIn(f"thing.idl:{line}: ", answer.stderr)
            self.assertIn(error, answer.stderr)


if __name__ == "__main__":
    unittest.main()
