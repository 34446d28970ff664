// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/continuation.hpp"
#include "model/innovation_checks.hpp"
#include "model/observer_step.hpp"
#include "tokid/innovations.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Subtracts the mean of the entries that are not NaN. Before the mean, it subtracts the first entry, so that a constant
// column becomes exactly zero.
template <class Column>
void centre(Column&& column) {
  const auto first = std::find_if(column.begin(), column.end(), [](double v) { return !std::isnan(v); });
  if (first == column.end()) return;
  const double origin = *first;
  double sum = 0.0;
  Index count = 0;
  for (const double v : column)
    if (!std::isnan(v)) sum += v - origin, ++count;
  column.array() -= origin;
  column.array() -= sum / double(count);
}

// The regression of the innovations on the effects that gain errors of the inputs would have on them.
class GainRegression {
 public:
  GainRegression(const Model& model, const Ensemble& data, const Innovations& innovations)
      : model_(model),
        data_(data),
        innovations_(innovations),
        centred_(model.period == 0 && data.experiments() > 1),
        gram_(Matrix::Zero(model.inputs, model.inputs)),
        cross_(Vector::Zero(model.inputs)),
        alone_squares_(Matrix::Zero(model.inputs, model.outputs)),
        output_squares_(Vector::Zero(model.outputs)) {}

  InputGains run() {
    const Index r = model_.inputs, end = std::min(model_.k_end(), data_.steps());
    InputGains gains{Vector::Constant(r, nan), Vector::Constant(r, nan), Vector::Constant(r, nan)};
    if (model_.steps() == 0 || end <= model_.k_begin) return gains;
    if (!model_.has(&Step::has_innovation_cov)) pooled_ = pooled_covariance(end);
    const Matrix none = Matrix::Zero(data_.experiments(), model_.n(model_.k_begin));
    error_.assign(size_t(r), none);
    alone_.assign(size_t(r), none);
    for (Index k = model_.k_begin; k < end; ++k) {
      checkpoint();
      advance(k);
    }
    solve(gains);
    return gains;
  }

 private:
  Matrix pooled_covariance(Index end) const {
    const Index m = model_.outputs;
    Matrix sum = Matrix::Zero(m, m);
    Index count = 0;
    for (Index k = model_.k_begin; k < end; ++k)
      for (const auto row : innovations_[size_t(k)].rowwise())
        if (row.allFinite()) sum += row.transpose() * row, ++count;
    return count > 0 ? Matrix(sum / double(count)) : Matrix::Identity(m, m);
  }

  // Departures of the inputs; a missing input is zero.
  Matrix inputs(Index k) const {
    Matrix u = data_.input(k);
    subtract_nominal(model_.u_nominal, k, u);
    if (centred_)
      for (auto column : u.colwise()) centre(column);
    return u.array().isNaN().select(0.0, u);
  }

  void advance(Index k) {
    const Step& step = model_.at(k);
    const Matrix u = inputs(k), &e = innovations_[size_t(k)];
    add_outputs(k);
    std::vector<Matrix> part(size_t(model_.inputs));  // effect on the innovations for α_i = 1
    for (Index i = 0; i < model_.inputs; ++i) {
      Matrix &error = error_[size_t(i)], &alone = alone_[size_t(i)];
      own_.setZero(u.rows(), u.cols());
      own_.col(i) = u.col(i);
      observer::output(step, alone, own_, output_);
      alone_squares_.row(i) += output_.colwise().squaredNorm();
      observer::next_state(step, alone, own_, next_);
      alone.swap(next_);
      // An error of the gain makes the observer expect an effect that the outputs do not have. The observer corrects
      // only by outputs that are available.
      observer::output(step, error, own_, part[size_t(i)]);
      output_ = e.array().isNaN().select(0.0, -part[size_t(i)]);
      observer::next_state(step, error, own_, output_, next_);
      error.swap(next_);
    }
    // A state that is not known will be estimated from the samples that follow, so its error starts at zero.
    for (Index n = 0; n < e.rows(); ++n)
      if (blind(k, n))
        for (Matrix& error : error_) error.row(n).setZero();
    regress(k, e, part);
  }

  bool blind(Index k, Index n) const {
    for (Index j = 0; j < model_.outputs; ++j)
      if (std::isnan(innovations_[size_t(k)](n, j)) && !std::isnan(data_.y(n, k, j))) return true;
    return false;
  }

  void add_outputs(Index k) {
    Matrix y = data_.output(k);
    subtract_nominal(model_.y_nominal, k, y);
    if (centred_)
      for (auto column : y.colwise()) centre(column);
    for (Index j = 0; j < y.cols(); ++j)
      for (const double v : y.col(j))
        if (!std::isnan(v)) output_squares_(j) += v * v;
  }

