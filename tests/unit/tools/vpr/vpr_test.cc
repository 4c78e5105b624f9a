// SPDX-License-Identifier: Apache-2.0
// citylearn_vpr from the outside: its files, its table, its complaints.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/util/random.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

struct Ended {
  int status = -1;
  std::string text;  // standard output and error
};

Ended vpr(const std::string& arguments) {
  const Folder folder;
  Service program(split(CITYLEARN_VPR " " + arguments, ' '), folder / "log");
  const int status = program.wait(seconds(100)).value_or(-1);
  return {status, program.output()};
}

/// summer.csv, and fall.csv with noise on it, which lacks those from `hole` to `after`; frames of 16 features.
void write_features(const Folder& folder, int frames = 60, int hole = 0, int after = 0) {
  Random random(3);
  std::ofstream summer(folder / "summer.csv"), fall(folder / "fall.csv");
  for (int frame = 0; frame < frames; ++frame)
    for (int d = 0; d < 16; ++d) {
      const double value = random.normal(), other = value + 0.5 * random.normal();
      const char* end = d < 15 ? "," : "\n";
      summer << value << end;
      if (frame < hole || frame >= after) fall << other << end;
    }
}

TEST(VprTool, FeaturesNeedNoEncoder) {
  const Folder data, output;
  write_features(data);
  const Ended ended = vpr("--dataset plain --data " + data.path() +
                          " --dimension 0,8 --centring own,none --method nearest,csls+sequence,seqslam,mlp --sequence 5"
                          " --mlp-epochs 20 --output " +
                          output.path());
  ASSERT_EQ(ended.status, 0) << ended.text;
  const std::string csv = contents(output / "results.csv");
  EXPECT_EQ(lines_of(csv).size(), 1u + 2 * 2 * 4) << csv;
  const nlohmann::json json = nlohmann::json::parse(contents(output / "results.json"));
  ASSERT_EQ(json["rows"].size(), 16u);
  for (const auto& row : json["rows"]) {
    EXPECT_EQ(row["query"], "fall");
    EXPECT_EQ(row["queries"], 60);
    EXPECT_LE(row["auc"].get<double>(), row["recall_1"].get<double>() + 1e-9);
    EXPECT_LE(row["recall_1"].get<double>(), row["recall_5"].get<double>());
    EXPECT_LE(row["recall_1_interval"][0].get<double>(), row["recall_1"].get<double>());
    const bool single = row["method"] == "nearest", sequence = row["method"] == "csls+sequence";
    const double least = sequence ? 1 : !single ? 0 : row["dimension"] == 16 ? 0.9 : 0.6;
    EXPECT_GE(row["recall_1"].get<double>(), least) << row;
  }
  const nlohmann::json curves = nlohmann::json::parse(contents(output / "curves.json"))["curves"];
  ASSERT_EQ(curves.size(), 16u);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    const nlohmann::json &curve = curves[i], &row = json["rows"][i];
    EXPECT_EQ(curve["method"], row["method"]);
    ASSERT_EQ(curve["recall"].size(), curve["precision"].size());
    EXPECT_LE(curve["recall"].size(), 60u) << "a point a query at most";
    EXPECT_EQ(curve["recall"].back(), row["recall_1"]) << "every query answered";
    EXPECT_EQ(curve["auc"], row["auc"]);
  }
  for (const std::string method : {"nearest", "csls-sequence", "seqslam", "mlp"}) {
    const std::string svg = contents(output / ("pr-fall-" + method + ".svg"));
    EXPECT_TRUE(contains(svg, "<svg ")) << method;
    EXPECT_TRUE(contains(svg, "recall"));
    EXPECT_TRUE(contains(svg, "</svg>"));
    EXPECT_FALSE(contains(svg, "nan"));
  }
  const cv::Mat picture = cv::imread(output / "similarity-features-16-own-fall-nearest.png");
  EXPECT_EQ(picture.size(), cv::Size(60, 60));
}

