// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers/sketch.hpp"

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// Most places of the record, or fewer if regressions take long, and the number of residuals that an experiment must
// have.
constexpr Index most_places = 16, costly_places = 8, fewest_residuals = 6;
// Most rows for each regressor. More rows take longer and hardly improve the evaluation of single experiments.
constexpr double most_rows_each = 8.0;
// A row with an entry above this multiple of the median size is scaled down, because this row alone would determine the
// regression.
constexpr double too_large = 10.0;
// The threshold is a quantile of Student's t: one ensemble without outliers in a thousand exceeds it. The scatter of
// the logarithmic sizes is computed from their median deviation. For Gaussian samples, this has the efficiency 0.37. A
// prior scatter with four degrees of freedom is added, which matters for few experiments.
constexpr double false_alarms = 1e-3, efficiency = 0.37, own_scatter = 0.2, own_freedom = 4.0;
// An experiment with larger samples than the others may have larger residuals, up to this factor, because the model may
// be too simple for large samples.
constexpr double larger = 10.0;

}  // namespace

// If one model serves all steps, fewer experiments suffice, because each experiment has many steps with this model.
Index fewest_experiments(const OutlierOptions& o) { return o.period == 1 ? 3 : 5; }
Index most_together(const OutlierOptions& o) { return o.period == 1 ? 64 : 16; }

double trimmed_mean(std::vector<double> sizes) {
  const auto kept = std::ptrdiff_t(sizes.size() - sizes.size() / 4);
  if (kept < std::ptrdiff_t(sizes.size())) std::nth_element(sizes.begin(), sizes.begin() + kept, sizes.end());
  double sum = 0.0;
  for (auto size = sizes.begin(); size != sizes.begin() + kept; ++size) sum += *size;
  return kept > 0 ? sum / double(kept) : nan;
}

LogScatter log_scatter(std::vector<double> deviations, double tests) {
  const double freedom = efficiency * double(Index(deviations.size()) - 1),
               scatter = 1.4826 * statistics::median(std::move(deviations));
  return {(own_freedom * own_scatter * own_scatter + freedom * scatter * scatter) / (own_freedom + freedom),
          statistics::student_quantile(1 - false_alarms / tests, own_freedom + freedom)};
}

// The mean size of n residuals has a relative standard deviation of 0.76/√n. Experiments with fewer residuals therefore
// have a higher threshold.
double variance_of_few(double count, double usual_count) {
  return 0.57 * std::max(0.0, 1.0 / count - 1.0 / usual_count);
}

Sketch::Sketch(const Ensemble& e, const OutlierOptions& o, const Layout& layout) : e_(e), o_(o), layout_(layout) {
  for (const Index begin : begins()) {
    Place p;
    p.begin = begin;
    if (fill(p)) places_.push_back(std::move(p));
  }
}

void Sketch::evaluate(const std::vector<char>& out) {
  parallel_for(0, Index(places_.size()), {o_.threads, {}}, [&](Index from, Index to) {
    for (Index i = from; i < to; ++i) regress(places_[size_t(i)], out);
  });
  const Index m = e_.outputs();
  const size_t n = size_t(e_.experiments());
  std::vector<std::vector<double>> sizes(n * size_t(m)), plain(n * size_t(m));
  for (const Place& p : places_)
    for (size_t i = 0; i < p.owner.size() && !p.empty; ++i)
      for (Index j = 0; j < m; ++j) {
        if (!(p.median(j) > 0)) continue;
        const size_t at = size_t(p.owner[i] * m + j);
        const double size = std::abs(p.residual(Index(i), j));
        sizes[at].push_back(size / p.deviation(Index(i), j) / p.median(j));
        plain[at].push_back(size / p.plain_median(j));
      }
  score_.assign(n, nan);
  plain_.assign(n, nan);
  count_.assign(n, 0);
  share_.setZero(e_.experiments(), m);
  std::vector<double> all, all_plain;
  for (size_t i = 0; i < n; ++i) {
    double sum = 0.0, plain_sum = 0.0;
    for (Index j = 0; j < m; ++j) {
      const size_t at = i * size_t(m) + size_t(j);
      if (sizes[at].empty()) continue;
      const double weight = double(sizes[at].size());
      count_[i] += Index(sizes[at].size());
      sum += share_(Index(i), j) = weight * trimmed_mean(sizes[at]);
      plain_sum += weight * trimmed_mean(plain[at]);
    }
    if (count_[i] < fewest_residuals) continue;
    score_[i] = sum / double(count_[i]);
    plain_[i] = plain_sum / double(count_[i]);
    if (!out[i]) all.push_back(score_[i]), all_plain.push_back(plain_[i]);
  }
  typical_ = statistics::median(all);
  typical_plain_ = statistics::median(all_plain);
  std::vector<double> deviation, counts;
  for (size_t i = 0; i < n; ++i)
    if (!out[i] && !std::isnan(score_[i])) {
      deviation.push_back(std::abs(std::log(score_[i] / typical_)));
      counts.push_back(double(count_[i]));
    }
  scatter_ = log_scatter(std::move(deviation), double(n));
  usual_count_ = statistics::median(counts);
}

