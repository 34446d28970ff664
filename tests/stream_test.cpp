// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/stream.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "io/formats/provenance_text.hpp"
#include "large/decide.hpp"
#include "large/reader.hpp"
#include "members.hpp"
#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/io.hpp"

namespace tokid::testing {
namespace {

namespace fs = std::filesystem;

class Stream : public ::testing::Test {
 public:
  Stream() : folder_(fs::temp_directory_path() / ("tokid-stream-" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~Stream() override { fs::remove_all(folder_); }

 protected:
  fs::path data(const Ensemble& e) const {
    save_ensemble(e, folder_ / "data.h5");
    return folder_ / "data.h5";
  }
  fs::path model() const { return folder_ / "model.h5"; }

  struct Both {
    Streamed streamed;
    Model model;
  };
  Both stream(const Ensemble& e, Index block, const IdentifyOptions& options = {}) const {
    StreamOptions o;
    o.identify = options;
    o.block = block;
    Both both;
    const EnsembleFile file(data(e));
    both.streamed = identify_stream(file, model(), o);
    both.model = load_model(model());
    return both;
  }

  fs::path folder_;
};

// Two that agree where both have steps; rounding errors of unlike factorisations, in systems of gain one to ten.
void expect_same(const Model& a, const Model& b) {
  EXPECT_EQ(a.k_begin, b.k_begin);
  EXPECT_EQ(a.k_end(), b.k_end());
  EXPECT_EQ(state_dims(a), state_dims(b));
  EXPECT_EQ(a.method, b.method);
  EXPECT_EQ(a.initial_state, b.initial_state);
  EXPECT_LE(kinematically_similar(a, b, 1e-9, 20).max_difference, 1e-9);
}

Model slow_system(Index steps) { return oscillator(steps); }

TEST_F(Stream, ReadsWhatLoadEnsembleReads) {
  Ensemble e = experiments(slow_system(50), {.experiments = 19, .seed = 3, .free_responses = 2});
  e.y(4, 17, 0) = nan;
  e.length.assign(19, 50);
  e.length[7] = 31;
  for (Index k = 31; k < 50; ++k) e.input(k).row(7).setConstant(nan), e.output(k).row(7).setConstant(nan);
  e.initial_state = InitialState::zero;
  for (int n = 1; n <= 19; ++n) e.experiment_names.push_back(std::to_string(n));
  const EnsembleFile file(data(e));
  EXPECT_EQ(file.experiments(), 19);
  EXPECT_EQ(file.steps(), 50);
  EXPECT_EQ(file.free_responses(), 2);
  for (const auto& [begin, end] : {std::pair<Index, Index>{0, 50}, {0, 1}, {13, 40}, {31, 50}, {49, 50}}) {
    const Ensemble part = file.read(begin, end), expected = stretch(e, begin, end);
    EXPECT_EQ(fingerprint(part), fingerprint(expected));
    EXPECT_EQ(part.length, expected.length);
    EXPECT_EQ(part.experiment_names, e.experiment_names);
    EXPECT_EQ(part.initial_state, expected.initial_state);
    EXPECT_EQ(part.free.y, e.free.y.middleCols(begin * e.outputs(), (end - begin) * e.outputs()));
  }
  EXPECT_THROW(file.read(10, 10), std::invalid_argument);
  EXPECT_THROW(file.read(10, 51), std::invalid_argument);
}

TEST_F(Stream, TheReaderHandsOutEachBlockToWhoeverAsks) {
  const Ensemble e = experiments(slow_system(60), {.experiments = 5, .seed = 4});
  const EnsembleFile file(data(e));
  stream::BlockLayout layout;
  layout.steps = 60;
  layout.count = 7;
  layout.before = 3;
  layout.after = 2;
  const auto expect_block = [&](const Ensemble& found, Index i) {
    const stream::Block block = layout.block(i);
    EXPECT_EQ(fingerprint(found), fingerprint(stretch(e, block.first, block.last))) << i;
  };
  for (const Index stride : {1, 2, 3})
    for (const Index ahead : {1, 2, 20}) {
      std::vector<Index> blocks;
      for (Index i = stride - 1; i < layout.count; i += stride) blocks.push_back(i);
      stream::Reader reader(file, layout, blocks, ahead);
      for (const Index i : blocks) expect_block(reader.take(i), i);
    }
  {
    // Out of order, as threads may ask: two blocks wait, and a third one comes once one of them is taken.
    stream::Reader reader(file, layout, {0, 1, 2, 4}, 2);
    expect_block(reader.take(1), 1);
    expect_block(reader.take(2), 2);
    expect_block(reader.take(0), 0);
  }
  const stream::Reader unused(file, layout, {0, 1}, 1);  // goes away with blocks that nobody wants
}

TEST_F(Stream, TheReaderPassesOnWhatWentWrong) {
  const Ensemble e = experiments(slow_system(3000), {.experiments = 20, .seed = 5});
  const fs::path path = data(e);
  const EnsembleFile file(path);
  fs::resize_file(path, fs::file_size(path) / 4);
  stream::BlockLayout layout;
  layout.steps = 3000;
  layout.count = 2;
  stream::Reader reader(file, layout, {0, 1}, 1);
  EXPECT_THROW(reader.take(0), IoError);
  EXPECT_THROW(reader.take(1), IoError);
}

TEST_F(Stream, FingerprintsOfFilesAndEnsemblesAgree) {
  const Ensemble e = experiments(slow_system(200), {.experiments = 30});
  const Both both = stream(e, 60);
  EXPECT_TRUE(has_seen(both.model.provenance, e));
  EXPECT_FALSE(has_seen(both.model.provenance, stretch(e, 0, 199)));
}

// Lengths that divide T, that don't, and one of everything.
class BlockLength : public Stream, public ::testing::WithParamInterface<Index> {};

TEST_P(BlockLength, WithoutNoiseFromZero) {
  const Ensemble e = experiments(slow_system(300), {.experiments = 25, .seed = 4});
  const Identification whole = identify(e);
  const Both both = stream(e, GetParam());
  expect_same(both.model, whole.model);
  EXPECT_EQ(both.streamed.identification.plan.lags, whole.plan.lags);
  EXPECT_EQ(io::provenance_text(both.model.provenance), io::provenance_text(whole.model.provenance));
  EXPECT_LE(output_error(e, simulate(both.model, e)), 1e-9);
  EXPECT_GE(both.streamed.identification.validation.one_step.fit.minCoeff(), 99.999999);
  EXPECT_GE(both.streamed.identification.validation.simulation.fit.minCoeff(), 99.999999);
}

TEST_P(BlockLength, RandomSystemsWhoseMatricesDependOnNothing) {
  const SystemSize size{3, 2, 2};
  const Ensemble e = random_experiments(random_system(size, 300, 1.0, 7), 40, 8);
  expect_same(stream(e, GetParam()).model, identify(e).model);
}

TEST_P(BlockLength, UnknownInitialStates) {
  const Ensemble e =
      experiments(slow_system(300), {.experiments = 25, .seed = 5, .initial_state = InitialState::unknown});
  const IdentifyOptions o{.initial_state = InitialState::unknown};
  const Both both = stream(e, GetParam(), o);
  expect_same(both.model, identify(e, o).model);
  EXPECT_EQ(both.model.method, "subspace");
}

TEST_P(BlockLength, MeanMotion) {
  Ensemble e = experiments(slow_system(300), {.experiments = 30, .seed = 6});
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k).array() += 5 * std::sin(0.1 * double(k));
    e.output(k).array() += 3 + 0.01 * double(k);
  }
  const Identification whole = identify(e);
  ASSERT_TRUE(whole.plan.nominal);
  const Both both = stream(e, GetParam());
  EXPECT_TRUE(both.streamed.identification.plan.nominal);
  expect_same(both.model, whole.model);
  EXPECT_LE((both.model.u_nominal - whole.model.u_nominal).norm(), 1e-12);
  EXPECT_LE((both.model.y_nominal - whole.model.y_nominal).norm(), 1e-12);
  EXPECT_NEAR(both.streamed.identification.validation.one_step.fit(0), 100.0, 1e-6);
}

TEST_P(BlockLength, MissingSamplesAndLengths) {
  Ensemble e = experiments(slow_system(300), {.experiments = 60, .seed = 9});
  for (Index k = 3; k < 300; k += 7) e.y(k % 60, k, 0) = nan;
  for (Index k = 5; k < 300; k += 41) e.u(k % 59, k, 0) = nan;
  e.length.assign(60, 300);
  for (Index n = 50; n < 60; ++n) {
    e.length[size_t(n)] = 20 * (n - 48);
    for (Index k = e.length[size_t(n)]; k < 300; ++k)
      e.input(k).row(n).setConstant(nan), e.output(k).row(n).setConstant(nan);
  }
  e.initial_state = InitialState::zero;
  const Both both = stream(e, GetParam());
  expect_same(both.model, identify(e).model);
  Index beyond = 0;
  for (const Index length : e.length) beyond += (300 - length) * e.channels();
  EXPECT_EQ(both.streamed.missing, e.missing() - beyond);
}

TEST_P(BlockLength, FreeResponsesGiveAllStatesFromTheFirstStepOn) {
  const Ensemble e = experiments(slow_system(300), {.experiments = 25, .seed = 11, .free_responses = 8});
  const Both both = stream(e, GetParam(), {.states = 4});
  expect_same(both.model, identify(e, {.states = 4}).model);
  EXPECT_EQ(both.model.full_begin(), 0);
}

INSTANTIATE_TEST_SUITE_P(All, BlockLength, ::testing::Values(50, 75, 100, 149, 299, 300, 1000));

TEST_F(Stream, SameBytesForAnyNumberOfThreads) {
  const Ensemble e = experiments(slow_system(400), {.experiments = 25, .measurement_noise = 0.0});
  stream(e, 40, {.execution = {1, {}}});
  fs::rename(model(), folder_ / "alone.h5");
  for (const int threads : {0, 2, 4}) {
    stream(e, 40, {.execution = {threads, {}}});
    std::ifstream a(model(), std::ios::binary), b(folder_ / "alone.h5", std::ios::binary);
    EXPECT_TRUE(std::equal(std::istreambuf_iterator<char>(a), {}, std::istreambuf_iterator<char>(b), {})) << threads;
  }
}

TEST_F(Stream, SameBytesForAnyNumberOfMembers) {
  const auto bytes = [&] {
    std::ifstream file(model(), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  for (const double noise : {0.0, 0.05}) {
    const Ensemble e = experiments(slow_system(400), {.experiments = 30, .seed = 21, .measurement_noise = noise});
    StreamOptions o;
    o.identify.hold_out = 0.25;
    o.identify.refine = false;
    o.block = 200;
    const EnsembleFile file(data(e));
    identify_stream(file, model(), o);
    const std::string alone = bytes();
    for (const Index members : {2, 3}) {
      fs::remove(model());
      Threads(members).run([&](const Team& team) {
        StreamOptions own = o;
        own.team = team;
        identify_stream(file, model(), own);
      });
      EXPECT_EQ(bytes(), alone) << noise << ", " << members;
    }
  }
}

TEST_F(Stream, TheFirstStepsDecide) {
  Ensemble e = experiments(slow_system(900), {.experiments = 20, .seed = 22});
  const EnsembleFile file(data(e));
  const stream::Decision exact = stream::decide(file, {.frame = Frame::smooth, .hold_out = 0.25});
  EXPECT_FALSE(exact.plan.noisy);
  EXPECT_EQ(exact.plan.frame, Frame::smooth);
  EXPECT_EQ(exact.evidence.experiments, 15);
  EXPECT_LT(exact.evidence.steps, 900);

  Random random(23);
  for (Index k = 600; k < e.steps(); ++k) e.output(k) += 0.05 * random.matrix(e.experiments(), e.outputs());
  const auto found = [](const Identification& i, Finding::Kind kind) {
    return std::find_if(i.findings.begin(), i.findings.end(), [kind](const Finding& f) { return f.kind == kind; });
  };
  const Identification late = stream(e, 300).streamed.identification;
  ASSERT_NE(found(late, Finding::Kind::exact_first_steps), late.findings.end());
  EXPECT_EQ(found(late, Finding::Kind::exact_first_steps)->scope, Finding::Scope::all);

  for (Index k = 0; k < 600; ++k) e.output(k) += 0.05 * random.matrix(e.experiments(), e.outputs());
  for (Index k = 0; k < e.steps(); ++k) e.output(k).row(7) *= -1;
  const Identification noisy = stream(e, 300, {.refine = false}).streamed.identification;
  EXPECT_TRUE(noisy.plan.noisy);
  ASSERT_EQ(noisy.outliers.size(), 1u);
  EXPECT_EQ(noisy.outliers[0].experiment, 7);
  ASSERT_NE(found(noisy, Finding::Kind::experiment_outlying), noisy.findings.end());
  EXPECT_EQ(found(noisy, Finding::Kind::experiment_outlying)->scope, Finding::Scope::first_steps);
}

TEST_F(Stream, BlocksOfAutomaticLengthAreSharedEvenly) {
  const double bytes_of_step = 25 * 4 * sizeof(double) * 4;  // with the copies of a block in memory
  const auto streamed = [&](Index steps, double length) {
    const EnsembleFile file(data(experiments(slow_system(steps), {.experiments = 25})));
    StreamOptions o;
    o.memory_per_thread = length * bytes_of_step;
    return identify_stream(file, model(), o);
  };
  for (const double length : {120.0, 150.0, 220.0, 370.0, 400.0, 5000.0}) {
    const Streamed found = streamed(1100, length);
    EXPECT_EQ(found.blocks % 4, 0) << length;
    EXPECT_LE(double(found.block), length + 1);
    const double fewest = std::ceil(1100 / length);
    EXPECT_LE((double(found.blocks) - fewest) * double(found.overlap), 0.05 * (1100 + fewest * double(found.overlap)));
    expect_same(load_model(model()), identify(load_ensemble(folder_ / "data.h5")).model);
  }
  EXPECT_EQ(streamed(100, 5000).blocks, 1);
  EXPECT_EQ(streamed(500, 5000).blocks, 2);
}

TEST_F(Stream, HeldOutExperimentsJudge) {
  const Ensemble e = experiments(slow_system(300), {.experiments = 40, .seed = 12});
  const Both both = stream(e, 100, {.hold_out = 0.25});
  EXPECT_TRUE(both.streamed.identification.held_out);
  EXPECT_EQ(both.streamed.identification.experiments, 30);
  expect_same(both.model, identify(e, {.hold_out = 0.25}).model);
  EXPECT_TRUE(has_seen(both.model.provenance, split(e, 0.25).training));
}

TEST_F(Stream, NoisyModelsDifferLittleFromThoseOfAllStepsAtOnce) {
  const ExperimentOptions noise{.experiments = 40, .seed = 13, .measurement_noise = 0.05};
  const Ensemble e = experiments(slow_system(400), noise);
  ExperimentOptions other = noise;
  other.seed = 14;
  const Ensemble fresh = experiments(slow_system(400), other);
  const IdentifyOptions o{.states = 4, .lags = 4, .smoothing = 1, .refine = false, .initial_state = InitialState::zero};
  const Identification whole = identify(e, o);
  const Both both = stream(e, 200, o);
  EXPECT_EQ(both.model.k_begin, 0);
  EXPECT_EQ(both.model.frame, "smooth");
  const double at_once = validate(whole.model, fresh).one_step.rmse.norm();
  const double in_blocks = validate(both.model, fresh).one_step.rmse.norm();
  // Regressions near both ends of a block have fewer neighbours that share what they know.
  EXPECT_NEAR(in_blocks, at_once, 0.03 * at_once);
  const double simulated = validate(whole.model, fresh).simulation.rmse.norm();
  EXPECT_NEAR(validate(both.model, fresh).simulation.rmse.norm(), simulated, 0.05 * simulated);
  // No jump where blocks meet.
  double largest = 0.0, at_border = 0.0;
  for (Index k = 20; k < 380; ++k) {
    const double change = (both.model.at(k).A() - both.model.at(k - 1).A()).norm();
    (std::abs(k - 200) <= 1 ? at_border : largest) = std::max(std::abs(k - 200) <= 1 ? at_border : largest, change);
  }
  EXPECT_LE(at_border, 5 * largest);
}

TEST_F(Stream, WhatNeedsAllStepsIsRefused) {
  const Ensemble e = experiments(slow_system(200), {.experiments = 25});
  EXPECT_NE(message([&] { stream(e, 50, {.period = 5}); }).find("needs all steps at once"), std::string::npos);
  EXPECT_NE(message([&] { stream(e, 50, {.frame = Frame::reference}); }).find("raw or smooth"), std::string::npos);
  EXPECT_NE(message([&] { stream(e, 3); }).find("block: 3 steps found"), std::string::npos);
  EXPECT_FALSE(fs::exists(model()));
}

TEST_F(Stream, OtherFilesAreRefused) {
  EXPECT_THROW(EnsembleFile(folder_ / "none.h5"), IoError);
  save_model(slow_system(5), folder_ / "model.h5");
  EXPECT_THROW(EnsembleFile(folder_ / "model.h5"), IoError);
}

TEST_F(Stream, ModelFilesHoldWhatSaveModelWrites) {
  const Ensemble e = experiments(slow_system(60), {.experiments = 25});
  const Model whole = identify(e).model;
  {
    ModelFile file(folder_ / "blocks.h5");
    for (const Index from : {0, 17, 40}) {
      const Index to = from == 0 ? 17 : from == 17 ? 40 : 60;
      Model part = from_step(whole, from);
      part.step.resize(size_t(to - from));
      file.append(part);
      EXPECT_THROW(file.append(part), std::invalid_argument);
      EXPECT_THROW(file.outline().check(), std::invalid_argument);
      Model other = from_step(whole, to);
      for (Step& step : other.step) step = Step(step.A(), step.B(), step.C(), step.D(), step.G());
      if (other.steps() > 0) {  // without condition, rank, lags
        EXPECT_THROW(file.append(other), std::invalid_argument);
      }
    }
    file.commit(whole.provenance);
  }
  const Model read = load_model(folder_ / "blocks.h5");
  save_model(read, folder_ / "a.npz");
  save_model(whole, folder_ / "b.npz");
  std::ifstream a(folder_ / "a.npz", std::ios::binary), b(folder_ / "b.npz", std::ios::binary);
  EXPECT_TRUE(std::equal(std::istreambuf_iterator<char>(a), {}, std::istreambuf_iterator<char>(b), {}));
  EXPECT_THROW(ModelFile(folder_ / "model.npz"), IoError);
}

}  // namespace
}  // namespace tokid::testing
