// The stages that serve noisy data: predictor subspaces, maximum likelihood, confidence bounds. No simple formula
// bounds their rounding errors closely. What ε may do is measured instead, with 50 digits: how far a result moves when
// every number that it comes from moves by a random share of itself.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "linalg/symmetric.hpp"
#include "noise/em/estimator.hpp"
#include "oracle.hpp"
#include "studies/accuracy_cases.hpp"
#include "tokid/identify.hpp"
#include "tokid/observer.hpp"
#include "tokid/subspace.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid::testing {

namespace {

using oracle::exact;
using oracle::Exact;

// Their standard deviation: so small that results move in proportion, so large that double precision holds it.
constexpr double nudge = 1e-10;
// How often they move: a few draws may miss what a result depends on.
constexpr int draws = 10;

class Nudged {
 public:
  explicit Nudged(Random& random) : random_(random) {}

  Matrix operator()(const ConstMatrixRef& a) {
    return a + nudge * std::sqrt(a.squaredNorm() / double(a.size())) * random_.matrix(a.rows(), a.cols());
  }
  Matrix symmetric(const ConstMatrixRef& a) {
    const Matrix moved = (*this)(a);
    return (moved + moved.transpose()) / 2;
  }
  Matrix columns(Matrix a) {
    for (Index i = 0; i < a.cols(); ++i) {
      const Vector there = a.col(i).array().isFinite().select(a.col(i), 0.0);
      a.col(i) += (*this)(there)-there;
    }
    return a;
  }
  // Columns that are factored with others, by shares of `sizes`: in any direction, and along each other and `others`,
  // as what a factorisation rounds does not average out over its rows.
  Exact factored(const Exact& a, const Matrix& others, const Vector& sizes) {
    Matrix beside(others.rows(), a.cols() + others.cols());
    beside << a.cast<double>(), others;
    beside.colwise().normalize();
    const Matrix any = random_.matrix(a.rows(), a.cols()) / std::sqrt(double(a.rows()));
    const Matrix along = beside * random_.matrix(beside.cols(), a.cols());
    return a + exact(nudge * (any + along) * sizes.asDiagonal());
  }
  Ensemble operator()(Ensemble e) {
    e.samples() = columns(e.samples());
    return e;
  }
  GtvArx operator()(GtvArx arx) {
    for (Index k = arx.k_begin; k < arx.steps(); ++k) {
      arx.coefficients(k) = (*this)(arx.coefficients(k));
      arx.residual_cov(k) = symmetric(arx.residual_cov(k));
      arx.noise_shape(k) = (*this)(arx.noise_shape(k));
    }
    return arx;
  }
  // Noise is added to what the states bring about, and is off by as much as their sum.
  Model operator()(Model model) {
    const KalmanFilter filter = kalman_filter(model);
    for (const auto part : system_parts)
      for (Step& step : model.step) (step.*part)() = (*this)((step.*part)());
    for (size_t s = 0; s < model.step.size(); ++s) {
      Step& step = model.step[s];
      step.set_Q(step.Q() + symmetric(filter.P[s + 1]) - filter.P[s + 1]);
      step.set_R(step.R() + symmetric(filter.innovation_cov[s]) - filter.innovation_cov[s]);
    }
    model.x0_mean = (*this)(model.x0_mean);
    model.x0_cov = symmetric(model.x0_cov);
    return model;
  }

