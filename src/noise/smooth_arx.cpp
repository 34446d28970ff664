// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/smooth_arx.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <stdexcept>

#include "base/search_progress.hpp"
#include "data/check.hpp"
#include "data/output_weights.hpp"
#include "data/pooled_windows.hpp"
#include "data/rows.hpp"
#include "noise/changes_at_jumps.hpp"
#include "tokid/random_walk.hpp"

namespace tokid {

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
// For the progress: pairs of lags and λ that are usually tried.
constexpr double usual_pairs = 12.0;

// 1 / RMS of each channel over the ensemble, as the scales of the regressors W_k.
Vector window_scales(const Windows& e, Index lags, bool feedthrough) {
  const Index d = e.channels(), r = feedthrough ? e.inputs() : 0;
  const Vector channel = e.channel_sizes().cwiseInverse();
  Vector scales(lags * d + r);
  for (Index j = 0; j < lags; ++j) scales.segment(j * d, d) = channel;
  scales.tail(r) = channel.head(r);
  return scales;
}

// The regressions of the steps begin … end-1 as triangular factors, one for each group of steps that share a model.
struct GroupFactors {
  Index regressors = 0;
  std::vector<Matrix> factor;             // (groups) factor of the scaled [W Y]: (≤ L+m) × (L+m)
  std::vector<Index> rows;                // (T) number of experiments at each step
  double mean_rows = 0.0;                 // mean number of rows over the groups with at least one row
  std::shared_ptr<const Matrix> windows;  // if there is one group: the factor of its windows
};

// The factor of the scaled [W Y] from that of windows.
Matrix scaled_factor(const Matrix& windows, const Vector& scales, Index outputs) {
  Matrix rows(windows.rows(), scales.size() + outputs);
  rows << windows.leftCols(scales.size()) * scales.asDiagonal(), windows.rightCols(outputs);
  return linalg::triangular_factor(rows);
}

GroupFactors group_factors(const Windows& e, const SmoothArxOptions& o, const Vector& scales, Index begin, Index end) {
  const Index p = o.lags, m = e.outputs(), groups = o.variation.groups(end - begin);
  GroupFactors w;
  w.regressors = scales.size();
  w.factor.resize(size_t(groups));
  w.rows.assign(size_t(e.steps()), 0);
  const Index first = o.initial_state == InitialState::zero ? begin : std::max(begin, p);
  if (groups == 1) {
    w.windows = std::make_shared<Matrix>(pooled_window_factor(e, p, first, std::max(first, end), o.execution));
    w.factor[0] = scaled_factor(*w.windows, scales, m);
    const std::vector<Index> counts = window_counts(e, p, first, end);
    std::copy(counts.begin(), counts.end(), w.rows.begin() + std::ptrdiff_t(first));
    w.mean_rows = double(std::accumulate(counts.begin(), counts.end(), Index{0}));
    return w;
  }
  parallel_for(0, groups, {o.execution.threads, {}}, [&](Index from, Index to) {
    Matrix window;
    for (Index g = from; g < to; ++g) {
      linalg::RowStack stack(w.regressors + m);
      for (Index k = begin; k < end; ++k) {
        if (k < first || o.variation.group(k - begin) != g) continue;
        w.rows[size_t(k)] = e.rows(k, p, window);
        Matrix rows(window.rows(), w.regressors + m);
        rows << window.leftCols(w.regressors) * scales.asDiagonal(), window.rightCols(m);
        stack.add(rows);
      }
      w.factor[size_t(g)] = stack.factor();
    }
  });
  double sum = 0.0;
  for (const Index rows : w.rows) sum += double(rows);
  w.mean_rows = sum / double(groups);
  return w;
}

Vector stiffness(const GroupFactors& w, double smoothing) {
  return Vector::Constant(w.regressors, std::isinf(smoothing) ? inf : std::sqrt(smoothing * w.mean_rows));
}

// Residual sums of squares and products of the rows [R Z] with the solution X.
Matrix residual_square(const Matrix& rows, const Matrix& x) {
  const Matrix e = rows.rightCols(x.cols()) - rows.leftCols(x.rows()) * x;
  return e.transpose() * e;
}

void check(const Windows& e, Index lags, const TimeVariation& v) {
  if (lags < 1 || lags >= e.steps())
    throw std::invalid_argument(fmt::format("lags: {} found, 1 to {} needed", lags, e.steps() - 1));
  if (!(v.smoothing >= 0))
    throw std::invalid_argument(fmt::format("smoothing: {} found, 0 or more needed", v.smoothing));
  if (v.period < 0) throw std::invalid_argument(fmt::format("period: {} found, 1 or more needed", v.period));
}

}  // namespace

