// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <optional>

#include "diagnose/outliers.hpp"
#include "diagnose/outliers/sketch.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Ratios of amplitudes. `exact`: largest residual of exact data, divided by the output. `beyond_doubt`: residual with
// an experiment divided by the residual without it, for a clear misfit. Ratios above `most_ratio` are determined by
// rounding errors, because squares are subtracted.
constexpr double exact = 1e-9, beyond_doubt = 1e6, most_ratio = 1e8;

// Residuals of a regression that adds one regressor after the other to an orthonormal basis.
class Regression {
 public:
  Regression(Matrix outputs, Index regressors)
      : basis_(outputs.rows(), std::min(outputs.rows(), regressors)),
        residual_(std::move(outputs)),
        leverage_(Vector::Zero(residual_.rows())) {}

  void add(Vector regressor) {
    const double size = regressor.norm();
    const auto known = basis_.leftCols(rank_);
    for (int twice = 0; twice < 2; ++twice) regressor -= known * (known.transpose() * regressor);
    if (rank_ == basis_.cols() || !(regressor.norm() > exact * size)) return;  // depends on the regressors before
    regressor.normalize();
    residual_ -= regressor * (regressor.transpose() * residual_);
    leverage_ += regressor.cwiseAbs2();
    basis_.col(rank_++) = regressor;
  }

  Index rank() const { return rank_; }
  const Matrix& residual() const { return residual_; }
  const Vector& leverage() const { return leverage_; }

 private:
  Matrix basis_, residual_;
  Vector leverage_;
  Index rank_ = 0;
};

// Examines windows of p_least … p_most lags before step k. If one experiment alone causes the residuals, returns this
// experiment with the ratio of the residuals with and without it.
std::optional<Outlier> misfit(const Ensemble& e, Index k, Index p_least, Index p_most, bool constant) {
  checkpoint();
  constexpr Index to_spare = 4;
  const Index d = e.channels(), r = e.inputs();
  const std::vector<Index> rows = e.complete_rows(k, p_most);
  const Index count = Index(rows.size());
  if (count < to_spare) return std::nullopt;
  const Matrix w = e.window(k, p_most)(rows, Eigen::all), y = e.output(k)(rows, Eigen::all);
  Regression regression(y, w.cols() + 1);
  if (constant) regression.add(Vector::Ones(count));
  for (Index i = 0; i < r; ++i) regression.add(w.col(p_most * d + i));
  for (Index p = 0; p <= p_most; ++p) {
    for (Index i = 0; p > 0 && i < d; ++i) regression.add(w.col((p_most - p) * d + i));
    if (count < regression.rank() + to_spare)
      break;  // with one row to spare, the fit is exact whichever row is left
              // out
    const double all = regression.residual().squaredNorm();
    if (p < p_least || !(all > exact * exact * y.squaredNorm())) continue;
    // Without row i, with residual e_i and leverage h_i, the sum of squares is all - |e_i|²/(1 - h_i).
    const Vector alone =
        regression.residual().rowwise().squaredNorm().array() / (1.0 - regression.leverage().array()).max(exact);
    Index worst = 0;
    const double without = all - alone.maxCoeff(&worst);
    if (without < all / (beyond_doubt * beyond_doubt))
      return Outlier{rows[size_t(worst)],
                     without > 0 ? std::min(most_ratio, std::sqrt(all / without)) : most_ratio,
                     {},
                     e.experiment_name(rows[size_t(worst)])};
  }
  return std::nullopt;
}

// Does experiment n move the inputs of `lags` + 1 successive steps in a direction that no other experiment uses? If so,
// experiment n may reach states that the other experiments do not reach.
bool excites_more(const Ensemble& e, Index n, Index lags, bool centred) {
  const Index r = e.inputs(), d = e.channels();
  const Index steps = std::min({lags + 1, e.steps(), std::max<Index>(1, most_regressors / r)});
  Matrix squares = Matrix::Zero(r * steps, r * steps), own(0, r * steps);
  for (Index k = 0; k + steps <= e.steps(); k += std::max<Index>(1, steps / 2)) {
    Matrix u(e.experiments(), r * steps);
    for (Index i = 0; i < steps; ++i) u.middleCols(i * r, r) = e.samples().middleCols((k + i) * d, r);
    std::vector<Index> others;
    for (Index i = 0; i < e.experiments(); ++i)
      if (i != n && u.row(i).allFinite()) others.push_back(i);
    if (others.empty() || !u.row(n).allFinite()) continue;
    Matrix x = u(others, Eigen::all);
    if (centred) {
      const Eigen::RowVectorXd mean = x.colwise().mean();
      x.rowwise() -= mean;
      u.row(n) -= mean;
    }
    squares += x.transpose() * x;
    own.conservativeResize(own.rows() + 1, Eigen::NoChange);
    own.row(own.rows() - 1) = u.row(n);
  }
  // Inputs are scaled by their sizes; an input may be zero in all other experiments.
  const Vector size = (squares.diagonal() + own.colwise().squaredNorm().transpose()).cwiseSqrt();
  const Vector unit = (size.array() > 0).select(size.cwiseInverse(), 0.0);
  const linalg::Svd found = linalg::svd(unit.asDiagonal() * squares * unit.asDiagonal());
  const Matrix along = own * unit.asDiagonal() * found.v;
  constexpr double nothing = 1e-13, something = 1e-10;  // of squares
  for (Index i = 0; i < found.s.size(); ++i)
    if (found.s(i) <= nothing * found.s(0) && along.col(i).squaredNorm() > something * along.squaredNorm()) return true;
  return false;
}

std::optional<Outlier> misfit(const Ensemble& e, const OutlierOptions& o) {
  const Index last = e.steps() - 1;
  const Index most = std::min({o.lags, last, std::max<Index>(1, (most_regressors - e.inputs()) / e.channels())});
  std::optional<Outlier> found;
  if (o.zero_start)
    for (Index k = 0; k <= most && !found; ++k) found = misfit(e, k, k, k, o.nominal);
  // At early steps, an experiment with an unusual initial state looks wrong. At later steps, inputs have moved the
  // other experiments in the same directions of the state.
  const Index first = o.zero_start ? most : std::max(most, last / 2);
  for (Index i = 1; i < fewest_places && !found; ++i)
    found = misfit(e, first + i * (last - first) / (fewest_places - 1), 1, most, o.nominal);
  return found;
}

}  // namespace

std::vector<Outlier> outliers_without_noise(const Ensemble& e, const OutlierOptions& options) {
  std::optional<Outlier> found = misfit(e, options);
  if (!found || excites_more(e, found->experiment, options.lags, options.nominal)) return {};
  OutlierOptions o = options;
  for (o.model = nullptr; o.lags > 0 && !found->explanation; --o.lags)
    for (const Outlier& other : outliers(e, o))
      if (other.experiment == found->experiment) found->explanation = other.explanation;
  return {*std::move(found)};
}

}  // namespace tokid
