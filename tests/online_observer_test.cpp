// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/online_observer.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "model/samples.hpp"
#include "testing.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize online_sizes[] = {{1, 1, 1}, {2, 1, 2}, {3, 4, 1}, {4, 2, 2}, {6, 2, 0}, {7, 3, 2}};

Matrix random_covariance(Random& random, Index size) {
  const Matrix a = random.matrix(size, size);
  return a * a.transpose() + 0.1 * Matrix::Identity(size, size);
}

struct Kind {
  bool innovation_cov = true;
  bool noise = false;           // Q, R
  bool varying_states = false;  // n_0 = 0, n_1 = 1 … and one state less in the middle
  bool nominal = true;
  Index begin = 0, period = 0;
  InitialState initial = InitialState::zero;
  bool estimate = false;  // x0_mean and x0_cov
};

Model online_model(const SystemSize& size, Index steps, const Kind& kind, std::uint64_t seed) {
  Random random(seed);
  Model model = random_system(size, steps, 0.9, seed);
  if (kind.varying_states) {
    const auto n = [&](Index k) { return k < size.n ? k : k == steps / 2 ? size.n - 1 : size.n; };
    for (Index k = 0; k < steps; ++k) {
      const Step& s = model.step[size_t(k)];
      model.step[size_t(k)] = Step(Matrix(s.A().topLeftCorner(n(k + 1), n(k))), Matrix(s.B().topRows(n(k + 1))),
                                   Matrix(s.C().leftCols(n(k))), s.D(), Matrix::Zero(n(k + 1), size.m));
    }
  }
  for (Step& step : model.step) {
    step.G() = 0.1 * random.matrix(step.next_states(), size.m);
    if (kind.innovation_cov) step.set_innovation_cov(random_covariance(random, size.m));
    if (!kind.noise) continue;
    step.set_Q(random_covariance(random, step.next_states()));
    step.set_R(random_covariance(random, size.m));
  }
  if (kind.nominal) {
    model.u_nominal = random.matrix(steps, size.r);
    model.y_nominal = random.matrix(steps, size.m);
  }
  model.initial_state = kind.initial;
  if (kind.estimate) {
    model.x0_mean = random.matrix(model.n(0), 1);
    model.x0_cov = random_covariance(random, model.n(0));
  }
  if (kind.period > 0) {
    model.step.resize(size_t(kind.period));
    model.period = kind.period;
    if (kind.nominal) {
      model.u_nominal.conservativeResize(kind.period, Eigen::NoChange);
      model.y_nominal.conservativeResize(kind.period, Eigen::NoChange);
    }
  }
  return kind.begin > 0 ? from_step(std::move(model), kind.begin) : model;
}

Ensemble online_data(const SystemSize& size, Index experiments, Index steps, double missing_outputs,
                     double missing_inputs, std::uint64_t seed) {
  Random random(seed);
  Ensemble data(experiments, steps, size.r, size.m);
  for (Index k = 0; k < steps; ++k) {
    data.input(k) = random.matrix(experiments, size.r);
    data.output(k) = random.matrix(experiments, size.m);
    for (Index n = 0; n < experiments; ++n) {
      for (Index j = 0; j < size.m; ++j)
        if (random.uniform(0, 1) < missing_outputs) data.y(n, k, j) = nan;
      for (Index i = 0; i < size.r; ++i)
        if (random.uniform(0, 1) < missing_inputs) data.u(n, k, i) = nan;
    }
  }
  return data;
}

bool same_bits(const Vector& a, const Vector& b) {
  if (a.size() != b.size()) return false;
  for (Index i = 0; i < a.size(); ++i)
    if (!(a(i) == b(i) || (std::isnan(a(i)) && std::isnan(b(i))))) return false;
  return true;
}