 private:
  Random& random_;
};

// A result beside the true one, and beside those of the numbers that were moved.
void see(Accuracy& accuracy, const Exact& found, const Exact& truth, const std::vector<Exact>& moved) {
  const double size = double(truth.norm());
  double square = 0.0;
  for (const Exact& other : moved) square += double(Exact(other - truth).squaredNorm()) / double(moved.size());
  see(accuracy, double(Exact(found - truth).norm()), std::sqrt(square) / nudge + size, size);
  accuracy.ratio = accuracy.error / (epsilon * accuracy.growth);
}

// result() of every draw
template <class Result>
auto every_draw(Result&& result) {
  std::vector<decltype(result())> all;
  for (int i = 0; i < draws; ++i) all.push_back(result());
  return all;
}
// part(result) of them
template <class Result, class Part>
std::vector<Exact> each(const std::vector<Result>& results, Part&& part) {
  std::vector<Exact> parts;
  for (const Result& result : results) parts.emplace_back(part(result));
  return parts;
}

Accuracy stage_of(const char* stage, const char* route) {
  Accuracy about;
  about.stage = stage;
  about.route = route;
  about.noisy = true;
  return about;
}

// What two models of the same system have in common.
struct Observer {
  oracle::Responses responses;
  std::vector<Exact> innovation_cov;
};
Observer observer_of(const Model& model, Index band) {
  Observer result{oracle::responses(model, band), {}};
  for (const Step& step : model.step) result.innovation_cov.push_back(exact(step.innovation_cov()));
  return result;
}
Observer observer_of(const oracle::Realised& realised, Index band) {
  return {oracle::responses(realised.system, band), realised.innovation_cov};
}

void see(Accuracy& pulses, Accuracy& gains, Accuracy& innovations, const Observer& found, const Observer& truth,
         const std::vector<Observer>& moved) {
  const size_t steps = truth.responses.system.size(), begin = steps - truth.innovation_cov.size();
  for (size_t k = begin + 1; k < steps; ++k) {
    see(pulses, found.responses.system[k], truth.responses.system[k],
        each(moved, [k](const Observer& o) { return o.responses.system[k]; }));
    see(gains, found.responses.gain[k], truth.responses.gain[k],
        each(moved, [k](const Observer& o) { return o.responses.gain[k]; }));
  }
  for (size_t s = 0; s < truth.innovation_cov.size(); ++s)
    see(innovations, found.innovation_cov[s], truth.innovation_cov[s],
        each(moved, [s](const Observer& o) { return o.innovation_cov[s]; }));
}

}  // namespace

