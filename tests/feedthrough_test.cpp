// Systems whose outputs are known not to answer to the inputs of the same step (D = 0), by every route.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "io/formats/provenance_text.hpp"
#include "testing.hpp"
#include "tokid/em.hpp"
#include "tokid/ensemble_file.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/identify.hpp"
#include "tokid/io.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/markov.hpp"
#include "tokid/model_file.hpp"
#include "tokid/refine_model.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/stream.hpp"
#include "tokid/subspace.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

using Reason = FeedthroughChoice::Reason;

bool has_kind(const Findings& findings, Finding::Kind kind) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& f) { return f.kind == kind; });
}

Model without_feedthrough(Model system) {
  for (Step& step : system.step) step.D().setZero();
  return system;
}

// The window of step k without u_k.
Matrix past(const Ensemble& e, Index k, Index lags) { return e.window(k, lags).leftCols(lags * e.channels()); }

TEST(Feedthrough, RegressionsWithoutItAreLeastSquaresOnThePastAlone) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {3, 1, 2}, {3, 2, 1}}) {
    const Index p = smallest_lag_order(size), n = minimum_experiments(size.r, size.m, p) + 20;
    const Ensemble e = with_noise(random_experiments(random_system(size, 30, 1.0, 7), n, 8), 0.1, 9);
    for (const Index block : {0, 1, 3}) {  // steps in lanes, alone, and with shared factorisations
      GtvArxOptions options;
      options.lags = {p};
      options.feedthrough = false;
      options.block = block;
      const GtvArx arx = gtv_arx(e, options);
      for (Index k = 0; k < e.steps(); ++k) {
        const Index lags = std::min(p, k);
        ASSERT_EQ(arx.regressors(k), lags * e.channels());
        EXPECT_TRUE(arx.D(k).isZero(0.0));
        EXPECT_EQ(arx.noise_shape(k).rows(), arx.regressors(k));
        EXPECT_EQ(arx.step[size_t(k)].freedom, n - arx.step[size_t(k)].rank);
        const Matrix w = past(e, k, lags), y = e.output(k);
        const Matrix expected = w.cols() > 0 ? Matrix(linalg::pseudo_inverse(w) * y) : Matrix(0, size.m);
        const double condition = std::max(1.0, arx.step[size_t(k)].condition), unit = double(n) * epsilon * condition;
        EXPECT_LE((arx.coefficients(k) - expected.transpose()).norm(), 10 * unit * std::max(1.0, expected.norm()))
            << name(size) << " block " << block << " k " << k;
        const Matrix residual = y - w * expected;
        const Matrix covariance = residual.transpose() * residual / double(arx.step[size_t(k)].freedom);
        EXPECT_LE((arx.residual_cov(k) - covariance).norm(), 10 * unit * y.squaredNorm() / double(n)) << k;
      }
    }
  }
}

TEST(Feedthrough, LeaveOneOutErrorsWithoutItAreThoseOfTheRegressionsWithoutIt) {
  const SystemSize size{2, 1, 2};
  const Ensemble e = with_noise(random_experiments(random_system(size, 8, 1.0, 11), 40, 12), 0.2, 13);
  LagOrderOptions options;
  options.p_max = 2;
  options.feedthrough = false;
  const LagOrderErrors found = lag_order_errors(e, options);
  for (size_t i = 0; i < found.steps.size(); ++i)
    for (Index p = 1; p <= options.p_max; ++p) {
      const Matrix w = past(e, found.steps[i], p), hat = w * linalg::pseudo_inverse(w), y = e.output(found.steps[i]);
      const Vector left_out = (y - hat * y).array() / (1 - hat.diagonal().array());
      const double expected = std::log(left_out.squaredNorm() / y.squaredNorm());
      EXPECT_NEAR(found.error(Index(i), p - 1), expected, 1e-10) << found.steps[i] << ' ' << p;
    }
}

