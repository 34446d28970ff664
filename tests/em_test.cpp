// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/em.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <limits>
#include <numbers>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/observer.hpp"
#include "tokid/validate.hpp"

namespace tokid::testing {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

Matrix covariance(Index n, double size, Random& random) {
  const Matrix root = random.matrix(n, n);
  return size * (root * root.transpose() + Matrix::Identity(n, n));
}

// A system with noise on its states and outputs, and with a random initial state if that is unknown.
Model noisy_system(const SystemSize& size, Index steps, InitialState initial, std::uint64_t seed,
                   bool constant = false) {
  Model system = constant ? constant_system(size, steps, 0.9, seed) : random_system(size, steps, 0.9, seed);
  Random random(seed + 1000);
  const Matrix q = covariance(size.n, 0.02, random), r = covariance(size.m, 0.05, random);
  for (Step& step : system.step) {
    step.set_Q(q);
    step.set_R(r);
  }
  system.x0_mean = Vector::Zero(size.n);
  system.x0_cov = Matrix::Zero(size.n, size.n);
  system.initial_state = initial;
  if (initial == InitialState::unknown) {
    system.x0_mean = random.matrix(size.n, 1);
    system.x0_cov = covariance(size.n, 0.5, random);
  }
  return kalman_observer(std::move(system));
}

Ensemble noisy_experiments(const Model& system, Index experiments, std::uint64_t seed) {
  Random random(seed);
  Ensemble e(experiments, system.steps(), system.inputs, system.outputs);
  const auto noise = [&](const Matrix& covariance) {
    return Matrix(random.matrix(experiments, covariance.rows()) *
                  linalg::covariance_factor(covariance).value().transpose());
  };
  Matrix x = noise(system.x0_cov).rowwise() + system.x0_mean.transpose();
  for (Index k = 0; k < e.steps(); ++k) {
    const size_t s = system.index(k);
    e.input(k) = random.matrix(experiments, e.inputs());
    e.output(k) =
        x * system.step[s].C().transpose() + e.input(k) * system.step[s].D().transpose() + noise(system.step[s].R());
    x = x * system.step[s].A().transpose() + e.input(k) * system.step[s].B().transpose() + noise(system.step[s].Q());
  }
  e.initial_state = system.initial_state;
  return e;
}

// Outputs missing one by one, in whole steps and at the end; an input or two as well.
void lose_samples(Ensemble& e, double share, bool inputs, std::uint64_t seed) {
  Random random(seed);
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = 0; k < e.steps(); ++k)
      for (Index j = 0; j < e.outputs(); ++j)
        if (random.uniform(0, 1) < share) e.y(n, k, j) = nan;
  for (Index j = 0; j < e.outputs(); ++j) e.y(0, 2, j) = nan;
  for (Index k = e.steps() - 2; k < e.steps(); ++k)
    for (Index j = 0; j < e.outputs(); ++j) e.y(e.experiments() - 1, k, j) = nan;
  if (inputs) e.u(0, 1, 0) = e.u(e.experiments() / 2, e.steps() / 2, e.inputs() - 1) = nan;
}

