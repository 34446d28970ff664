// SPDX-License-Identifier: BSD-3-Clause
#include "oracle.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/constants/constants.hpp>
#include <cmath>
#include <initializer_list>
#include <numeric>
#include <utility>

namespace tokid::testing::oracle {

namespace {

// aᵀb column by column: numbers this long gain nothing from blocks, but much from zeros that are left out.
Real product(const Exact& a, Index i, const Exact& b, Index j) {
  Real sum = 0;
  for (Index n = 0; n < a.rows(); ++n)
    if (a(n, i) != 0 && b(n, j) != 0) sum += a(n, i) * b(n, j);
  return sum;
}

Exact identity(Index n) { return Exact::Identity(n, n); }

}  // namespace

double distance(const ConstMatrixRef& a, const Exact& truth) { return double(Exact(exact(a) - truth).norm()); }

LeastSquares least_squares(const Exact& a, const Exact& b) {
  const Index cols = a.cols(), right = b.cols();
  Exact gram(cols, cols), moments(cols, right);
  for (Index j = 0; j < cols; ++j) {
    for (Index i = j; i < cols; ++i) gram(i, j) = product(a, i, a, j);
    for (Index i = 0; i < right; ++i) moments(j, i) = product(a, j, b, i);
  }
  const Real square = gram.trace();
  const Eigen::LLT<Exact, Eigen::Lower> cholesky(gram);
  LeastSquares result;
  result.x = cholesky.solve(moments);
  result.inverse_root = cholesky.matrixL().solve(identity(cols));
  result.size = double(sqrt(square));
  result.condition = double(sqrt(square) * result.inverse_root.norm());
  result.right.resize(right);
  result.residual.resize(right);
  for (Index j = 0; j < right; ++j) {
    Real before = 0, after = 0;
    for (Index n = 0; n < a.rows(); ++n) {
      Real rest = b(n, j);
      before += rest * rest;
      for (Index i = 0; i < cols; ++i) rest -= a(n, i) * result.x(i, j);
      after += rest * rest;
    }
    result.right(j) = double(sqrt(before));
    result.residual(j) = double(sqrt(after));
  }
  return result;
}

Responses responses(const GtvArx& arx, Index band) {
  const Index steps = arx.steps(), r = arx.inputs, m = arx.outputs;
  Responses result;
  result.system.assign(size_t(steps), Exact::Zero(m, band * r));
  result.gain.assign(size_t(steps), Exact::Zero(m, band * m));
  for (Index k = arx.k_begin; k < steps; ++k) {
    const Index lags = arx.step[size_t(k)].lags;
    for (Index i = std::max(arx.k_begin, k - band); i < k; ++i) {
      Exact h = Exact::Zero(m, r), g = Exact::Zero(m, m);
      for (Index j = 1; j <= std::min(k - i, lags); ++j) {
        const Exact minus_h2 = exact(arx.output_block(k, j));
        if (j == k - i) {
          h += exact(arx.input_block(k, j)) + minus_h2 * exact(arx.D(i));
          g -= minus_h2;
        } else {
          const size_t step = size_t(k - j);
          h += minus_h2 * result.system[step].middleCols((k - j - i - 1) * r, r);
          g += minus_h2 * result.gain[step].middleCols((k - j - i - 1) * m, m);
        }
      }
      result.system[size_t(k)].middleCols((k - i - 1) * r, r) = h;
      result.gain[size_t(k)].middleCols((k - i - 1) * m, m) = g;
    }
  }
  return result;
}

System system(const Model& model) {
  System result{model.inputs, model.outputs, model.k_begin, {}, {}, {}, {}};
  for (size_t s = 0; s < model.step.size(); ++s) {
    result.A.push_back(exact(model.step[s].A()));
    result.B.push_back(exact(model.step[s].B()));
    result.C.push_back(exact(model.step[s].C()));
    result.G.push_back(exact(model.step[s].G()));
  }
  return result;
}

Responses responses(const System& system, Index band) {
  const Index begin = system.k_begin, steps = begin + Index(system.A.size()), r = system.inputs, m = system.outputs;
  Responses result;
  result.system.assign(size_t(steps), Exact::Zero(m, band * r));
  result.gain.assign(size_t(steps), Exact::Zero(m, band * m));
  for (Index i = begin; i + 1 < steps; ++i) {
    const size_t first = size_t(i - begin);
    Exact state(system.B[first].rows(), r + m);
    state << system.B[first], system.G[first];
    for (Index k = i + 1; k < std::min(steps, i + 1 + band); ++k) {
      const size_t s = size_t(k - begin);
      const Exact output = system.C[s] * state;
      result.system[size_t(k)].middleCols((k - i - 1) * r, r) = output.leftCols(r);
      result.gain[size_t(k)].middleCols((k - i - 1) * m, m) = output.rightCols(m);
      state = (system.A[s] * state).eval();
    }
  }
  return result;
}

std::vector<Exact> outputs(const Model& model, const Ensemble& data, const Matrix& x0, bool corrected) {
  std::vector<Exact> result;
  Exact x = exact(x0);
  for (size_t s = 0; s < model.step.size(); ++s) {
    const Index k = model.k_begin + Index(s);
    const Exact u = exact(data.input(k));
    const Exact y = x * exact(model.step[s].C()).transpose() + u * exact(model.step[s].D()).transpose();
    Exact next = x * exact(model.step[s].A()).transpose() + u * exact(model.step[s].B()).transpose();
    if (corrected) next -= (exact(data.output(k)) - y) * exact(model.step[s].G()).transpose();
    result.push_back(y);
    x = next;
  }
  return result;
}

Arx arx(const GtvArx& arx) {
  Arx result{arx.inputs, arx.outputs, arx.step.back().lags, {}, {}};
  for (Index k = 0; k < arx.steps(); ++k) {
    result.coefficients.push_back(exact(arx.coefficients(k)));
    result.residual_cov.push_back(exact(arx.residual_cov(k)));
  }
  return result;
}

namespace {

// b on a: coefficients (of b × of a), and what they leave.
struct Fit {
  Exact coefficients, residuals;
};
Fit fit(const Exact& a, const Exact& b) {
  const Exact x = least_squares(a, b).x;
  return {x.transpose(), b - a * x};
}

Exact covariance(const Exact& residuals, Index spent) {
  return residuals.transpose() * residuals / Real(residuals.rows() - spent);
}

Exact beside(const Exact& a, const Exact& b) {
  Exact both(a.rows(), a.cols() + b.cols());
  both << a, b;
  return both;
}

// S = V diag(values) Vᵀ, largest first, by Jacobi's rotations: each makes an entry beside the diagonal zero.
struct Spectrum {
  Exact values, vectors;  // (n × 1), (n × n)
};
Spectrum eigenvalues(Exact s) {
  const Index n = s.rows();
  Exact v = identity(n);
  const Real negligible = s.norm() * 1e-48;
  const auto rotate = [](auto&& a, auto&& b, const Real& cos, const Real& sin) {
    const Exact before = a;
    a = cos * before - sin * b;
    b = sin * before + cos * b;
  };
  for (Real rest = s.norm(); rest > negligible;) {
    rest = 0;
    for (Index j = 1; j < n; ++j)
      for (Index i = 0; i < j; ++i) {
        rest = std::max(rest, Real(abs(s(i, j))));
        if (s(i, j) == 0) continue;
        const Real half = (s(j, j) - s(i, i)) / (2 * s(i, j));
        const Real tan = (half < 0 ? -1 : 1) / (abs(half) + sqrt(half * half + 1));
        const Real cos = 1 / sqrt(tan * tan + 1);
        rotate(s.row(i), s.row(j), cos, tan * cos);
        rotate(s.col(i), s.col(j), cos, tan * cos);
        rotate(v.col(i), v.col(j), cos, tan * cos);
      }
  }
  std::vector<Index> order(static_cast<size_t>(n));
  std::iota(order.begin(), order.end(), Index(0));
  std::sort(order.begin(), order.end(), [&](Index i, Index j) { return s(i, i) > s(j, j); });
  const Exact values = s.diagonal();
  return {values(order, Eigen::all), v(Eigen::all, order)};
}

// v_{k-p} … v_{k-1}
Exact past(const Ensemble& data, Index k, Index lags) {
  return exact(data.samples().middleCols((k - lags) * data.channels(), lags * data.channels()));
}

// W, W S Wᵀ = I
Exact whitener(const Exact& s) { return Eigen::LLT<Exact>(s).matrixL().solve(identity(s.rows())); }

}  // namespace

Arx arx(const Ensemble& data, Index lags) {
  Arx result{data.inputs(), data.outputs(), lags, {}, {}};
  result.coefficients.resize(size_t(data.steps()));
  result.residual_cov = result.coefficients;
  for (Index k = lags; k < data.steps(); ++k) {
    const Fit of_step = fit(beside(past(data, k, lags), exact(data.input(k))), exact(data.output(k)));
    result.coefficients[size_t(k)] = of_step.coefficients;
    result.residual_cov[size_t(k)] = covariance(of_step.residuals, of_step.coefficients.cols());
  }
  return result;
}

States states(const Arx& arx, const Ensemble& data, Index most, bool many_steps) {
  const Index p = arx.lags, r = arx.inputs, m = arx.outputs, d = r + m, steps = data.steps();
  States result;
  result.singular_values.resize(size_t(steps));
  result.map = result.singular_values;
  for (Index k = p; k < steps; ++k) {
    const Index future = std::min(p, steps - k);
    Exact predictor = Exact::Zero(future * m, p * d), weighted = predictor;
    for (Index a = 0; a < future; ++a) {
      const Exact& coefficients = arx.coefficients[size_t(k + a)];
      auto row = predictor.middleRows(a * m, m);
      row.rightCols((p - a) * d) = coefficients.leftCols((p - a) * d);
      for (Index j = 1; many_steps && j <= a; ++j)
        row += coefficients.middleCols((p - j) * d + r, m) * predictor.middleRows((a - j) * m, m);
      weighted.middleRows(a * m, m) = whitener(arx.residual_cov[size_t(k + a)]) * row;
    }
    const Exact predicted = past(data, k, p) * weighted.transpose();
    const Spectrum squares = eigenvalues(predicted.transpose() * predicted / Real(data.experiments()));
    const Exact singular = squares.values.cwiseMax(Real(0)).cwiseSqrt();
    const Index n = std::min(most, singular.rows());
    result.singular_values[size_t(k)] = singular;
    result.map[size_t(k)] = singular.topRows(n).cwiseSqrt().cwiseInverse().col(0).asDiagonal() *
                            (squares.vectors.leftCols(n).transpose() * weighted);
  }
  return result;
}

std::vector<Exact> samples(const States& states, const Ensemble& data, Index lags) {
  std::vector<Exact> result(states.map.size());
  for (Index k = lags; k < data.steps(); ++k)
    result[size_t(k)] = past(data, k, lags) * states.map[size_t(k)].transpose();
  return result;
}

Realised realise(const std::vector<Exact>& states, const Ensemble& data, Index lags, const Handed& handed) {
  const Index r = data.inputs(), m = data.outputs(), steps = data.steps();
  Realised result{{r, m, lags, {}, {}, {}, {}}, {}};
  System& model = result.system;
  Exact p = Exact::Zero(states[size_t(lags)].cols(), states[size_t(lags)].cols());
  for (Index k = lags; k < steps; ++k) {
    const Exact &x = states[size_t(k)], known = beside(x, exact(data.input(k)));
    const Index n = x.cols(), next = k + 1 < steps ? states[size_t(k + 1)].cols() : 0;
    const Fit output = fit(known, exact(data.output(k)));
    const Exact c = output.coefficients.leftCols(n), sigma = covariance(output.residuals, n + r);
    Exact of_state = Exact::Zero(next, n + r + m), noise = Exact::Zero(next, next);
    if (next > 0) {
      const Exact residuals = handed ? handed(k, output.residuals) : output.residuals;
      const Fit state = fit(beside(known, residuals), states[size_t(k + 1)]);
      of_state = state.coefficients;
      noise = covariance(state.residuals, n + r + m);
    }
    const Exact a = of_state.leftCols(n), g = -of_state.rightCols(m), closed = a + g * c;
    const Exact cp = c * p, innovation = cp * c.transpose() + sigma;
    const Eigen::LLT<Exact> cholesky(innovation);
    model.A.push_back(a);
    model.B.emplace_back(of_state.middleCols(n, r));
    model.C.push_back(c);
    model.G.emplace_back(cholesky.solve(Exact((g * sigma - a * cp.transpose()).transpose())).transpose());
    result.innovation_cov.push_back(innovation);
    p = (closed * (p - cp.transpose() * cholesky.solve(cp)) * closed.transpose() + noise).eval();
  }
  return result;
}

namespace {

// Numbers that are known, and others that are entries of the unknown vector.
struct Part {
  Exact value;            // (rows × 1)
  std::vector<Index> at;  // (rows) of the unknown vector; -1: known
};

Part unknown(Index size, Index& unknowns) {
  Part part{Exact::Zero(size, 1), {}};
  for (Index i = 0; i < size; ++i) part.at.push_back(unknowns++);
  return part;
}

Part samples(const Matrix& row, Index& unknowns) {
  Part part{Exact::Zero(row.size(), 1), {}};
  for (Index i = 0; i < row.size(); ++i) {
    const bool known = std::isfinite(row(i));
    if (known) part.value(i, 0) = row(i);
    part.at.push_back(known ? -1 : unknowns++);
  }
  return part;
}

Part stacked(std::initializer_list<const Part*> parts) {
  Part all{Exact(0, 1), {}};
  for (const Part* part : parts) {
    all.value.conservativeResize(all.value.rows() + part->value.rows(), 1);
    all.value.bottomRows(part->value.rows()) = part->value;
    all.at.insert(all.at.end(), part->at.begin(), part->at.end());
  }
  return all;
}

// weight · (sum of matrices times parts) = weight · right, every row with noise of variance 1.
class Equations {
 public:
  explicit Equations(Index unknowns) : a_(0, unknowns), b_(0, 1) {}