Vector jump_gains(const Windows& e, const SmoothArxOptions& options) {
  check(e, options.lags, options.variation);
  const Index m = e.outputs();
  GroupFactors w = group_factors(e, options, window_scales(e, options.lags, options.feedthrough), 0, e.steps());
  const Vector stiff = stiffness(w, options.variation.smoothing);
  const std::vector<Matrix> x = random_walk_regression(w.factor, w.regressors, stiff);
  Matrix covariance = Matrix::Zero(m, m);
  for (size_t k = 0; k < x.size(); ++k)
    covariance += residual_square(w.factor[k], x[k]) / (w.mean_rows * double(x.size()));
  const Matrix whitener = linalg::whitener(covariance);
  for (Matrix& rows : w.factor) rows.rightCols(m) = (rows.rightCols(m) * whitener.transpose()).eval();
  return loosening_gains(w.factor, stiff, options.lags + 1);
}

GtvArx smooth_arx(const Windows& e, const SmoothArxOptions& options) {
  check(e, options.lags, options.variation);
  const Index p = options.lags, m = e.outputs(), steps = e.steps();
  const Vector scales = window_scales(e, p, options.feedthrough);
  const GroupFactors w = group_factors(e, options, scales, 0, steps);
  const std::vector<Matrix> x =
      random_walk_regression(w.factor, w.regressors, stiffness(w, options.variation.smoothing),
                             changes_at_jumps(options.variation.jumps, 0, p, 0));
  GtvArx arx;
  arx.feedthrough = options.feedthrough;
  arx.resize(steps, e.inputs(), m, p, false, 0, options.variation.period);
  arx.window_factor = w.windows;
  arx.begin_at(options.initial_state == InitialState::zero ? 0 : p);

  // The number of rows of each group. All steps of a group share one residual covariance.
  std::vector<Index> rows(w.factor.size(), 0);
  for (Index k = 0; k < steps; ++k) rows[size_t(options.variation.group(k))] += w.rows[size_t(k)];
  for (Index k = arx.k_begin; k < steps; ++k) {
    const size_t g = size_t(options.variation.group(k));
    GtvArxStep& step = arx.step[size_t(k)];
    step.lags = std::min(p, k);
    step.rows = w.rows[size_t(k)];
    if (arx.slot(k) != k) continue;
    const Index own = arx.regressors(k);  // number of own regressors: the last rows of x
    arx.coefficients(k) = (scales.tail(own).asDiagonal() * x[g].bottomRows(own)).transpose();
    const double count = double(std::max<Index>(1, rows[g]));
    arx.residual_cov(k) = residual_square(w.factor[g], x[g]) / count;
    arx.output_rms(k) = (w.factor[g].rightCols(m).colwise().squaredNorm() / count).cwiseSqrt().transpose();
  }
  return arx;
}

Index fold_count(Index experiments) { return experiments <= 10 ? experiments : 5; }

Split fold(const Ensemble& ensemble, Index f, Index folds, bool centred) {
  const std::vector<Index> held_out = fold_rows(ensemble.experiments(), f, folds);
  Split parts{ensemble.subset(other_rows(ensemble.experiments(), held_out)), ensemble.subset(held_out)};
  if (centred) {
    const Nominal nominal = nominal_trajectory(parts.training);
    parts.training = departures(std::move(parts.training), nominal);
    parts.held_out = departures(std::move(parts.held_out), nominal);
  }
  return parts;
}