// log density of the outputs of experiment n that are there, stacked over time, from the covariance of all of them; a
// missing input is random with the mean square of its channel.
double direct_log_likelihood(const Model& system, const Ensemble& e, Index n) {
  const Index t_end = e.steps(), m = e.outputs(), r = e.inputs();
  // Sources: x_0, then u_k, w_k, v_k of every step. Their map to [y_0; …], mean and covariance.
  std::vector<Vector> mean;
  std::vector<Matrix> map;  // of x_k to the sources, columns grow
  Index sources = system.x0_mean.size();
  Matrix x = Matrix::Identity(sources, sources);
  std::vector<double> source_mean(system.x0_mean.begin(), system.x0_mean.end());
  Matrix source_cov = system.x0_cov;
  Matrix y(t_end * m, 0);
  const auto add = [&](const Vector& new_mean, const Matrix& new_cov) {
    const Index more = new_mean.size();
    x.conservativeResize(Eigen::NoChange, sources + more);
    x.rightCols(more).setZero();
    y.conservativeResize(Eigen::NoChange, sources + more);
    y.rightCols(more).setZero();
    source_cov.conservativeResize(sources + more, sources + more);
    source_cov.rightCols(more).setZero();
    source_cov.bottomRows(more).setZero();
    source_cov.bottomRightCorner(more, more) = new_cov;
    source_mean.insert(source_mean.end(), new_mean.begin(), new_mean.end());
    sources += more;
    return sources - more;
  };
  y.conservativeResize(Eigen::NoChange, sources);
  y.setZero();
  for (Index k = 0; k < t_end; ++k) {
    const size_t s = system.index(k);
    Vector u = e.input(k).row(n).transpose();
    Matrix u_cov = Matrix::Zero(r, r);
    for (Index i = 0; i < r; ++i)
      if (std::isnan(u(i))) {
        const ChannelSummary c = channel_summary(e, i);
        u(i) = 0.0;
        u_cov(i, i) = c.mean * c.mean + c.std * c.std;
      }
    const Index at_u = add(u, u_cov), at_v = add(Vector::Zero(m), system.step[s].R());
    const Index at_w = add(Vector::Zero(system.step[s].Q().rows()), system.step[s].Q());
    auto y_k = y.middleRows(k * m, m);
    y_k = system.step[s].C() * x;
    y_k.middleCols(at_u, r) += system.step[s].D();
    y_k.middleCols(at_v, m).diagonal().array() += 1.0;
    x = Matrix(system.step[s].A() * x);
    x.middleCols(at_u, r) += system.step[s].B();
    x.middleCols(at_w, system.step[s].Q().rows()).diagonal().array() += 1.0;
  }
  std::vector<Index> there;
  std::vector<double> values;
  for (Index k = 0; k < t_end; ++k)
    for (Index j = 0; j < m; ++j)
      if (std::isfinite(e.y(n, k, j))) there.push_back(k * m + j), values.push_back(e.y(n, k, j));
  if (there.empty()) return 0.0;
  const Matrix seen = y(there, Eigen::all);
  const Vector error = Eigen::Map<const Vector>(values.data(), Index(values.size())) -
                       seen * Eigen::Map<const Vector>(source_mean.data(), sources);
  const Eigen::LLT<Matrix> factor(seen * source_cov * seen.transpose());
  const Matrix l = factor.matrixL();
  return -0.5 * (error.dot(factor.solve(error)) + 2 * l.diagonal().array().log().sum() +
                 double(there.size()) * std::log(2 * std::numbers::pi));
}

TEST(LogLikelihoods, AreTheDensityOfTheStackedOutputs) {
  for (const SystemSize size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 2}, SystemSize{1, 3, 1}, SystemSize{0, 2, 1}})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const double share : {0.0, 0.2}) {
        const Model system = noisy_system(size, 7, initial, 3);
        Ensemble e = noisy_experiments(system, 5, 4);
        if (share > 0) lose_samples(e, share, true, 5);
        const Vector found = log_likelihoods(system, e);
        for (Index n = 0; n < e.experiments(); ++n) {
          const double direct = direct_log_likelihood(system, e, n);
          // The direct formula factors a matrix of condition some 1e4.
          EXPECT_NEAR(found(n), direct, 1e-9 * (1 + std::abs(direct))) << name(size) << " " << n;
        }
      }
}

// A start that is off: every matrix a little wrong, the noise too large.
Model disturbed(Model model, double size, std::uint64_t seed) {
  Random random(seed);
  for (const auto part : system_parts)
    for (Step& step : model.step) {
      Step::Writable a = (step.*part)();
      a += size * random.matrix(a.rows(), a.cols());
    }
  for (Step& step : model.step) {
    step.set_Q(2 * step.Q());
    step.set_R(1.5 * step.R());
  }
  return kalman_observer(std::move(model));
}

void expect_monotone(const Refinement& r, const std::string& what) {
  ASSERT_EQ(Index(r.penalised.size()), r.iterations + 1) << what;
  for (size_t i = 1; i < r.penalised.size(); ++i)
    EXPECT_GE(r.penalised[i], r.penalised[i - 1]) << what << " iteration " << i;
  EXPECT_GT(r.penalised.back(), r.penalised.front()) << what;
}

struct Case {
  SystemSize size;
  InitialState initial;
  double missing;
  double smoothing;
  Index period;
};

std::string text(const Case& c) {
  return name(c.size) + " " + to_string(c.initial) + " missing " + std::to_string(c.missing) + " smoothing " +
         std::to_string(c.smoothing) + " period " + std::to_string(c.period);
}

