// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/tvera.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace tokid {

namespace {

// No error estimate vouches for singular values below this share of the largest.
constexpr double negligible = 8 * std::numeric_limits<double>::epsilon();
// Relative size below which a singular value is error of arithmetic rather than of noisy data.
constexpr double arithmetic = 1e-9;

// Channel sizes as given, or 1.
struct Units {
  Units(const Markov& markov, const TveraOptions& options)
      : output(options.output_size.size() > 0 ? options.output_size : Vector(Vector::Ones(markov.outputs))),
        input(options.input_size.size() > 0 ? options.input_size : Vector(Vector::Ones(markov.inputs))) {}
  // A block with outputs as rows and inputs as columns, in these units.
  Matrix scaled(const ConstMatrixRef& block) const {
    return output.cwiseInverse().asDiagonal() * block * input.asDiagonal();
  }
  Matrix scaled_variance(const ConstMatrixRef& block) const {
    return output.cwiseAbs2().cwiseInverse().asDiagonal() * block * input.cwiseAbs2().asDiagonal();
  }
  Vector output, input;
};

HankelFactor factorise(const Markov& markov, const FreeResponse& free, const Units& units, Index k, Index rows,
                       Index cols) {
  const Index m = markov.outputs, r = markov.inputs;
  const Index extra = k + rows <= free.steps ? free.experiments : 0;
  Matrix h(rows * m, cols * r + extra);
  double variance = 0.0;
  for (Index a = 0; a < rows; ++a)
    for (Index b = 0; b < cols; ++b) {
      h.block(a * m, b * r, m, r) = units.scaled(markov.h(k + a, k - 1 - b));
      variance += units.scaled_variance(markov.h_noise(k + a, k - 1 - b)).sum();
    }
  if (extra > 0) {
    auto columns = h.rightCols(extra);
    columns = free.y.middleCols(k * m, rows * m).transpose();
    columns = units.output.cwiseInverse().replicate(rows, 1).asDiagonal() * columns;
    // The states of the free experiments may have any size: give both parts the same weight.
    const double forced = h.leftCols(cols * r).norm(), own = columns.norm();
    if (forced > 0 && own > 0) columns *= forced / own;
  }
  const double error = std::hypot(std::sqrt(variance), negligible * h.norm());
  linalg::Svd d = linalg::svd(h);
  const double scale = std::max(d.s.size() > 0 ? d.s(0) : 0.0, units.scaled(markov.D[size_t(k)]).norm());
  return {std::move(d.u), std::move(d.s), scale, error};
}

// O_k of the chosen order, and what is needed to multiply by its pseudo-inverse.
struct Observability {
  Matrix u;     // (rows·m × n_k)
  Vector root;  // (n_k) Σ^{1/2}

  Index n() const { return root.size(); }
  Matrix matrix() const { return u * root.asDiagonal(); }
  Matrix solve(const Matrix& right) const { return root.cwiseInverse().asDiagonal() * (u.transpose() * right); }
};

Observability choose_order(const HankelFactor& factor, const TveraOptions& options) {
  const Vector& sigma = factor.singular_values;
  // The estimate of the error may be far too large where many steps hand it on: whatever it says, singular values this
  // large are no errors of arithmetic.
  const double threshold = std::min(options.noise_factor * factor.error, arithmetic * factor.scale);
  Index n = (sigma.array() > threshold).count();
  if (options.states > 0) n = std::min(n, options.states);
  return {factor.u.leftCols(n), sigma.head(n).cwiseSqrt()};
}

// [x_{k,i}; x_{k+1,i}; …] with the given number of blocks, for the Markov parameters x = h or h° (37).
template <class Parameter>
Matrix stacked(Index rows, Index outputs, Index cols, Parameter&& parameter) {
  Matrix result(rows * outputs, cols);
  for (Index a = 0; a < rows; ++a) result.middleRows(a * outputs, outputs) = parameter(a);
  return result;
}

void realise_step(const Markov& markov, const Units& units, const Observability& now, const Observability& next,
                  Index k, Model& model) {
  const Index m = markov.outputs, r = markov.inputs;
  const size_t s = model.at(k);
  const Matrix o = now.matrix();
  model.C[s] = units.output.asDiagonal() * o.topRows(m);
  model.D[s] = markov.D[size_t(k)];
  model.A[s] = Matrix::Zero(next.n(), now.n());
  model.B[s] = Matrix::Zero(next.n(), r);
  model.G[s] = Matrix::Zero(next.n(), m);
  if (next.n() == 0) return;
  const Index rows = next.u.rows() / m, shared = o.rows() - m;  // block rows of O_{k+1}; rows of O_k↓ and O_{k+1}↑
  model.A[s] = linalg::minimum_norm(next.matrix().topRows(shared), o.bottomRows(shared), negligible).x;
  const auto from_outputs = units.output.cwiseInverse().asDiagonal();
  model.B[s] = next.solve(stacked(rows, m, r, [&](Index a) { return from_outputs * markov.h(k + 1 + a, k); }));
  model.G[s] =
      next.solve(stacked(rows, m, m, [&](Index a) { return from_outputs * markov.h_gain(k + 1 + a, k); }));  // (40)
}

}  // namespace