  void add(const Exact& weight, std::initializer_list<std::pair<Exact, const Part*>> terms, const Exact& right) {
    const Index first = a_.rows();
    a_.conservativeResize(first + weight.rows(), Eigen::NoChange);
    a_.bottomRows(weight.rows()).setZero();
    b_.conservativeResize(a_.rows(), Eigen::NoChange);
    b_.bottomRows(weight.rows()) = weight * right;
    for (const auto& [matrix, part] : terms) {
      const Exact weighted = weight * matrix;
      for (Index i = 0; i < weighted.cols(); ++i)
        if (part->at[size_t(i)] < 0)
          b_.bottomRows(weight.rows()) -= weighted.col(i) * part->value(i, 0);
        else
          a_.col(part->at[size_t(i)]).tail(weight.rows()) += weighted.col(i);
    }
    for (Index i = 0; i < weight.rows(); ++i) log_density_ += log(weight(i, i));
  }

  // Finds the unknowns.
  void solve() {
    const LeastSquares solution = least_squares(a_, b_);
    x_ = solution.x;
    covariance_ = solution.inverse_root.transpose() * solution.inverse_root;
    // The joint density of all at the solution, over that of the unknowns given what is known.
    log_density_ -= (a_ * x_ - b_).squaredNorm() / 2;
    for (Index i = 0; i < a_.cols(); ++i) log_density_ += log(solution.inverse_root(i, i));
    log_density_ -= Real(a_.rows() - a_.cols()) / 2 * log(2 * boost::math::constants::pi<Real>());
  }
  const Real& log_density() const { return log_density_; }