TEST(VprTool, RightAnswersWithinMetres) {
  const auto recall = [](const std::string& truth) {
    const Folder output;
    const Ended ended =
        vpr("--synthetic-images 0 --synthetic-frames 100 --query night --output " + output.path() + truth);
    EXPECT_EQ(ended.status, 0) << ended.text;
    const auto results = nlohmann::json::parse(contents(output / "results.json"));
    EXPECT_TRUE(contains(contents(output / "index.html"), results["ground_truth"].get<std::string>()));
    EXPECT_LE(results["rows"][0]["recall_10"], results["rows"][0]["recall_20"]);
    return results["rows"][0]["recall_1"].get<double>();
  };
  EXPECT_EQ(recall(" --radius 3"), recall(" --tolerance 0")) << "frames lie 10 m apart, a little more or less";
}

/// Four queries equal four places. All four have one confidence, so two that were judged wrong would halve the area.
TEST(VprTool, QueriesWithoutAPlaceAreNotJudged) {
  const Folder data, output;
  for (const std::string name : {"fall", "summer"}) make_file(data / (name + ".csv"), "1,0\n0,1\n-1,0\n0,-1\n");
  make_file(data / "summer.poses.csv", "metres\n0\n10\n20\n30\n");
  make_file(data / "fall.poses.csv", "metres\n0\n10\nnan\nnan\n");
  const Ended ended =
      vpr("--data " + data.path() + " --dimension 0 --centring none --radius 3 --output " + output.path());
  EXPECT_TRUE(contains(ended.text, "fall: 2 of 4 frames have no known place and are not judged")) << ended.text;
  const auto row = nlohmann::json::parse(contents(output / "results.json"))["rows"][0];
  EXPECT_EQ(row["recall_1"], 1);
  EXPECT_EQ(row["auc"], 1);
  // A reference frame without a place is no answer: the query in which it alone looks equal has the next one, 45
  // degrees away, whose place is right.
  make_file(data / "fall.csv", "0,1\n0,-1\n");
  make_file(data / "summer.csv", "0,1\n-1,-1\n1,1\n0,-1\n");
  make_file(data / "fall.poses.csv", "metres\n0\n10\n");
  make_file(data / "summer.poses.csv", "metres\n0\n10\nnan\nnan\n");
  const Ended other =
      vpr("--data " + data.path() + " --dimension 0 --centring none --radius 3 --output " + output.path());
  EXPECT_TRUE(contains(other.text, "summer: 2 of 4 frames have no known place and are no answers")) << other.text;
  EXPECT_EQ(nlohmann::json::parse(contents(output / "results.json"))["rows"][0]["recall_1"], 1);
  make_file(data / "spring.csv", "1\n2\n3\n4\n");
  EXPECT_TRUE(contains(vpr("--data " + data.path() + " --query spring --output " + output.path()).text,
                       "summer and spring: one has 2 features a frame, the other 1 (0: pictures)"));
}

/// The query lacks 32 of 96 places, where it shows others: judged there, at most 64 of 96 answers, .67, would be right.
TEST(VprTool, PlacesThatAQueryLacksAreNotJudged) {
  const Folder data, output;
  write_features(data, 96, 40, 72);
  const Ended ended =
      vpr("--data " + data.path() + " --dimension 0 --centring none --align-by sight --output " + output.path());
  EXPECT_TRUE(contains(ended.text, "fall: 32 of 96 frames have no known place and are not judged")) << ended.text;
  const auto row = nlohmann::json::parse(contents(output / "results.json"))["rows"][0];
  EXPECT_GT(row["recall_1"].get<double>(), 0.9);
}