// Experiment by experiment and step by step: predictions, innovations and predictions of several steps of predict().
// Returns the number of predictions that are not missing.
Index expect_predict(const Model& model, const Ensemble& data, OnlineObserverOptions options, Index horizon = 4) {
  const bool missing = data.missing() > 0;
  options.samples_missing = missing;
  const Model whole = continued(model, data.steps());
  if (data.inputs() > 0) options.input_square = kalman::samples_of(whole, data, kalman::Tail::keep).u_square;
  const Prediction one = predict(model, data, {1, options.initial_state, options.initial_estimate});
  const Prediction ahead = predict(model, data, {horizon, options.initial_state, options.initial_estimate});
  const Index end = std::min(whole.k_end(), data.steps());
  Index known = 0;
  OnlineObserver observer(model, options);
  for (Index n = 0; n < data.experiments(); ++n) {
    observer.reset();
    for (Index k = 0; k < end; ++k) {
      if (k >= model.k_begin && k + horizon <= end) {
        Matrix inputs(horizon, data.inputs());
        for (Index h = 0; h < horizon; ++h) inputs.row(h) = data.input(k + h).row(n);
        const Matrix found = observer.predict(inputs);
        const Vector expected = ahead.y.output(k + horizon - 1).row(n);
        EXPECT_TRUE(same_bits(found.row(horizon - 1), expected)) << "experiment " << n << ", step " << k;
        EXPECT_TRUE(same_bits(found.row(0), one.y.output(k).row(n))) << "experiment " << n << ", step " << k;
      }
      EXPECT_EQ(observer.k(), k);
      if (k % 5 == 3) {  // goes on in another observer
        OnlineObserver other(model, options);
        other.restore(observer.saved());
        observer = std::move(other);
      }
      const Observation& shown = observer.step(data.input(k).row(n).transpose(), data.output(k).row(n).transpose());
      EXPECT_TRUE(same_bits(shown.prediction, one.y.output(k).row(n))) << "experiment " << n << ", step " << k;
      EXPECT_TRUE(same_bits(shown.innovation, one.innovations[size_t(k)].row(n))) << n << ", step " << k;
      known += shown.prediction.allFinite();
    }
  }
  return known;
}

TEST(OnlineObserver, IsPredictToTheLastBit) {
  for (const SystemSize& size : online_sizes)
    for (const bool covariance : {false, true})
      for (const double missing : {0.0, 0.2}) {
        const Model model = online_model(size, 30, {.innovation_cov = covariance}, 11);
        const Ensemble data = online_data(size, 7, 30, missing, 0, 12);
        EXPECT_EQ(expect_predict(model, data, {}), 7 * 30) << name(size);
      }
}

TEST(OnlineObserver, LosesAndFindsTheStateAsPredictDoes) {
  for (const SystemSize& size : online_sizes)
    for (const bool covariance : {false, true})
      for (const double missing : {0.0, 0.1}) {
        if (size.r == 0) continue;
        const Model model = online_model(size, 60, {.innovation_cov = covariance}, 21);
        const Ensemble data = online_data(size, 9, 60, missing, 0.02 / double(size.r), 22);
        const Index known = expect_predict(model, data, {});
        EXPECT_GT(known, 9 * 60 / 3) << name(size);
        EXPECT_LT(known, 9 * 60) << name(size);
      }
}

TEST(OnlineObserver, BeginsFromUnknownStatesAsPredictDoes) {
  for (const SystemSize& size : online_sizes)
    for (const Index begin : {0, 3})
      for (const bool estimate : {false, true})
        for (const double missing : {0.0, 0.1}) {
          const Kind kind{.begin = begin, .initial = InitialState::unknown, .estimate = estimate && begin == 0};
          const Model model = online_model(size, 40, kind, 31);
          const Ensemble data = online_data(size, 5, 40, missing, 0, 32);
          const Index known = expect_predict(model, data, {});
          EXPECT_GT(known, 5 * 20) << name(size);
          EXPECT_EQ(known == 5 * 40, kind.estimate) << name(size);
          if (!kind.estimate) continue;
          EXPECT_LT(expect_predict(model, data, {.initial_estimate = false}), 5 * 40);
        }
}

