// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/innovations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <stdexcept>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/innovation_checks.hpp"

namespace tokid {

namespace {

constexpr double smallest_variance = 1e-140;

using statistics::Cumulants;

// Samples minus their mean, as columns of norm 1, and an orthonormal basis of their span.
struct Centred {
  Matrix columns, basis;

  double freedom() const { return double(columns.rows()) - 1; }  // ν
  double rank() const { return double(basis.cols()); }
};

Centred centred(Matrix samples) {
  samples = unit_columns(std::move(samples));
  const linalg::Svd d = linalg::svd(samples);
  const Index rank = d.s.size() == 0 ? 0 : (d.s.array() > 1e-12 * d.s(0)).count();
  return {std::move(samples), d.u.leftCols(rank)};
}

std::vector<Index> finite_rows(const Matrix& a) {
  std::vector<Index> rows;
  for (Index n = 0; n < a.rows(); ++n)
    if (a.row(n).allFinite()) rows.push_back(n);
  return rows;
}

// Tests over the experiments if at least one step has enough of them. Otherwise all samples are pooled. Pooled samples
// of one experiment depend on each other, so the distribution of the test is right only for many samples.
Pooling pooling(const Innovations& innovations) {
  Index most = 0, all = 0;
  for (const Matrix& e : innovations) {
    const Index rows = static_cast<Index>(finite_rows(e).size());
    most = std::max(most, rows);
    all += rows;
  }
  const Index few = too_few(innovations);
  return most > few ? Pooling::experiments : all > 10 * few ? Pooling::time : Pooling::none;
}

Cumulants pillai(const Centred& a, const Centred& b) {
  return statistics::projected_trace(a.rank(), a.freedom(), b.rank(), b.rank(), b.rank());
}

double standardised(double sum, const Cumulants& c) {
  return c.variance > 0 ? (sum - c.mean) / std::sqrt(c.variance) : nan;
}

// Keeps the entries of the last steps: entry k replaces entry k - count.
template <class T>
class Latest {
 public:
  explicit Latest(Index count) : kept_(size_t(count)) {}
  T& at(Index k) { return kept_[size_t(k) % kept_.size()]; }

 private:
  std::vector<T> kept_;
};

// Adds up the traces of the whiteness test.
class WhitenessSums {
 public:
  WhitenessSums(Index steps, Index lags, Index outputs)
      : variance_(Matrix::Zero(steps, lags)), freedom_(variance_), lag_(size_t(lags), Lag{Vector::Zero(outputs)}) {}

  // Adds the trace of ε_k (`now`) and ε_{k-j} (`before`).
  void add(Index k, Index j, const Centred& now, const Centred& before) {
    if (now.basis.cols() == 0 || before.basis.cols() == 0) return;
    Lag& lag = lag_[size_t(j - 1)];
    const Cumulants c = pillai(now, before);
    lag.cumulants += c;
    lag.trace += (now.basis.transpose() * before.basis).squaredNorm();
    lag.correlation += now.columns.cwiseProduct(before.columns).colwise().sum().transpose();
    lag.correlation_variance += 1 / now.freedom();
    ++lag.terms;
    variance_(k, j - 1) = c.variance;
    freedom_(k, j - 1) = now.freedom();
  }

  Whiteness result(Pooling over) const {
    constexpr double two_sided_99 = 2.5758293035489;  // quantile of the normal distribution
    const Index lags = variance_.cols(), m = lag_.empty() ? 0 : lag_.front().correlation.size();
    Whiteness result{nan, Vector::Constant(lags, nan), Matrix::Constant(lags, m, nan), Vector::Constant(lags, nan),
                     Pooling::none};
    Cumulants all{0.0, 0.0, common_third()};
    double trace = 0.0;
    for (Index j = 0; j < lags; ++j) {
      const Lag& lag = lag_[size_t(j)];
      all += lag.cumulants;
      trace += lag.trace;
      if (lag.terms == 0) continue;
      result.z(j) = standardised(lag.trace, lag.cumulants);
      result.correlation.row(j) = lag.correlation.transpose() / double(lag.terms);
      result.bound(j) = two_sided_99 * std::sqrt(lag.correlation_variance) / double(lag.terms);
    }
    result.p = statistics::upper_tail(all, trace);
    if (!std::isnan(result.p)) result.over = over;
    return result;
  }