// Plain EM is compared with itself: a step that lowers the likelihood is not hidden by the safeguard of the climb, for
// that would end it at once, far from convergence.
TEST(Refine, LikelihoodNeverFalls) {
  for (const SystemSize size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 2}, SystemSize{2, 3, 1}})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const double missing : {0.0, 0.15})
        for (const double smoothing : {0.0, 0.1, infinity})
          for (const Index period : {Index{0}, Index{3}}) {
            const Case c{size, initial, missing, smoothing, period};
            const bool constant = smoothing > 0;
            const Model system = noisy_system(size, 9, initial, 11, constant);
            Ensemble e = noisy_experiments(system, 40, 12);
            if (missing > 0) lose_samples(e, missing, true, 13);
            RefineOptions o;
            o.smoothing = smoothing;
            o.period = period;
            o.iterations = 6;
            o.tolerance = 0.0;
            for (const bool accelerate : {false, true}) {
              o.accelerate = accelerate;
              const Refinement r = refine(disturbed(system, 0.05, 14), e, o);
              EXPECT_EQ(r.iterations, 6) << text(c);
              expect_monotone(r, text(c));
              r.model.check();
              if (smoothing == 0 && initial == InitialState::zero) {
                EXPECT_EQ(r.penalised, r.log_likelihood) << text(c);
              }
              // What is reported is the likelihood of the model that is returned.
              EXPECT_NEAR(log_likelihoods(r.model, e).sum(), r.log_likelihood.back(),
                          1e-9 * std::abs(r.log_likelihood.back()))
                  << text(c);
            }
          }
}

TEST(Refine, RoundingErrorsOfTheDataHardlyGrow) {
  const Model system = noisy_system({4, 2, 2}, 50, InitialState::zero, 41);
  const Ensemble e = noisy_experiments(system, 40, 42);
  Matrix samples = e.samples();
  for (Index i = 0; i < samples.size(); ++i)
    samples.data()[i] = std::nextafter(samples.data()[i], i % 2 == 0 ? infinity : -infinity);
  Ensemble changed = e;
  changed.samples() = samples;
  const RefineOptions o{.smoothing = 3, .iterations = 168, .tolerance = 0.0};
  const Model start = disturbed(system, 0.05, 43), a = refine(start, e, o).model, b = refine(start, changed, o).model;
  for (Index k = 0; k < 50; ++k) {
    const Matrix of_a = predict(a, e).y.output(k), difference = of_a - predict(b, e).y.output(k);
    // The moments are sums of 2000 products, and 168 iterations follow each other.
    EXPECT_LE(difference.norm(), 2000 * 168 * 100 * std::numeric_limits<double>::epsilon() * of_a.norm()) << k;
  }
}

TEST(Refine, GainsAreThoseOfTheKalmanFilter) {
  const Model system = noisy_system({3, 2, 2}, 10, InitialState::unknown, 21);
  const Model refined = refine(system, noisy_experiments(system, 60, 22), {.iterations = 3}).model;
  const KalmanFilter filter = kalman_filter(refined);
  for (size_t s = 0; s < 10; ++s) {
    EXPECT_EQ(refined.step[s].K(), filter.K[s]);
    // Sums of three products, which processors with fused products round in more than one way.
    const double bound =
        2 * 3 * std::numeric_limits<double>::epsilon() * refined.step[s].A().norm() * filter.K[s].norm();
    EXPECT_LE((refined.step[s].G() + refined.step[s].A() * filter.K[s]).norm(), bound);
    EXPECT_EQ(refined.step[s].innovation_cov(), filter.innovation_cov[s]);
  }
  EXPECT_EQ(refined.method, "em");
  EXPECT_EQ(refined.x0_mean.size(), 3);
}

// Shared matrices are determined by all steps, so that few experiments determine the initial states beside them.
TEST(Refine, PredictsFromStepZeroAlsoWithFewExperiments) {
  for (const Index period : {0, 1, 2}) {
    SCOPED_TRACE(period);
    const Model system = noisy_system({4, 1, 1}, 60, InitialState::unknown, 61, true);
    const auto initial_states = [&](Index experiments) {
      const RefineOptions o{.smoothing = period > 0 ? 0.0 : 3.0, .period = period, .iterations = 3};
      return refine(system, noisy_experiments(system, experiments, 62), o).model.x0_mean.size();
    };
    EXPECT_EQ(initial_states(5), 4);
    EXPECT_EQ(initial_states(4), period > 0 ? 4 : 0);
    EXPECT_EQ(initial_states(2), period > 0 ? 4 : 0);
    EXPECT_EQ(initial_states(1), 0);
  }
}