double Sketch::error() const {
  double sum = 0.0;
  Index count = 0;
  for (const Place& p : places_)
    for (Index j = 0; j < e_.outputs() && !p.empty; ++j) {
      const Vector unweighted = p.y.col(j).cwiseQuotient(p.weight);
      const double size = std::sqrt(unweighted.squaredNorm() / double(unweighted.size()));
      if (size > 0 && p.plain_median(j) > 0) sum += std::log(p.plain_median(j) / size), ++count;
    }
  return count > 0 ? std::exp(sum / double(count)) : 0.0;
}

Vector Sketch::usual_residual() const {
  Vector result(e_.outputs());
  for (Index j = 0; j < e_.outputs(); ++j) {
    std::vector<double> sizes;
    for (const Place& p : places_)
      if (!p.empty) sizes.push_back(p.plain_median(j));
    result(j) = statistics::median(sizes);
  }
  return result;
}

bool Sketch::is_evaluated(Index n) const { return !std::isnan(score_[size_t(n)]); }

double Sketch::threshold(Index n) const {
  const double own = variance_of_few(double(count_[size_t(n)]), usual_count_);
  return std::max(of_consequence, std::exp(scatter_.quantile * std::sqrt(scatter_.variance + own)));
}

std::optional<Index> Sketch::output(Index n) const {
  Index j = 0;
  const double most = share_.row(n).maxCoeff(&j);
  return e_.outputs() > 1 && most > 0.8 * share_.row(n).sum() ? std::optional(j) : std::nullopt;
}

template <class Use>
void Sketch::for_each_row(const Eigen::RowVectorXd& x, Places at, Use&& use) const {
  const Index d = e_.channels(), q = layout_.lags, m = e_.outputs();
  Vector w(regressors());
  for (size_t i = 0; i < places_.size(); ++i) {
    const Place& p = places_[i];
    if (p.empty || (at != Places::all && (i % 2 == 0) != (at == Places::even))) continue;
    for (Index k = p.begin; k < p.begin + layout_.together; ++k) {
      const auto window = x.segment((k - q) * d, (q + 1) * d);
      if (window.array().isNaN().any()) continue;
      w.setOnes();
      w.head((q + 1) * d - m) = window.head((q + 1) * d - m).transpose();
      w = w.cwiseQuotient(p.scale);
      use(p, w, Eigen::RowVectorXd(window.tail(m)));
    }
  }
}

double Sketch::ratio_of(const Eigen::RowVectorXd& x, Places at) const {
  std::vector<std::vector<double>> sizes(static_cast<size_t>(e_.outputs()));
  for_each_row(x, at, [&](const Place& p, const Vector& w, const Eigen::RowVectorXd& y) {
    const Vector g = p.inverse.transpose() * w;
    const double deviation = std::max(std::sqrt(1 + g.squaredNorm()), allowance(w.transpose()));
    const Eigen::RowVectorXd e = y - w.transpose() * p.coefficients;
    for (Index j = 0; j < e.size(); ++j)
      if (p.median(j) > 0) sizes[size_t(j)].push_back(std::abs(e(j)) / deviation / p.median(j));
  });
  double sum = 0.0, count = 0.0;
  for (const auto& own : sizes)
    if (!own.empty()) sum += double(own.size()) * trimmed_mean(own), count += double(own.size());
  return count >= double(at == Places::all ? fewest_residuals : fewest_residuals / 2) ? sum / count / typical_ : nan;
}

double Sketch::share_of(const Eigen::RowVectorXd& x) const {
  const Index m = e_.outputs();
  Vector error = Vector::Zero(m), size = Vector::Zero(m), usual_error = Vector::Zero(m), usual_size = Vector::Zero(m);
  for_each_row(x, Places::all, [&](const Place& p, const Vector& w, const Eigen::RowVectorXd& y) {
    error += (y - w.transpose() * p.coefficients).cwiseAbs().transpose();
    size += y.cwiseAbs().transpose();
    usual_error += p.plain_median;
    usual_size += p.size;
  });
  double worst = 0.0;
  for (Index j = 0; j < m; ++j)
    if (usual_error(j) > 0 && size(j) > 0)
      worst = std::max(worst, error(j) / size(j) / (usual_error(j) / usual_size(j)));
  return worst;
}