 private:
  // Any two traces are uncorrelated, but the three traces of three steps are not independent. Each triple of steps adds
  // six times the mean product of its centred traces.
  double common_third() const {
    double sum = 0.0;
    for (Index k = 0; k < variance_.rows(); ++k)
      for (Index j = 2; j <= std::min(k, variance_.cols()); ++j)
        for (Index i = 1; i < j; ++i) {
          const double product = variance_(k, i - 1) * variance_(k, j - 1) * variance_(k - i, j - i - 1);
          const double nu = freedom_(k, i - 1);
          if (product > 0) sum += 6 * std::sqrt(2 * product / ((nu - 1) * (nu + 2)));
        }
    return sum;
  }

  struct Lag {
    Vector correlation;  // (m)
    double correlation_variance = 0.0;
    Cumulants cumulants = {};
    double trace = 0.0;
    Index terms = 0;
  };
  Matrix variance_, freedom_;  // (T × lags) variance and degrees of freedom of the trace of ε_k and ε_{k-j}
  std::vector<Lag> lag_;
};

Whiteness whiteness_over_experiments(const Innovations& innovations, Index lags) {
  const Index steps = static_cast<Index>(innovations.size()), m = innovations.front().cols();
  const auto enough = [few = size_t(too_few(innovations))](const std::vector<Index>& rows) {
    return rows.size() > few;
  };
  struct Innovation {
    std::vector<Index> rows;
    Centred over;
  };
  Latest<Innovation> latest(lags + 1);
  WhitenessSums sums(steps, lags, m);
  for (Index k = 0; k < steps; ++k) {
    const Matrix& e = innovations[size_t(k)];
    Innovation& now = latest.at(k);
    now.rows = finite_rows(e);
    now.over = enough(now.rows) ? centred(e(now.rows, Eigen::all)) : Centred{};
    for (Index j = 1; j <= std::min(lags, k); ++j) {
      const Innovation& before = latest.at(k - j);
      if (now.rows == before.rows) {
        sums.add(k, j, now.over, before.over);
        continue;
      }
      std::vector<Index> both;
      std::set_intersection(now.rows.begin(), now.rows.end(), before.rows.begin(), before.rows.end(),
                            std::back_inserter(both));
      if (enough(both))
        sums.add(k, j, centred(e(both, Eigen::all)), centred(innovations[size_t(k - j)](both, Eigen::all)));
    }
  }
  return sums.result(Pooling::experiments);
}

// Collects the samples of all steps and experiments as rows.
class Stack {
 public:
  explicit Stack(Index columns) : columns_(columns) {}
  template <class Row>
  void add(const Row& row) {
    for (Index j = 0; j < columns_; ++j) values_.push_back(row(j));
    ++rows_;
  }
  Index rows() const { return rows_; }
  Matrix matrix() const { return Eigen::Map<const Matrix>(values_.data(), columns_, rows_).transpose(); }

 private:
  Index columns_, rows_ = 0;
  std::vector<double> values_;
};

Whiteness whiteness_over_time(const Innovations& innovations, Index lags) {
  const Index steps = static_cast<Index>(innovations.size()), m = innovations.front().cols();
  WhitenessSums sums(1, lags, m);
  for (Index j = 1; j <= lags; ++j) {
    Stack now(m), before(m);
    for (Index k = j; k < steps; ++k)
      for (Index n = 0; n < innovations[size_t(k)].rows(); ++n) {
        const auto e = innovations[size_t(k)].row(n), e_before = innovations[size_t(k - j)].row(n);
        if (!e.allFinite() || !e_before.allFinite()) continue;
        now.add(e);
        before.add(e_before);
      }
    if (now.rows() > too_few(innovations)) sums.add(0, j, centred(now.matrix()), centred(before.matrix()));
  }
  return sums.result(Pooling::time);
}

}  // namespace

Whiteness whiteness(const Innovations& innovations, Index lags) {
  switch (pooling(innovations)) {
    case Pooling::experiments:
      return whiteness_over_experiments(innovations, lags);
    case Pooling::time:
      return whiteness_over_time(innovations, lags);
    default:
      return WhitenessSums(0, lags, innovations.empty() ? 0 : innovations.front().cols()).result(Pooling::none);
  }
}

double whiteness_p(const Innovations& innovations, Index lags) { return whiteness(innovations, lags).p; }

namespace {

// An orthonormal basis of the inputs of the given rows. The mean of the available inputs replaces a missing one.
Matrix input_basis(Matrix u) {
  fill_missing_inputs(u);
  return centred(std::move(u)).basis;
}

class IndependenceSums {
 public:
  explicit IndependenceSums(Index lags)
      : lag_(size_t(lags)), trace_(size_t(lags), 0.0), correlations_(size_t(lags), 0.0) {}

