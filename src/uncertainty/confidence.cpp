// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "base/nan.hpp"
#include "data/unused.hpp"
#include "tokid/identify.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/validate.hpp"
#include "uncertainty/interval.hpp"
#include "uncertainty/replicate.hpp"
#include "uncertainty/replication.hpp"

namespace tokid {

namespace {

// A step is reported if the bias of its Markov parameters is larger than their scatter by this factor.
constexpr double reported_bias = 2.0;

class Bounds {
 public:
  Bounds(const Model& model, const Ensemble& data, const ConfidenceOptions& options)
      : model_(model), options_(options), identification_(identify_options(model.provenance)) {
    uncertainty::check_level(options.level);
    data_ = uncertainty::training_part(model, data, identification_);
    if (options.band < 0 || options.band >= data_.steps())
      throw std::invalid_argument(
          fmt::format("band: {} found, 1 to {} (or automatic) needed", options.band, data_.steps() - 1));
    band_ = std::clamp<Index>(options.band > 0 ? options.band : 2 * estimation_window(model), 1,
                              std::max<Index>(1, data_.steps() - 1));
    loop_.reference_step = options.reference_step;
    result_.level = options.level;
    result_.dt = model.dt;
    result_.names = model.names;
    result_.experiments = data_.experiments();
    result_.lags = model.max_lags();
  }

  Confidence run() {
    append(result_.findings, uncertainty::findings_of_data(model_, data_));
    const std::optional<Spectrum> spectrum = spectrum_in_frame();
    const Functional functional = [&](const Model& model) { return everything(model, spectrum); };
    const uncertainty::Replication found =
        uncertainty::replicate(model_, data_, identification_, functional, places(spectrum), options_);
    result_.replicates = found.bootstrap.replicates;
    result_.freedom = found.bootstrap.freedom;
    result_.smoothing = found.smoothing;
    append(result_.findings, found.findings);
    if (found.smoothing > 0) report_bias(found);
    scatter(found.bootstrap, spectrum);
    return std::move(result_);
  }

 private:
  void report(Finding finding) { result_.findings.push_back(std::move(finding)); }

  // Bounds of eigenvalues need a frame, but not every model has one.
  std::optional<Spectrum> spectrum_in_frame() {
    if (model_.states() == 0) return std::nullopt;
    try {
      return closed_loop_spectrum(model_, loop_);
    } catch (const std::invalid_argument& error) {
      if (options_.reference_step >= 0) throw;
      report({.kind = Finding::Kind::no_eigenvalue_bounds, .detail = error.what()});
      return std::nullopt;
    }
  }

  // The places of Markov parameters, outputs and eigenvalues in the list of everything().
  std::vector<uncertainty::PerStep> places(const std::optional<Spectrum>& spectrum) const {
    const Index steps = data_.steps(), m = model_.outputs, parameters = m * (band_ + 1) * model_.inputs;
    std::vector<uncertainty::PerStep> result{{0, steps, parameters},
                                             {steps * parameters, steps, data_.experiments() * m}};
    Index begin = steps * (parameters + data_.experiments() * m);
    for (size_t i = 0; spectrum && i < spectrum->eigenvalues.size();) {
      uncertainty::PerStep same_size{begin, 0, 2 * spectrum->eigenvalues[i].size()};
      for (; i < spectrum->eigenvalues.size() && 2 * spectrum->eigenvalues[i].size() == same_size.size; ++i)
        ++same_size.steps;
      begin += same_size.steps * same_size.size;
      result.push_back(same_size);
    }
    return result;
  }

  // Stores the size of the bias of the Markov parameters over their scatter, and reports the steps where it is large.
  void report_bias(const uncertainty::Replication& found) {
    const Index steps = data_.steps(), size = model_.outputs * (band_ + 1) * model_.inputs;
    result_.bias = Vector::Constant(steps, nan);
    std::vector<Index> large;
    for (Index k = 0; k < steps; ++k) {
      double bias = 0.0, scatter = 0.0;
      for (Index i = k * size; i < (k + 1) * size; ++i)
        if (std::isfinite(found.scatter(i))) {
          bias += found.bias_squares(i);
          scatter += found.scatter(i) * found.scatter(i);
        }
      if (scatter > 0) result_.bias(k) = std::sqrt(bias / scatter);
      if (result_.bias(k) > reported_bias) large.push_back(k);
    }
    if (!large.empty())
      report({.kind = Finding::Kind::bounds_with_bias,
              .steps = std::move(large),
              .numbers = {{"smoothing", result_.smoothing},
                          {"largest", result_.bias.array().isNaN().select(0, result_.bias).maxCoeff()}}});
  }