TEST(Refine, StaysAtTheTruthForManyExperiments) {
  const Model system = noisy_system({2, 2, 1}, 6, InitialState::zero, 31);
  const Ensemble e = noisy_experiments(system, 20000, 32);
  const Refinement r = refine(system, e, {.iterations = 10});
  // 20 coefficients a step (18 with their covariances) gain half a unit of likelihood each by fitting the noise.
  EXPECT_LT(r.log_likelihood.back() - r.log_likelihood.front(), 6 * 18);
  // Errors of size 1/√N = 0.7 %, largest of many.
  EXPECT_LT(kinematically_similar(system, r.model).max_difference, 0.05);
}

TEST(Refine, FindsTheNoiseAndBringsADisturbedModelBack) {
  const Model system = noisy_system({2, 2, 2}, 12, InitialState::zero, 41);
  const Ensemble e = noisy_experiments(system, 2000, 42), fresh = noisy_experiments(system, 500, 43);
  const Model start = disturbed(system, 0.1, 44);
  const Refinement r = refine(start, e, {.iterations = 200});
  const double best = log_likelihoods(system, fresh).sum(), before = log_likelihoods(start, fresh).sum();
  const double after = log_likelihoods(r.model, fresh).sum();
  EXPECT_GT(after, best - 0.05 * (best - before));
  EXPECT_TRUE(r.converged);
}

TEST(Refine, UnequalLengthsAreTruncatedData) {
  const Model system = noisy_system({2, 2, 1}, 10, InitialState::zero, 51);
  const Ensemble whole = noisy_experiments(system, 30, 52);
  Ensemble shorter = whole;  // all end at step 7
  for (Index k = 7; k < 10; ++k) shorter.output(k).setConstant(nan);
  Ensemble cut(30, 7, 1, 2);
  for (Index k = 0; k < 7; ++k) cut.input(k) = whole.input(k), cut.output(k) = whole.output(k);
  cut.initial_state = InitialState::zero;
  // Not accelerated: the coordinates of steps without data would have a say in how far to go.
  const RefineOptions plain{.iterations = 4, .accelerate = false};
  const Refinement a = refine(system, shorter, plain), b = refine(system, cut, plain);
  ASSERT_EQ(a.log_likelihood.size(), b.log_likelihood.size());
  for (size_t i = 0; i < a.log_likelihood.size(); ++i)
    EXPECT_NEAR(a.log_likelihood[i], b.log_likelihood[i], 1e-9 * std::abs(b.log_likelihood[i]));
  // Steps without data keep the matrices of the start.
  EXPECT_EQ(a.model.step[9].C(), system.step[9].C());
}

TEST(Refine, SharedMatricesAreShared) {
  const Model system = noisy_system({2, 1, 1}, 12, InitialState::unknown, 61, true);
  const Ensemble e = noisy_experiments(system, 20, 62);
  const Model constant = refine(system, e, {.smoothing = infinity, .iterations = 3}).model;
  const Model periodic = refine(system, e, {.period = 4, .iterations = 3}).model;
  for (size_t s = 1; s < 12; ++s) {
    EXPECT_EQ(constant.step[s].A(), constant.step[0].A());
    EXPECT_EQ(constant.step[s].R(), constant.step[0].R());
    if (s < 4) continue;
    EXPECT_EQ(periodic.step[s].A(), periodic.step[s - 4].A());
    EXPECT_EQ(periodic.step[s].Q(), periodic.step[s - 4].Q());
  }
  EXPECT_NE(periodic.step[1].A(), periodic.step[0].A());
}

TEST(Refine, OneLongRecordIsEnoughForAConstantSystem) {
  const Model system = noisy_system({2, 1, 1}, 2000, InitialState::unknown, 65, true);
  const Ensemble e = noisy_experiments(system, 1, 66), fresh = noisy_experiments(system, 1, 67);
  const Model start = disturbed(system, 0.02, 68);
  const Refinement r = refine(start, e, {.smoothing = infinity});
  expect_monotone(r, "one record");
  // Some ten parameters cost about five units on fresh data; three times that.
  EXPECT_GT(log_likelihoods(r.model, fresh)(0), log_likelihoods(system, fresh)(0) - 15);
}

