// SPDX-License-Identifier: BSD-3-Clause
#include "outliers.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>

#include "statistics.hpp"
#include "tokid/parallel.hpp"
#include "words.hpp"

namespace tokid {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr Index fewest_experiments = 5;
// Places of the record that are looked at, and how many residuals of an experiment there have to be.
constexpr Index most_places = 16, costly_places = 8, fewest_places = 4, fewest_residuals = 6;
// Regressors, and rows for each of them: more of both say little more of single experiments, and take longer.
constexpr Index most_regressors = 40;
constexpr double rows_each = 3.0, most_rows_each = 8.0;
// Steps of a place, where the experiments of one are too few.
constexpr Index most_together = 16;
// A residual of so many times the usual size counts as no larger: one wild sample is no wild experiment.
constexpr double largest = 50.0;
// Rows of so many times the usual size are scaled down to it: one of them alone would determine what it is judged by.
constexpr double too_large = 10.0;
// The threshold: less than thrice the usual is of no consequence. Beyond it, what one ensemble in a thousand exceeds by
// Student's t, of log sizes that scatter as their median deviation says; that of Gaussian samples is worth so much of a
// standard deviation, and few experiments are helped out by what so many residuals scatter by themselves.
constexpr double of_consequence = 3.0, false_alarms = 1e-3, efficiency = 0.37, own_scatter = 0.2, own_freedom = 4.0;
// Of experiments that are larger than others up to so much, larger residuals are expected: those of a model that is too
// simple.
constexpr double larger = 10.0;
// What is explained is as usual: no more than this.
constexpr double usual = 2.0;
constexpr size_t most_told = 5;

// q lags at `together` steps of a place.
struct Kind {
  Index lags = 1, together = 1;
};

// The rows [W Y] of one place, those of an experiment one below the other.
struct Place {
  Index begin = 0;               // first step
  Matrix w, y;                   // scaled by weights
  std::vector<Index> owner;      // of each row
  Vector weight;                 // of each row
  Vector scale;                  // of the columns of w: medians of their sizes
  Matrix coefficients, inverse;  // of the model of the others: x, R⁻¹
  Matrix residual, deviation;    // leave-one-out ones, unweighted, and what they scatter by in units of the noise
  Vector median, raw_median;     // (m) of their sizes over the others
};

class Sketch {
 public:
  Sketch(const Ensemble& e, const OutlierOptions& o, const Kind& kind) : e_(e), o_(o), kind_(kind) {
    for (const Index begin : places()) {
      Place p;
      p.begin = begin;
      if (fill(p)) places_.push_back(std::move(p));
    }
  }

  bool usable() const { return Index(places_.size()) >= fewest_places; }

  // The models of all but `out`, and the residuals of everyone.
  void judge(const std::vector<char>& out) {
    parallel_for(0, Index(places_.size()), {o_.threads, {}}, [&](Index from, Index to) {
      for (Index i = from; i < to; ++i) regress(places_[size_t(i)], out);
    });
    const size_t n = size_t(e_.experiments());
    score_.assign(n, nan);
    raw_.assign(n, nan);
    count_.assign(n, 0);
    std::vector<double> sum(n, 0.0), raw(n, 0.0);
    share_.setZero(e_.experiments(), e_.outputs());
    for (const Place& p : places_)
      for (size_t i = 0; i < p.owner.size(); ++i)
        for (Index j = 0; j < e_.outputs(); ++j) {
          if (!(p.median(j) > 0)) continue;
          const size_t owner = size_t(p.owner[i]);
          const double t = std::abs(p.residual(Index(i), j)) / p.deviation(Index(i), j) / p.median(j);
          sum[owner] += std::min(largest, t);
          raw[owner] += std::abs(p.residual(Index(i), j)) / p.raw_median(j);
          share_(p.owner[i], j) += std::min(largest, t);
          ++count_[owner];
        }
    std::vector<double> all, all_raw;
    for (size_t i = 0; i < n; ++i) {
      if (count_[i] < fewest_residuals) continue;
      score_[i] = sum[i] / double(count_[i]);
      raw_[i] = raw[i] / double(count_[i]);
      if (!out[i]) all.push_back(score_[i]), all_raw.push_back(raw_[i]);
    }
    typical_ = statistics::median(all);
    typical_raw_ = statistics::median(all_raw);
    std::vector<double> deviation, counts;
    for (size_t i = 0; i < n; ++i)
      if (!out[i] && !std::isnan(score_[i])) {
        deviation.push_back(std::abs(std::log(score_[i] / typical_)));
        counts.push_back(double(count_[i]));
      }
    const double freedom = efficiency * double(Index(deviation.size()) - 1),
                 scatter = 1.4826 * statistics::median(deviation);
    variance_ = (own_freedom * own_scatter * own_scatter + freedom * scatter * scatter) / (own_freedom + freedom);
    quantile_ = statistics::student_quantile(1 - false_alarms / double(n), own_freedom + freedom);
    usual_count_ = statistics::median(counts);
  }