double Sketch::best_share(const Eigen::RowVectorXd& x, const Eigen::RowVectorXd& z) const {
  std::vector<double> own, change;
  const auto residuals = [&](const Eigen::RowVectorXd& samples, std::vector<double>& to, bool constant) {
    for_each_row(samples, Places::all, [&](const Place& p, Vector& w, const Eigen::RowVectorXd& y) {
      if (!constant && o_.nominal) w(w.size() - 1) = 0.0;
      const Eigen::RowVectorXd e = y - w.transpose() * p.coefficients;
      for (Index j = 0; j < e.size(); ++j) to.push_back(p.median(j) > 0 ? e(j) / p.median(j) : 0.0);
    });
  };
  residuals(x, own, true);
  residuals(z, change, false);
  double product = 0.0, square = 0.0;
  if (own.size() != change.size()) return nan;
  for (size_t i = 0; i < own.size(); ++i) product += own[i] * change[i], square += change[i] * change[i];
  return square > 0 ? -product / square : nan;
}

// Factor by which the residuals of a row of w may be larger.
double Sketch::allowance(const ConstMatrixRef& row) const {
  const Index samples = layout_.lags * e_.channels() + e_.inputs();
  return std::clamp(row.leftCols(samples).norm() / (1.4826 * std::sqrt(double(samples))), 1.0, larger);
}

Index Sketch::regressors() const { return layout_.lags * e_.channels() + e_.inputs() + (o_.nominal ? 1 : 0); }

// Spreads the places evenly over the samples, not over the steps, because some experiments may be short.
std::vector<Index> Sketch::begins() const {
  const Index begin = layout_.lags, end = e_.steps() - layout_.together + 1;
  std::vector<double> alive;
  double all = 0.0;
  for (Index k = begin; k < end; ++k) {
    Index count = e_.experiments();
    if (!e_.length.empty()) count = std::count_if(e_.length.begin(), e_.length.end(), [&](Index l) { return l > k; });
    alive.push_back(all += double(count));
  }
  const double cost = double(e_.experiments()) * double(layout_.together) * double(regressors() * regressors());
  const Index most = std::clamp(Index(1e7 / cost), costly_places, most_places);
  std::vector<Index> result;
  for (Index i = 0; i < most && all > 0; ++i) {
    const double at = (double(i) + 0.5) / double(most) * all;
    const Index k = begin + Index(std::lower_bound(alive.begin(), alive.end(), at) - alive.begin());
    if (k < end && (result.empty() || k >= result.back() + layout_.together)) result.push_back(k);
  }
  return result;
}

bool Sketch::fill(Place& p) const {
  const Index d = e_.channels(), q = layout_.lags, l = regressors(), m = e_.outputs();
  std::vector<std::pair<Index, Index>> rows;
  for (Index k = p.begin; k < p.begin + layout_.together; ++k)
    for (const Index n : e_.complete_rows(k, q)) rows.emplace_back(n, k);
  if (double(rows.size()) < 0.8 * rows_each * double(l)) return false;
  std::sort(rows.begin(), rows.end());
  Index owners = 0, last = -1;
  for (const auto& [n, k] : rows)
    if (n != last) last = n, ++owners;
  if (owners < fewest_experiments(o_)) return false;
  p.w.resize(Index(rows.size()), l);
  p.y.resize(Index(rows.size()), m);
  for (size_t i = 0; i < rows.size(); ++i) {
    const auto [n, k] = rows[i];
    p.owner.push_back(n);
    for (Index c = 0; c < q * d + e_.inputs(); ++c) p.w(Index(i), c) = e_.samples()(n, (k - q) * d + c);
    for (Index j = 0; j < m; ++j) p.y(Index(i), j) = e_.y(n, k, j);
  }
  if (o_.nominal) p.w.col(l - 1).setOnes();
  const auto sizes = [](const Matrix& a) {
    Vector result(a.cols());
    for (Index j = 0; j < a.cols(); ++j) {
      const Vector size = a.col(j).cwiseAbs();
      result(j) = statistics::median({size.begin(), size.end()});
      if (!(result(j) > 0)) result(j) = size.maxCoeff();
      if (!(result(j) > 0)) result(j) = 1.0;
    }
    return result;
  };
  p.scale = sizes(p.w);
  p.w *= p.scale.cwiseInverse().asDiagonal();
  p.weight = (too_large / p.w.cwiseAbs().rowwise().maxCoeff().array().max(1e-300)).min(1.0);
  p.w = p.weight.asDiagonal() * p.w;
  p.y = p.weight.asDiagonal() * p.y;
  return true;
}