  // Adds the bases of all lags; the basis of a lag without inputs is empty. Inputs may be correlated in time, so that
  // the bases overlap. The traces of the sum of the projections account for the overlap.
  void add(const Centred& innovations, const std::vector<Matrix>& bases) {
    if (innovations.basis.cols() == 0) return;
    Index columns = 0;
    for (const Matrix& basis : bases) columns += basis.cols();
    Matrix all(innovations.columns.rows(), columns);
    columns = 0;
    for (size_t j = 0; j < bases.size(); ++j) {
      const Matrix& basis = bases[j];
      if (basis.cols() == 0) continue;
      all.middleCols(columns, basis.cols()) = basis;
      columns += basis.cols();
      const double q = double(basis.cols());
      lag_[j] += statistics::projected_trace(innovations.rank(), innovations.freedom(), q, q, q);
      trace_[j] += (innovations.basis.transpose() * basis).squaredNorm();
      correlations_[j] += std::min(q, innovations.rank());
    }
    const Matrix gram = all.transpose() * all;
    const Matrix square = gram * gram;
    all_ += statistics::projected_trace(innovations.rank(), innovations.freedom(), gram.trace(), square.trace(),
                                        square.cwiseProduct(gram).sum());
  }

  Independence result(Index first, Pooling over) const {
    Independence result;
    result.first = first;
    result.z = result.correlation = Vector::Constant(Index(lag_.size()), nan);
    double trace = 0.0;
    for (size_t j = 0; j < lag_.size(); ++j) {
      result.z(Index(j)) = standardised(trace_[j], lag_[j]);
      if (correlations_[j] > 0)
        result.correlation(Index(j)) = std::sqrt(std::max(0.0, trace_[j] - lag_[j].mean) / correlations_[j]);
      trace += trace_[j];
    }
    // If the variance is only rounding error, the inputs span all experiments, and the test has no result.
    if (all_.variance > 1e-12 * all_.mean * all_.mean) result.p = statistics::upper_tail(all_, trace);
    if (!std::isnan(result.p)) result.over = over;
    return result;
  }

 private:
  std::vector<Cumulants> lag_;
  std::vector<double> trace_, correlations_;  // sums of squared canonical correlations, and their number
  Cumulants all_;
};

Independence independence_over_experiments(const Innovations& innovations, const Ensemble& data, Index first,
                                           Index last) {
  IndependenceSums sums(last - first + 1);
  // Bases over all experiments. Step k needs those of the steps k - last … k - first.
  struct Basis {
    Index step = -1;
    Matrix basis;
  };
  Latest<Basis> whole(last - first + 1);
  for (Index k = 0; k < data.steps(); ++k) {
    const std::vector<Index> rows = finite_rows(innovations[size_t(k)]);
    if (static_cast<Index>(rows.size()) <= too_few(innovations)) continue;
    std::vector<Matrix> bases;
    for (Index j = first; j <= last; ++j) {
      bases.emplace_back();
      if (k - j < 0 || k - j >= data.steps()) continue;
      if (static_cast<Index>(rows.size()) < data.experiments()) {
        bases.back() = input_basis(data.input(k - j)(rows, Eigen::all));
        continue;
      }
      Basis& kept = whole.at(k - j);
      if (kept.step != k - j) kept = {k - j, input_basis(data.input(k - j))};
      bases.back() = kept.basis;
    }
    sums.add(centred(innovations[size_t(k)](rows, Eigen::all)), bases);
  }
  return sums.result(first, Pooling::experiments);
}

Independence independence_over_time(const Innovations& innovations, const Ensemble& data, Index first, Index last) {
  Stack e(data.outputs());
  std::vector<Stack> inputs(size_t(last - first + 1), Stack(data.inputs()));
  const Vector missing = Vector::Constant(data.inputs(), nan);
  for (Index k = 0; k < data.steps(); ++k)
    for (Index n = 0; n < data.experiments(); ++n) {
      if (!innovations[size_t(k)].row(n).allFinite()) continue;
      e.add(innovations[size_t(k)].row(n));
      for (Index j = first; j <= last; ++j)
        if (k - j >= 0 && k - j < data.steps())
          inputs[size_t(j - first)].add(data.input(k - j).row(n));
        else
          inputs[size_t(j - first)].add(missing);
    }
  std::vector<Matrix> bases;
  bases.reserve(inputs.size());
  for (const Stack& u : inputs) bases.push_back(input_basis(u.matrix()));
  IndependenceSums sums(last - first + 1);
  sums.add(centred(e.matrix()), bases);
  return sums.result(first, Pooling::time);
}

}  // namespace

Independence independence(const Innovations& innovations, const Ensemble& data, Index first, Index last) {
  if (first > last)
    throw std::invalid_argument(
        fmt::format("lags: {} to {} found, a last lag that is not below the first needed", first, last));
  check_innovations(innovations, data);
  switch (pooling(innovations)) {
    case Pooling::experiments:
      return independence_over_experiments(innovations, data, first, last);
    case Pooling::time:
      return independence_over_time(innovations, data, first, last);
    default:
      return IndependenceSums(last - first + 1).result(first, Pooling::none);
  }
}

namespace {

// Squares minus their expectation, summed for each experiment.
class Squares {
 public:
  explicit Squares(Index experiments) : excess_(size_t(experiments), 0.0), freedom_(size_t(experiments), 0) {}