  // Geometric mean over the places of the usual residual over the size of the outputs.
  double error() const {
    double sum = 0.0;
    Index count = 0;
    for (const Place& p : places_)
      for (Index j = 0; j < e_.outputs(); ++j) {
        const Vector unweighted = p.y.col(j).cwiseQuotient(p.weight);
        const double size = std::sqrt(unweighted.squaredNorm() / double(unweighted.size()));
        if (size > 0 && p.raw_median(j) > 0) sum += std::log(p.raw_median(j) / size), ++count;
      }
    return count > 0 ? std::exp(sum / double(count)) : 0.0;
  }

  bool judged(Index n) const { return !std::isnan(score_[size_t(n)]); }
  double ratio(Index n) const { return score_[size_t(n)] / typical_; }
  double raw_ratio(Index n) const { return raw_[size_t(n)] / typical_raw_; }
  double threshold(Index n) const {
    // Fewer residuals scatter more: their mean size by 0.76 of itself over the root of their number.
    const double own = std::max(0.0, 1.0 / double(count_[size_t(n)]) - 1.0 / usual_count_);
    return std::max(of_consequence, std::exp(quantile_ * std::sqrt(variance_ + 0.57 * own)));
  }
  // The output that has nearly all of it, if there is one.
  std::optional<Index> output(Index n) const {
    Index j = 0;
    const double most = share_.row(n).maxCoeff(&j);
    return e_.outputs() > 1 && most > 0.8 * share_.row(n).sum() ? std::optional(j) : std::nullopt;
  }

  // The size of the residuals that the samples x (T·d) of experiment n would have, over the usual ones; NaN for none.
  double ratio_of(const Eigen::RowVectorXd& x) const {
    double sum = 0.0;
    Index count = 0;
    for_each_row(x, [&](const Place& p, const Vector& w, const Eigen::RowVectorXd& y) {
      const Vector g = p.inverse.transpose() * w;
      const double deviation = std::max(std::sqrt(1 + g.squaredNorm()), allowance(w.transpose()));
      const Eigen::RowVectorXd e = y - w.transpose() * p.coefficients;
      for (Index j = 0; j < e.size(); ++j)
        if (p.median(j) > 0) sum += std::min(largest, std::abs(e(j)) / deviation / p.median(j)), ++count;
    });
    return count >= fewest_residuals ? sum / double(count) / typical_ : nan;
  }

  // a that makes the residuals of x + a·z smallest, as their squares over the usual ones have it; NaN for none.
  double best_share(const Eigen::RowVectorXd& x, const Eigen::RowVectorXd& z) const {
    std::vector<double> fixed, moved;
    const auto residuals = [&](const Eigen::RowVectorXd& samples, std::vector<double>& to, bool constant) {
      for_each_row(samples, [&](const Place& p, Vector& w, const Eigen::RowVectorXd& y) {
        if (!constant && o_.nominal) w(w.size() - 1) = 0.0;
        const Eigen::RowVectorXd e = y - w.transpose() * p.coefficients;
        for (Index j = 0; j < e.size(); ++j) to.push_back(p.median(j) > 0 ? e(j) / p.median(j) : 0.0);
      });
    };
    residuals(x, fixed, true);
    residuals(z, moved, false);
    double product = 0.0, square = 0.0;
    if (fixed.size() != moved.size()) return nan;
    for (size_t i = 0; i < fixed.size(); ++i) product += fixed[i] * moved[i], square += moved[i] * moved[i];
    return square > 0 ? -product / square : nan;
  }