TEST(OnlineObserver, FollowsVaryingStateDimensions) {
  for (const SystemSize& size : online_sizes)
    for (const bool noise : {false, true})
      for (const double missing : {0.0, 0.1}) {
        const Model model = online_model(size, 30, {.noise = noise, .varying_states = true}, 41);
        const Ensemble data = online_data(size, 5, 30, missing, 0, 42);
        EXPECT_EQ(expect_predict(model, data, {}), 5 * 30) << name(size);
        EXPECT_LT(expect_predict(model, data, {.initial_state = InitialState::unknown}), 5 * 30 + 1) << name(size);
      }
}

TEST(OnlineObserver, GoesOnWithAPeriodicModel) {
  for (const SystemSize& size : online_sizes)
    for (const bool noise : {false, true})
      for (const Index begin : {0, 2})
        for (const double missing : {0.0, 0.05}) {
          const Kind kind{.noise = noise, .begin = 0, .period = 7};
          Model model = online_model(size, 30, kind, 51);
          if (begin > 0) {  // whole periods after a later begin
            model = from_step(continued(model, 14), begin);
          }
          const Ensemble data = online_data(size, 4, 60, missing, size.r > 0 ? missing / 10 : 0, 52);
          EXPECT_GT(expect_predict(model, data, {}), 4 * 20) << name(size);
        }
}

TEST(OnlineObserver, IsTheKalmanFilterOfPredictWhereSamplesAreMissing) {
  for (const SystemSize& size : online_sizes)
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const Index period : {0, 1}) {
        const Kind kind{.noise = true, .period = period, .initial = initial, .estimate = true};
        const Model model = online_model(size, 50, kind, 61);
        const Ensemble data = online_data(size, 6, 50, 0.1, 0.05, 62);
        EXPECT_GT(expect_predict(model, data, {}), 6 * 50 / 2) << name(size);
        // Without missing samples for a long time, the covariances settle.
        Ensemble rarely = online_data(size, 3, 50, 0, 0, 63);
        rarely.y(0, 2, 0) = rarely.y(1, 45, 0) = nan;
        EXPECT_EQ(expect_predict(model, rarely, {}), 3 * 50) << name(size);
      }
}

TEST(OnlineObserver, StatesTheNormalisedSquareOfTheAvailableOutputs) {
  for (const SystemSize& size : online_sizes)
    for (const bool noise : {false, true}) {
      const Model model = online_model(size, 30, {.noise = noise}, 71);
      const Ensemble data = online_data(size, 1, 30, 0.3, 0, 72);
      OnlineObserver observer(model);
      for (Index k = 0; k < 30; ++k) {
        const Observation& shown = observer.step(data.input(k).row(0).transpose(), data.output(k).row(0).transpose());
        std::vector<Index> seen;
        for (Index j = 0; j < size.m; ++j)
          if (std::isfinite(data.y(0, k, j))) seen.push_back(j);
        EXPECT_EQ(shown.outputs, Index(seen.size()));
        if (seen.empty()) {
          EXPECT_TRUE(std::isnan(shown.normalised_square));
          continue;
        }
        const Matrix covariance = model.at(k).innovation_cov()(seen, seen);
        const Vector e = shown.innovation(seen);
        const double exact = e.dot(linalg::solve(covariance, e).col(0));
        // The covariance has a condition of at most a few hundred.
        EXPECT_NEAR(shown.normalised_square, exact, 1e4 * epsilon * exact) << name(size) << " " << k;
      }
    }
}

