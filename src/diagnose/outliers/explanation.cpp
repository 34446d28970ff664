// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers/explanation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "base/words.hpp"
#include "data/survey.hpp"
#include "diagnose/standstill.hpp"

namespace tokid {

namespace {

// The residual ratio of an explained experiment is at most this.
constexpr double usual = 2.0;
// A factor closer to one explains nothing.
constexpr double least_factor = 1.5;

// Searches for a change of an experiment's samples that makes its residuals usual.
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
  std::string name(Index c) const { return channel_name(e_.names, e_.inputs(), c); }

  // One of many attempts may succeed by chance, but hardly at two separate sets of places.
  void try_one_of_many(const Eigen::RowVectorXd& x, std::string text) {
    if (sketch_.ratio_of(x, Sketch::Places::even) <= accepted_ && sketch_.ratio_of(x, Sketch::Places::odd) <= accepted_)
      try_with(x, std::move(text));
  }

  // Small samples have small residuals anyway, so the residuals relative to the outputs must be usual too. A factor
  // close to one explains nothing. Of the negative factors only -1 is tried, elsewhere.
  void try_factor(const Eigen::RowVectorXd& x, double factor, std::string text) {
    if (factor > 1e-9 && std::abs(std::log(factor)) > std::log(least_factor) && sketch_.share_of(x) <= usual)
      try_with(x, std::move(text));
  }

  void try_with(const Eigen::RowVectorXd& x, std::string text) {
    const double ratio = sketch_.ratio_of(x);
    // Simpler changes come first. A later change replaces them only if it is clearly better.
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
        const auto plain = [&](Index c) { return c < r ? e_.names.input(c) : e_.names.output(c - r); };
        try_with(x, fmt::format("with {} {} and {} swapped", a < r ? "inputs" : "outputs", plain(a), plain(b)));
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
      if (c < e_.inputs() && std::abs(factor) < 0.05) try_with(x_ - own, fmt::format("with {} at zero", name(c)));
      if (std::abs(factor + 1) < 0.2)
        try_with(x_ - 2 * own, fmt::format("with the sign of {} changed", name(c)));
      else
        try_factor(x_ + (factor - 1) * own, factor, fmt::format("with {} multiplied by {:.3g}", name(c), factor));
    }
    if (e_.outputs() < 2) return;
    Eigen::RowVectorXd outputs = Eigen::RowVectorXd::Zero(x_.size());
    for (Index j = 0; j < e_.outputs(); ++j) outputs += only(e_.inputs() + j);
    const double factor = 1 + sketch_.best_share(x_, outputs);
    try_factor(x_ + (factor - 1) * outputs, factor, fmt::format("with all outputs multiplied by {:.3g}", factor));
  }

  void offsets() {
    for (Index c = 0; c < d(); ++c) {
      Eigen::RowVectorXd one = Eigen::RowVectorXd::Zero(x_.size());
      for (Index k = 0; k < e_.steps(); ++k) one(k * d() + c) = 1.0;
      const double offset = sketch_.best_share(x_, one);
      if (std::isnan(offset)) continue;
      try_with(x_ + offset * one, fmt::format("with {:.3g} {} {}", std::abs(offset),
                                              offset < 0 ? "subtracted from" : "added to", name(c)));
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
        try_one_of_many(shifted(0, d(), by), fmt::format("with everything {}", when(by)));
        try_one_of_many(shifted(e_.inputs(), e_.outputs(), by), fmt::format("with the outputs {}", when(by)));
        if (e_.outputs() > 1)
          for (Index j = 0; j < e_.outputs(); ++j)
            try_one_of_many(shifted(e_.inputs() + j, 1, by),
                            fmt::format("with output {} {}", e_.names.output(j), when(by)));
        if (e_.inputs() > 1)
          for (Index i = 0; i < e_.inputs(); ++i)
            try_one_of_many(shifted(i, 1, by), fmt::format("with input {} {}", e_.names.input(i), when(by)));
      }
  }

  std::string standstill() const {
    for (Index c = d() - 1; c >= 0; --c)
      for (const Standstill& s : standstills(e_, c))
        if (s.experiment == n_)
          return fmt::format("its {} stays at {:.3g} at steps {}–{}", name(c), s.value, s.begin, s.end - 1);
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

std::string explanation(const Ensemble& e, const Sketch& sketch, Index n) { return Explanation(e, sketch, n).text(); }

}  // namespace tokid