 private:
  // What the residuals of a row of w are larger by.
  double allowance(const ConstMatrixRef& row) const {
    const Index samples = kind_.lags * e_.channels() + e_.inputs();
    return std::clamp(row.leftCols(samples).norm() / (1.4826 * std::sqrt(double(samples))), 1.0, larger);
  }
  Index regressors() const { return kind_.lags * e_.channels() + e_.inputs() + (o_.nominal ? 1 : 0); }

  // Where the experiments are, rather than where the steps are: some may be short.
  std::vector<Index> places() const {
    const Index begin = kind_.lags, end = e_.steps() - kind_.together + 1;
    std::vector<double> alive;
    double all = 0.0;
    for (Index k = begin; k < end; ++k) {
      Index count = e_.experiments();
      if (!e_.length.empty()) count = std::count_if(e_.length.begin(), e_.length.end(), [&](Index l) { return l > k; });
      alive.push_back(all += double(count));
    }
    const double cost = double(e_.experiments()) * double(kind_.together) * double(regressors() * regressors());
    const Index most = std::clamp(Index(1e7 / cost), costly_places, most_places);
    std::vector<Index> result;
    for (Index i = 0; i < most && all > 0; ++i) {
      const double at = (double(i) + 0.5) / double(most) * all;
      const Index k = begin + Index(std::lower_bound(alive.begin(), alive.end(), at) - alive.begin());
      if (k < end && (result.empty() || k >= result.back() + kind_.together)) result.push_back(k);
    }
    return result;
  }

  bool fill(Place& p) const {
    const Index d = e_.channels(), q = kind_.lags, l = regressors(), m = e_.outputs();
    std::vector<std::pair<Index, Index>> rows;
    for (Index k = p.begin; k < p.begin + kind_.together; ++k)
      for (const Index n : e_.complete_rows(k, q)) rows.emplace_back(n, k);
    if (double(rows.size()) < 0.8 * rows_each * double(l)) return false;
    std::sort(rows.begin(), rows.end());
    Index owners = 0, last = -1;
    for (const auto& [n, k] : rows)
      if (n != last) last = n, ++owners;
    if (owners < fewest_experiments) return false;
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

  void regress(Place& p, const std::vector<char>& out) const {
    const Index l = p.w.cols(), m = p.y.cols(), rows = p.w.rows();
    std::vector<Index> used;
    for (Index i = 0; i < rows; ++i)
      if (!out[size_t(p.owner[size_t(i)])]) used.push_back(i);
    // Enough of them, whole experiments, make the model; the others are judged by it all the same.
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
    // The last rows lift directions that nothing shows.
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
        const Matrix back = left.partialPivLu().inverse();
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
    p.raw_median.resize(m);
    for (Index j = 0; j < m; ++j) {
      std::vector<double> own, raw, size;
      for (const Index i : used) {
        raw.push_back(std::abs(p.residual(i, j)));
        own.push_back(raw.back() / p.deviation(i, j));
        size.push_back(std::abs(p.y(i, j) / p.weight(i)));
      }
      // Errors of arithmetic are none.
      const double floor = 1e-6 * statistics::median(size);
      p.median(j) = std::max(floor, statistics::median(std::move(own)));
      p.raw_median(j) = std::max(floor, statistics::median(std::move(raw)));
    }
  }

  template <class Use>
  void for_each_row(const Eigen::RowVectorXd& x, Use&& use) const {
    const Index d = e_.channels(), q = kind_.lags, m = e_.outputs();
    Vector w(regressors());
    for (const Place& p : places_)
      for (Index k = p.begin; k < p.begin + kind_.together; ++k) {
        const auto window = x.segment((k - q) * d, (q + 1) * d);
        if (window.array().isNaN().any()) continue;
        w.setOnes();
        w.head((q + 1) * d - m) = window.head((q + 1) * d - m).transpose();
        w = w.cwiseQuotient(p.scale);
        use(p, w, Eigen::RowVectorXd(window.tail(m)));
      }
  }

  const Ensemble& e_;
  const OutlierOptions& o_;
  Kind kind_;
  std::vector<Place> places_;
  std::vector<double> score_, raw_;
  std::vector<Index> count_;
  Matrix share_;
  double typical_ = 1.0, typical_raw_ = 1.0, variance_ = 0.0, quantile_ = 0.0, usual_count_ = 1.0;
};

// The most lags for one step at a time, and for more of them where the experiments are too few for that.
std::vector<Kind> kinds(const Ensemble& e, const OutlierOptions& o) {
  const Index d = e.channels(), fixed = e.inputs() + (o.nominal ? 1 : 0);
  std::vector<Kind> result;
  Index before = 0;
  for (Index together = 1; together <= most_together; together *= 2) {
    Index most = std::min(o.lags, std::max<Index>(1, (most_regressors - fixed) / d));
    for (; most > 0; --most) {
      if (e.steps() < most + fewest_places * together) continue;
      std::vector<double> rows;
      for (Index i = 0; i < 5; ++i)
        rows.push_back(double(e.complete_rows(most + i * (e.steps() - 1 - most) / 4, most).size()));
      if (statistics::median(rows) * double(together) >= rows_each * double(most * d + fixed)) break;
    }
    if (most > before) result.push_back({most, together});
    before = std::max(before, most);
    if (most >= o.lags) break;
  }
  return result;
}

std::vector<char> members(Index experiments, const std::vector<Index>& list) {
  std::vector<char> result(size_t(experiments), 0);
  for (const Index n : list) result[size_t(n)] = 1;
  return result;
}

std::string channel_name(const Ensemble& e, Index c) {
  return c < e.inputs() ? "input " + e.names.input(c) : "output " + e.names.output(c - e.inputs());
}

// What, done to the samples of an experiment, would make it as usual.
class Explanation {
 public:
  Explanation(const Ensemble& e, const Sketch& sketch, Index n)
      : e_(e), sketch_(sketch), n_(n), x_(e.samples().row(n)) {}

