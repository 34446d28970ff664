// Chooses the orders, weightings, λ and EM of an identification from noisy data by cross-validation error.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/em.hpp"
#include "tokid/subspace.hpp"

namespace tokid {

// Relative errors of a model of departures: logs of error over departure, averaged over the outputs. Predictions over
// many steps that are worse than none count as no better than none.
struct Errors {
  double one_step = 0.0, ahead = 0.0, simulation = 0.0;

  // The one-step error weighs most. Errors over many steps are correlated and uncertain, so they carry little
  // information. Equal weights gave worse models of measured data, over one step and over many.
  double mean() const { return (3 * one_step + ahead + simulation) / 5; }
};
// Outputs that a model of departures computes. They are NaN before step `first`. With unknown initial states, `first`
// is first_scored(). From there on all models can predict, and no output was used to estimate an initial state.
struct Computed {
  Ensemble one_step, ahead, simulation;
};
Computed computed_by(Model model, const Ensemble& data, InitialState initial, Index first);
// `like`: where it is given, the errors cover only the samples that it has computed too.
Errors errors_of(Computed computed, const Ensemble& data, const Computed* like = nullptr);
Index first_scored(InitialState initial, Index lags, Index period);

// Runs this many iterations of EM with this λ, in the same stages as cross-validation does.
Model refined(Model model, const Ensemble& data, double smoothing, Index iterations, RefineOptions options);

class Folds {
 public:
  struct Options {
    Index lags = 1;
    InitialState initial_state = InitialState::zero;
    bool feedthrough = true;  // as in Plan
    TimeVariation variation = {};
    std::vector<Weighting> weightings = {Weighting::one_step};  // to choose from
    bool centred = false;                                       // departures from a mean motion: see fold()
    int threads = 1;
  };
  // Fits an ARX model and predictors to the experiments outside each fold.
  Folds(const Ensemble& ensemble, const Options& options);

  // Chooses n, the weighting and the λ of the regressions on states. `states`: n, if it is given.
  OrderScores choose_states(std::optional<Index> states, Index most) const;
  // Chooses the number of EM iterations and, unless it is given, their λ. EM starts from subspace models with this many
  // states, the weighting of the scores, and the λ of EM. It competes with the subspace models that have the λ of the
  // scores.
  RefinementChoice choose_refinement(Index states, const OrderScores& scores,
                                     std::optional<double> smoothing = std::nullopt) const;
  // Tries EM with other numbers of states. Fewer states are taken where they do about as well after EM: subspace models
  // use extra states to make up for dynamics beyond their lags. More states, up to `most`, are taken where the error
  // falls clearly.
  RefinementChoice reconsider_states(RefinementChoice choice, const OrderScores& scores, Index most,
                                     std::optional<double> smoothing = std::nullopt) const;

 private:
  class RefinementSearch;
  struct Fold {
    Split data;
    GtvArx arx;
    std::map<Weighting, PredictorFactors> factors;
  };
  Model start(size_t f, Index states, Weighting weighting, double smoothing) const;
  OrderScores scores(Weighting weighting, double smoothing, Index least, Index most) const;
  // The errors of the models of the first `count` folds; empty where a model lacks the states asked for.
  template <class MakeModel>
  std::optional<std::vector<Errors>> errors_of_folds(size_t count, Index states, MakeModel&& make,
                                                     const std::vector<Computed>& like = {}) const;

  Options options_;
  Index first_ = 0;
  std::vector<Fold> folds_;
};

}  // namespace tokid
