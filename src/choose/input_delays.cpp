// SPDX-License-Identifier: BSD-3-Clause
#include "choose/input_delays.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/statistics.hpp"
#include "choose/held_out_error.hpp"
#include "data/channel_sizes.hpp"
#include "linalg/symmetric.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

namespace {

// Lags of the regressions. Shorter dead times are left to the states.
constexpr Index few_lags = 4;
// The probability of a dead time where there is none.
constexpr double error_probability = 1e-3;
// The probability that an input takes a dead time of other inputs if it has none.
constexpr double shared_error_probability = 0.05;
// Most input lags of all inputs together, stretches of steps, folds, unknowns of a regression, and multiplications for
// the products.
constexpr Index most_columns = 320, most_stretches = 4, most_folds = 10, most_unknowns = 100;
constexpr double most_products = 2e9;
// Windows of a stretch for each unknown.
constexpr Index windows_of_unknown = 16;
// Squared errors relative to the outputs below this one are rounding errors of the products.
constexpr double rounding = 1e-12;

// First and last lag of an input in a regression.
struct Lags {
  Index first = 0, last = few_lags;
};

// Log of the errors of a regression on held-out experiments, of each fold.
using FoldErrors = Eigen::ArrayXd;

// Regressions of the outputs on few of their own lags and on some lags of each input, with one set of coefficients in
// each stretch of steps. The products of all lags serve all regressions.
class Products {
 public:
  Products(const Ensemble& e, Index most_delay, Index stretches, Index folds)
      : m_(e.outputs()), r_(e.inputs()), lags_(most_delay + few_lags), folds_(folds) {
    const Index begin = lags_, columns = columns_of_target() + m_;
    const Index fewer = experiments_within(e, columns);
    products_.assign(size_t(stretches * folds), Matrix::Zero(columns, columns));
    Matrix rows;
    for (Index i = 0; i < fewer; ++i)
      for (Index s = 0; s < stretches; ++s) {
        const Index from = begin + s * (e.steps() - begin) / stretches,
                    to = begin + (s + 1) * (e.steps() - begin) / stretches;
        fill(e, i * e.experiments() / fewer, from, to, rows);
        linalg::add_squares(rows, products_[size_t(s * folds + i % folds)]);
      }
    for (Matrix& product : products_) product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
  }

  Index folds() const { return folds_; }

  FoldErrors errors(const std::vector<Lags>& lags) const {
    std::vector<Index> columns;
    for (Index c = 0; c < few_lags * m_; ++c) columns.push_back(c);
    for (Index i = 0; i < r_; ++i)
      for (Index l = lags[size_t(i)].first; l <= lags[size_t(i)].last; ++l)
        columns.push_back(few_lags * m_ + l * r_ + i);
    std::vector<Index> targets;
    for (Index j = 0; j < m_; ++j) targets.push_back(columns_of_target() + j);
    Matrix errors = Matrix::Zero(folds_, m_), sizes = errors;
    for (size_t s = 0; s < products_.size(); s += size_t(folds_)) {
      Matrix all = products_[s];
      for (Index f = 1; f < folds_; ++f) all += products_[s + size_t(f)];
      const Matrix regressors = all(columns, columns), responses = all(columns, targets);
      for (Index f = 0; f < folds_; ++f) {
        const Matrix& held_out = products_[s + size_t(f)];
        const Matrix of_regressors = held_out(columns, columns), of_responses = held_out(columns, targets);
        Matrix training = regressors - of_regressors;
        training.diagonal().array() += rounding * training.trace() / double(columns.size());
        const Matrix theta = training.ldlt().solve(responses - of_responses);
        const Eigen::RowVectorXd size = held_out.diagonal()(targets).transpose();
        sizes.row(f) += size;
        errors.row(f) +=
            size + ((of_regressors * theta - 2 * of_responses).array() * theta.array()).colwise().sum().matrix();
      }
    }
    const Eigen::ArrayXXd relative = errors.array() / sizes.array();
    return 0.5 * (sizes.array() > 0).select(relative.max(rounding), 1.0).log().rowwise().mean();
  }

 private:
  Index columns_of_target() const { return few_lags * m_ + (lags_ + 1) * r_; }

  Index experiments_within(const Ensemble& e, Index columns) const {
    const double each = double((e.steps() - lags_) * columns) * double(columns);
    return std::clamp(Index(most_products / each), std::min(folds_, e.experiments()), e.experiments());
  }

  // The windows of experiment n that end at the steps from … to-1. A window with a missing sample becomes zero.
  void fill(const Ensemble& e, Index n, Index from, Index to, Matrix& rows) const {
    const Index d = r_ + m_;
    rows.resize(to - from, columns_of_target() + m_);
    const auto sample = e.samples().row(n);
    for (Index k = from; k < to; ++k) {
      auto row = rows.row(k - from);
      for (Index l = 1; l <= few_lags; ++l) row.segment((l - 1) * m_, m_) = sample.segment((k - l) * d + r_, m_);
      for (Index l = 0; l <= lags_; ++l) row.segment(few_lags * m_ + l * r_, r_) = sample.segment((k - l) * d, r_);
      row.tail(m_) = sample.segment(k * d + r_, m_);
      if (!row.allFinite()) row.setZero();
    }
  }

