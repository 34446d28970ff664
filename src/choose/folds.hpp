// The choices of an identification from noisy data, by the errors of models on experiments that had no part in them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/em.hpp"
#include "tokid/subspace.hpp"

namespace tokid {

// Errors of a model of departures over the departures, mean of the logs over outputs. Predictions over many steps that
// are worse than none say no more than that.
struct Errors {
  double one_step = 0.0, ahead = 0.0, simulation = 0.0;

  // Errors over many steps hang together, so that they are few numbers, and uncertain: choices by all three alike were
  // worse on measured data, over one step and over many.
  double mean() const { return (3 * one_step + ahead + simulation) / 5; }
};
// Outputs of a model of departures. From step `first` on: where initial states are unknown, first_judged(), from which
// on all models can predict and none has been told the outputs to find its state.
struct Computed {
  Ensemble one_step, ahead, simulation;
};
Computed computed_by(Model model, const Ensemble& data, InitialState initial, Index first);
// On the samples that `like`, where it is given, has computed too.
Errors errors_of(Computed computed, const Ensemble& data, const Computed* like = nullptr);
Index first_judged(InitialState initial, Index lags, Index period);

// The model after as many iterations of EM with this λ, in the stages that the folds judge.
Model refined(Model model, const Ensemble& data, double smoothing, Index iterations, RefineOptions options);

class Folds {
 public:
  struct Options {
    Index lags = 1;
    InitialState initial_state = InitialState::zero;
    TimeVariation variation = {};
    std::vector<Weighting> weightings = {Weighting::one_step};  // to choose from
    bool centred = false;                                       // departures from a mean motion: see fold()
    int threads = 1;
  };
  // The ARX models and predictors of the experiments outside each fold.
  Folds(const Ensemble& ensemble, const Options& options);

  // n, the weighting and the λ of the regressions on states; `states`: n where it is given, else 0.
  OrderScores choose_states(Index states, Index most) const;
  // How far to go with EM, and with which λ, unless it is given, from the subspace models of so many states and the
  // weighting and λ of the scores.
  RefinementChoice choose_refinement(Index states, const OrderScores& scores,
                                     std::optional<double> smoothing = std::nullopt) const;
  // Goes on from that to as few states as do as well after EM: subspace models need some to make up for what their lags
  // leave out. Or to more, up to `most`, where EM finds them worth it.
  RefinementChoice reconsider_states(RefinementChoice choice, const OrderScores& scores, Index most,
                                     std::optional<double> smoothing = std::nullopt) const;

 private:
  struct Fold {
    Split data;
    GtvArx arx;
    std::map<Weighting, PredictorFactors> factors;
  };
  Model start(size_t f, Index states, Weighting weighting, double smoothing) const;
  OrderScores scores(Weighting weighting, double smoothing, Index least, Index most) const;
  // The errors of one model for each of the first folds; none where one has not the states asked for.
  template <class MakeModel>
  std::optional<std::vector<Errors>> errors_of_folds(size_t count, Index states, MakeModel&& make,
                                                     const std::vector<Computed>& like = {}) const;

  Options options_;
  Index first_ = 0;
  std::vector<Fold> folds_;
};

}  // namespace tokid