TEST(Feedthrough, PulseResponsesWithoutItAreExact) {
  for (const SystemSize size : {SystemSize{4, 2, 2}, {3, 2, 1}}) {
    const Model system = without_feedthrough(random_system(size, 20, 1.0, 21));
    const Index p = smallest_lag_order(size);
    // One experiment fewer than a regression with feedthrough needs.
    const Index n = minimum_experiments(size.r, size.m, p, false) + size.r - 1;
    GtvArxOptions options;
    options.lags = {p};
    options.feedthrough = false;
    const Markov found = markov(gtv_arx(random_experiments(system, n, 22), options), 2 * p);
    for (Index k = 0; k < 20; ++k) {
      EXPECT_TRUE(found.D(k).isZero(0.0));
      for (Index i = std::max<Index>(0, k - 2 * p); i < k; ++i) {
        const Matrix expected = pulse_response(system, k, i);
        EXPECT_LE((found.h(k, i) - expected).norm(), 1e-9 * std::max(1.0, expected.norm())) << k << ' ' << i;
      }
    }
  }
}

// The error of the outputs that a subspace model of noise-free data simulates.
double subspace_error(const Ensemble& e, Weighting weighting, TimeVariation variation, Index p) {
  SmoothArxOptions options{.lags = p, .feedthrough = false, .variation = variation};
  const GtvArx arx = smooth_arx(e, options);
  SubspaceOptions o;
  o.variation = variation;
  o.weighting = weighting;
  o.noisy = false;
  const Model model = subspace(e, arx, o);
  for (const Step& step : model.step) EXPECT_TRUE(step.D().isZero(0.0));
  return output_error(e, simulate_data(model, e, InitialState::zero), p);
}

TEST(Feedthrough, SubspaceModelsWithoutItAreExact) {
  const SystemSize size{3, 2, 1};
  const Index p = smallest_lag_order(size) + 1;
  const Ensemble varying = random_experiments(without_feedthrough(random_system(size, 20, 1.0, 31)), 30, 32);
  EXPECT_LE(subspace_error(varying, Weighting::one_step, {0.0, 0}, p), 1e-8);
  const Ensemble constant = random_experiments(without_feedthrough(constant_system(size, 60, 0.9, 33)), 5, 34);
  for (const Weighting weighting : {Weighting::one_step, Weighting::many_steps, Weighting::projection})
    EXPECT_LE(subspace_error(constant, weighting, {0.0, 1}, p), 1e-8) << int(weighting);
}

TEST(Feedthrough, EmKeepsItAtZeroAndRaisesTheLikelihood) {
  const Model truth = without_feedthrough(random_system({2, 2, 1}, 25, 0.9, 41));
  const Ensemble e = with_noise(random_experiments(truth, 60, 42), 0.1, 43);
  const GtvArx arx = smooth_arx(e, {.lags = 3, .variation = {1.0, 0}});
  SubspaceOptions o;
  o.states = 2;
  o.variation = {1.0, 0};
  const Model start = subspace(e, arx, o);  // with the feedthrough that noise suggests
  for (const double smoothing : {0.0, 1.0, std::numeric_limits<double>::infinity()}) {
    RefineOptions options;
    options.smoothing = smoothing;
    options.iterations = 20;
    options.feedthrough = false;
    const Refinement found = refine(start, e, options);
    for (const Step& step : found.model.step) EXPECT_TRUE(step.D().isZero(0.0)) << smoothing;
    for (size_t i = 1; i < found.penalised.size(); ++i)
      EXPECT_GE(found.penalised[i], found.penalised[i - 1]) << smoothing << ' ' << i;
    EXPECT_GT(found.penalised.back(), found.penalised.front()) << smoothing;
  }
}

// Experiments under feedback in the same step, u_k = w_k - gain·y_k, with noise on states and sensors.
Ensemble under_feedback(const Model& plant, Index experiments, double gain, std::uint64_t seed) {
  Random random(seed);
  Ensemble e(experiments, plant.steps(), plant.inputs, plant.outputs);
  for (Index n = 0; n < experiments; ++n) {
    Vector x = Vector::Zero(plant.states());
    for (Index k = 0; k < plant.steps(); ++k) {
      const Step& step = plant.step[size_t(k)];
      const Vector y = step.C() * x + 0.3 * random.matrix(plant.outputs, 1);
      const Vector u = 0.3 * random.matrix(plant.inputs, 1) - gain * y;
      x = step.A() * x + step.B() * u + 0.05 * random.matrix(plant.states(), 1);
      for (Index i = 0; i < plant.inputs; ++i) e.u(n, k, i) = u(i);
      for (Index j = 0; j < plant.outputs; ++j) e.y(n, k, j) = y(j);
    }
  }
  return e;
}