TEST(Refine, TheSameBitsForAnyNumberOfThreads) {
  const Model system = noisy_system({3, 2, 2}, 8, InitialState::unknown, 71);
  Ensemble e = noisy_experiments(system, 150, 72);
  for (Index k = 0; k < 3; ++k) e.y(10 * k, k, 0) = nan;
  RefineOptions o{.smoothing = 0.3, .iterations = 4};
  const Refinement one = refine(system, e, o);
  o.execution.threads = 3;
  const Refinement three = refine(system, e, o);
  EXPECT_EQ(one.penalised, three.penalised);
  for (size_t s = 0; s < 8; ++s) {
    EXPECT_EQ(one.model.step[s].A(), three.model.step[s].A());
    EXPECT_EQ(one.model.step[s].Q(), three.model.step[s].Q());
  }
}

TEST(Refine, NominalTrajectoriesAreRemoved) {
  Model system = noisy_system({2, 1, 1}, 8, InitialState::zero, 81);
  const Ensemble e = noisy_experiments(system, 40, 82);
  Random random(83);
  const Nominal nominal{random.matrix(8, 1), 10 * random.matrix(8, 1)};
  const Ensemble shifted = departures(e, {-nominal.u, -nominal.y});
  const Refinement a = refine(system, e, {.iterations = 3});
  system.u_nominal = nominal.u;
  system.y_nominal = nominal.y;
  const Refinement b = refine(system, shifted, {.iterations = 3});
  EXPECT_NEAR(a.log_likelihood.back(), b.log_likelihood.back(), 1e-8 * std::abs(a.log_likelihood.back()));
  EXPECT_EQ(b.model.y_nominal, nominal.y);
}

TEST(Refine, StartsFromRealisationsWithoutNoiseAndWithMissingEnds) {
  ExperimentOptions options;
  options.experiments = 60;
  options.process_noise = 0.1;
  options.measurement_noise = 0.3;
  const Model system = oscillator(30);
  Ensemble e = experiments(system, options);
  options.seed = 2;
  options.experiments = 200;
  const Ensemble fresh = experiments(system, options);
  const Model start = kalman_observer([&] {
    Model known = with_noise(system, options);
    return from_step(known, 3);
  }());
  Model bare = start;
  for (Step& step : bare.step) step.forget_noise();
  const Refinement r = refine(bare, e, {.smoothing = 0.3});
  EXPECT_EQ(r.model.k_begin, 0);
  EXPECT_EQ(r.model.steps(), 30);
  const double best = log_likelihoods(with_noise(system, options), fresh).sum();
  EXPECT_GT(log_likelihoods(r.model, fresh).sum() / best, 0.9);
  EXPECT_LT(log_likelihoods(r.model, fresh).sum() / best, 1.2);
}

// A model that an unstable plant has driven off, as an earlier stage of EM may leave it.
TEST(Refine, SaysThatItHasDiverged) {
  Model model = with_noise(random_system({3, 1, 1}, 30, 0.9, 41), {.process_noise = 0.1, .measurement_noise = 0.1});
  const Ensemble data =
      experiments(model, {.experiments = 10, .seed = 42, .process_noise = 0.1, .measurement_noise = 0.1});
  for (Step& step : model.step) step.set_Q(Vector{{1e36, 1e28, 1.0}}.asDiagonal());
  RefineOptions options;
  options.smoothing = 100.0;
  EXPECT_THROW(refine(model, data, options), std::runtime_error);
}

TEST(Refine, SaysThatDataHaveNoNoise) {
  const Model system = random_system({3, 2, 2}, 12, 0.9, 91);
  for (const double smoothing : {0.0, infinity}) {
    const Model truth = smoothing > 0 ? constant_system({3, 2, 2}, 12, 0.9, 91) : system;
    const Ensemble e = random_experiments(truth, 60, 92), fresh = random_experiments(truth, 10, 93);
    const Refinement r = refine(truth, e, {.smoothing = smoothing, .iterations = 40});
    expect_monotone(r, "no noise");
    ASSERT_FALSE(r.findings.empty());
    EXPECT_NE(in_words(r.findings)[0].find("no noise"), std::string::npos) << in_words(r.findings)[0];
    // The floors are variances of 1e-12 of the signals: no state is told better than to 1e-6, and the outputs of an
    // unexcited direction not at all.
    EXPECT_LT(output_error(fresh, predict(r.model, fresh).y), 1e-4);
  }
}

