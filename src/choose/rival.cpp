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

class Race {
 public:
  Race(const RegressionErrors& errors, const std::vector<Squares>& of_models)
      : errors_(errors),
        models_(errors.error_of(of_models)),
        models_in_first_(errors.error_of({of_models.front()})),
        folds_(Index(of_models.size())) {}

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
    const bool smaller = !best_ || found.value < best_->second.value;
    if (smaller) best_.emplace(Rival{lags, smoothing}, std::move(found));
    return smaller;
  }
  // The orders from `least` on, until two in succession are hopeless.
  void run(const std::vector<Index>& orders, Index least, double smoothing) {
    hopeless_ = 0;
    for (const Index p : orders)
      if (p >= least && hopeless_ < 2) leads(p, smoothing);
  }

  std::optional<Rival> winner() const {
    // A regression and EM often predict alike, and a second search takes much time.
    constexpr double standard_errors = 2.0;
    if (!best_ || !clearly_smaller(best_->second, models_, standard_errors)) return std::nullopt;
    return best_->first;
  }

 private:
  // Does the first fold exclude that the regression predicts as well as the models?
  bool hopeless(const HeldOutError& in_first) const {
    constexpr double probability = 1e-3;  // of giving up a regression that predicts as well
    const double freedom = double(in_first.influence.size()) - 1.0;
    return freedom > 0 &&
           clearly_smaller(models_in_first_, in_first, statistics::student_quantile(1 - probability, freedom));
  }

  const RegressionErrors& errors_;
  HeldOutError models_, models_in_first_;
  Index folds_;
  std::optional<std::pair<Rival, HeldOutError>> best_;
  int hopeless_ = 0;  // number of the last regressions that were
};

}  // namespace

std::optional<Rival> better_rival(const Rivals& rivals, const RegressionErrors& errors,
                                  const std::vector<Squares>& of_models) {
  const std::vector<Index>& orders = rivals.options.lags;
  Race race(errors, of_models);
  if (std::isinf(rivals.smoothing)) {
    for (const double slower : slow)
      if (!race.leads(std::min(rivals.lags, orders.back()), slower)) break;
  } else {
    race.run(orders, rivals.lags, all_alike);
    race.run(orders, rivals.reached + 1, rivals.smoothing);
  }
  return race.winner();
}

}  // namespace tokid