// In the Kalman filter of the exact noise, the squares have the mean of a χ² distribution, also with missing samples.
TEST(OnlineObserver, HasNormalisedSquaresOfTheSizeThatTheFilterSays) {
  const SystemSize size{4, 2, 2};
  Random random(81);
  Model model = online_model(size, 3000, {.noise = true, .nominal = false, .estimate = false}, 82);
  OnlineObserver observer(model, {.samples_missing = true, .input_square = Vector::Ones(2)});
  Vector x = Vector::Zero(4);
  double sum = 0.0, outputs = 0.0;
  for (Index k = 0; k < 3000; ++k) {
    const Step& step = model.at(k);
    Vector u = random.matrix(2, 1);
    Vector y = step.C() * x + step.D() * u + *linalg::covariance_factor(step.R()) * random.matrix(2, 1);
    x = step.A() * x + step.B() * u + *linalg::covariance_factor(step.Q()) * random.matrix(4, 1);
    if (k % 3 == 0) y(k % 2) = nan;
    if (k % 7 == 0) u(k % 2) = nan;
    const Observation& shown = observer.step(u, y);
    EXPECT_EQ(shown.prediction.hasNaN(), k % 7 == 0);
    sum += shown.normalised_square;
    outputs += double(shown.outputs);
  }
  // χ² with some 5000 degrees of freedom: its mean has a standard deviation of 2 %.
  EXPECT_NEAR(sum / outputs, 1.0, 0.08);
}

TEST(OnlineObserver, FindsTheStateOfExactDataAfterTheWindow) {
  for (const SystemSize& size : online_sizes) {
    const Model model = online_model(size, 40, {.initial = InitialState::unknown}, 91);
    Random random(92);
    const Ensemble inputs = online_data(size, 3, 40, 0, 0, 93);
    const Ensemble data = simulate(model, inputs, random.matrix(size.n, 3));
    OnlineObserver observer(model);
    for (Index n = 0; n < 3; ++n) {
      observer.reset();
      for (Index k = 0; k < 40; ++k) {
        EXPECT_EQ(observer.knows_state(), k >= estimation_window(model)) << name(size);
        EXPECT_EQ(observer.state().allFinite(), observer.knows_state());
        const Observation& shown = observer.step(data.input(k).row(n).transpose(), data.output(k).row(n).transpose());
        // The window of random systems has a condition of at most 1e5 or so.
        EXPECT_TRUE(k < estimation_window(model) || shown.innovation.norm() <= 1e-9) << name(size) << " " << k;
      }
    }
  }
}

TEST(OnlineObserver, BeginsAgainAfterReset) {
  const SystemSize size{4, 2, 2};
  for (const bool missing : {false, true}) {
    const Model model = online_model(size, 20, {.noise = true}, 101);
    const Ensemble data = online_data(size, 1, 20, missing ? 0.2 : 0, 0, 102);
    OnlineObserver observer(model, {.samples_missing = missing});
    std::vector<Vector> first;
    for (const Index round : {0, 1}) {
      for (Index k = 0; k < 20; ++k) {
        const Vector found =
            observer.step(data.input(k).row(0).transpose(), data.output(k).row(0).transpose()).prediction;
        if (round == 0) first.push_back(found);
        EXPECT_TRUE(same_bits(found, first[size_t(k)]));
      }
      observer.reset();
      EXPECT_EQ(observer.k(), 0);
    }
    // A moved observer goes on.
    observer.step(data.input(0).row(0).transpose(), data.output(0).row(0).transpose());
    OnlineObserver moved = std::move(observer);
    EXPECT_TRUE(same_bits(moved.step(data.input(1).row(0).transpose(), data.output(1).row(0).transpose()).prediction,
                          first[1]));
  }
}

