// SPDX-License-Identifier: BSD-3-Clause
#include "choose/rival.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "data/rows.hpp"

namespace tokid {

namespace {

constexpr double all_alike = std::numeric_limits<double>::infinity();  // λ of one model for all steps
// The largest λ below that, and the ratio of two successive ones.
constexpr double slowest = 1e3;
const double half_a_decade = std::sqrt(10.0);

// EM seldom brings more than this factor.
constexpr double far_better = 2.0;
// With more experiments, the same errors may be larger by this factor.
constexpr double about_as_well = 1.25;
// Into so many parts a fold is divided at most, to hold out less.
constexpr Index most_small_parts = 4;

class Race {
 public:
  Race(const RegressionErrors& errors, const std::vector<Squares>& of_models, RegressionErrors::Found chosen)
      : errors_(errors),
        models_in_first_(errors.error_of({of_models.front()})),
        folds_(Index(of_models.size())),
        best_(std::move(chosen)) {}

  // The orders from `least` on, each with λ of the one before, or with a larger or smaller one that is better in the
  // first fold. Ends after two hopeless orders in succession.
  void run(const std::vector<Index>& orders, Index least, double smoothing) {
    int given_up = 0;
    for (auto p = std::lower_bound(orders.begin(), orders.end(), least); p != orders.end() && given_up < 2; ++p) {
      std::vector<Squares> first = errors_.squares(0, 1, *p, smoothing);
      const auto move = [&](double factor) {
        std::vector<Squares> next = errors_.squares(0, 1, *p, smoothing * factor);
        if (!(errors_.error_of(next).value < errors_.error_of(first).value)) return false;
        smoothing *= factor;
        first = std::move(next);
        return true;
      };
      bool moved = false;
      while (smoothing < slowest && move(half_a_decade)) moved = true;
      while (!moved && std::isfinite(smoothing) && move(1 / half_a_decade)) {
      }
      const HeldOutError in_first = errors_.error_of(first);
      const bool excluded =
          clearly_smaller(models_in_first_, in_first, errors_to_give_up(Index(in_first.influence.size())));
      given_up = excluded ? given_up + 1 : 0;
      if (given_up == 0) enter(std::move(first), *p, smoothing);
    }
  }

  const RegressionErrors::Found& winner() const { return best_; }

 private:
  // `squares`: of the first fold
  void enter(std::vector<Squares> squares, Index lags, double smoothing) {
    for (Squares& fold : errors_.squares(1, folds_, lags, smoothing)) squares.push_back(std::move(fold));
    RegressionErrors::Found found = errors_.found(squares, lags, smoothing);
    if (found.error.value < best_.error.value) best_ = std::move(found);
  }

  const RegressionErrors& errors_;
  HeldOutError models_in_first_;
  Index folds_;
  RegressionErrors::Found best_;
};

}  // namespace

RegressionErrors::Found best_regression(const Rivals& rivals, const RegressionErrors& errors,
                                        RegressionErrors::Found chosen, const std::vector<Squares>& of_models) {
  if (rivals.stated) return chosen;
  const std::vector<Index>& orders = rivals.options.lags;
  Race race(errors, of_models, std::move(chosen));
  race.run(orders, rivals.lags, std::isinf(rivals.smoothing) ? slowest : all_alike);
  if (std::isfinite(rivals.smoothing)) race.run(orders, rivals.lags, rivals.smoothing);
  return race.winner();
}

bool surely_smaller(const HeldOutError& regression, const HeldOutError& model) {
  constexpr double standard_errors = 1.0;
  return regression.value < model.value - std::log(most_uncertain) &&
         clearly_smaller(regression, model, standard_errors);
}

bool far_smaller(const HeldOutError& regression, const HeldOutError& model) {
  return regression.value < model.value - std::log(far_better) && surely_smaller(regression, model);
}

bool holds_with_nearly_all(const RegressionErrors::Found& regression, const RegressionErrors& errors,
                           const Ensemble& selection, const SmoothingOptions& options) {
  const Index folds = fold_count(selection.experiments()),
              parts = std::min(most_small_parts, selection.experiments() / folds);
  std::vector<Index> rows;  // of the experiments that are held out again
  for (Index f = 0, first = 0; f < errors.folds(); ++f) {
    const Index count = Index(fold_rows(selection.experiments(), f, folds).size());
    for (Index i = 0; i < count; i += parts) rows.push_back(first + i);
    first += count;
  }
  Squares same;
  same.errors = regression.squares.errors(rows, Eigen::all);
  same.outputs = regression.squares.outputs(rows, Eigen::all);
  const RegressionErrors nearly_all(selection, options, errors.folds(), errors.ahead().horizons, folds * parts);
  return nearly_all.found(regression.lags, regression.smoothing, regression.jumps).error.value <
         errors.error_of({same}).value + std::log(about_as_well);
}

}  // namespace tokid