  std::string text() {
    const double before = sketch_.ratio_of(x_);
    if (std::isnan(before)) return "";
    accepted_ = std::min(usual, before / 2);
    exchanges();
    scales();
    if (best_text_.empty()) offsets();
    if (best_text_.empty()) shifts();
    if (best_text_.empty())
      if (std::string stuck = standstill(); !stuck.empty()) return stuck;
    if (!best_text_.empty()) return best_text_ + " they would be as usual";
    if (const auto j = sketch_.output(n_)) return fmt::format("nearly all of it in output {}", e_.names.output(*j));
    return "";
  }

 private:
  Index d() const { return e_.channels(); }

  void try_with(const Eigen::RowVectorXd& x, std::string text) {
    const double ratio = sketch_.ratio_of(x);
    // Simpler ones come first, and stay unless others are clearly better.
    if (ratio <= accepted_ && (best_text_.empty() || ratio < 0.8 * best_)) {
      best_ = ratio;
      best_text_ = std::move(text);
    }
  }

  void exchanges() {
    const Index r = e_.inputs();
    for (Index a = 0; a < d(); ++a)
      for (Index b = a + 1; b < (a < r ? r : d()); ++b) {
        Eigen::RowVectorXd x = x_;
        for (Index k = 0; k < e_.steps(); ++k) std::swap(x(k * d() + a), x(k * d() + b));
        const auto name = [&](Index c) { return c < r ? e_.names.input(c) : e_.names.output(c - r); };
        try_with(x, fmt::format("with {} {} and {} swapped", a < r ? "inputs" : "outputs", name(a), name(b)));
      }
  }

  Eigen::RowVectorXd only(Index c) const {
    Eigen::RowVectorXd x = Eigen::RowVectorXd::Zero(x_.size());
    for (Index k = 0; k < e_.steps(); ++k) x(k * d() + c) = x_(k * d() + c);
    return x;
  }