HankelFactors hankel_factors(const Markov& markov, const FreeResponse& free, const TveraOptions& options) {
  if (options.rows < 1 || options.cols < 1 || options.states < 0)
    throw std::invalid_argument(fmt::format("tvera: {} block rows, {} block columns, {} states asked for", options.rows,
                                            options.cols, options.states));
  const auto check_sizes = [](const char* name, const Vector& sizes, Index channels) {
    if (sizes.size() > 0 && (sizes.size() != channels || !(sizes.array() > 0).all()))
      throw std::invalid_argument(
          fmt::format("{}: {} values found, {} positive ones needed", name, sizes.size(), channels));
  };
  check_sizes("output_size", options.output_size, markov.outputs);
  check_sizes("input_size", options.input_size, markov.inputs);
  if (options.rows + options.cols - 1 > markov.band && markov.band < markov.steps() - 1)
    throw std::invalid_argument(
        fmt::format("tvera: {} x {} blocks need Markov parameters up to {} steps apart, {} found", options.rows,
                    options.cols, options.rows + options.cols - 1, markov.band));
  if (free.experiments > 0 && free.y.cols() != free.steps * markov.outputs)
    throw std::invalid_argument(fmt::format("free_y: {} samples per experiment found, {} steps x {} outputs needed",
                                            free.y.cols(), free.steps, markov.outputs));
  HankelFactors factors{options.rows, options.cols, markov.i_begin, {}};
  factors.step.resize(size_t(markov.steps() - markov.i_begin));
  const FreeResponse complete_free = complete(free);
  const Units units(markov, options);
  parallel_for(markov.i_begin, markov.steps(), options.execution, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      factors.step[size_t(k - factors.k_begin)] =
          factorise(markov, complete_free, units, k, std::min(options.rows, markov.steps() - k),
                    std::min(options.cols, k - markov.i_begin));
  });
  return factors;
}

Model realise(const Markov& markov, const HankelFactors& factors, const TveraOptions& options) {
  Model model;
  model.inputs = markov.inputs;
  model.outputs = markov.outputs;
  model.k_begin = factors.k_begin;
  model.method = "tvera";
  const size_t steps = factors.step.size();
  for (auto* list : {&model.A, &model.B, &model.C, &model.D, &model.G}) list->resize(steps);
  std::vector<Observability> observability(steps + 1);  // that of step T is empty: no output follows
  for (size_t s = 0; s < steps; ++s) {
    observability[s] = choose_order(factors.step[s], options);
    model.singular_values.push_back(factors.step[s].singular_values);
  }
  for (const Observability& o : observability) model.state_dim.push_back(o.n());
  const Units units(markov, options);
  parallel_for(0, Index(steps), options.execution, [&](Index begin, Index end) {
    for (Index s = begin; s < end; ++s)
      realise_step(markov, units, observability[size_t(s)], observability[size_t(s) + 1], factors.k_begin + s, model);
  });
  return model;
}

Model tvera(const Markov& markov, const FreeResponse& free, const TveraOptions& options) {
  return realise(markov, hankel_factors(markov, free, options), options);
}

}  // namespace tokid