// Median over the steps of |h - h°| / |h°| for h = h_{k,k-1}, the effect of an input on the next output.
double error_of_first_response(const Model& plant, const Model& found) {
  std::vector<double> errors;
  for (Index k = found.k_begin + 5; k < plant.steps(); ++k) {
    const Matrix truth = pulse_response(plant, k, k - 1);
    errors.push_back((pulse_response(found, k, k - 1) - truth).norm() / truth.norm());
  }
  std::nth_element(errors.begin(), errors.begin() + std::ptrdiff_t(errors.size() / 2), errors.end());
  return errors[errors.size() / 2];
}

// A slowly varying plant whose input moves the next output by about one.
Model reacting_plant(Index steps) {
  Model plant = without_feedthrough(constant_system({2, 1, 1}, steps, 1.0, 1));
  for (Index k = 0; k < steps; ++k) {
    Step& step = plant.step[size_t(k)];
    step.A() << 0.9, 0.3, -0.2, 0.7 + 0.1 * std::sin(0.1 * double(k));
    step.B() << 1 + 0.3 * std::cos(0.1 * double(k)), 0.5;
    step.C() << 1, 0;
  }
  return plant;
}

TEST(Feedthrough, FeedbackInTheSameStepIsNotTakenForFeedthroughIfItIsStated) {
  const Model plant = reacting_plant(60);
  for (const std::uint64_t seed : {51, 52, 53}) {
    const Ensemble e = under_feedback(plant, 100, 0.8, seed);
    const Identification stated = identify(e, {.feedthrough = false, .initial_state = InitialState::zero});
    const Identification free = identify(e, {.initial_state = InitialState::zero});
    for (const Step& step : stated.model.step) EXPECT_TRUE(step.D().isZero(0.0));
    EXPECT_LE(error_of_first_response(plant, stated.model), 0.05) << seed;
    EXPECT_EQ(stated.plan.feedthrough.reason, Reason::stated);
    EXPECT_FALSE(has_kind(stated.findings, Finding::Kind::feedthrough_or_feedback));
    // Without the statement, D takes up noise of the sensor: the data cannot tell the two apart, and a warning says so.
    EXPECT_GE(error_of_first_response(plant, free.model), 0.2) << seed;
    EXPECT_TRUE(free.plan.feedthrough.present);
    EXPECT_EQ(free.plan.feedthrough.reason, Reason::feedback);
    EXPECT_TRUE(has_kind(free.findings, Finding::Kind::feedthrough_or_feedback));
  }
}

TEST(Feedthrough, UpdatesAndRefinementsKeepTheStatement) {
  const Model plant = without_feedthrough(constant_system({2, 1, 1}, 40, 0.95, 61));
  const Ensemble first = under_feedback(plant, 40, 0.0, 62), second = under_feedback(plant, 40, 0.0, 63);
  const IdentifyOptions options{.states = 2, .feedthrough = false, .initial_state = InitialState::zero};
  const Identification found = identify(first, options);
  EXPECT_FALSE(found.plan.feedthrough.present);
  EXPECT_EQ(identify_options(found.model.provenance).feedthrough, false);
  UpdateState state = update_state(first, found, options);
  update(state, second);
  for (const Step& step : identify(state).model.step) EXPECT_TRUE(step.D().isZero(0.0));
  const std::filesystem::path path = std::filesystem::path(::testing::TempDir()) / "tokid_without_feedthrough.h5";
  save_update_state(state, path);
  EXPECT_FALSE(load_update_state(path).plan.feedthrough.present);
  for (const Step& step : identify(load_update_state(path)).model.step) EXPECT_TRUE(step.D().isZero(0.0));
  // EM goes on without feedthrough from a model that was identified without it.
  for (const Step& step : refine_model(found.model, first, {}).refinement.model.step) EXPECT_TRUE(step.D().isZero(0.0));
}

