// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/learned_files.h"

#include <gtest/gtest.h>

namespace citylearn::testing {
namespace {

TEST(FeatureRecipe, NamesWhatTheReductionWasLearnedOn) {
  const FeatureRecipe recipe{"hog_vlad-1 vlad-share=0.2 of hog-1, vlad-2", "64 running 0.2", 0xAB};
  EXPECT_EQ(recipe.text(), "hog_vlad-1 vlad-share=0.2 of hog-1, vlad-2 | 64 running 0.2 of 00000000000000ab");
  EXPECT_EQ(recipe.encoder_option(), "hog_vlad");
  const auto read = FeatureRecipe::parse(recipe.text());
  ASSERT_TRUE(read);
  EXPECT_EQ(read->encoder, recipe.encoder);
  EXPECT_EQ(read->reduction, recipe.reduction);
  EXPECT_EQ(read->learned_on, 0xABu);
  const FeatureRecipe none{"raw84-2", "0 none 0.2"};
  EXPECT_EQ(none.text(), "raw84-2 | 0 none 0.2");
  EXPECT_EQ(FeatureRecipe::parse(none.text())->learned_on, 0u);
  EXPECT_EQ(FeatureRecipe::parse("hog-1 | drive of home.reduction")->reduction, "drive of home.reduction");
  EXPECT_FALSE(FeatureRecipe::parse("features"));
}

TEST(FeatureRecipe, AgreesUnlessSomethingIsKnownToDiffer) {
  const FeatureRecipe one{"hog-1", "64 running 0.2", 1};
  FeatureRecipe other = one;
  EXPECT_TRUE(one.agrees(other));
  other.learned_on = 2;
  EXPECT_FALSE(one.agrees(other));
  other.learned_on = 0;
  EXPECT_TRUE(one.agrees(other) && other.agrees(one));
  other.reduction = "64 running 0.25";
  EXPECT_FALSE(one.agrees(other));
}

}  // namespace
}  // namespace citylearn::testing