  void add(Index n, double square, Index outputs) {
    excess_[size_t(n)] += square - double(outputs);
    freedom_[size_t(n)] += outputs;
  }
  void add(const Squares& other) {
    for (size_t n = 0; n < excess_.size(); ++n) excess_[n] += other.excess_[n], freedom_[n] += other.freedom_[n];
  }

  double ratio() const { return freedom() > 0 ? 1 + excess() / double(freedom()) : nan; }
  // The χ² distribution assumes normal innovations. It is used for fewer than 20 experiments, which are too few to
  // estimate the spread over the experiments.
  bool normal() const { return count() < 20; }
  double p() const {
    if (freedom() == 0) return nan;
    if (normal()) return statistics::chi_square_two_sided(excess() + double(freedom()), double(freedom()));
    const double size = double(count()), mean = excess() / size;
    double squares = 0.0;
    for (size_t n = 0; n < excess_.size(); ++n)
      if (freedom_[n] > 0) squares += (excess_[n] - mean) * (excess_[n] - mean);
    const double error = std::sqrt(squares / (size * (size - 1)));
    return error > 0 ? statistics::student_two_sided(mean / error, size - 1) : nan;
  }

 private:
  double excess() const {
    double sum = 0.0;
    for (const double e : excess_) sum += e;
    return sum;
  }
  Index freedom() const {
    Index sum = 0;
    for (const Index f : freedom_) sum += f;
    return sum;
  }
  Index count() const {
    return std::count_if(freedom_.begin(), freedom_.end(), [](Index f) { return f > 0; });
  }

  std::vector<double> excess_;  // (N)
  std::vector<Index> freedom_;  // (N)
};

}  // namespace

namespace {

// The rank of a covariance whose variances are all positive. The rank is below the number of outputs if outputs repeat
// each other.
Index stated_directions(const Matrix& covariance) {
  constexpr double negligible = 1e-8;  // EM leaves a variance of 1e-12 of the signals
  const Vector scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Vector sigma = linalg::singular_values(scale.asDiagonal() * covariance * scale.asDiagonal());
  return (sigma.array() > negligible * sigma(0)).count();
}

}  // namespace

NormalisedSquares normalised_squares(const Model& model, const Innovations& innovations) {
  const Index T = static_cast<Index>(innovations.size()), N = T > 0 ? innovations.front().rows() : 0;
  if (T > 0 && innovations.front().cols() != model.outputs)
    throw std::invalid_argument(
        fmt::format("innovations: of {} outputs found, the model has {}", innovations.front().cols(), model.outputs));
  NormalisedSquares result;
  result.step = result.step_p = Vector::Constant(T, nan);
  if (!model.has(&Step::has_innovation_cov)) return result;
  Squares total(N);
  std::vector<Index> seen, whitened;  // outputs
  const double* of = nullptr;         // the covariance of the whitener; repeated steps share theirs
  Matrix whitener;
  Index directions = 0;
  for (Index k = model.k_begin; k < std::min(T, model.k_end()); ++k) {
    const Step::View covariance = model.at(k).innovation_cov();
    if (!covariance.allFinite()) continue;
    Squares step(N);
    for (Index n = 0; n < N; ++n) {
      const Vector e = innovations[size_t(k)].row(n);
      seen.clear();
      // An output is not tested if its variance is zero, or so small that squares overflow.
      for (Index j = 0; j < e.size(); ++j)
        if (std::isfinite(e(j)) && covariance(j, j) > smallest_variance) seen.push_back(j);
      if (seen.empty()) continue;
      if (seen != whitened || covariance.data() != of) {
        whitened = seen;
        of = covariance.data();
        whitener = linalg::whitener(covariance(seen, seen));
        directions = stated_directions(covariance(seen, seen));
      }
      step.add(n, (whitener * e(seen)).squaredNorm(), directions);
    }
    result.step(k) = step.ratio();
    result.step_p(k) = step.p();
    total.add(step);
  }
  result.ratio = total.ratio();
  result.p = total.p();
  result.normal = total.normal();
  return result;
}

}  // namespace tokid