// D also where the model was identified without it, and no D where it was identified with it.
TEST(Feedthrough, RefinementsTakeAStatement) {
  const Model plant = constant_system({2, 1, 1}, 40, 0.95, 64);
  const Ensemble e = with_noise(random_experiments(plant, 40, 65), 0.05, 66);
  const auto refined = [&](const Model& model, std::optional<bool> feedthrough) {
    const Model result = refine_model(model, e, {.feedthrough = feedthrough}).refinement.model;
    EXPECT_EQ(has_feedthrough(result.provenance), feedthrough.value_or(has_feedthrough(model.provenance)));
    if (feedthrough) {
      EXPECT_EQ(feedthrough_choice(result.provenance).reason, Reason::stated);
      EXPECT_EQ(identify_options(result.provenance).feedthrough, feedthrough);
    }
    return result;
  };
  const Model without = identify(e, {.states = 2, .feedthrough = false}).model, found = refined(without, true);
  for (Index k = 0; k < 40; ++k) {
    EXPECT_TRUE(without.at(k).D().isZero(0.0));
    // 40 experiments with noise of 0.05 and inputs of size 1
    EXPECT_NEAR(found.at(k).D()(0, 0), plant.at(k).D()(0, 0), 0.05);
    EXPECT_GT(std::abs(plant.at(k).D()(0, 0)), 0.2);
  }
  for (const Step& step : refined(found, false).step) EXPECT_TRUE(step.D().isZero(0.0));
  EXPECT_THROW(refine_model(found, e, {.refine = {.feedthrough = false}}), std::invalid_argument);
  EXPECT_FALSE(refined(found, {}).at(0).D().isZero(0.0));
}

TEST(Feedthrough, BlocksKeepTheStatement) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "tokid_feedthrough_blocks";
  std::filesystem::create_directories(folder);
  save_ensemble(random_experiments(reacting_plant(300), 40, 71), folder / "data.h5");
  StreamOptions options;
  options.block = 100;
  options.identify.feedthrough = false;
  const EnsembleFile file(folder / "data.h5");
  identify_stream(file, folder / "model.h5", options);
  const Model model = load_model(folder / "model.h5");
  EXPECT_FALSE(has_feedthrough(model.provenance));
  EXPECT_EQ(model.steps(), 300);
  for (const Step& step : model.step) EXPECT_TRUE(step.D().isZero(0.0));
  std::filesystem::remove_all(folder);
}

TEST(Feedthrough, RegressionsOfFullRankLackNothing) {
  const Model plant = without_feedthrough(random_system({4, 2, 2}, 20, 1.0, 81));
  const Ensemble e = random_experiments(plant, 40, 82);
  const Model model = identify(e, {.lags = 2, .feedthrough = false, .initial_state = InitialState::zero}).model;
  ASSERT_EQ(model.method, "tvera");
  for (Index k = 6; k < 20; ++k) {
    EXPECT_EQ(unknowns(model, k), 8);
    EXPECT_EQ(model.at(k).rank(), 8);
  }
  const Confidence bounds = confidence(model, e);
  for (const Matrix& half : {bounds.markov.step[10].lower, bounds.markov.step[10].upper})
    EXPECT_TRUE(half.leftCols(2).isZero(0.0));  // D is known exactly
}

// An input that responds to the output of its own step is no sign against a model without feedthrough.
TEST(Feedthrough, FeedbackInTheSameStepIsNoSignAgainstTheModel) {
  const Model plant = reacting_plant(60);
  const Model model = identify(under_feedback(plant, 100, 0.8, 91), {.feedthrough = false}).model;
  const Validation found = validate(model, under_feedback(plant, 100, 0.8, 92));
  EXPECT_EQ(found.independence.first, 1);
  EXPECT_GT(found.independence.p, 1e-4);
  EXPECT_LT(found.feedback.p, 1e-10);  // the feedback is seen at lag 0
}

TEST(Feedthrough, DataWithoutNoiseHaveAnExactOne) {
  const Identification found =
      identify(random_experiments(without_feedthrough(random_system({3, 2, 1}, 30, 1.0, 101)), 40, 102));
  EXPECT_TRUE(found.plan.feedthrough.present);
  EXPECT_EQ(found.plan.feedthrough.reason, Reason::exact);
}

