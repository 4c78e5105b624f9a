// SPDX-License-Identifier: Apache-2.0
// Encoders that are Python functions: what comes to them, and what is said of those that do wrong.
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>

#include <map>
#include <opencv2/core.hpp>

#include "core/util/sha256.h"
#include "encoder_service/encoder_options.h"
#include "tests/paths.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// FILE.py: a function with this body, whose parameter is `p`. It notes its process and how many pictures it gets.
std::string program(const std::string& body, const std::string& options = "") {
  return "import os, sys, time\nimport numpy\nimport citylearn\n\ndef encode(p):\n"
         "    open(__file__ + '.log', 'a').write(f'{os.getpid()} {len(p)}\\n')\n"
         "    v = numpy.stack([*p.mean((1, 2)).T, *[numpy.full(len(p), s) for s in p.shape[1:3]]], 1, "
         "dtype='float32')\n"
         "    seven = p.shape[1] == 7\n    " +
         body + "\n    return v\n\ncitylearn.serve_encoder(encode" + options + ")\n";
}

class PythonEncoder : public ::testing::Test {
 protected:
  void SetUp() override { interpret_by("/usr/bin/python3"); }
  static void interpret_by(const std::string& path) { ::setenv("CITYLEARN_PYTHON", path.c_str(), 1); }
  std::unique_ptr<Encoder> make(const std::string& text, const std::string& name = "e.py") {
    make_file(folder_ / name, text);
    const auto [entry, files] = choose_encoder(folder_ / name, {});
    return entry.create(Parameters(entry.name, entry.parameters, {{"seconds", 1}}), files);
  }
  std::string refusal(const std::string& text) {
    return error_of([&] { make(text); });
  }
  std::string log() const { return contents(folder_ / "e.py.log"); }
  Folder folder_;
};

cv::Mat picture(int height, int width) { return cv::Mat(height, width, CV_8UC3, cv::Scalar(10, 20, 30)); }

Eigen::MatrixXf encode(Encoder& encoder, const std::vector<cv::Mat>& pictures) { return encoder.encode(pictures); }

/// Returns the second word of each line: the sizes of batches.
std::vector<int> batches(const std::string& log) {
  std::istringstream in(log);
  std::vector<int> sizes;
  for (std::string process, size; in >> process >> size;) sizes.push_back(std::stoi(size));
  return sizes;
}

TEST_F(PythonEncoder, GetsRedGreenBlueInBatchesOfTheSizeItNames) {
  const auto encoder = make(program("os.write(1, b'\\0\\1\\2 printed')", ", size=(8, 4), batch=2"));
  EXPECT_EQ(encoder->spec().dimension, 5);
  EXPECT_EQ(encoder->spec().batch, 2);
  const Eigen::MatrixXf numbers = encode(*encoder, {picture(9, 9), picture(4, 8), picture(2, 2)});
  Eigen::VectorXf expected(5);
  expected << 30, 20, 10, 4, 8;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(numbers.col(i), expected);
  EXPECT_EQ(batches(log()), (std::vector<int>{1, 1, 2, 2, 1})) << "the trial, then these";
}

TEST_F(PythonEncoder, GetsPicturesAsTheyAreWhenItNamesNoSize) {
  const auto encoder = make(program(""));
  const Eigen::MatrixXf numbers = encode(*encoder, {picture(3, 5), picture(3, 5), picture(6, 2)});
  EXPECT_EQ(numbers.row(3), (Eigen::RowVector3f(3, 3, 6)));
  EXPECT_EQ(numbers.row(4), (Eigen::RowVector3f(5, 5, 2)));
  EXPECT_EQ(batches(log()), (std::vector<int>{1, 1, 2, 2, 1})) << "one size a call";
}

TEST_F(PythonEncoder, IsNamedByTheFilesBytesAndItsVersion) {
  const std::string text = program("");
  const std::string name = make(text)->spec().name;
  EXPECT_EQ(name, "python-1 1 " + sha256(text).substr(0, 16));
  EXPECT_EQ(make(text, "same.py")->spec().name, name);
  EXPECT_NE(make(text + "\n")->spec().name, name);
  EXPECT_TRUE(make(program("", ", version='dino-2'"))->spec().name.starts_with("python-1 dino-2 "));
}

TEST_F(PythonEncoder, ItsThreadsSleepWhileTheyWaitUnlessTheUserNamesAPolicy) {
  const std::string text = program("v[:] = ['passive', 'active'].index(os.environ['OMP_WAIT_POLICY'])");
  ::unsetenv("OMP_WAIT_POLICY");
  EXPECT_EQ(encode(*make(text), {picture(8, 6)})(0, 0), 0);
  ::setenv("OMP_WAIT_POLICY", "active", 1);
  EXPECT_EQ(encode(*make(text), {picture(8, 6)})(0, 0), 1);
  ::unsetenv("OMP_WAIT_POLICY");
}