namespace {

// Cross-validation errors of (p, λ). The factors of each p are kept for all λ.
class CandidateErrors {
 public:
  CandidateErrors(const Ensemble& e, const SmoothingOptions& o, SearchProgress& work)
      : options_(o),
        work_(work),
        folds_(std::min(o.folds, e.experiments())),
        weights_(weights_of(o.output_weights, e.outputs())) {
    for (Index f = 0; f < folds_; ++f) parts_.push_back(fold(e, f, folds_, o.centred));
    stretches_ = {{0, e.steps()}};
    const Index length = std::max<Index>(o.steps / 4, 2 * o.lags.back());
    if (o.period == 0 && e.steps() > std::max(o.steps, 4 * length)) {
      stretches_.clear();
      for (Index s = 0; s < 4; ++s) {
        const Index begin = s * (e.steps() - length) / 3;
        stretches_.emplace_back(begin, begin + length);
      }
    }
  }

  double error(Index lags, double smoothing) {
    const auto key = std::make_pair(lags, smoothing);
    if (const auto known = errors_.find(key); known != errors_.end()) return known->second;
    const std::vector<Piece>& pieces = factors(lags);
    const Index m = parts_[0].training.outputs();
    const Progress progress = work_.counted(1.0 / double(pieces.size()));
    std::vector<Matrix> sums(pieces.size(), Matrix::Zero(m, 2));  // squared errors, squared outputs
    parallel_for(0, Index(pieces.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) {
        const Piece& piece = pieces[size_t(i)];
        const auto x = random_walk_regression(piece.training.factor, piece.training.regressors,
                                              stiffness(piece.training, smoothing), piece.changes);
        for (size_t g = 0; g < x.size(); ++g) {
          const Matrix& factor = piece.held_out.factor[g];
          sums[size_t(i)].col(0) += residual_square(factor, x[g]).diagonal();
          sums[size_t(i)].col(1) += factor.rightCols(m).colwise().squaredNorm().transpose();
        }
        if (progress) progress({});
      }
    });
    Matrix sum = Matrix::Zero(m, 2);
    for (const Matrix& s : sums) sum += s;
    double log_error = 0.0;
    double trained = 0.0, tested = 0.0;
    for (const Piece& piece : pieces) {
      for (const Index rows : piece.training.rows) trained += double(rows) / double(pieces.size());
      for (const Index rows : piece.held_out.rows) tested += double(rows);
    }
    // With missing samples, there may be too few windows of this length. Then the error is infinite.
    if (tested == 0 || trained < 2 * double(pieces.front().training.regressors)) log_error = inf;
    for (Index j = 0; j < m; ++j)
      log_error += sum(j, 1) > 0 ? weights_(j) * 0.5 * std::log(std::max(sum(j, 0) / sum(j, 1), 1e-300)) : 0.0;
    const double error = std::isfinite(log_error) ? std::exp(log_error / weights_.sum()) : inf;
    errors_[key] = error;
    trials.push_back({lags, smoothing, error});
    return error;
  }

  std::vector<SmoothingTrial> trials;

 private:
  struct Piece {
    GroupFactors training, held_out;
    std::vector<Index> changes;
  };

  const std::vector<Piece>& factors(Index lags) {
    std::vector<Piece>& pieces = factors_[lags];
    if (!pieces.empty()) return pieces;
    SmoothArxOptions o;
    o.lags = lags;
    o.initial_state = options_.initial_state;
    o.feedthrough = options_.feedthrough;
    o.variation.period = options_.period;
    o.execution.threads = options_.execution.threads;
    for (const Split& part : parts_) {
      const Vector scales = window_scales(part.training, lags, o.feedthrough);
      for (const auto& [begin, end] : stretches_)
        pieces.push_back({group_factors(part.training, o, scales, begin, end),
                          group_factors(part.held_out, o, scales, begin, end),
                          changes_at_jumps(options_.jumps, 0, lags, begin)});
    }
    return pieces;
  }