TEST(Refine, SmoothingPaysWhereTheSystemVariesSlowly) {
  ExperimentOptions options;
  options.experiments = 30;
  options.process_noise = 0.1;
  options.measurement_noise = 0.3;
  const Model system = oscillator(40);
  const Ensemble e = experiments(system, options);
  options.seed = 2;
  options.experiments = 300;
  const Ensemble fresh = experiments(system, options);
  const Model start = disturbed(with_noise(system, options), 0.05, 95);
  const auto score = [&](double smoothing) {
    return log_likelihoods(refine(start, e, {.smoothing = smoothing}).model, fresh).sum();
  };
  const double free = score(0.0), held = score(1.0), constant = score(infinity);
  EXPECT_GT(held, free);
  EXPECT_GT(held, constant);
  const LikelihoodChoice choice = choose_smoothing({start, start, start}, e, {.iterations = 15});
  EXPECT_GT(choice.best, 0.0);
  EXPECT_LT(choice.best, infinity);
  EXPECT_EQ(choice.smoothing.size(), choice.log_likelihood.size());
}

TEST(Refine, WorksWithoutStatesAndForOneExperiment) {
  const Model without = noisy_system({0, 2, 1}, 6, InitialState::zero, 121);
  const Ensemble e = noisy_experiments(without, 50, 122);
  for (const double smoothing : {0.0, 1.0, infinity}) {
    const Refinement r = refine(disturbed(without, 0.1, 123), e, {.smoothing = smoothing, .iterations = 5});
    EXPECT_EQ(r.model.states(), 0);
    EXPECT_GT(r.penalised.back(), r.penalised.front());
  }
  const Model single = noisy_system({2, 1, 1}, 300, InitialState::unknown, 124, true);
  const Refinement r = refine(single, noisy_experiments(single, 1, 125), {.period = 2, .iterations = 5});
  expect_monotone(r, "one experiment");
  EXPECT_TRUE(linalg::covariance_factor(r.model.x0_cov).has_value());
}

TEST(Refine, SeesWhereTheSizeOfTheNoiseChanges) {
  const ExperimentOptions options{.experiments = 100, .process_noise = 0.1, .measurement_noise = 0.2};
  const Model system = oscillator(30), start = disturbed(with_noise(system, options), 0.02, 96);
  Ensemble e = experiments(system, options);
  const Refinement same = refine(start, e, {.smoothing = 1});
  EXPECT_EQ(same.noise_segments, 1);
  EXPECT_EQ(same.model.step[5].R(), same.model.step[25].R());
  Random random(97);
  for (Index k = 15; k < 30; ++k) e.output(k) += 0.6 * random.matrix(100, 2);
  const Refinement changing = refine(start, e, {.smoothing = 1});
  expect_monotone(changing, "changing noise");
  EXPECT_GT(changing.noise_segments, 1);
  // Variances 0.04 and 0.4 from 200 samples each, some of them spent on the coefficients.
  EXPECT_NEAR(changing.model.step[5].R().trace() / 2, 0.04, 0.02);
  EXPECT_NEAR(changing.model.step[25].R().trace() / 2, 0.4, 0.15);
}

TEST(Refine, MissingSamplesCostLittle) {
  const ExperimentOptions options{.experiments = 150, .process_noise = 0.1, .measurement_noise = 0.3};
  const Model system = oscillator(30), start = disturbed(with_noise(system, options), 0.05, 99);
  const Ensemble whole = experiments(system, options);
  Ensemble gaps = whole, shorter = whole;
  lose_samples(gaps, 0.1, true, 100);
  for (Index n = 0; n < 150; n += 3)
    for (Index k = 20; k < 30; ++k) shorter.y(n, k, 0) = shorter.y(n, k, 1) = nan;
  const Ensemble fresh =
      experiments(system, {.experiments = 300, .seed = 2, .process_noise = 0.1, .measurement_noise = 0.3});
  const auto score = [&](const Ensemble& e) {
    return fit(fresh, predict(refine(start, e, {.smoothing = 0.3}).model, fresh).y).rmse.norm();
  };
  const double complete = score(whole);
  EXPECT_LT(score(gaps), 1.02 * complete);
  EXPECT_LT(score(shorter), 1.02 * complete);
}