  Index m_, r_, lags_, folds_;
  std::vector<Matrix> products_;
};

// How many standard errors `a` is smaller than `b`. Both are errors of the same folds.
double advantage(const FoldErrors& a, const FoldErrors& b) {
  const double count = double(a.size());
  const FoldErrors gain = b - a;
  return gain.mean() / std::sqrt((gain - gain.mean()).square().sum() / (count * (count - 1)));
}

// Moves the lags of one input after the other to where the errors are the smallest. False: all stay.
bool move_lags(const Products& products, Index most_delay, const Execution& execution, std::vector<Lags>& lags) {
  FoldErrors least = products.errors(lags);
  const double tries = double(Index(lags.size()) * most_delay);
  const double sure = statistics::student_quantile(1 - error_probability / tries, double(least.size() - 1));
  bool any = false;
  for (bool moved = true; moved;) {
    moved = false;
    for (size_t i = 0; i < lags.size(); ++i) {
      std::vector<FoldErrors> found(size_t(most_delay + 1));
      parallel_for(0, most_delay + 1, {execution.threads, {}}, [&](Index begin, Index end) {
        for (Index delay = begin; delay < end; ++delay) {
          std::vector<Lags> tried = lags;
          tried[i] = {delay, delay + few_lags};
          found[size_t(delay)] = products.errors(tried);
        }
      });
      const auto smallest = std::min_element(found.begin(), found.end(),
                                             [](const auto& a, const auto& b) { return a.mean() < b.mean(); });
      if (!(advantage(*smallest, least) > sure)) continue;
      const Index delay = smallest - found.begin();
      lags[i] = {delay, delay + few_lags};
      least = *smallest;
      moved = lags.size() > 1;
      any = true;
    }
  }
  return any;
}

// Inputs often have the same dead time. An input without one takes that of another input with less evidence than an
// unknown one. False: none does.
bool share_lags(const Products& products, Index most_delay, std::vector<Lags>& lags) {
  std::set<Index> known;
  for (const Lags& other : lags)
    if (other.first > few_lags && other.first <= most_delay) known.insert(other.first);
  if (known.empty()) return false;
  FoldErrors least = products.errors(lags);
  const double sure =
      statistics::student_quantile(1 - shared_error_probability / double(known.size()), double(least.size() - 1));
  bool any = false;
  for (Lags& input : lags) {
    if (input.first > few_lags) continue;
    for (const Index first : known) {
      const Lags own = std::exchange(input, {first, first + few_lags});
      FoldErrors found = products.errors(lags);
      if (advantage(found, least) > sure)
        least = std::move(found), any = true;
      else
        input = own;
    }
  }
  return any;
}

// Lags that begin too early say as much as those that begin with the first response. Leaves out the first lag of an
// input as long as the errors fall.
void leave_needless_lags(const Products& products, std::vector<Lags>& lags) {
  double least = products.errors(lags).mean();
  for (bool moved = true; moved;) {
    moved = false;
    for (Lags& input : lags) {
      if (input.first == 0 || input.first == input.last) continue;
      ++input.first;
      const double found = products.errors(lags).mean();
      const bool needless = found < least;
      if (needless)
        least = found;
      else
        --input.first;
      moved = moved || needless;
    }
  }
}

// Once an input has its lags, those of another one show more.
std::vector<Lags> best_lags(const Products& products, Index inputs, Index most_delay, const Execution& execution) {
  std::vector<Lags> best(static_cast<size_t>(inputs));
  while (move_lags(products, most_delay, execution, best) || share_lags(products, most_delay, best))
    leave_needless_lags(products, best);
  // Do the lags in front say nothing? One standard error is chance, and a gain that is not worth it is unknowns that
  // make up for what no regression of a stretch can describe.
  const FoldErrors errors = products.errors(best);
  std::vector<Lags> result = best;
  for (size_t i = 0; i < best.size(); ++i) {
    if (best[i].first == 0) continue;
    std::vector<Lags> tried = best;
    tried[i].first = 0;
    const FoldErrors all = products.errors(tried);
    if (advantage(all, errors) > 1.0 && errors.mean() - all.mean() > std::log(worth_it)) result[i] = {};
  }
  return result;
}

}  // namespace

std::vector<Index> find_delays(const Ensemble& e, const Execution& execution) {
  const Index r = e.inputs(), unknowns = few_lags * e.outputs() + (few_lags + 1) * r,
              folds = std::min(most_folds, e.experiments());
  // The regression with all lags in front needs windows, too.
  const Index most_delay =
      std::min({e.steps() / 2, most_columns / r, e.experiments() * e.steps() / windows_of_unknown}) - few_lags - 1;
  const Index windows = most_delay > few_lags ? e.experiments() * (e.steps() - most_delay - few_lags) : 0;
  if (folds < 2 || unknowns > most_unknowns || windows < windows_of_unknown * unknowns) return {};
  const Index stretches = std::clamp<Index>(windows / (windows_of_unknown * unknowns), 1, most_stretches);
  const Products products(e, most_delay, stretches, folds);
  std::vector<Index> delays;
  for (const Lags& lags : best_lags(products, r, most_delay, execution)) {
    // The first lag with a response needs no dead time: the state responds one step after the input.
    const Index delay = lags.first - 1;
    delays.push_back(delay < few_lags ? 0 : delay);
  }
  const bool any = std::any_of(delays.begin(), delays.end(), [](Index delay) { return delay > 0; });
  return any ? delays : std::vector<Index>{};
}

}  // namespace tokid