void Sketch::regress(Place& p, const std::vector<char>& out) const {
  const Index l = p.w.cols(), m = p.y.cols(), rows = p.w.rows();
  std::vector<Index> used;
  for (Index i = 0; i < rows; ++i)
    if (!out[size_t(p.owner[size_t(i)])]) used.push_back(i);
  p.empty = used.empty();
  if (p.empty) return;
  // The model is fitted to enough whole experiments. It also evaluates the other experiments.
  std::vector<char> inside(size_t(rows), 0);
  const Index most = Index(most_rows_each * double(l)),
              stride = std::max<Index>(1, Index(used.size()) / std::max<Index>(1, most));
  std::vector<Index> kept;
  Index turn = -1, last = -1;
  for (const Index i : used) {
    if (p.owner[size_t(i)] != last) last = p.owner[size_t(i)], ++turn;
    if (turn % stride != 0) continue;
    kept.push_back(i);
    inside[size_t(i)] = 1;
  }
  // The last rows regularise directions that the data do not determine.
  Matrix both = Matrix::Zero(Index(kept.size()) + l, l + m);
  for (size_t i = 0; i < kept.size(); ++i) both.row(Index(i)) << p.w.row(kept[i]), p.y.row(kept[i]);
  const double lift = 1e-7 * std::sqrt(double(kept.size()));
  both.bottomLeftCorner(l, l).diagonal().setConstant(lift);
  const Matrix r = linalg::triangular_factor(both);
  const auto upper = r.topLeftCorner(l, l).triangularView<Eigen::Upper>();
  p.coefficients = upper.solve(r.topRightCorner(l, m));
  p.inverse = upper.solve(Matrix(Matrix::Identity(l, l)));
  const Matrix g = p.w * p.inverse, e = p.y - p.w * p.coefficients;
  p.residual.resize(rows, m);
  p.deviation.resize(rows, m);
  for (Index i = 0; i < rows;) {
    Index end = i + 1;
    while (end < rows && p.owner[size_t(end)] == p.owner[size_t(i)]) ++end;
    const Index own = end - i;
    if (!inside[size_t(i)]) {
      p.residual.middleRows(i, own) = e.middleRows(i, own);
      for (Index a = i; a < end; ++a) p.deviation.row(a).setConstant(std::sqrt(1 + g.row(a).squaredNorm()));
    } else if (own == 1) {
      const double left = std::max(1e-12, 1 - g.row(i).squaredNorm());
      p.residual.row(i) = e.row(i) / left;
      p.deviation.row(i).setConstant(1 / std::sqrt(left));
    } else {
      const Matrix left = Matrix::Identity(own, own) - g.middleRows(i, own) * g.middleRows(i, own).transpose();
      const Matrix back = linalg::solve(left, Matrix::Identity(own, own));
      p.residual.middleRows(i, own) = back * e.middleRows(i, own);
      for (Index a = 0; a < own; ++a) p.deviation.row(i + a).setConstant(std::sqrt(std::max(1.0, back(a, a))));
    }
    i = end;
  }
  for (Index i = 0; i < rows; ++i) {
    p.residual.row(i) /= p.weight(i);
    const double least = allowance(p.w.row(i) / p.weight(i));
    p.deviation.row(i) = (p.deviation.row(i) / p.weight(i)).cwiseMax(least);
  }
  p.median.resize(m);
  p.plain_median.resize(m);
  p.size.resize(m);
  for (Index j = 0; j < m; ++j) {
    std::vector<double> own, plain, size;
    for (const Index i : used) {
      plain.push_back(std::abs(p.residual(i, j)));
      own.push_back(plain.back() / p.deviation(i, j));
      size.push_back(std::abs(p.y(i, j) / p.weight(i)));
    }
    // Sizes at the level of rounding errors do not count.
    p.size(j) = statistics::median(std::move(size));
    const double floor = 1e-6 * p.size(j);
    p.median(j) = std::max(floor, statistics::median(std::move(own)));
    p.plain_median(j) = std::max(floor, statistics::median(std::move(plain)));
  }
}

}  // namespace tokid