TEST(ChooseSmoothing, KeepsConstantSystemsConstant) {
  const Model system = noisy_system({2, 2, 1}, 20, InitialState::zero, 97, true);
  const Ensemble e = noisy_experiments(system, 30, 98);
  EXPECT_EQ(choose_smoothing({system, system, system}, e, {.iterations = 15}).best, infinity);
}

TEST(WithConstantStates, EndsAreThoseOfTheNearestFullStep) {
  const Model system = oscillator(20);
  Model known = kalman_observer(with_noise(system, {.process_noise = 0.1, .measurement_noise = 0.1}));
  const Model inner = from_step(known, 5);
  const Model whole = with_constant_states(inner, 25);
  EXPECT_EQ(whole.k_begin, 0);
  EXPECT_EQ(whole.steps(), 25);
  EXPECT_EQ(whole.step[0].A(), known.step[5].A());
  EXPECT_EQ(whole.step[12].A(), known.step[12].A());
  EXPECT_EQ(whole.step[24].A(), known.step[19].A());
  whole.check();
}

// Root mean square of the innovations that are there, from step `from` on.
double error(const Prediction& prediction, size_t from = 0) {
  double sum = 0.0, count = 0.0;
  for (size_t k = from; k < prediction.innovations.size(); ++k)
    for (const double value : prediction.innovations[k].reshaped())
      if (!std::isnan(value)) sum += value * value, count += 1;
  return std::sqrt(sum / count);
}

TEST(Predict, FiltersExactlyAroundMissingSamples) {
  const Model system = noisy_system({3, 2, 2}, 20, InitialState::unknown, 101);
  const Ensemble whole = noisy_experiments(system, 200, 102);
  // A gap at the very end changes the path that is taken, and nothing else.
  Ensemble almost = whole;
  almost.y(7, 19, 1) = nan;
  for (const Index horizon : {1, 3}) {
    const Prediction observer = predict(system, whole, {horizon}), filter = predict(system, almost, {horizon});
    for (Index k = 0; k < 20; ++k)
      EXPECT_LT((observer.y.output(k) - filter.y.output(k)).norm(), 1e-10 * observer.y.output(k).norm()) << k;
  }
  Ensemble e = whole;
  lose_samples(e, 0.3, true, 103);
  Model observer = system;
  for (Step& step : observer.step) step.forget_noise();
  Model skipping = observer;
  for (Step& step : skipping.step) step.forget_innovation_cov();
  const Prediction filter = predict(system, e);
  EXPECT_LT(error(filter), 0.998 * error(predict(observer, e)));
  EXPECT_LT(error(filter), 0.99 * error(predict(skipping, e)));
  EXPECT_TRUE(std::isnan(filter.innovations[1](0, 0)));   // the input of this very step is not known
  EXPECT_FALSE(std::isnan(filter.innovations[3](0, 0)));  // those of later steps are
}

TEST(Predict, UnknownInitialStatesHaveTheirMean) {
  const Model system = noisy_system({3, 2, 1}, 12, InitialState::unknown, 111);
  const Ensemble e = noisy_experiments(system, 300, 112);
  const Prediction p = predict(system, e);
  const Matrix expected =
      (e.input(0) * system.step[0].D().transpose()).rowwise() + (system.step[0].C() * system.x0_mean).transpose();
  EXPECT_LT((p.y.output(0) - expected).norm(), 1e-12 * expected.norm());
  // Said to come from elsewhere, they are estimated first, from two steps.
  const Prediction elsewhere = predict(system, e, {.initial_estimate = false});
  EXPECT_TRUE(elsewhere.innovations[1].hasNaN());
  EXPECT_FALSE(elsewhere.innovations[2].hasNaN());
  EXPECT_LT(error(p, 2), error(elsewhere, 2));
  // Single states: the mean of what the prior and the first samples say, better than either.
  const double posterior = fit(e, simulate_data(system, e)).rmse.norm();
  EXPECT_LT(posterior, fit(e, simulate(system, e)).rmse.norm());
  const Matrix estimate = estimate_state(system, e, 0, estimation_window(system));
  EXPECT_LT(posterior, fit(e, simulate(system, e, estimate)).rmse.norm());
  Ensemble zero = e;
  zero.initial_state = InitialState::zero;
  EXPECT_EQ(simulate(system, zero).y(0, 0, 0), system.step[0].D()(0, 0) * e.u(0, 0, 0));
}