// The plant with feedthrough of this size, identified from noisy experiments in open loop.
Identification in_open_loop(double feedthrough, Index period, std::uint64_t seed) {
  Model plant = period == 1 ? constant_system({2, 2, 1}, 60, 0.9, seed) : reacting_plant(60);
  for (Index k = 0; k < plant.steps(); ++k)
    plant.step[size_t(k)].D().setConstant(feedthrough * (period == 1 ? 1.0 : std::cos(0.1 * double(k))));
  const IdentifyOptions options{.period = period, .initial_state = InitialState::zero};
  return identify(with_noise(random_experiments(plant, 60, seed + 1), 0.1, seed + 2), options);
}

TEST(Feedthrough, IsFoundInOpenLoopWhereThereIsSome) {
  for (const Index period : {0, 1})
    for (const std::uint64_t seed : {111, 121, 131}) {
      const Identification with = in_open_loop(0.3, period, seed), none = in_open_loop(0.0, period, seed);
      EXPECT_TRUE(with.plan.feedthrough.present) << seed;
      EXPECT_EQ(with.plan.feedthrough.reason, Reason::response) << seed;
      EXPECT_FALSE(none.plan.feedthrough.present) << seed;
      EXPECT_EQ(none.plan.feedthrough.reason, Reason::no_response) << seed;
      for (const Step& step : none.model.step) EXPECT_TRUE(step.D().isZero(0.0));
    }
}

TEST(Feedthrough, UpdatesAndFilesKeepTheChoice) {
  const Ensemble e = under_feedback(reacting_plant(40), 60, 0.0, 141);
  const IdentifyOptions options{.lags = 3, .initial_state = InitialState::zero};
  const Identification found = identify(e, options);
  ASSERT_EQ(found.plan.feedthrough.reason, Reason::no_response);
  EXPECT_FALSE(identify_options(found.model.provenance).feedthrough);
  const std::filesystem::path folder = ::testing::TempDir();
  save_model(found.model, folder / "tokid_feedthrough_choice.npz");
  const FeedthroughChoice loaded = feedthrough_choice(load_model(folder / "tokid_feedthrough_choice.npz").provenance);
  EXPECT_FALSE(loaded.present);
  EXPECT_EQ(loaded.reason, Reason::no_response);
  save_update_state(update_state(e, found, options), folder / "tokid_feedthrough_choice.h5");
  UpdateState state = load_update_state(folder / "tokid_feedthrough_choice.h5");
  EXPECT_EQ(state.plan.feedthrough.reason, Reason::no_response);
  update(state, under_feedback(reacting_plant(40), 30, 0.0, 142));
  for (const Step& step : identify(state).model.step) EXPECT_TRUE(step.D().isZero(0.0));
  for (const Step& step : refine_model(found.model, e, {}).refinement.model.step) EXPECT_TRUE(step.D().isZero(0.0));
}

TEST(Feedthrough, BlocksDecideFromTheirStretches) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "tokid_feedthrough_stretches";
  std::filesystem::create_directories(folder);
  for (const double gain : {0.0, 0.8}) {
    save_ensemble(under_feedback(reacting_plant(400), 40, gain, 151), folder / "data.h5");
    StreamOptions options;
    options.block = 200;
    options.identify.lags = 3;
    options.identify.refine = false;
    const Streamed found = identify_stream(EnsembleFile(folder / "data.h5"), folder / "model.h5", options);
    EXPECT_EQ(found.identification.plan.feedthrough.reason, gain > 0 ? Reason::feedback : Reason::no_response);
    EXPECT_EQ(has_kind(found.identification.findings, Finding::Kind::feedthrough_or_feedback), gain > 0);
    EXPECT_EQ(has_feedthrough(load_model(folder / "model.h5").provenance), gain > 0);
  }
  std::filesystem::remove_all(folder);
}

TEST(Feedthrough, OptionOfEarlierFilesIsTheirChoice) {
  for (const bool yes : {true, false}) {
    const Provenance old = io::provenance_of(yes ? R"({"feedthrough":"yes"})" : R"({"feedthrough":"no"})");
    EXPECT_EQ(identify_options(old).feedthrough, yes);
    EXPECT_EQ(feedthrough_choice(old).reason, Reason::stated);
    EXPECT_EQ(has_feedthrough(old), yes);
  }
  EXPECT_TRUE(has_feedthrough(io::provenance_of(R"({"lags":3})")));
}

}  // namespace
}  // namespace tokid::testing
