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

  // Is it worth trying the next regression of the same kind?
  bool go_on(Index lags, double smoothing) {
    std::vector<Squares> own = errors_.squares(0, 1, lags, smoothing);
    if (hopeless(errors_.error_of(own))) return ++hopeless_ < 2;
    hopeless_ = 0;
    for (Squares& squares : errors_.squares(1, folds_, lags, smoothing)) own.push_back(std::move(squares));
    HeldOutError found = errors_.error_of(own);
    const bool smaller = !best_ || found.value < best_->second.value;
    if (smaller) best_.emplace(Rival{lags, smoothing}, std::move(found));
    return true;
  }
  void next_kind() { hopeless_ = 0; }

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
  int hopeless_ = 0;  // of the last regressions of this kind
};

}  // namespace

std::optional<Rival> better_rival(const Rivals& rivals, const RegressionErrors& errors,
                                  const std::vector<Squares>& of_models) {
  const std::vector<Index>& orders = rivals.options.lags;
  const auto beyond = [&](Index least) {
    return std::find_if(orders.begin(), orders.end(), [&](Index p) { return p >= least; });
  };
  Race race(errors, of_models);
  if (std::isinf(rivals.smoothing)) {
    for (const double slower : slow)
      if (!race.go_on(std::min(rivals.lags, orders.back()), slower)) break;
  } else {
    for (auto p = beyond(rivals.lags); p != orders.end() && race.go_on(*p, all_alike); ++p) continue;
    race.next_kind();
    for (auto p = beyond(rivals.reached + 1); p != orders.end() && race.go_on(*p, rivals.smoothing); ++p) continue;
  }
  return race.winner();
}

}  // namespace tokid