TEST(Refine, BadInputs) {
  const Model system = noisy_system({2, 1, 1}, 8, InitialState::zero, 1);
  const Ensemble e = noisy_experiments(system, 10, 2);
  const auto message = [&](const Model& model, const Ensemble& data, const RefineOptions& o) {
    try {
      refine(model, data, o);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message(system, e, {.smoothing = -1}).find("smoothing: -1"), std::string::npos);
  EXPECT_NE(message(system, e, {.smoothing = nan}).find("smoothing: nan"), std::string::npos);
  EXPECT_NE(message(system, e, {.period = -1}).find("period: -1"), std::string::npos);
  EXPECT_NE(message(system, e, {.iterations = -1}).find("iterations: -1"), std::string::npos);
  EXPECT_NE(message(system, e, {.tolerance = -1}).find("tolerance: -1"), std::string::npos);
  EXPECT_NE(message(system, Ensemble(3, 8, 2, 1), {}).find("inputs: 2"), std::string::npos);
  EXPECT_NE(message(system, Ensemble(3, 8, 1, 2), {}).find("outputs: 2"), std::string::npos);
  Ensemble silent = e;
  for (Index k = 0; k < 8; ++k) silent.output(k).setConstant(nan);
  EXPECT_NE(message(system, silent, {}).find("no output sample"), std::string::npos);
  Model nothing;
  nothing.inputs = nothing.outputs = 1;
  EXPECT_NE(message(nothing, e, {}).find("two"), std::string::npos);
  EXPECT_THROW(choose_smoothing({system}, e), std::invalid_argument);
  EXPECT_THROW(choose_smoothing(std::vector<Model>(11, system), e), std::invalid_argument);
  Model bare = system;
  for (Step& step : bare.step) step.forget_noise();
  EXPECT_THROW(log_likelihoods(bare, e), std::invalid_argument);
}

}  // namespace
// A system of constant matrices until the step `at`, and of others from there on.
Model jumping_system(const SystemSize& size, Index steps, Index at) {
  Model system = noisy_system(size, steps, InitialState::zero, 1, true);
  const Model other = noisy_system(size, steps, InitialState::zero, 2, true);
  for (Index k = at; k < steps; ++k) {
    Step& step = system.step[size_t(k)];
    step.A() = other.step[size_t(k)].A();
    step.B() = other.step[size_t(k)].B();
  }
  return kalman_observer(std::move(system));
}

TEST(Jumps, MatricesFollowAJumpAtOnce) {
  const Index steps = 40, at = 18;
  const Model system = jumping_system({2, 1, 2}, steps, at);
  const Ensemble data = noisy_experiments(system, 200, 3);
  RefineOptions options;
  options.smoothing = 100;
  const Model smeared = refine(system, data, options).model;
  options.jumps = {at};
  const Model sharp = refine(system, data, options).model;
  // The pulse responses across the jump, relative to those of the system, with 1 % noise of 200 experiments.
  const auto error = [&](const Model& model) {
    double square = 0.0, size = 0.0;
    for (Index k = at - 3; k < at + 3; ++k)
      for (Index i = 1; i <= 4; ++i) {
        square += (pulse_response(model, k + i, k) - pulse_response(system, k + i, k)).squaredNorm();
        size += pulse_response(system, k + i, k).squaredNorm();
      }
    return std::sqrt(square / size);
  };
  EXPECT_LT(error(sharp), 0.05);
  EXPECT_GT(error(smeared), 3 * error(sharp));
}

TEST(Jumps, BadInputs) {
  const Model system = jumping_system({2, 1, 1}, 10, 5);
  const Ensemble data = noisy_experiments(system, 20, 3);
  for (const std::vector<Index>& jumps : {std::vector<Index>{0}, {10}, {4, 4}, {6, 3}})
    EXPECT_THROW(refine(system, data, {.smoothing = 1, .jumps = jumps}), std::invalid_argument);
  EXPECT_THROW(refine(system, data, {.smoothing = 1, .period = 3, .jumps = {5}}), std::invalid_argument);
}

}  // namespace tokid::testing
