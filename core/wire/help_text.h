// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

namespace CLI {
class App;
class FormatterBase;
}  // namespace CLI

namespace citylearn {

/// Gives a program its `--help`: 80 columns, after each option its default and what is allowed, "[2; 1..1000]".
/// Parameters of plug-ins, whose groups have names in lower case, are left to `--help-all`, which programs with such
/// parameters get too. Call it when all options are there.
void add_help(CLI::App& app);

}  // namespace citylearn
