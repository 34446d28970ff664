// SPDX-License-Identifier: BSD-3-Clause
#include "choose/rival.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/statistics.hpp"
#include "data/rows.hpp"

namespace tokid {

namespace {

constexpr double all_alike = std::numeric_limits<double>::infinity();  // λ of one model for all steps
// λ of models that vary, where one model for all steps was chosen.
constexpr double slow[] = {1e3, 316.0, 100.0};

// EM seldom brings more than this factor.
constexpr double far_better = 2.0;
// With more experiments, the same errors may be larger by this factor.
constexpr double about_as_well = 1.25;
// Into so many parts a fold is divided at most, to hold out less.
constexpr Index most_small_parts = 4;

class Race {
 public:
  Race(const RegressionErrors& errors, const std::vector<Squares>& of_models)
      : errors_(errors), models_in_first_(errors.error_of({of_models.front()})), folds_(Index(of_models.size())) {}

  // Does this regression predict better than those before?
  bool leads(Index lags, double smoothing) {
    std::vector<Squares> own = errors_.squares(0, 1, lags, smoothing);
    if (hopeless(errors_.error_of(own))) {
      ++hopeless_;
      return false;
    }
    hopeless_ = 0;
    for (Squares& squares : errors_.squares(1, folds_, lags, smoothing)) own.push_back(std::move(squares));
    RegressionErrors::Found found = errors_.found(own, lags, smoothing);
    const bool smaller = !best_ || found.error.value < best_->error.value;
    if (smaller) best_ = std::move(found);
    return smaller;
  }
  // The orders from `least` to `most`, until two in succession are hopeless.
  void run(const std::vector<Index>& orders, Index least, Index most, double smoothing) {
    hopeless_ = 0;
    for (const Index p : orders)
      if (p >= least && p <= most && hopeless_ < 2) leads(p, smoothing);
  }

  const std::optional<RegressionErrors::Found>& winner() const { return best_; }

 private:
  // Does the first fold exclude that the regression predicts as well as the models?
  bool hopeless(const HeldOutError& in_first) const {
    constexpr double probability = 1e-3;  // of giving up a regression that predicts as well
    const double freedom = double(in_first.influence.size()) - 1.0;
    return freedom > 0 &&
           clearly_smaller(models_in_first_, in_first, statistics::student_quantile(1 - probability, freedom));
  }

  const RegressionErrors& errors_;
  HeldOutError models_in_first_;
  Index folds_;
  std::optional<RegressionErrors::Found> best_;
  int hopeless_ = 0;  // number of the last regressions that were
};

}  // namespace

std::optional<RegressionErrors::Found> best_rival(const Rivals& rivals, const RegressionErrors& errors,
                                                  const std::vector<Squares>& of_models) {
  if (rivals.stated) return std::nullopt;
  const std::vector<Index>& orders = rivals.options.lags;
  Race race(errors, of_models);
  if (std::isinf(rivals.smoothing)) {
    for (const double slower : slow)
      if (!race.leads(rivals.lags, slower)) break;
  } else {
    race.run(orders, rivals.lags, orders.back(), all_alike);
    race.run(orders, rivals.lags + 1, rivals.reached, rivals.smoothing);
    race.run(orders, rivals.reached + 1, orders.back(), rivals.smoothing);
  }
  return race.winner();
}

bool surely_smaller(const HeldOutError& regression, const HeldOutError& model) {
  constexpr double standard_errors = 2.0;
  return clearly_smaller(regression, model, standard_errors);
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