TEST(OnlineObserver, RestoresNoRunOfAnotherObserverAndNoDamagedOne) {
  const SystemSize size{2, 1, 2};
  const Model model = online_model(size, 30, {.noise = true}, 5), wider = online_model({3, 1, 2}, 30, {}, 5);
  const Ensemble data = online_data(size, 1, 30, 0, 0, 6);
  OnlineObserver observer(model), filter(model, {.samples_missing = true}), other(wider);
  for (Index k = 0; k < 4; ++k) observer.step(data.input(k).row(0).transpose(), data.output(k).row(0).transpose());
  const std::string saved = observer.saved();
  for (OnlineObserver* wrong : {&filter, &other}) EXPECT_THROW(wrong->restore(saved), std::invalid_argument);
  for (size_t size_left = 0; size_left < saved.size(); ++size_left)
    EXPECT_THROW(observer.restore(saved.substr(0, size_left)), std::invalid_argument);
  EXPECT_THROW(observer.restore(saved + "x"), std::invalid_argument);
  for (size_t place = 0; place < saved.size(); ++place) {
    std::string damaged = saved;
    damaged[place] = char(damaged[place] ^ 0x10);
    EXPECT_THROW(observer.restore(damaged), std::invalid_argument) << place;
  }
  EXPECT_EQ(observer.k(), 4);  // as it was
  OnlineObserver same(model);
  same.restore(saved);
  EXPECT_EQ(same.k(), 4);
  EXPECT_TRUE(same_bits(same.state(), observer.state()));
}

TEST(OnlineObserver, RestoresNoRunThatBeginsAtAnotherStep) {
  Model model = online_model({3, 1, 2}, 30, {.varying_states = true, .begin = 1, .initial = InitialState::unknown}, 5);
  const Index n = model.n(model.k_begin);
  ASSERT_LT(n, model.states());
  model.x0_mean = Vector::Zero(n);
  model.x0_cov = Matrix::Identity(n, n);
  const OnlineObserver from_estimate(model);
  OnlineObserver from_samples(model, {.initial_estimate = false});
  EXPECT_THROW(from_samples.restore(from_estimate.saved()), std::invalid_argument);
}

TEST(OnlineObserver, RefusesWhatDoesNotFit) {
  const SystemSize size{3, 2, 1};
  const Model model = online_model(size, 5, {.noise = true}, 111);
  EXPECT_NE(message([] { OnlineObserver observer{Model{}}; }).find("model: "), std::string::npos);
  EXPECT_EQ(message([&] { OnlineObserver observer(model, {.input_square = Vector::Ones(2)}); }),
            "input_square: 2 numbers found, one finite number of at least 0 for each of 1 inputs needed");
  OnlineObserver observer(model);
  EXPECT_EQ(message([&] { observer.step(Vector::Ones(2), Vector::Ones(2)); }), "u: 2 samples found, 1 needed");
  EXPECT_EQ(message([&] { observer.step(Vector::Ones(1), Vector::Ones(1)); }), "y: 1 samples found, 2 needed");
  const Vector infinite = Vector::Constant(2, std::numeric_limits<double>::infinity());
  EXPECT_EQ(message([&] { observer.step(Vector::Ones(1), infinite); }),
            "y: an infinite sample found, a finite one needed, or NaN if it is missing");
  EXPECT_EQ(observer.k(), 0);
  EXPECT_EQ(message([&] { observer.predict(Matrix::Ones(6, 1)); }),
            "inputs: steps 0 to 5 found, steps within 0 to 4 needed, which the model has");
  EXPECT_EQ(message([&] { observer.predict(Matrix::Constant(2, 1, std::numeric_limits<double>::infinity())); }),
            "inputs: an infinite value found, finite ones needed, or NaN for a missing input");
  EXPECT_NE(message([&] { observer.predict(Matrix::Ones(2, 2)); }).find("inputs: 2 x 2 found"), std::string::npos);
  for (Index k = 0; k < 5; ++k) observer.step(Vector::Ones(1), Vector::Ones(2));
  EXPECT_EQ(message([&] { observer.step(Vector::Ones(1), Vector::Ones(2)); }),
            "step: step 5 found, at most 4 needed: the model ends there");
  OnlineObserver filter(model, {.samples_missing = true});
  EXPECT_NE(message([&] { filter.step(Vector::Constant(1, nan), Vector::Ones(2)); }).find("input_square"),
            std::string::npos);
  EXPECT_EQ(filter.k(), 0);
}

}  // namespace
}  // namespace tokid::testing
