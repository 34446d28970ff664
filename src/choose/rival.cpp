// SPDX-License-Identifier: BSD-3-Clause
#include "choose/rival.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/statistics.hpp"

namespace tokid {

namespace {

constexpr double all_alike = std::numeric_limits<double>::infinity();  // λ of one model for all steps
// λ of models that vary, where one model for all steps was chosen.
constexpr double slow[] = {1e3, 316.0, 100.0};

// A regression that is to be the model must predict better by this factor than a model without states. A model of fewer
// states says more: the factor's logarithm is in proportion to the states that it saves.
constexpr double far_better = 1.25;
// A guard with nearly all experiments: one part of so many is held out, and so many parts in turn.
constexpr Index small_parts = 20, held_out_parts = 5;

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
    HeldOutError found = errors_.error_of(own);
    const bool smaller = !best_ || found.value < best_->error.value;
    if (smaller) best_.emplace(lags, smoothing, std::move(found));
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
      if (!race.leads(std::min(rivals.lags, orders.back()), slower)) break;
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

bool replaces_model(const RegressionErrors::Found& regression, const HeldOutError& model, Index states,
                    const Ensemble& selection, const SmoothingOptions& options) {
  const double all = double(regression.lags * selection.outputs()),
               limit = model.value - std::log(far_better) * std::max(0.0, 1.0 - double(states) / all);
  if (!(regression.error.value < limit) || !surely_smaller(regression.error, model)) return false;
  const RegressionErrors nearly_all(selection, options, held_out_parts, {1, 5, 20},
                                    std::min(small_parts, selection.experiments()));
  return nearly_all.found(regression.lags, regression.smoothing).error.value < limit;
}

}  // namespace tokid