  // Lists Markov parameters, outputs, and the real and imaginary parts of eigenvalues.
  Vector everything(const Model& model, const std::optional<Spectrum>& spectrum) const {
    const Index r = model_.inputs, m = model_.outputs, steps = data_.steps();
    std::vector<double> all;
    for (Index k = 0; k < steps; ++k) {
      Matrix row = Matrix::Constant(m, (band_ + 1) * r, nan);
      if (k >= model.k_begin && k < model.k_end()) {
        row.leftCols(r) = model.at(k).D();
        Matrix back = model.at(k).C();  // C_k A_{k-1} … A_{i+1}
        for (Index i = k - 1; i >= std::max(model.k_begin, k - band_); --i) {
          row.middleCols((k - i) * r, r) = back * model.at(i).B();
          back = back * model.at(i).A();
        }
      }
      all.insert(all.end(), row.data(), row.data() + row.size());
    }
    const Ensemble outputs = simulate_data(model, data_, model_.initial_state);
    for (Index k = 0; k < steps; ++k) {
      const Matrix y = outputs.output(k);
      all.insert(all.end(), y.data(), y.data() + y.size());
    }
    if (spectrum) add_spectrum(model, *spectrum, all);
    return Eigen::Map<const Vector>(all.data(), Index(all.size()));
  }

  void add_spectrum(const Model& model, const Spectrum& spectrum, std::vector<double>& all) const {
    std::optional<Spectrum> found;
    try {
      ClosedLoopOptions o = loop_;  // the frame of the original
      o.reference_step = loop_.reference_step >= 0 ? loop_.reference_step : model_.full_begin();
      o.rows = estimation_window(model_);
      found = closed_loop_spectrum(model, o);
    } catch (const std::invalid_argument&) {
      // This replicate does not have the frame of the original.
    }
    for (size_t i = 0; i < spectrum.eigenvalues.size(); ++i) {
      const Index at = found ? spectrum.begin + Index(i) - found->begin : -1;
      const bool there = at >= 0 && at < Index(found->eigenvalues.size());
      const Eigen::VectorXcd values =
          there ? matched(found->eigenvalues[size_t(at)], spectrum.eigenvalues[i])
                : Eigen::VectorXcd::Constant(spectrum.eigenvalues[i].size(), std::complex<double>(nan, nan));
      for (const std::complex<double>& value : values) {
        all.push_back(value.real());
        all.push_back(value.imag());
      }
    }
  }

  // Distributes the bounds of the list to their places in the result.
  void scatter(const Bootstrap& found, const std::optional<Spectrum>& spectrum) {
    const Index r = model_.inputs, m = model_.outputs, steps = data_.steps(), experiments = data_.experiments();
    Index at = 0;
    const auto take = [&](Index rows, Index cols, Index stride = 1) {
      Interval interval;
      const auto part = [&](const Matrix& from) {
        Matrix result(rows, cols);
        for (Index i = 0; i < result.size(); ++i) result.reshaped()(i) = from(at + i * stride);
        return result;
      };
      interval = {part(found.interval.estimate), part(found.interval.deviation), part(found.interval.lower),
                  part(found.interval.upper)};
      return interval;
    };
    result_.markov = {r, m, band_, model_.k_begin, {}};
    for (Index k = 0; k < steps; ++k, at += m * (band_ + 1) * r)
      result_.markov.step.push_back(take(m, (band_ + 1) * r));
    for (Index k = 0; k < steps; ++k, at += experiments * m) result_.simulated.step.push_back(take(experiments, m));
    if (!spectrum) return;
    result_.spectrum.begin = spectrum->begin;
    for (size_t i = 0; i < spectrum->eigenvalues.size(); ++i) {
      const Index n = spectrum->eigenvalues[i].size();
      SpectrumBounds::Step step;
      step.real = take(n, 1, 2);
      step.covariance.resize(n);
      for (Index e = 0; e < n; ++e) step.covariance(e) = found.covariance(at + 2 * e);
      ++at;
      step.imaginary = take(n, 1, 2);
      at += 2 * n - 1;
      step.eigenvalues = step.real.estimate.cast<std::complex<double>>() +
                         std::complex<double>(0, 1) * step.imaginary.estimate.cast<std::complex<double>>();
      uncertainty::find_simple(step, model_.at(spectrum->begin + Index(i)).closed_loop().norm());
      result_.spectrum.step.push_back(std::move(step));
    }
  }

  const Model& model_;
  const ConfidenceOptions& options_;
  IdentifyOptions identification_;
  Ensemble data_;
  Index band_ = 1;
  ClosedLoopOptions loop_;
  Confidence result_;
};

}  // namespace

RelativeError relative_error(const MarkovBounds& bounds) {
  Matrix errors = Matrix::Zero(bounds.outputs, bounds.inputs), widths = errors, sizes = errors;
  for (const Interval& step : bounds.step)
    for (Index block = 0; block <= bounds.band; ++block) {
      const auto part = [&](const Matrix& all) { return all.middleCols(block * bounds.inputs, bounds.inputs).array(); };
      const auto known = !part(step.deviation).isNaN();
      errors.array() += known.select(part(step.deviation).square(), 0.0);
      widths.array() += known.select(((part(step.upper) - part(step.lower)) / 2).square(), 0.0);
      sizes.array() += known.select(part(step.estimate).square(), 0.0);
    }
  const auto relative = [&](const Matrix& squares) -> Matrix {
    return (sizes.array() > 0).select((squares.array() / sizes.array()).sqrt(), nan);
  };
  return {relative(errors), relative(widths)};
}

Confidence confidence(const Model& model, const Ensemble& data, const ConfidenceOptions& options) {
  return with_remark_on_unused(data, [&] { return Bounds(model, data, options).run(); });
}

}  // namespace tokid