AccuracyFindings predictor_subspaces(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(8000 + c));
    Nudged nudged(random);
    const Sizes size = draw_sizes(random);
    const Index p = size.p, steps = p + 4, most = whole(random, 1, size.n), fewest = size.regressors() + size.m + 2;
    const bool many_steps = c % 2 > 0;
    const Model system =
        random_system({size.n, size.m, size.r}, steps, random.uniform(0.6, 1.1), std::uint64_t(8500 + c));
    const Index experiments = std::min(3 * fewest, draw_experiments(random, fewest));
    const Ensemble data = with_noise(random_experiments(system, experiments, std::uint64_t(8700 + c), 1.0),
                                     power(random, -2.0, 0.0), std::uint64_t(8900 + c));

    GtvArxOptions regressions;
    regressions.lags = {p};
    regressions.initial_state = InitialState::unknown;
    const GtvArx arx = gtv_arx(data, regressions);
    SubspaceOptions o;
    o.states = most;
    o.weighting = many_steps ? Weighting::many_steps : Weighting::one_step;
    const PredictorFactors factors = predictor_factors(data, arx, o);
    const char* const route = many_steps ? "many steps" : "one step";

    // States are the same but for orthogonal coordinates.
    Accuracy values = stage_of("subspace: singular values", route), maps = stage_of("subspace: states", route);
    const auto states_of = [&](const oracle::Arx& from, const Ensemble& e) {
      return oracle::states(from, e, most, many_steps);
    };
    const oracle::States truth = states_of(oracle::arx(arx), data);
    const auto moved = every_draw([&] { return states_of(oracle::arx(nudged(arx)), nudged(data)); });
    oracle::States given = truth;
    for (size_t k = size_t(p); k < size_t(steps); ++k) {
      const PredictorFactor& factor = factors.group[k];
      const Index n = truth.map[k].rows();
      const auto gram = [n](const Exact& of, const Exact& sizes) -> Exact {
        return of.topRows(n).transpose() * sizes.col(0).head(n).asDiagonal() * of.topRows(n);
      };
      see(values, exact(factor.singular_values), truth.singular_values[k],
          each(moved, [k](const oracle::States& s) { return s.singular_values[k]; }));
      see(maps, gram(exact(factor.state), exact(factor.singular_values)), gram(truth.map[k], truth.singular_values[k]),
          each(moved, [&](const oracle::States& s) { return gram(s.map[k], s.singular_values[k]); }));
      given.map[k] = exact(factor.state.topRows(n));
    }
    findings.all.push_back(values);
    findings.all.push_back(maps);

    Accuracy pulses = stage_of("subspace: A, B, C", route), gains = stage_of("subspace: gains G", route);
    Accuracy innovations = stage_of("subspace: innovations", route);
    // Samples of the states are rounded, and so are residuals of outputs, by shares of these.
    const auto realised = [&](const oracle::States& states, const Ensemble& e) {
      return observer_of(oracle::realise(oracle::samples(states, e, p), e, p), steps);
    };
    const auto realised_nearby = [&](const oracle::States& states, const Ensemble& e) {
      const auto measured = [&](Index k) { return e.samples().middleCols(k * e.channels(), e.channels()); };
      std::vector<Exact> x = oracle::samples(states, e, p);
      for (Index k = p; k < steps; ++k) {
        Exact& now = x[size_t(k)];
        now = nudged.factored(now, measured(k), now.cast<double>().colwise().norm());
      }
      const auto handed = [&](Index k, const Exact& residuals) {
        Matrix others(residuals.rows(), x[size_t(k)].cols() + e.channels());
        others << x[size_t(k)].cast<double>(), measured(k);
        return nudged.factored(residuals, others, e.output(k).colwise().norm());
      };
      return observer_of(oracle::realise(x, nudged(e), p, handed), steps);
    };
    see(pulses, gains, innovations, observer_of(realise(data, arx, factors, o), steps), realised(given, data),
        every_draw([&] { return realised_nearby(given, nudged(data)); }));
    findings.all.insert(findings.all.end(), {pulses, gains, innovations});

    IdentifyOptions options;
    options.lags = p;
    options.states = most;
    options.method = Method::subspace;
    options.smoothing = 0.0;
    options.weighting = o.weighting;
    options.refine = false;
    options.initial_state = InitialState::unknown;
    options.nominal = NominalChoice::none;
    options.feedthrough = true;
    Accuracy whole = stage_of("whole identification with noise", route);
    for (Index k = p; k < steps; ++k) whole.condition = std::max(whole.condition, arx.step[size_t(k)].condition);
    // Every stage rounds by itself: what they are given no longer goes together.
    see(whole, whole, whole, observer_of(identify(data, options).model, steps),
        realised(states_of(oracle::arx(data, p), data), data), every_draw([&] {
          const oracle::Arx regressed = oracle::arx(nudged(gtv_arx(nudged(data), regressions)));
          return realised_nearby(states_of(regressed, nudged(data)), nudged(data));
        }));
    findings.all.push_back(whole);
    ++findings.judged;
  }
  return findings;
}

