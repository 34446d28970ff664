// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/deploy.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "deploy/tables.hpp"
#include "testing.hpp"
#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

using c_code::Blocks;

TEST(Deploy, NumbersReadBackAsTheSameBits) {
  Random random(1);
  const auto read = [](const std::string& text) { return std::strtod(text.c_str(), nullptr); };
  for (int i = 0; i < 2000; ++i) {
    const double value = random.normal() * std::pow(10.0, random.uniform(-40, 38));
    const std::string text = c_code::number_text(value, false);
    EXPECT_EQ(read(text), value) << text;
    EXPECT_NE(text.find_first_of(".e"), std::string::npos);  // no integer
    const std::string single = c_code::number_text(value, true);
    EXPECT_EQ(std::strtof(single.c_str(), nullptr), float(value)) << single;
    EXPECT_EQ(single.back(), 'f');
    EXPECT_LE(single.size(), text.size() + 1);
  }
  EXPECT_EQ(c_code::number_text(3, false), "3.0");
  EXPECT_EQ(c_code::number_text(-3, true), "-3.0f");
  EXPECT_EQ(c_code::number_text(1e-300, true), "0.0f");
  EXPECT_EQ(message([] { c_code::number_text(-1e39, true); }),
            "model: the number -1e+39 found, at most 3.4e+38 needed in single precision. Use other units");
  for (const bool single : {false, true})
    EXPECT_EQ(message([&] { c_code::number_text(nan, single); }), "model: nan found, finite numbers needed");
}

TEST(Deploy, CommentsDoNotEnd) {
  for (const std::string text :
       {"a*/b", "/*", "*//*/", "?\?/", "?\?\?", "line\nnext", "end\\", "*\\/", "*\xE2\x80\xAE/"}) {
    const std::string safe = c_code::comment_text(text);
    for (const char* part : {"*/", "/*", "?\?", "\n", "\\"}) EXPECT_EQ(safe.find(part), std::string::npos) << safe;
  }
  EXPECT_EQ(c_code::comment_text("angle [rad]"), "angle [rad]");
}

TEST(Deploy, EqualBlocksShareTheirPlace) {
  Blocks blocks;
  for (const double first : {1.0, 2.0, 1.0, 3.0, 2.0}) blocks.add({first, 5.0});
  EXPECT_EQ(blocks.rows(), 5);
  EXPECT_EQ(blocks.count(), 3);
  EXPECT_EQ(blocks.block_of(), (std::vector<Index>{0, 1, 0, 2, 1}));
  EXPECT_EQ(blocks.begins(), (std::vector<Index>{0, 2, 4}));
  EXPECT_TRUE(blocks.same_size());
  blocks.add({1.0});
  EXPECT_FALSE(blocks.same_size());
  EXPECT_EQ(blocks.numbers(), 7);
}

TEST(Deploy, TablesOfPeriodicModelsDoNotGrow) {
  Model model = random_system({4, 2, 2}, 3, 0.9, 2);
  model.period = 3;
  const DeployedCode one = deploy(model);
  EXPECT_EQ(one.name, "observer");
  EXPECT_EQ(one.stored_steps, 3);
  EXPECT_EQ(one.table_bytes, 3 * 8 * (2 * (4 + 2) + 4 * (4 + 2 + 2)));
  EXPECT_EQ(one.state_bytes, 4 * 8 + 8);
  EXPECT_EQ(one.step.multiplications, 2 * (4 + 2) + 4 * (4 + 2 + 2));
  const DeployedCode long_model = deploy(continued(model, 3 * 50));
  EXPECT_EQ(long_model.table_bytes, one.table_bytes + 150);  // one byte for each step says which it is
  const DeployedCode single = deploy(model, {.single_precision = true});
  EXPECT_EQ(single.table_bytes, one.table_bytes / 2);
  EXPECT_EQ(single.step.additions, one.step.additions);
}

TEST(Deploy, RefusesWithTheReason) {
  Model model = random_system({3, 2, 1}, 6, 0.9, 3);
  const auto refused = [](const Model& given, const DeployOptions& options = {},
                          const Controller* controller = nullptr) {
    return message([&] { deploy(given, options, controller); });
  };
  EXPECT_EQ(refused(model), "no exception");
  EXPECT_EQ(refused(model, {.name = "a b"}),
            "name: 'a b' found, a letter, then letters, digits and '_', in all at most 64, needed");
  Model empty;
  empty.outputs = 1;
  EXPECT_EQ(refused(empty), "model: no step found, at least one needed");
  Model late = model;
  late.k_begin = 1'000'000'000'000;
  EXPECT_NE(refused(late).find("model: last step 1000000000005 found"), std::string::npos);
  Model unknown = from_step(model, 2);
  EXPECT_NE(refused(unknown).find("model: an unknown initial state at step 2 found"), std::string::npos);
  EXPECT_EQ(refused(unknown, {.start_from_zero = true}), "no exception");
  unknown.initial_state = InitialState::unknown;
  unknown.x0_mean = Vector::Ones(3);
  unknown.x0_cov = Matrix::Identity(3, 3);
  EXPECT_EQ(refused(unknown), "no exception");

  const CostWeights weights{.output = {Matrix::Identity(2, 2)}, .input = {Matrix::Identity(1, 1)}};
  const Controller controller = lqr(model, weights).controller;
  EXPECT_EQ(refused(model, {}, &controller), "no exception");
  Controller other = controller;
  other.K[1] = Matrix::Zero(1, 2);
  EXPECT_EQ(refused(model, {}, &other), "controller: a gain of 1 x 2 found at step 1, 1 x 3 of the model needed");
  Model turned = model;
  turned.step[2].D()(0, 0) += 1;
  EXPECT_EQ(refused(turned, {}, &controller),
            "model: other matrices or coordinates found, those of the model needed from which the controller was "
            "designed");
  other = controller;
  other.begin = 1;
  EXPECT_EQ(refused(model, {}, &other), "model: steps 0 to 5 found, 1 to 6 of the controller needed");
  other = controller;
  other.u_nominal(2, 0) = 1;
  EXPECT_EQ(refused(model, {}, &other), "controller: another nominal input found at step 2, that of the model needed");
  other = controller;
  other.K[3](0, 1) = nan;
  EXPECT_EQ(refused(model, {}, &other), "controller: a gain that is not finite found at step 3");
  other = controller;
  other.feedforward = Matrix::Constant(6, 1, nan);
  EXPECT_EQ(refused(model, {}, &other),
            "controller: a feedforward or nominal value that is not finite found, finite ones needed");
}

TEST(Deploy, SaysOperationsInWords) {
  EXPECT_EQ(in_words(Operations{44, 46, 0}), "44 multiplications, 46 additions");
  EXPECT_EQ(in_words(Operations{3, 2, 1}), "3 multiplications, 2 additions, 1 division");
}

TEST(Deploy, NamesTheHeaderAfterTheSource) {
  const Model model = random_system({1, 1, 1}, 1, 0.9, 3);
  EXPECT_EQ(message([&] { save_deployed(model, "folder/2nd.c"); }),
            "name: '2nd' found, which is that of the file, a letter, then letters, digits and '_', in all at most 64, "
            "needed. State another name");
  EXPECT_EQ(deployed_header("folder/my-plant.v2.c"), "folder/my-plant.v2.h");
  for (const char* bad : {"a.h", "a", "a b.c", "a\".c", ".c"}) EXPECT_THROW(deployed_header(bad), IoError) << bad;
}

}  // namespace
}  // namespace tokid::testing
