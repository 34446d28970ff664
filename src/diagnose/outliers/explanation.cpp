// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers/explanation.hpp"

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "data/subjects.hpp"
#include "diagnose/standstill.hpp"

namespace tokid {

namespace {

using Kind = Explanation::Kind;

// A change explains an outlier only if the residual ratio is then at most this.
constexpr double usual = 2.0;
// A factor closer to one is not accepted as an explanation.
constexpr double least_factor = 1.5;

// Searches for a change of an experiment's samples after which the experiment fits the others.
class Search {
 public:
  Search(const Ensemble& e, const Sketch& sketch, Index n) : e_(e), sketch_(sketch), n_(n), x_(e.samples().row(n)) {}

  std::optional<Explanation> result() {
    const double before = sketch_.ratio_of(x_);
    if (std::isnan(before)) return std::nullopt;
    accepted_ = std::min(usual, before / 2);
    exchanges();
    scales();
    if (!best_) offsets();
    if (!best_) shifts();
    if (!best_) best_ = stuck();
    if (!best_)
      if (const auto j = sketch_.output(n_))
        best_ = {.kind = Kind::one_output, .channels = {output_channel(e_.names, *j)}};
    return best_;
  }

 private:
  Index d() const { return e_.channels(); }
  Finding::Channel channel(Index c) const { return tokid::channel(e_.names, e_.inputs(), c); }

  // One of many changes may fit by chance. It must therefore fit at the even places and at the odd places.
  void try_one_of_many(const Eigen::RowVectorXd& x, Explanation change) {
    if (sketch_.ratio_of(x, Sketch::Places::even) <= accepted_ && sketch_.ratio_of(x, Sketch::Places::odd) <= accepted_)
      try_with(x, std::move(change));
  }

  // A factor that makes the samples small also makes the residuals small. The residuals divided by the outputs must
  // therefore also be as small as those of other experiments. Negative factors are not tried here; scales() tries the
  // factor -1.
  void try_factor(const Eigen::RowVectorXd& x, double factor, Explanation change) {
    if (!(factor > 1e-9 && std::abs(std::log(factor)) > std::log(least_factor) && sketch_.share_of(x) <= usual)) return;
    change.numbers = {{"factor", factor}};
    try_with(x, std::move(change));
  }

  void try_with(const Eigen::RowVectorXd& x, Explanation change) {
    const double ratio = sketch_.ratio_of(x);
    // Simpler changes are tried first. A later change replaces a simpler one only if its ratio is clearly smaller.
    if (ratio <= accepted_ && (!best_ || ratio < 0.8 * best_ratio_)) {
      best_ratio_ = ratio;
      best_ = std::move(change);
    }
  }

  void exchanges() {
    const Index r = e_.inputs();
    for (Index a = 0; a < d(); ++a)
      for (Index b = a + 1; b < (a < r ? r : d()); ++b) {
        Eigen::RowVectorXd x = x_;
        for (Index k = 0; k < e_.steps(); ++k) std::swap(x(k * d() + a), x(k * d() + b));
        try_with(x, {.kind = Kind::swapped, .channels = {channel(a), channel(b)}});
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
      if (c < e_.inputs() && std::abs(factor) < 0.05)
        try_with(x_ - own, {.kind = Kind::at_zero, .channels = {channel(c)}});
      if (std::abs(factor + 1) < 0.2)
        try_with(x_ - 2 * own, {.kind = Kind::sign_changed, .channels = {channel(c)}});
      else
        try_factor(x_ + (factor - 1) * own, factor, {.kind = Kind::scaled, .channels = {channel(c)}});
    }
    if (e_.outputs() < 2) return;
    Eigen::RowVectorXd outputs = Eigen::RowVectorXd::Zero(x_.size());
    for (Index j = 0; j < e_.outputs(); ++j) outputs += only(e_.inputs() + j);
    const double factor = 1 + sketch_.best_share(x_, outputs);
    try_factor(x_ + (factor - 1) * outputs, factor, {.kind = Kind::outputs_scaled});
  }

  void offsets() {
    for (Index c = 0; c < d(); ++c) {
      Eigen::RowVectorXd one = Eigen::RowVectorXd::Zero(x_.size());
      for (Index k = 0; k < e_.steps(); ++k) one(k * d() + c) = 1.0;
      const double offset = sketch_.best_share(x_, one);
      if (std::isnan(offset)) continue;
      try_with(x_ + offset * one, {.kind = Kind::offset, .channels = {channel(c)}, .numbers = {{"offset", offset}}});
    }
  }

  void shifts() {
    constexpr Index furthest = 8;
    const auto try_shift = [&](Kind kind, Index from, Index count, Index by) {
      Eigen::RowVectorXd x = x_;
      for (Index k = 0; k < e_.steps(); ++k)
        for (Index c = from; c < from + count; ++c)
          x(k * d() + c) = k + by >= 0 && k + by < e_.steps() ? x_((k + by) * d() + c) : nan;
      Explanation change{.kind = kind, .numbers = {{"earlier", double(by)}}};
      if (kind == Kind::shifted) change.channels = {channel(from)};
      try_one_of_many(x, std::move(change));
    };
    const Index r = e_.inputs();
    for (Index size = 1; size <= furthest; ++size)
      for (const Index by : {size, -size}) {
        try_shift(Kind::all_shifted, 0, d(), by);
        try_shift(Kind::outputs_shifted, r, e_.outputs(), by);
        for (Index c = r; e_.outputs() > 1 && c < d(); ++c) try_shift(Kind::shifted, c, 1, by);
        for (Index c = 0; r > 1 && c < r; ++c) try_shift(Kind::shifted, c, 1, by);
      }
  }

  std::optional<Explanation> stuck() const {
    for (Index c = d() - 1; c >= 0; --c)
      for (const Standstill& s : standstills(e_, c))
        if (s.experiment == n_)
          return Explanation{.kind = Kind::stuck,
                             .channels = {channel(c)},
                             .steps = {s.begin, s.end - 1},
                             .numbers = {{"value", s.value}}};
    return std::nullopt;
  }

  const Ensemble& e_;
  const Sketch& sketch_;
  Index n_;
  Eigen::RowVectorXd x_;
  double accepted_ = usual, best_ratio_ = 0.0;
  std::optional<Explanation> best_;
};

}  // namespace

std::optional<Explanation> explanation(const Ensemble& e, const Sketch& sketch, Index n) {
  return Search(e, sketch, n).result();
}

}  // namespace tokid