TEST_F(PythonEncoder, AWrongFileIsOneLineThatNamesIt) {
  const std::map<std::string, std::string> wrong = {
      {program("raise ValueError('too long')"), "e.py:9: ValueError: too long"},
      {program("v[0, 1] = numpy.nan"), "NaN or infinite numbers for picture 0 of 1"},
      {program("v = v * 1e39 * 1e39"), "NaN or infinite numbers"},
      {program("v = v[0]"), "shape (5,) for 1 pictures, not an array of shape (1, 1 to 65536)"},
      {program("v = (v, v[:, :2])"), "gives a tuple for 1 pictures, not an array of shape (1, 1 to 65536)"},
      {program("v = (row for row in v)"), "gives a generator for 1 pictures"},
      {program("v = None"), "gives a NoneType for 1 pictures"},
      {program("v = v.astype(object)"), "type object, not float32"},
      {program("", ", dimension=6"), "shape (1, 5) for 1 pictures, not an array of shape (1, 6)"},
      {program("v = v.astype(int)"), "type int64, not float32"},
      {program("v = 'text'"), "gives a str for 1 pictures"},
      {program("v = numpy.random.rand(len(p), 5)"), "other numbers each time for the same picture"},
      {program("v = v - v.mean(0) + 1"), "other numbers for a picture when another is beside it"},
      {program("raise OSError('\\n\\nno weights:\\n  a, b')"), "e.py:9: OSError: no weights: a, b"},
      {program("sys.exit(4)"), "e.py:9: SystemExit: 4"},
      {program("os._exit(3)"), "e.py: /usr/bin/python3 ended with status 3"},
      {program("os.kill(os.getpid(), 11)"), "ended by signal: Segmentation fault"},
      {program("", ", size=0"), "size is 0, not a whole number from 1 to 4096"},
      {program("", ", size=(1, 2, 3)"), "size is not (width, height)"},
      {program("", ", batch=0"), "batch is 0"},
      {program("", ", version='a b'"), "version is 'a b'"},
      {"import no_such_module", "e.py:1: ModuleNotFoundError: No module named 'no_such_module' (the interpreter is "},
      {"\nx = (", "e.py:2: SyntaxError"},
      {"import citylearn\ncitylearn.serve_encoder(3)", "3 is not a function"},
      {"", "does not call citylearn.serve_encoder"},
  };
  for (const auto& [text, said] : wrong) {
    const std::string line = refusal(text);
    EXPECT_TRUE(contains(line, said)) << text;
    EXPECT_TRUE(line.starts_with(folder_ / "e.py")) << line;
  }
  interpret_by(folder_ / "none");
  EXPECT_TRUE(contains(refusal(program("")), "cannot start '" + (folder_ / "none")));
  make_file(folder_ / "bare", "#!/bin/sh\nexec /usr/bin/python3 -S \"$@\"\n");  // without Debian's packages
  std::filesystem::permissions(folder_ / "bare", std::filesystem::perms::owner_all);
  interpret_by(folder_ / "bare");
  EXPECT_TRUE(contains(refusal(program("")), "No module named 'numpy' (the interpreter is "));
}

TEST_F(PythonEncoder, TakesListsAndNumbersOf16Bits) {
  for (const std::string body : {"v = [[float(x) for x in row] for row in v]", "v = v.astype('float16')"})
    EXPECT_EQ(encode(*make(program(body)), {picture(8, 6)})(4, 0), 6) << body;
}

TEST_F(PythonEncoder, AWorkerMayImportTheFileWhereThePackageIsInstalled) {
  make_file(folder_ / "citylearn.py", contents(CITYLEARN_SOURCE_DIR "/python/citylearn/encoder.py"));
  make(
      "import multiprocessing\nimport numpy\nimport citylearn\n\ndef encode(p):\n    return numpy.ones((len(p), 3))\n\n"
      "if __name__ == '__main__':\n    worker = multiprocessing.get_context('spawn').Process(target=abs, args=[1])\n"
      "    worker.start()\n    worker.join()\n    assert worker.exitcode == 0\n\ncitylearn.serve_encoder(encode)\n");
}

TEST_F(PythonEncoder, AFaultInTheMiddleIsSaidAndTheNextPictureEncoded) {
  const std::map<std::string, std::string> wrong = {
      {"if seven: raise KeyError(3)", "e.py:9: KeyError: 3"},
      {"v = v[:, :4] if seven else v", "shape (1, 4) for 1 pictures, not an array of shape (1, 5)"},
      {"v = v / 0 if seven else v", "NaN or infinite numbers for picture 0 of 1"},
  };
  for (const auto& [body, said] : wrong) {
    const auto encoder = make(program(body));
    EXPECT_TRUE(contains(error_of([&] { encode(*encoder, {picture(7, 7)}); }), said));
    EXPECT_EQ(encode(*encoder, {picture(8, 6)})(4, 0), 6);
  }
}

TEST_F(PythonEncoder, ADeadProcessIsStartedAgainOnce) {
  const std::string once = "if seven and not os.path.exists(__file__ + '.x'): open(__file__ + '.x', 'w'); os._exit(9)";
  const auto encoder = make(program(once));
  EXPECT_EQ(encode(*encoder, {picture(7, 6)})(4, 0), 6);
  EXPECT_EQ(batches(log()), (std::vector<int>{1, 1, 2, 1, 1, 1, 2, 1})) << "two trials, the picture twice";
  const auto always = make(program("if seven: os._exit(9)"));
  EXPECT_TRUE(contains(error_of([&] { encode(*always, {picture(7, 7)}); }), "ended with status 9 twice while"));
  const auto changed = make(program("if seven: os._exit(9)"));
  make_file(folder_ / "e.py", program(""));
  EXPECT_TRUE(contains(error_of([&] { encode(*changed, {picture(7, 7)}); }), "has changed since"));
}

TEST_F(PythonEncoder, AHangingFunctionIsNamedAndKilled) {
  auto encoder = make(program("while seven: time.sleep(1)"));
  EXPECT_TRUE(contains(error_of([&] { encode(*encoder, {picture(7, 7)}); }), "has not encoded a batch within 1 s"));
  const int process = std::stoi(log());
  EXPECT_EQ(::kill(process, 0), 0);
  encoder.reset();
  EXPECT_EQ(::kill(process, 0), -1) << "its process goes with it";
}

}  // namespace
}  // namespace citylearn::testing
