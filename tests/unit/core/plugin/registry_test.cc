// SPDX-License-Identifier: Apache-2.0
#include "core/plugin/registry.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const std::vector<ParameterSpec> kSpecs = {
    {.name = "rate", .help = "step size", .default_value = 0.5, .minimum = 0, .maximum = 1},
    {.name = "layers", .help = "number of layers", .default_value = 2, .minimum = 1, .maximum = 8, .integer = true},
    {.name = "bias", .help = "0 or 1", .default_value = 1, .minimum = 0, .maximum = 1, .integer = true},
};

std::string parameter_refusal(const std::map<std::string, double>& values) {
  return error_of([&] { Parameters("network 'mlp'", kSpecs, values); });
}

TEST(Parameters, DefaultsAndGivenValues) {
  const Parameters parameters("network 'mlp'", kSpecs, {{"layers", 3}});
  EXPECT_EQ(parameters["rate"], 0.5);
  EXPECT_EQ(parameters.integer("layers"), 3);
  EXPECT_TRUE(parameters.flag("bias"));
  EXPECT_EQ(parameters.values().size(), 3u);
  EXPECT_THROW(parameters["depth"], Error) << "it was not declared";
}

TEST(Parameters, WrongOnesAreNamed) {
  EXPECT_EQ(parameter_refusal({{"rate", 0}, {"layers", 8}}), "") << "bounds are allowed";
  EXPECT_EQ(parameter_refusal({{"depth", 3}}), "network 'mlp': unknown parameter 'depth' (known: rate, layers, bias)");
  EXPECT_EQ(parameter_refusal({{"rate", 1.5}}), "network 'mlp'.rate: is 1.5, must be 0..1");
  EXPECT_EQ(parameter_refusal({{"layers", 0}}), "network 'mlp'.layers: is 0, must be 1..8");
  EXPECT_NE(parameter_refusal({{"rate", std::nan("")}}), "");
  EXPECT_EQ(parameter_refusal({{"layers", 2.5}}), "network 'mlp'.layers: is 2.5, must be a whole number");
}

struct Shape {
  virtual ~Shape() = default;
  virtual double area() const = 0;
};
struct Square : Shape {
  explicit Square(double s) : side(s) {}
  double area() const override { return side * side; }
  double side;
};
using Shapes = Registry<Shape, int>;
const Shapes::Registration square_registration({"square",
                                                "four sides",
                                                {{.name = "side", .help = "metres", .default_value = 2, .maximum = 9}},
                                                [](const Parameters& p, int scale) {
                                                  return std::make_unique<Square>(p["side"] * scale);
                                                }});
const Shapes::Registration circle_registration({"circle", "no sides", {}, [](const Parameters&, int) {
                                                  return nullptr;
                                                }});

TEST(Registry, FindsSortsAndCreates) {
  ASSERT_EQ(Shapes::instance().entries().size(), 2u);
  EXPECT_EQ(Shapes::instance().entries()[0]->name, "circle");
  const Shapes::Entry& entry = Shapes::instance().find("shape", "square");
  EXPECT_EQ(entry.create(Parameters("square", entry.parameters, {}), 3)->area(), 36);
}

TEST(Registry, UnknownListsTheKnown) {
  EXPECT_EQ(error_of([&] { Shapes::instance().find("shape", "cube"); }),
            "unknown shape 'cube' (known: circle, square)");
}

}  // namespace
}  // namespace citylearn::testing