  Exact second_moment(const Part& part) const {
    Exact mean = part.value;
    for (Index i = 0; i < mean.rows(); ++i)
      if (part.at[size_t(i)] >= 0) mean(i, 0) = x_(part.at[size_t(i)], 0);
    Exact moment = mean * mean.transpose();
    for (Index i = 0; i < mean.rows(); ++i)
      for (Index j = 0; j < mean.rows(); ++j)
        if (part.at[size_t(i)] >= 0 && part.at[size_t(j)] >= 0)
          moment(i, j) += covariance_(part.at[size_t(i)], part.at[size_t(j)]);
    return moment;
  }

 private:
  Exact a_, b_, x_, covariance_;
  Real log_density_ = 0;
};

// (r × 1) of the samples that are there
Exact mean_squares(const Ensemble& data) {
  Exact sum = Exact::Zero(data.inputs(), 1);
  for (Index i = 0; i < data.inputs(); ++i) {
    Real count = 0;
    for (Index k = 0; k < data.steps(); ++k)
      for (const double value : data.input(k).col(i))
        if (std::isfinite(value)) sum(i, 0) += Real(value) * Real(value), count += 1;
    sum(i, 0) /= count;
  }
  return sum;
}

}  // namespace

Expectation expectation(const Model& model, const Ensemble& data) {
  const Index r = model.inputs, m = model.outputs, steps = data.steps(), n = model.states();
  const Exact input_square = mean_squares(data);
  Expectation result{std::vector<Exact>(size_t(steps), Exact::Zero(n + r + m, n + r + m)),
                     std::vector<Exact>(size_t(steps), Exact::Zero(n + r + n, n + r + n)),
                     Exact::Zero(data.experiments(), 1)};
  for (Index experiment = 0; experiment < data.experiments(); ++experiment) {
    const auto any_output = [&](Index k) { return data.output(k).row(experiment).array().isFinite().any(); };
    Index end = steps, unknowns = 0;
    while (end > 0 && !any_output(end - 1)) --end;
    if (end == 0) continue;
    std::vector<Part> x, u, y;
    for (Index k = 0; k < end; ++k) {
      x.push_back(unknown(n, unknowns));
      u.push_back(samples(data.input(k).row(experiment), unknowns));
      y.push_back(samples(data.output(k).row(experiment), unknowns));
    }
    Equations equations(unknowns);
    equations.add(whitener(exact(model.x0_cov)), {{identity(n), &x[0]}}, exact(model.x0_mean));
    for (size_t s = 0; s < size_t(end); ++s) {
      for (Index i = 0; i < r; ++i)
        if (u[s].at[size_t(i)] >= 0)
          equations.add(Exact::Constant(1, 1, 1 / sqrt(input_square(i, 0))), {{Exact(identity(r).row(i)), &u[s]}},
                        Exact::Zero(1, 1));
      equations.add(whitener(exact(model.step[s].R())),
                    {{identity(m), &y[s]}, {-exact(model.step[s].C()), &x[s]}, {-exact(model.step[s].D()), &u[s]}},
                    Exact::Zero(m, 1));
      if (s + 1 < size_t(end))
        equations.add(
            whitener(exact(model.step[s].Q())),
            {{identity(n), &x[s + 1]}, {-exact(model.step[s].A()), &x[s]}, {-exact(model.step[s].B()), &u[s]}},
            Exact::Zero(n, 1));
    }
    equations.solve();
    result.log_likelihood(experiment, 0) = equations.log_density();
    for (size_t s = 0; s < size_t(end); ++s) {
      if (any_output(Index(s))) result.measured[s] += equations.second_moment(stacked({&x[s], &u[s], &y[s]}));
      if (s + 1 < size_t(end)) result.moved[s] += equations.second_moment(stacked({&x[s], &u[s], &x[s + 1]}));
    }
  }
  return result;
}

Regression regression(const ConstMatrixRef& moments, Index regressors) {
  const Exact all = exact(moments);
  const Index right = all.rows() - regressors;
  const Exact cross = all.topRightCorner(regressors, right);
  const Exact x = Eigen::LLT<Exact>(all.topLeftCorner(regressors, regressors)).solve(cross);
  return {x.transpose(), all.bottomRightCorner(right, right) - x.transpose() * cross};
}

}  // namespace tokid::testing::oracle