AccuracyFindings likelihoods(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(9000 + c));
    Nudged nudged(random);
    const Index n = whole(random, 1, 12), m = whole(random, 1, 3), r = whole(random, 1, 2), steps = 4, experiments = 5;
    Model model = random_system({n, m, r}, steps, random.uniform(0.5, 1.2), std::uint64_t(9500 + c));
    for (Index k = 0; k < steps; ++k) {
      model.at(k).set_Q(draw_covariance(random, n));
      model.at(k).set_R(draw_covariance(random, m));
    }
    model.x0_mean = random.matrix(n, 1);
    model.x0_cov = draw_covariance(random, n);
    model.initial_state = InitialState::unknown;
    Ensemble data =
        with_noise(random_experiments(model, experiments, std::uint64_t(9700 + c), 1.0), 0.3, std::uint64_t(9900 + c));
    // The first three experiments are complete, more than there are inputs: else these alone explain all outputs. The
    // others have gaps, and the last one ends early.
    for (Index i = 3; i < experiments; ++i)
      for (Index k = 0; k < steps; ++k) {
        for (Index j = 0; j < r; ++j)
          if (random.uniform(0, 1) < 0.15) data.u(i, k, j) = std::nan("");
        for (Index j = 0; j < m; ++j)
          if (random.uniform(0, 1) < 0.25 || (i + 1 == experiments && k + 1 == steps)) data.y(i, k, j) = std::nan("");
      }

    const kalman::Samples samples = kalman::samples_of(model, data);
    const kalman::Smoothed found = kalman::Smoother(samples).smooth(model);
    const oracle::Expectation truth = oracle::expectation(model, data);
    const auto moved = every_draw([&] { return oracle::expectation(nudged(model), nudged(data)); });
    Accuracy moments = stage_of("EM: expected moments", "smoother"), density = stage_of("EM: log-likelihood", "filter");
    for (size_t s = 0; s < size_t(steps); ++s) {
      if (found.moments.measured_count(Index(s)) > 0)
        see(moments, exact(found.moments.measured[s]), truth.measured[s],
            each(moved, [s](const oracle::Expectation& e) { return e.measured[s]; }));
      if (found.moments.moved_count(Index(s)) > 0)
        see(moments, exact(found.moments.moved[s]), truth.moved[s],
            each(moved, [s](const oracle::Expectation& e) { return e.moved[s]; }));
    }
    Exact of_experiment(experiments, 1);
    for (Index i = 0; i < experiments; ++i) of_experiment(samples.experiment[size_t(i)], 0) = found.log_likelihood(i);
    see(density, of_experiment, truth.log_likelihood,
        each(moved, [](const oracle::Expectation& e) { return e.log_likelihood; }));

    em::Estimator estimator(model, samples,
                            {.estimate_x0 = true, .innovation_cov = Matrix::Identity(m, m)});
    estimator.set_scales(found.moments, samples);
    const em::Parameters next = estimator.maximise(found.moments, estimator.start());
    Accuracy matrices = stage_of("EM: maximising A, B, C, D", "Cholesky roots");
    Accuracy noise = stage_of("EM: maximising Q, R", "Cholesky roots");
    const auto see_regression = [&](const Matrix& moment, double count, const Matrix& coefficients,
                                    const Matrix& covariance, const Vector& floor) {
      const oracle::Regression exactly = oracle::regression(moment, n + r);
      const auto otherwise = every_draw([&] { return oracle::regression(nudged.symmetric(moment), n + r); });
      see(matrices, exact(coefficients), exactly.coefficients,
          each(otherwise, [](const oracle::Regression& g) { return g.coefficients; }));
      bool raised = false;
      linalg::bounded_below(exactly.residual.cast<double>() / count, floor, &raised);
      if (raised) return;  // a covariance at the floor is the floor's
      see(noise, exact(covariance) * oracle::Real(count), exactly.residual,
          each(otherwise, [](const oracle::Regression& g) { return g.residual; }));
    };
    for (Index k = 0; k < steps; ++k) {
      const size_t s = size_t(k);
      const kalman::Moments& sums = found.moments;
      if (sums.moved_count(k) > 0)
        see_regression(sums.moved[s], sums.moved_count(k), next.ab[s], next.process.of(k), estimator.process_floor());
      if (sums.measured_count(k) > 0)
        see_regression(sums.measured[s], sums.measured_count(k), next.cd[s], next.measurement.of(k),
                       estimator.measurement_floor());
    }
    findings.all.insert(findings.all.end(), {moments, density, matrices, noise});
    ++findings.judged;
  }
  return findings;
}

}  // namespace tokid::testing