  void scales() {
    for (Index c = 0; c < d(); ++c) {
      const Eigen::RowVectorXd own = only(c);
      const double factor = 1 + sketch_.best_share(x_, own);
      if (std::isnan(factor)) continue;
      const std::string name = channel_name(e_, c);
      Eigen::RowVectorXd x = x_ + (factor - 1) * own;
      if (c < e_.inputs() && std::abs(factor) < 0.05) try_with(x_ - own, fmt::format("with {} at zero", name));
      if (std::abs(factor + 1) < 0.2)
        try_with(x_ - 2 * own, fmt::format("with the sign of {} changed", name));
      else if (std::abs(factor) > 1e-9)
        try_with(x, fmt::format("with {} multiplied by {:.3g}", name, factor));
    }
    if (e_.outputs() < 2) return;
    Eigen::RowVectorXd outputs = Eigen::RowVectorXd::Zero(x_.size());
    for (Index j = 0; j < e_.outputs(); ++j) outputs += only(e_.inputs() + j);
    const double factor = 1 + sketch_.best_share(x_, outputs);
    if (std::abs(factor) > 1e-9)
      try_with(x_ + (factor - 1) * outputs, fmt::format("with all outputs multiplied by {:.3g}", factor));
  }

  void offsets() {
    for (Index c = 0; c < d(); ++c) {
      Eigen::RowVectorXd one = Eigen::RowVectorXd::Zero(x_.size());
      for (Index k = 0; k < e_.steps(); ++k) one(k * d() + c) = 1.0;
      const double offset = sketch_.best_share(x_, one);
      if (std::isnan(offset)) continue;
      try_with(x_ + offset * one, fmt::format("with {:.3g} {} {}", std::abs(offset),
                                              offset < 0 ? "subtracted from" : "added to", channel_name(e_, c)));
    }
  }

  void shifts() {
    constexpr Index furthest = 8;
    const auto shifted = [&](Index from, Index count, Index by) {
      Eigen::RowVectorXd x = x_;
      for (Index k = 0; k < e_.steps(); ++k)
        for (Index c = from; c < from + count; ++c)
          x(k * d() + c) = k + by >= 0 && k + by < e_.steps() ? x_((k + by) * d() + c) : nan;
      return x;
    };
    const auto when = [](Index by) {
      return fmt::format("{} {}", words::plural(std::abs(by), "step"), by > 0 ? "earlier" : "later");
    };
    for (Index size = 1; size <= furthest; ++size)
      for (const Index by : {size, -size}) {
        try_with(shifted(0, d(), by), fmt::format("with everything {}", when(by)));
        try_with(shifted(e_.inputs(), e_.outputs(), by), fmt::format("with the outputs {}", when(by)));
        if (e_.outputs() > 1)
          for (Index j = 0; j < e_.outputs(); ++j)
            try_with(shifted(e_.inputs() + j, 1, by), fmt::format("with output {} {}", e_.names.output(j), when(by)));
        if (e_.inputs() > 1)
          for (Index i = 0; i < e_.inputs(); ++i)
            try_with(shifted(i, 1, by), fmt::format("with input {} {}", e_.names.input(i), when(by)));
      }
  }

  // Longest run of one value.
  std::pair<Index, Index> run(Index n, Index c) const {
    std::pair<Index, Index> best{0, 0};
    for (Index k = 0; k < e_.steps();) {
      Index end = k + 1;
      while (end < e_.steps() && e_.samples()(n, end * d() + c) == e_.samples()(n, k * d() + c)) ++end;
      if (end - k > best.second - best.first) best = {k, end};
      k = end;
    }
    return best;
  }

  std::string standstill() const {
    for (Index c = d() - 1; c >= 0; --c) {
      const auto [begin, end] = run(n_, c);
      if (end - begin < std::max<Index>(5, e_.steps() / 20)) continue;
      Index others = 0;
      for (Index n = 0; n < e_.experiments(); ++n)
        if (n != n_) others = std::max(others, run(n, c).second - run(n, c).first);
      if (end - begin < 2 * others) continue;
      return fmt::format("its {} stays at {:.3g} at steps {}–{}", channel_name(e_, c),
                         e_.samples()(n_, begin * d() + c), begin, end - 1);
    }
    return "";
  }

