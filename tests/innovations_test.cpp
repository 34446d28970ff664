// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/innovations.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/validate.hpp"

namespace tokid::testing {
namespace {

// √runs times the largest distance of the sample from the uniform distribution (Kolmogorov and Smirnov), with Stephens'
// correction for its size. 1.95 is exceeded by one in a thousand.
double distance_from_uniform(std::vector<double> p) {
  std::sort(p.begin(), p.end());
  const double runs = double(p.size());
  double distance = 0.0;
  for (size_t i = 0; i < p.size(); ++i) {
    if (std::isnan(p[i])) return nan;
    distance = std::max({distance, std::abs(p[i] - double(i) / runs), std::abs(p[i] - double(i + 1) / runs)});
  }
  return distance * (std::sqrt(runs) + 0.12 + 0.11 / std::sqrt(runs));
}
constexpr double one_in_a_thousand = 1.95;
constexpr int runs = 200;

// Time varying examples and random systems, in turn.
Model true_system(int run, Index steps) {
  switch (run % 3) {
    case 0:
      return oscillator(steps);
    case 1:
      return rotating_tube(steps);
    default:
      return random_system({1 + run % 4, 1 + run % 2, 1 + run / 3 % 2}, steps, 0.95, std::uint64_t(run));
  }
}

struct Setting {
  const char* name;
  Index experiments, steps;
  InitialState initial_state = InitialState::zero;
  double missing = 0.0;
  bool constant = false;
};

void PrintTo(const Setting& setting, std::ostream* out) { *out << setting.name; }

class TrueModels : public ::testing::TestWithParam<Setting> {};

// The tests of the innovations of the true Kalman filter on its own data.
TEST_P(TrueModels, HaveUniformProbabilities) {
  const Setting& s = GetParam();
  std::vector<double> white, independent, feedback, squares, gains;
  double ratio = 0.0;
  for (int run = 0; run < runs; ++run) {
    const ExperimentOptions options{.experiments = s.experiments,
                                    .seed = 1000 + std::uint64_t(run),
                                    .process_noise = 0.1,
                                    .measurement_noise = 0.3,
                                    .initial_state = s.initial_state};
    const Model system = s.constant ? constant_system({1 + run % 4, 1 + run % 2, 1}, s.steps, 0.95, std::uint64_t(run))
                                    : true_system(run, s.steps);
    Ensemble data = experiments(system, options);
    Random random{std::uint64_t(run)};
    for (Index k = 0; s.missing > 0 && k < data.steps(); ++k)
      for (double& y : data.output(k).reshaped())
        if (random.uniform(0, 1) < s.missing) y = nan;
    const Validation v = validate(with_noise(system, options), data);
    white.push_back(v.whiteness_p);
    independent.push_back(v.independence.p);
    feedback.push_back(v.feedback.p);
    squares.push_back(v.squares.p);
    gains.push_back(std::erfc(std::abs(v.gains.error(0)) / v.gains.deviation(0) / std::sqrt(2.0)));
    ratio += v.squares.ratio / runs;
    EXPECT_EQ(v.whiteness.over, s.constant ? Pooling::time : Pooling::experiments);
    EXPECT_EQ(v.independence.over, v.whiteness.over);
    EXPECT_EQ(v.squares.normal, s.experiments < 20);
  }
  for (const auto& [test, p] :
       {std::pair("whiteness", white), std::pair("inputs", independent), std::pair("feedback", feedback),
        std::pair("squares", squares), std::pair("gains", gains)}) {
    const double distance = distance_from_uniform(p);
    EXPECT_LT(distance, one_in_a_thousand) << test;
    RecordProperty(test, std::to_string(distance));  // for the table of docs/evidence.md
  }
  // A mean of 200 runs of at least 80 squares each, of variance 2: four standard deviations are at most 0.045.
  EXPECT_NEAR(ratio, 1.0, 0.045);
}

INSTANTIATE_TEST_SUITE_P(All, TrueModels,
                         ::testing::Values(Setting{"FewExperiments", 7, 25}, Setting{"ManyExperiments", 100, 25},
                                           Setting{"FewSteps", 12, 8},
                                           Setting{"UnknownInitialStates", 30, 25, InitialState::unknown},
                                           Setting{"MissingOutputs", 40, 25, InitialState::zero, 0.1},
                                           Setting{"OneLongRecord", 1, 120, InitialState::zero, 0.0, true},
                                           Setting{"TwoRecords", 2, 80, InitialState::unknown, 0.0, true}),
                         [](const auto& setting) { return setting.param.name; });

Innovations innovations(Index experiments, Index steps, Index outputs, double correlation, std::uint64_t seed) {
  Random random(seed);
  const Matrix mix = random.matrix(outputs, outputs);  // outputs of one step may be correlated, that is no defect
  Innovations e;
  Matrix previous = random.matrix(experiments, outputs);
  for (Index k = 0; k < steps; ++k) {
    const Matrix fresh = random.matrix(experiments, outputs);
    e.emplace_back((correlation * previous + fresh) * mix);
    previous = fresh;
  }
  return e;
}

TEST(Whiteness, SeesCorrelationInTime) { EXPECT_LT(whiteness_p(innovations(60, 30, 2, 0.4, 7), 5), 1e-6); }

TEST(Whiteness, CorrelationsAreThoseOfEachLag) {
  // e_k = c e_{k-1} + fresh: c / √(1 + c²) at lag 1 where the previous innovation is fresh alone, which it is here.
  Random random(5);
  const double c = 0.5;
  Innovations e;
  for (int pair = 0; pair < 40; ++pair) {
    const Matrix first = random.matrix(200, 1);
    e.push_back(first);
    e.emplace_back(c * first + random.matrix(200, 1));
  }
  const Whiteness w = whiteness(e, 3);
  // Every second pair of steps is correlated, 40 of 79. Bounds of 99 %: twice that leaves no doubt.
  EXPECT_NEAR(w.correlation(0, 0), 40.0 / 79 * c / std::sqrt(1 + c * c), 2 * w.bound(0));
  EXPECT_LT(std::abs(w.correlation(1, 0)), 2 * w.bound(1));
  EXPECT_NEAR(w.bound(0), 2.576 / std::sqrt(79.0 * 199), 1e-4);
  EXPECT_GT(w.z(0), 10);
  EXPECT_LT(std::abs(w.z(2)), 4);
  EXPECT_EQ(w.p, whiteness_p(e, 3));
}

TEST(Whiteness, LeavesOutWhatIsMissingAndNeedsEnoughExperiments) {
  Innovations e = innovations(20, 30, 2, 0.0, 8);
  e[4](3, 0) = nan;
  e[5].setConstant(nan);
  const double p = whiteness_p(e, 5);
  EXPECT_GT(p, 0.0);
  EXPECT_LE(p, 1.0);
  EXPECT_EQ(whiteness(e, 5).over, Pooling::experiments);
  const Whiteness few = whiteness(innovations(4, 11, 2, 0.0, 9), 5);
  EXPECT_GT(few.p, 0.0);
  EXPECT_EQ(few.over, Pooling::time);
  const Whiteness none = whiteness(innovations(4, 10, 2, 0.0, 9), 5);
  EXPECT_TRUE(std::isnan(none.p));
  EXPECT_EQ(none.over, Pooling::none);
  EXPECT_TRUE(std::isnan(whiteness_p({}, 5)));
}

TEST(Whiteness, SeesCorrelationWithinOneRecord) {
  const Whiteness w = whiteness(innovations(1, 400, 1, 0.4, 7), 5);
  EXPECT_EQ(w.over, Pooling::time);
  EXPECT_LT(w.p, 1e-6);
  EXPECT_GT(w.correlation(0, 0), w.bound(0));
}

// Inputs that hardly change from step to step share what little they have to say.
TEST(Independence, ProbabilitiesAreUniformForInputsCorrelatedInTime) {
  for (const Index count : {8, 1}) {
    std::vector<double> p;
    for (int run = 0; run < runs; ++run) {
      Random random(std::uint64_t(run) + 500);
      Ensemble data(count, count == 1 ? 80 : 12, 2, 1);
      Innovations e;
      Matrix u = random.matrix(count, 2);
      for (Index k = 0; k < data.steps(); ++k) {
        u = 0.95 * u + 0.3 * random.matrix(count, 2);
        data.input(k) = u;
        e.push_back(random.matrix(count, 1));
      }
      data.u(0, 3, 1) = nan;
      p.push_back(independence(e, data, 0, 5).p);
    }
    EXPECT_LT(distance_from_uniform(p), one_in_a_thousand) << count;
  }
}

// A system with noise, whose data are judged with models that are wrong in one way each.
class WrongModels : public ::testing::Test {
 protected:
  static constexpr double certain = 1e-6, possible = 1e-3;
  const ExperimentOptions options_{.experiments = 60, .seed = 4, .process_noise = 0.1, .measurement_noise = 0.3};
  const Model truth_ = with_noise(oscillator(40), options_);
  const Ensemble data_ = experiments(truth_, options_);
};

TEST_F(WrongModels, TheTruthIsPossible) {
  const Validation v = validate(truth_, data_);
  for (const double p : {v.whiteness.p, v.independence.p, v.feedback.p, v.squares.p}) EXPECT_GT(p, possible);
}

TEST_F(WrongModels, AWrongDirectEffectShowsAtLagZero) {
  Model model = truth_;
  for (Step& step : model.step) step.D()(0, 1) += 0.15;  // half of the measurement noise
  const Validation v = validate(model, data_);
  EXPECT_LT(v.independence.p, certain);
  Index lag = 0;
  v.independence.z.maxCoeff(&lag);
  EXPECT_EQ(v.independence.first + lag, 0);
  EXPECT_GT(v.feedback.p, possible);
}

TEST_F(WrongModels, AMissingStateShowsInTimeAndInTheInputs) {
  Model model = truth_;
  for (size_t s = 0; s < model.step.size(); ++s) {  // the last state neither moves nor is seen
    model.step[s].A().col(3).setZero();
    model.step[s].A().row(3).setZero();
    model.step[s].B().row(3).setZero();
    model.step[s].G().row(3).setZero();
    model.step[s].C().col(3).setZero();
  }
  const Validation v = validate(model, data_);
  EXPECT_LT(v.whiteness.p, certain);
  EXPECT_LT(v.independence.p, certain);
  EXPECT_GT(v.squares.ratio, 1.1);
  EXPECT_LT(v.squares.p, certain);
}

// A system that is stable with and without the controller: motion that explodes hides the noise that is fed back.
TEST_F(WrongModels, FeedbackIsSeenAndIsNoFaultOfTheModel) {
  const Index count = 200, steps = 40;
  Model system = constant_system({2, 1, 1}, steps, 0.6, 2);
  for (Step& step : system.step) step.B() *= 0.3, step.D() *= 0.3;
  system = with_noise(system, options_);
  Random random(11);
  Ensemble data(count, steps, 1, 1);
  data.initial_state = InitialState::zero;
  Matrix x = Matrix::Zero(count, 2), y = Matrix::Zero(count, 1);
  for (Index k = 0; k < steps; ++k) {
    const size_t s = size_t(k);
    data.input(k) = 0.5 * (random.matrix(count, 1) - y);  // outputs of the step before
    y = x * system.step[s].C().transpose() + data.input(k) * system.step[s].D().transpose() +
        0.3 * random.matrix(count, 1);
    x = x * system.step[s].A().transpose() + data.input(k) * system.step[s].B().transpose() +
        0.1 * random.matrix(count, 2);
    data.output(k) = y;
  }
  ASSERT_LT(y.cwiseAbs().maxCoeff(), 10);
  const Validation v = validate(system, data);
  EXPECT_LT(v.feedback.p, certain);
  Index lag = 0;
  v.feedback.z.maxCoeff(&lag);
  EXPECT_EQ(v.feedback.first + lag, -1);
  EXPECT_GT(v.independence.p, possible);
  EXPECT_GT(v.whiteness.p, possible);
}

TEST_F(WrongModels, SquaresTellOverconfidenceFromCaution) {
  for (const double scale : {0.8, 1.25}) {
    Model model = truth_;
    for (Step& step : model.step) step.set_innovation_cov(scale * step.innovation_cov());
    const NormalisedSquares squares = validate(model, data_).squares;
    EXPECT_NEAR(squares.ratio * scale, validate(truth_, data_).squares.ratio, 1e-12);
    EXPECT_LT(squares.p, certain);
    EXPECT_EQ(squares.step.size(), 40);
  }
}

// Outputs that are noise alone, whose distribution has heavy tails: products of normal numbers, of kurtosis 9.
TEST(NormalisedSquares, ManyExperimentsNeedNoNormalDistribution) {
  Model model = random_system({1, 1, 1}, 10, 0.5, 1);
  for (Step& step : model.step) step.set_innovation_cov(Matrix::Identity(1, 1));
  std::vector<double> p, chi_square;
  for (int run = 0; run < runs; ++run) {
    Random random(std::uint64_t(run) + 900);
    Innovations e;
    for (Index k = 0; k < 10; ++k) e.emplace_back(random.matrix(60, 1).cwiseProduct(random.matrix(60, 1)));
    const NormalisedSquares squares = normalised_squares(model, e);
    EXPECT_FALSE(squares.normal);
    p.push_back(squares.p);
    for (Matrix& a : e) a = a.topRows(19).eval();
    const NormalisedSquares few = normalised_squares(model, e);
    EXPECT_TRUE(few.normal);
    chi_square.push_back(few.p);
  }
  EXPECT_LT(distance_from_uniform(p), one_in_a_thousand);
  EXPECT_GT(distance_from_uniform(chi_square), one_in_a_thousand);  // which is why
}

TEST(NormalisedSquares, NeedACovariance) {
  Model model = random_system({1, 2, 1}, 3, 0.5, 1);
  const Innovations e(3, Matrix::Ones(4, 2));
  EXPECT_TRUE(std::isnan(normalised_squares(model, e).ratio));
  for (Step& step : model.step) step.set_innovation_cov(Matrix::Identity(2, 2));
  model.step[1].set_innovation_cov(Matrix::Zero(2, 2));  // of a step that leaves no degree of freedom
  const NormalisedSquares squares = normalised_squares(model, e);
  EXPECT_DOUBLE_EQ(squares.ratio, 1.0);
  EXPECT_TRUE(std::isnan(squares.step(1)));
  EXPECT_DOUBLE_EQ(squares.step(2), 1.0);
  EXPECT_THROW(normalised_squares(model, Innovations(3, Matrix::Ones(4, 1))), std::invalid_argument);
}

// Outputs that repeat each other count once, and one without a variance not at all.
TEST(NormalisedSquares, CountTheDirectionsThatHaveAVariance) {
  Model model = random_system({2, 3, 1}, 20, 0.5, 1);
  Matrix covariance = Matrix::Zero(3, 3);
  covariance.topLeftCorner(2, 2).setConstant(4.0);
  for (Step& step : model.step) step.set_innovation_cov(covariance);
  Random random(2);
  Innovations e;
  for (Index k = 0; k < 20; ++k) {
    Matrix step = Matrix::Zero(50, 3);
    step.col(0) = 2 * random.matrix(50, 1);
    step.col(1) = step.col(0);
    e.push_back(step);
  }
  const NormalisedSquares squares = normalised_squares(model, e);
  EXPECT_NEAR(squares.ratio, 1.0, 4 * std::sqrt(2.0 / 1000));  // four standard errors of 1000 squares
  EXPECT_GT(squares.p, 1e-4);
  for (Matrix& step : e) step.col(1) *= -1;  // which the model says is impossible
  EXPECT_GT(normalised_squares(model, e).ratio, 1e6);
}

TEST(ModelInnovations, AreThoseOfThePredictionWhereNothingIsMissing) {
  const ExperimentOptions options{.experiments = 9, .process_noise = 0.1, .measurement_noise = 0.3};
  const Model model = with_noise(oscillator(20), options);
  Ensemble data = experiments(model, options);
  data.u(4, 7, 0) = data.y(6, 9, 1) = nan;
  const Innovations predicted = predict(model, data).innovations, found = model_innovations(model, data);
  for (size_t k = 0; k < 20; ++k) {
    for (Index n = 0; n < 9; ++n) {
      const bool complete = (n != 4 || k < 7) && (n != 6 || k < 9);
      EXPECT_TRUE(!complete || (found[k] - predicted[k]).row(n).norm() < 1e-13) << k;
    }
    // Nothing is known of the state after the missing input but what the samples from step 8 on tell, two steps of them
    EXPECT_EQ(found[k].row(4).allFinite(), k < 7 || k >= 10) << k;
    EXPECT_EQ(std::isnan(found[k](6, 1)), k == 9) << k;
  }
  // predict() goes on with a gain that is no longer the best.
  EXPECT_GT((found[12] - predicted[12]).row(6).norm(), 1e-6);
}

TEST(ModelInnovations, EndWhereModelOrDataDo) {
  const ExperimentOptions options{.experiments = 5, .process_noise = 0.1, .measurement_noise = 0.3};
  const Model model = with_noise(oscillator(12), options);
  const Innovations found = model_innovations(from_step(model, 4), experiments(oscillator(15), options));
  ASSERT_EQ(found.size(), 15u);
  for (size_t k = 0; k < 15; ++k) EXPECT_EQ(found[k].allFinite(), k >= 6 && k < 12) << k;
}

// e_k = c u_{k-2} + noise: correlation c / √(1 + c²).
TEST(Independence, CorrelationsAreThoseOfEachLag) {
  Random random(6);
  Ensemble data(500, 30, 1, 1);
  Innovations e;
  for (Index k = 0; k < 30; ++k) {
    data.input(k) = random.matrix(500, 1);
    e.push_back(random.matrix(500, 1));
    if (k >= 2) e.back() += 0.5 * data.input(k - 2);
  }
  for (const Index count : {500, 3}) {
    Innovations part;
    for (const Matrix& a : e) part.emplace_back(a.topRows(count));
    std::vector<Index> rows;
    for (Index n = 0; n < count; ++n) rows.push_back(n);
    const Independence found = independence(part, data.subset(rows), 0, 3);
    EXPECT_EQ(found.over, count == 3 ? Pooling::time : Pooling::experiments);
    EXPECT_LT(found.p, 1e-4);
    // The standard deviation of a correlation is 1 / √samples, three of which are the tolerance.
    EXPECT_NEAR(found.correlation(2), 0.5 / std::sqrt(1.25), 3 / std::sqrt(30.0 * double(count)));
    // Root mean squares beyond chance of what is not there: below the square root of three standard deviations.
    for (const Index lag : {0, 1, 3}) EXPECT_LT(found.correlation(lag), std::sqrt(3 * 1.5 / (double(count) * 5)));
  }
}

TEST(Independence, RefusesWhatDoesNotFit) {
  const Ensemble data(3, 4, 1, 2);
  EXPECT_THROW(independence(Innovations(4, Matrix::Zero(3, 2)), data, 1, 0), std::invalid_argument);
  EXPECT_THROW(independence(Innovations(5, Matrix::Zero(3, 2)), data, 0, 1), std::invalid_argument);
  EXPECT_THROW(independence(Innovations(4, Matrix::Zero(2, 2)), data, 0, 1), std::invalid_argument);
  EXPECT_THROW(independence(Innovations(4, Matrix::Zero(3, 1)), data, 0, 1), std::invalid_argument);
}

TEST(Independence, IsNotTestedWhereInputsFillTheSpaceOfTheExperiments) {
  Random random(3);
  Ensemble data(5, 6, 4, 1);
  for (Index k = 0; k < 6; ++k) data.input(k) = random.matrix(5, 4);
  Innovations e;
  for (Index k = 0; k < 6; ++k) e.push_back(random.matrix(5, 1));
  EXPECT_TRUE(std::isnan(independence(e, data, 0, 2).p));
}

// Effects of the inputs that are wrong in the model, each by its own factor, with feedback from the outputs.
TEST(InputGains, TellHowMuchStrongerTheEffectsAre) {
  const ExperimentOptions options{.experiments = 60, .process_noise = 0.1, .measurement_noise = 0.1};
  const Model system = with_noise(oscillator(50), options);
  for (const bool gaps : {false, true}) {
    Ensemble data = experiments(system, options);
    Random random(2);
    if (gaps)
      for (Index k = 0; k < data.steps(); ++k)
        for (double& y : data.output(k).reshaped())
          if (random.uniform(0, 1) < 0.1) y = nan;
    Model wrong = system;
    for (size_t k = 0; k < wrong.step.size(); ++k) {
      wrong.step[k].B().col(0) *= 0.5, wrong.step[k].D().col(0) *= 0.5;
      wrong.step[k].B().col(1) *= -1.0, wrong.step[k].D().col(1) *= -1.0;
    }
    const InputGains right = validate(system, data).gains, found = validate(wrong, data).gains;
    for (Index i = 0; i < 2; ++i) {
      EXPECT_LT(right.deviation(i), 0.02);
      EXPECT_LT(std::abs(right.error(i)), 4 * right.deviation(i));
      EXPECT_GT(right.share(i), 0.2);
    }
    EXPECT_NEAR(found.error(0), 1.0, 0.05);
    EXPECT_NEAR(found.error(1), -2.0, 0.05);
    EXPECT_EQ(conclusions(validate(system, data), {}).gains.result, TestResult::nothing);
    const Conclusion against = conclusions(validate(wrong, data), {}).gains;
    EXPECT_EQ(against.result, TestResult::against);
    EXPECT_EQ(against.reason, Conclusion::Reason::gains_wrong);
    EXPECT_NE(in_words(against).find("to u2 with the opposite sign of what the model says"), std::string::npos)
        << in_words(against);
  }
}

TEST(InputGains, AreNotKnownOfInputsThatDoNotDiffer) {
  const ExperimentOptions options{.experiments = 20, .process_noise = 0.1, .measurement_noise = 0.1};
  const Model system = with_noise(oscillator(30), options);
  Ensemble data = experiments(system, options);
  for (Index k = 0; k < data.steps(); ++k) data.input(k).col(1).setConstant(std::sin(0.3 * double(k)));
  const InputGains found = validate(system, data).gains;
  EXPECT_TRUE(std::isnan(found.error(1)));
  EXPECT_TRUE(std::isinf(found.deviation(1)));
  EXPECT_EQ(found.share(1), 0.0);
  // Two inputs of which one is half of the other can't be told apart.
  for (Index k = 0; k < data.steps(); ++k) data.input(k).col(1) = 0.5 * data.input(k).col(0);
  const InputGains together = input_gains(system, data, predict(system, data).innovations);
  EXPECT_TRUE(std::isfinite(together.share(0)));
  EXPECT_THROW(input_gains(system, Ensemble(20, 30, 1, 2), Innovations(30, Matrix::Zero(20, 2))),
               std::invalid_argument);
  EXPECT_THROW(input_gains(system, data, Innovations(29, Matrix::Zero(20, 2))), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