TEST(VprTool, DimensionsThatCannotBeAreLeftOut) {
  const Folder data, output;
  write_features(data);
  const std::string common = "--dataset plain --data " + data.path() + " --output " + output.path();
  const Ended some = vpr(common + " --dimension 8,512");
  EXPECT_EQ(some.status, 0) << some.text;
  EXPECT_TRUE(contains(some.text, "512"));
  EXPECT_EQ(lines_of(contents(output / "results.csv")).size(), 2u);
  EXPECT_EQ(vpr(common + " --dimension 512").status, 1);
}

TEST(VprTool, ComplainsInOneLine) {
  const Folder data, output;
  write_features(data);
  const std::string common = "--dataset plain --data " + data.path() + " --output " + output.path() + " ";
  const auto complaint = [&](const std::string& arguments, int status) {
    const Ended ended = vpr(common + arguments);
    EXPECT_EQ(ended.status, status) << arguments << ": " << ended.text;
    EXPECT_EQ(lines_of(ended.text).size(), 1u) << ended.text;
    return ended.text;
  };
  EXPECT_TRUE(contains(complaint("--method nearst", 1), "known: nearest"));
  complaint("--method seqslam+csls", 1);
  complaint("--method csls+mlp", 1);
  complaint("--sequence 4", 1);
  complaint("--slowest 2 --fastest 1", 1);
  complaint("--measure hamming", 2);
  complaint("--tolerance -1", 2);
  EXPECT_TRUE(contains(complaint("--radius 5", 1), "--radius"));
  EXPECT_TRUE(contains(complaint("--query spring", 1), "fall, summer"));
  EXPECT_TRUE(contains(complaint("--encoder hog", 1), "--encoder"));
  complaint("--output " + data.path() + "/summer.csv/below", 1);
  EXPECT_FALSE(std::filesystem::exists(output / "results.csv"));
}

TEST(VprTool, PicturesGoThroughTheDefaultEncoder) {
  const Folder output;
  const Ended ended = vpr("--synthetic-frames 40 --query fall --dimension 16 --output " + output.path());
  ASSERT_EQ(ended.status, 0) << ended.text;
  const auto row = nlohmann::json::parse(contents(output / "results.json"))["rows"][0];
  EXPECT_EQ(row["encoder"], kDefaultEncoder);
  EXPECT_GT(row["recall_1"].get<double>(), 0.8);
  // The page shows queries beside answers and truth: twelve columns of three pictures.
  const std::string matches = "matches-" + std::string(kDefaultEncoder) + "-16-running-fall-nearest.jpg";
  EXPECT_TRUE(contains(contents(output / "index.html"), matches));
  const cv::Mat sheet = cv::imread(output / matches);
  EXPECT_EQ(sheet.cols, 12 * (160 + 2 * 4 + 6));
}

TEST(VprTool, PicturesThroughAnEncoderAndAStore) {
  const std::string data = testing::real_data(CITYLEARN_SOURCE_DIR, "nordland-64x32");
  if (data.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const Folder output, store;
  const std::string common =
      "--dataset plain --data " + data +
      " --query winter --step 10 --encoder hog --centring own --method nearest,sequence --store " + store.path() +
      " --output " + output.path();
  const Ended first = vpr(common);
  ASSERT_EQ(first.status, 0) << first.text;
  const auto rows = nlohmann::json::parse(contents(output / "results.json"))["rows"];
  EXPECT_EQ(rows[0]["queries"], 358);
  EXPECT_GT(rows[0]["recall_1"].get<double>(), 0.7);
  EXPECT_GT(rows[1]["recall_1"].get<double>(), 0.99);
  // What was kept gives the same answers.
  ASSERT_EQ(vpr(common).status, 0);
  const auto again = nlohmann::json::parse(contents(output / "results.json"))["rows"];
  for (const int i : {0, 1}) {
    EXPECT_EQ(rows[i]["recall_1"], again[i]["recall_1"]);
    EXPECT_EQ(rows[i]["auc"], again[i]["auc"]);
  }
}

}  // namespace
}  // namespace citylearn::testing
