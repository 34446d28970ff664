// SPDX-License-Identifier: BSD-3-Clause
#include "data/noise_of.hpp"

#include <algorithm>
#include <cmath>

namespace tokid {

namespace {

// Rounding of the whole window may cause residuals up to this multiple of the rounding of the output.
constexpr double roundings = 10.0;
constexpr Index most_steps = 16;       // at which regressions are done
constexpr Index most_unknowns = 100;   // of a regression
constexpr Index rows_per_unknown = 3;  // more rows hardly change the result
constexpr double negligible = 1e-12;   // pivots, as a share of the largest one

constexpr Index many_states = 6;  // if a window has this many past outputs, residuals are noise, not unknown states

enum class Residuals { too_few, exact, noisy };

class Regressions {
 public:
  Regressions(const Ensemble& e, const std::vector<Index>& rows, const Scales& s) : e_(e), rows_(rows), scales_(s) {}

  // Regresses y_k on u_0 … u_k, as long as the experiments suffice.
  Residuals from_rest() const {
    Residuals result = Residuals::too_few;
    for (Index k = 0; k < std::min(e_.steps(), most_steps); ++k) {
      std::vector<Index> columns;
      for (Index j = 0; j <= k; ++j) append(columns, j, e_.inputs());
      const Residuals found = regression(columns, k);
      if (found == Residuals::noisy) return found;
      if (found == Residuals::exact) result = found;
    }
    return result;
  }

  // Regresses y_k on u_k and the window of p steps before it.
  Residuals lagged(Index p) const {
    Residuals result = Residuals::too_few;
    const Index left = e_.steps() - p, count = std::min(left, most_steps);
    for (Index i = 0; i < count; ++i) {
      const Index k = p + (2 * i + 1) * left / (2 * count);
      std::vector<Index> columns;
      for (Index j = k - p; j < k; ++j) append(columns, j, e_.channels());
      append(columns, k, e_.inputs());
      const Residuals found = regression(columns, k);
      if (found == Residuals::noisy) return found;
      if (found == Residuals::exact) result = found;
    }
    return result;
  }

  bool suffice(Index unknowns) const { return unknowns <= most_unknowns && unknowns < Index(rows_.size()); }

 private:
  void append(std::vector<Index>& columns, Index step, Index count) const {
    for (Index c = 0; c < count; ++c) columns.push_back(step * e_.channels() + c);
  }

  Residuals regression(const std::vector<Index>& columns, Index k) const {
    const Index unknowns = Index(columns.size()), m = e_.outputs();
    if (!suffice(unknowns)) return Residuals::too_few;
    const std::vector<Index> whole = complete_rows(columns, k, rows_per_unknown * unknowns + most_steps);
    const Index N = Index(whole.size());
    if (N <= unknowns) return Residuals::too_few;
    Matrix a = Matrix::Ones(N, unknowns + (N > unknowns + 1 ? 1 : 0));
    for (Index i = 0; i < unknowns; ++i) {
      const Index c = columns[size_t(i)];
      a.col(i) = e_.samples().col(c)(whole) / size(c % e_.channels());
    }
    const Matrix y = e_.output(k)(whole, Eigen::all);
    const linalg::MinimumNorm solution = linalg::minimum_norm(a, y, negligible);
    if (solution.rank >= N) return Residuals::too_few;
    if ((y.array() == 0).all()) return Residuals::too_few;  // the outputs have not moved yet, so they show no noise
    const Matrix residual = y - a * solution.x;
    for (Index j = 0; j < m; ++j) {
      const double rms = residual.col(j).norm() / std::sqrt(double(N - solution.rank));
      if (rms > allowed(whole, y, e_.inputs() + j, j)) return Residuals::noisy;
    }
    return Residuals::exact;
  }

  std::vector<Index> complete_rows(const std::vector<Index>& columns, Index k, Index most) const {
    std::vector<Index> result;
    for (const Index n : rows_) {
      const auto missing = [&](Index c) { return std::isnan(e_.samples()(n, c)); };
      if (std::none_of(columns.begin(), columns.end(), missing) && e_.output(k).row(n).allFinite()) result.push_back(n);
      if (Index(result.size()) == most) break;
    }
    return result;
  }

  double size(Index channel) const { return scales_.departure(channel) > 0 ? scales_.departure(channel) : 1.0; }

  double allowed(const std::vector<Index>& whole, const Matrix& y, Index channel, Index j) const {
    double square = 0.0;
    for (size_t i = 0; i < whole.size(); ++i)
      square += std::pow(scales_.precision_of(whole[i], channel).rounding(y(Index(i), j)), 2);
    return std::max({roundings * std::sqrt(square / double(whole.size())),
                     rounding_of_departures * scales_.departure(channel), scales_.arithmetic(channel)});
  }

  const Ensemble& e_;
  const std::vector<Index>& rows_;
  const Scales& scales_;
};

}  // namespace

Noise noise_of(const Ensemble& e, const std::vector<Index>& rows, const Scales& s) {
  const Regressions regressions(e, rows, s);
  const Residuals rest = regressions.from_rest();
  if (rest == Residuals::exact) return Noise::none;
  Noise result = rest == Residuals::noisy && e.initial_state == InitialState::zero ? Noise::visible : Noise::unknown;
  for (const Index p : {1, 2, 3, 4, 5, 6, 8, 10, 12, 16}) {
    if (p >= e.steps() || !regressions.suffice(p * e.channels() + e.inputs())) break;
    const Residuals found = regressions.lagged(p);
    if (found == Residuals::exact) return Noise::none;
    if (found == Residuals::noisy && p * e.outputs() >= many_states) result = Noise::visible;
  }
  return result;
}

}  // namespace tokid