  void regress(Index k, Matrix e, std::vector<Matrix>& part) {
    for (Matrix& p : part) p = e.array().isNaN().select(nan, p);
    if (centred_)
      for (Index j = 0; j < e.cols(); ++j) {
        centre(e.col(j));
        for (Matrix& p : part) centre(p.col(j));
        freedom_ -= e.col(j).array().isNaN().all() ? 0 : 1;
      }
    const Matrix& covariance = !model_.has(&Step::has_innovation_cov) ? pooled_ : model_.at(k).innovation_cov();
    for (auto& [seen, rows] : groups_) rows.clear();
    for (Index n = 0; n < e.rows(); ++n) {
      seen_.clear();
      for (Index j = 0; j < e.cols(); ++j)
        if (std::isfinite(e(n, j)) && covariance(j, j) > 0) seen_.push_back(j);
      if (!seen_.empty()) groups_[seen_].push_back(n);
    }
    for (const auto& [seen, rows] : groups_) {
      if (rows.empty()) continue;
      const Matrix& whitener = whitener_of(covariance(seen, seen));
      const Matrix white = e(rows, seen) * whitener;
      std::vector<Matrix> white_part;
      for (const Matrix& p : part) white_part.emplace_back(p(rows, seen) * whitener);
      for (size_t i = 0; i < part.size(); ++i) {
        cross_(Index(i)) += white.cwiseProduct(white_part[i]).sum();
        for (size_t j = 0; j <= i; ++j) gram_(Index(i), Index(j)) += white_part[i].cwiseProduct(white_part[j]).sum();
      }
      squares_ += white.squaredNorm();
      freedom_ += white.size();
    }
  }

  // Transposed. Successive steps often have the same covariance.
  const Matrix& whitener_of(const Matrix& covariance) {
    if (whitened_.rows() == covariance.rows() && whitened_ == covariance) return whitener_;
    whitened_ = covariance;
    whitener_ = linalg::whitener(covariance).transpose();
    return whitener_;
  }

  // The data do not determine the gain of an input if the input has no effect, or if other inputs have the same effect.
  void solve(InputGains& gains) const {
    std::vector<Index> moving;
    for (Index i = 0; i < model_.inputs; ++i)
      if (gram_(i, i) > 0 && std::isfinite(gram_(i, i))) moving.push_back(i);
    for (Index i = 0; i < model_.inputs; ++i) {
      gains.share(i) = 0.0;
      for (Index j = 0; j < model_.outputs; ++j)
        if (output_squares_(j) > 0)
          gains.share(i) = std::fmax(gains.share(i), std::sqrt(alone_squares_(i, j) / output_squares_(j)));
    }
    const double freedom = double(freedom_ - Index(moving.size()));
    if (freedom <= 0) return;
    gains.deviation.setConstant(infinity);
    if (moving.empty()) return;
    const Matrix lower = gram_(moving, moving), full = lower.selfadjointView<Eigen::Lower>();
    const Vector scale = full.diagonal().cwiseSqrt().cwiseInverse();
    const linalg::Svd d = linalg::svd(scale.asDiagonal() * full * scale.asDiagonal());
    const auto determined = (d.s.array() > 1e-10 * d.s(0)).cast<double>().eval();
    const Matrix inverse = d.v * (determined / d.s.array().max(1e-300)).matrix().asDiagonal() * d.u.transpose();
    const Vector cross = cross_(moving), scaled = scale.asDiagonal() * cross, solution = inverse * scaled;
    const double variance = std::max(0.0, squares_ - scaled.dot(solution)) / freedom;
    for (size_t a = 0; a < moving.size(); ++a) {
      const Index i = Index(a);
      const double undetermined = (d.u.row(i).array().square() * (1 - determined.transpose())).sum();
      if (undetermined > 1e-8) continue;
      gains.error(moving[a]) = scale(i) * solution(i);
      gains.deviation(moving[a]) = scale(i) * std::sqrt(variance * inverse(i, i));
    }
  }

  const Model& model_;
  const Ensemble& data_;
  const Innovations& innovations_;
  bool centred_;
  Matrix pooled_;                      // covariance, if the model has none
  std::vector<Matrix> error_, alone_;  // (r) of (N × n_k): s_i, and the state of the model for input i alone
  Matrix own_, output_, next_;         // for one step and input
  Matrix whitened_, whitener_;         // the last covariance and its whitener
  // Available outputs → their experiments at the present step.
  std::map<std::vector<Index>, std::vector<Index>> groups_;
  std::vector<Index> seen_;
  Matrix gram_;  // lower triangle
  Vector cross_;
  Matrix alone_squares_;   // (r × m)
  Vector output_squares_;  // (m)
  double squares_ = 0.0;
  Index freedom_ = 0;
};

}  // namespace

InputGains input_gains(const Model& model, const Ensemble& data, const Innovations& innovations) {
  if (ends_early(model, data.steps())) return input_gains(continued(model, data.steps()), data, innovations);
  if (data.inputs() != model.inputs || data.outputs() != model.outputs)
    throw std::invalid_argument(fmt::format("data: {} inputs and {} outputs found, {} and {} needed", data.inputs(),
                                            data.outputs(), model.inputs, model.outputs));
  check_innovations(innovations, data);
  return GainRegression(model, data, innovations).run();
}

}  // namespace tokid