  const SmoothingOptions& options_;
  SearchProgress& work_;
  Index folds_;
  Vector weights_;  // (m) of the outputs
  std::vector<Split> parts_;
  std::vector<std::pair<Index, Index>> stretches_;
  std::map<Index, std::vector<Piece>> factors_;
  std::map<std::pair<Index, double>, double> errors_;
};

// A minimum elsewhere must be smaller by this factor.
constexpr double clearly_better = 1.25;

// Local minimum of f over the indices begin … end-1, by descent from `start`.
template <class Function>
Index descend(Index start, Index begin, Index end, Function&& f) {
  double least = f(start);
  for (const Index direction : {1, -1}) {
    bool moved = false;
    for (Index i = start + direction; i >= begin && i < end; i += direction) {
      const double value = f(i);
      if (!(value < least)) break;
      least = value;
      start = i;
      moved = true;
    }
    if (moved) break;
  }
  return start;
}

}  // namespace

SmoothingChoice choose_smoothing(const Ensemble& ensemble, const SmoothingOptions& options) {
  check_samples(ensemble);
  if (ensemble.experiments() < 2)
    throw std::invalid_argument(
        fmt::format("experiments: {} found, at least 2 needed to choose the smoothing", ensemble.experiments()));
  if (options.lags.empty())
    throw std::invalid_argument("lags: none found, at least one lag order to choose from needed");
  for (const Index p : options.lags) check(ensemble, p, {options.smoothing.value_or(0.0), options.period});

  // The usual weights in their order, then small ones.
  std::vector<double> weights{options.smoothing.value_or(0.0)};
  Index weight = 0, usual = 1;
  if (!options.smoothing && options.period != 1) {
    for (int half = -5; half <= 6; ++half) weights.push_back(std::pow(10.0, 0.5 * half));
    weights.push_back(inf);
    weight = 6;  // λ = 1
    usual = Index(weights.size());
    for (int decade = -4; decade >= -10; --decade) weights.push_back(std::pow(10.0, decade + 0.5));
  }
  if (options.period == 1) weights = {0.0};

  SearchProgress work(options.execution, std::min(usual_pairs, double(options.lags.size() * weights.size())));
  CandidateErrors candidates(ensemble, options, work);
  const auto error = [&](Index p, Index w) { return candidates.error(options.lags[size_t(p)], weights[size_t(w)]); };
  Index lag = Index(options.lags.size()) / 2;
  for (bool moved = true; moved;) {
    const Index weight_before = weight, lag_before = lag;
    const auto of_weight = [&](Index w) { return error(lag, w); };
    if (weight < usual)
      weight = descend(weight, 0, usual, of_weight);
    else
      for (Index w = 0; w < usual; w += 3)
        if (error(lag, w) < error(lag, weight)) weight = w;
    // Almost without noise, the error may fall again by far at other λ and p. Which λ matters less the smaller it is.
    for (Index w = usual + 1; w < Index(weights.size()); w += 3)
      if (error(lag, w) * clearly_better < error(lag, weight)) weight = w;
    if (weight >= usual) weight = descend(weight, usual, Index(weights.size()), of_weight);
    lag = descend(lag, 0, Index(options.lags.size()), [&](Index p) { return error(p, weight); });
    // If each step has its own coefficients, the largest orders take the most time. They are left out after two
    // successive rises.
    for (Index p = 0, rises = 0; p < Index(options.lags.size()) && rises < 2; ++p) {
      if (error(p, weight) * clearly_better < error(lag, weight)) lag = p;
      const bool rose = p > lag && options.period == 0 && error(p, weight) > error(p - 1, weight);
      rises = rose ? rises + 1 : 0;
    }
    moved = weight != weight_before || lag != lag_before;
  }
  SmoothingChoice choice{std::move(candidates.trials), options.lags[size_t(lag)], weights[size_t(weight)], 0.0};
  for (const SmoothingTrial& t : choice.trials)
    if (t.lags == choice.lags && t.smoothing == choice.smoothing) choice.error = t.error;
  return choice;
}

}  // namespace tokid