  const Ensemble& e_;
  const Sketch& sketch_;
  Index n_;
  Eigen::RowVectorXd x_;
  double accepted_ = usual, best_ = 0.0;
  std::string best_text_;
};

}  // namespace

namespace {

std::vector<Outlier> outliers_of(const Ensemble& e, Sketch& sketch) {
  const Index count = e.experiments();
  // Judged by the model of those that are nearest to each other: wild ones may hide each other, or themselves.
  std::vector<Index> order;
  const auto sort = [&] {
    order.clear();
    for (Index n = 0; n < count; ++n)
      if (sketch.judged(n)) order.push_back(n);
    std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return sketch.ratio(a) > sketch.ratio(b); });
  };
  sort();
  std::vector<Index> out(order.begin(), order.begin() + std::min<Index>(Index(order.size()), (count + 9) / 10)), found;
  for (int round = 0; round < 4; ++round) {
    sketch.judge(members(count, out));
    sort();
    found.clear();
    for (const Index n : order)
      if (sketch.ratio(n) > sketch.threshold(n)) found.push_back(n);
    std::vector<Index> next = found;
    if (Index(next.size()) > count / 4) next.resize(size_t(count / 4));
    if (found.empty() || next == out) break;
    out = std::move(next);
  }
  std::vector<Outlier> result;
  for (size_t i = 0; i < found.size(); ++i)
    result.push_back({found[i], std::max(sketch.ratio(found[i]), sketch.raw_ratio(found[i])),
                      i < most_told ? Explanation(e, sketch, found[i]).text() : ""});
  return result;
}

}  // namespace

std::vector<Outlier> outliers(const Ensemble& e, const OutlierOptions& o) {
  if (e.experiments() < fewest_experiments) return {};
  const auto judged = [&](const Kind& kind) {
    auto sketch = std::make_unique<Sketch>(e, o, kind);
    if (sketch->usable()) sketch->judge(members(e.experiments(), {}));
    return sketch->usable() ? std::move(sketch) : nullptr;
  };
  std::unique_ptr<Sketch> best, first;
  Index lags = 0;
  for (const Kind& kind : kinds(e, o)) {
    auto own = judged(kind);
    if (!own) continue;
    if (!first) first = judged({1, kind.together});
    if (!best || own->error() < best->error()) best = std::move(own), lags = kind.lags;
  }
  std::vector<Outlier> result;
  if (best) result = outliers_of(e, *best);
  // Many lags leave directions of the windows to the noise, which a wild experiment need not keep away from: what it
  // does there nobody knows. One lag leaves none.
  if (first && lags > 1)
    for (Outlier& other : outliers_of(e, *first)) {
      const auto same = std::find_if(result.begin(), result.end(),
                                     [&](const Outlier& x) { return x.experiment == other.experiment; });
      if (same == result.end())
        result.push_back(std::move(other));
      else if (same->explanation.empty() || same->ratio < other.ratio)
        *same = std::move(other);
    }
  std::stable_sort(result.begin(), result.end(), [](const Outlier& a, const Outlier& b) { return a.ratio > b.ratio; });
  return result;
}

namespace {

// Two digits are enough.
std::string times(double ratio) {
  if (ratio >= 1e4) return "more than 10000";
  const double unit = ratio >= 1000 ? 100 : ratio >= 100 ? 10 : ratio >= 10 ? 1 : 0.1;
  return fmt::format("{:.{}f}", std::round(ratio / unit) * unit, unit < 1 ? 1 : 0);
}

}  // namespace

std::vector<std::string> warnings_of(const std::vector<Outlier>& outliers) {
  std::vector<std::string> result;
  for (size_t i = 0; i < std::min(most_told, outliers.size()); ++i) {
    const Outlier& o = outliers[i];
    result.push_back(
        fmt::format("experiment {} does not fit the others: its leave-one-out residuals are {} times as "
                    "large as theirs{}{}",
                    o.experiment, times(o.ratio), o.explanation.empty() ? "" : "; ", o.explanation));
  }
  if (outliers.size() > most_told)
    result.push_back(fmt::format("{} more do not fit the others: are these runs of one system, in the same units?",
                                 words::plural(Index(outliers.size() - most_told), "experiment")));
  return result;
}

}  // namespace tokid
