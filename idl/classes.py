# SPDX-License-Identifier: Apache-2.0
"""C++ classes for the structs of idl/ and core/ros2/msg/, with the accessors that IDL compilers of DDS give them."""

NUMBERS = {"octet": "std::uint8_t", "boolean": "bool", "short": "std::int16_t", "unsigned short": "std::uint16_t",
           "long": "std::int32_t", "unsigned long": "std::uint32_t", "long long": "std::int64_t",
           "unsigned long long": "std::uint64_t", "float": "float", "double": "double"}
SIZES = {"octet": 1, "boolean": 1, "short": 2, "unsigned short": 2, "long": 4, "unsigned long": 4, "long long": 8,
         "unsigned long long": 8, "float": 4, "double": 8}


def class_of(name, fields):
    """Returns the lines of a class. `fields` maps each field's name to its C++ type and whether it is a number or an enum."""
    lines = [f"class {name} {{", " public:"]
    for field, (kind, plain) in fields.items():
        if plain:
            lines += [f"  {kind} {field}() const {{ return {field}_; }}",
                      f"  void {field}({kind} value) {{ {field}_ = value; }}"]
        else:
            lines += [f"  const {kind}& {field}() const {{ return {field}_; }}",
                      f"  void {field}(const {kind}& value) {{ {field}_ = value; }}",
                      f"  void {field}({kind}&& value) {{ {field}_ = std::move(value); }}"]
        lines += [f"  {kind}& {field}() {{ return {field}_; }}"]
    lines += [f"  bool operator==(const {name}&) const = default;", "", " private:"]
    return lines + [f"  {kind} {field}_{{}};" for field, (kind, _) in fields.items()] + ["};"]
