// How often intervals hold the truth, over simulated ensembles whose truth is known.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "testing.hpp"
#include "tokid/markov.hpp"
#include "tokid/observer.hpp"
#include "tokid/tvera.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid::testing {

// A system that turns and changes slowly, with the gains of its deadbeat observer.
inline Model turning_system(const SystemSize& size, Index steps, std::uint64_t seed) {
  Random random(seed);
  Model model = constant_system(size, steps, 1.0, seed);
  const Matrix a = model.step[0].A(), turn = 0.4 * random.orthogonal(size.n);
  for (Index k = 0; k < steps; ++k) {
    const double phase = 0.15 * double(k);
    model.step[size_t(k)].A() = 0.85 * (a * std::cos(phase) + turn * std::sin(phase));
    model.step[size_t(k)].C() *= 1 + 0.2 * std::sin(phase);
  }
  set_gains(model, deadbeat_gain(model).G);
  return model;
}

// Experiments whose one-step predictions by the model's own observer err by white noise. Deadbeat gains make the
// GTV-ARX model of their order exact, so that nothing but scatter stands between estimate and truth.
inline Ensemble innovation_experiments(const Model& model, Index experiments, double noise, Random& random,
                                       double initial = 0.0) {
  Ensemble e(experiments, model.steps(), model.inputs, model.outputs, model.dt);
  Matrix x = initial * random.matrix(experiments, model.n(model.k_begin));
  for (Index k = 0; k < model.steps(); ++k) {
    const size_t s = size_t(k);
    const Matrix u = random.matrix(experiments, model.inputs);
    const Matrix innovation = noise * random.matrix(experiments, model.outputs);
    e.input(k) = u;
    e.output(k) = x * model.step[s].C().transpose() + u * model.step[s].D().transpose() + innovation;
    x = (x * model.step[s].A().transpose() + u * model.step[s].B().transpose() -
         innovation * model.step[s].G().transpose())
            .eval();
  }
  return e;
}

inline GtvArx regressions(const Ensemble& e, Index lags, InitialState initial = InitialState::zero, Index spent = 0) {
  GtvArxOptions options;
  options.lags = {lags};
  options.initial_state = initial;
  options.spent = spent;
  return gtv_arx(e, options);
}

inline TveraOptions blocks(Index rows, Index cols, Index states) {
  TveraOptions o;
  o.rows = rows;
  o.cols = cols;
  o.states = states;
  return o;
}

inline Model realised(const GtvArx& arx, const TveraOptions& o) {
  return tvera(markov(arx, o.rows + o.cols - 1), {}, o);
}

// Each entry that has bounds is counted; entries without an estimate, or known to rounding, say nothing.
struct Coverage {
  static constexpr double exact = 1e-6;  // widths, of quantities of size one
  double held = 0, judged = 0;

  void add(double truth, double lower, double upper) {
    if (!std::isfinite(lower) || std::isnan(truth) || upper - lower <= exact) return;
    ++judged;
    held += lower <= truth && truth <= upper;
  }
  void add(const Matrix& truth, const Interval& interval) {
    for (Index i = 0; i < truth.size(); ++i)
      add(truth.reshaped()(i), interval.lower.reshaped()(i), interval.upper.reshaped()(i));
  }
  double percent() const { return 100 * held / judged; }
};

// [h_{k,k} h_{k,k-1} … h_{k,k-band}], the layout of MarkovBounds; NaN before the model begins.
inline Matrix pulse_row(const Model& model, Index k, Index band) {
  const Index r = model.inputs;
  Matrix row = Matrix::Constant(model.outputs, (band + 1) * r, std::numeric_limits<double>::quiet_NaN());
  if (k < model.k_begin) return row;
  row.leftCols(r) = model.at(k).D();
  for (Index i = std::max(model.k_begin, k - band); i < k; ++i)
    row.middleCols((k - i) * r, r) = pulse_response(model, k, i);
  return row;
}

// The entries of a band of Markov parameters and of the outputs for given inputs.
inline Vector entries(const Model& model, const Ensemble& given, Index band) {
  std::vector<double> all;
  const Ensemble outputs = simulate(model, given);
  for (Index k = 0; k < given.steps(); ++k) {
    const Matrix row = pulse_row(model, k, band), y = outputs.output(k);
    all.insert(all.end(), row.data(), row.data() + row.size());
    all.insert(all.end(), y.data(), y.data() + y.size());
  }
  return Eigen::Map<const Vector>(all.data(), Index(all.size()));
}

}  // namespace tokid::testing
