// Chooses the orders, weightings, λ and EM of an identification from noisy data by cross-validation error.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "base/search_progress.hpp"
#include "choose/held_out_error.hpp"
#include "choose/refinement.hpp"
#include "tokid/choices.hpp"
#include "tokid/em.hpp"
#include "tokid/subspace.hpp"

namespace tokid {

class Folds {
 public:
  // The number of folds that are used, of all folds of so many experiments: three, or as many as hold out 20.
  static Index validating(Index experiments);

  struct Options {
    Index lags = 1;
    InitialState initial_state = InitialState::zero;
    bool feedthrough = true;  // as in Plan
    TimeVariation variation = {};
    std::vector<Weighting> weightings = {Weighting::one_step};  // to choose from
    bool centred = false;                                       // departures from a mean motion: see fold()
    Vector output_weights = {};                                 // as in Plan
    std::vector<Index> horizons = IdentifyOptions().horizons;
    Execution execution = {};
  };
  // Fits an ARX model and predictors to the experiments outside each fold.
  Folds(const Ensemble& ensemble, const Options& options);

  // Chooses n, the weighting and the λ of the regressions on states. `states`: n, if it is given.
  OrderScores choose_states(std::optional<Index> states, Index most, const Execution& execution = {});
  // The models of the folds, with the weighting and λ of these scores and without EM.
  std::vector<Model> models_of(const OrderScores& scores, Index states) const;
  // The same models, but predicting from step 0 on.
  std::vector<Model> from_first_step(std::vector<Model> models) const;
  // Of the predictions by these models, of the experiments that each fold holds out.
  std::vector<Squares> squares(const std::vector<Model>& models, const Ahead& ahead) const;
  // The pointers to the data stay valid as long as the folds.
  RefinementSettings refinement_settings() const;

 private:
  struct Fold {
    Split data;
    GtvArx arx;
    std::map<Weighting, PredictorFactors> factors;
  };
  void factorise(Index future);
  OrderScores choose_shown_states(std::optional<Index> states, Index most, const Execution& execution) const;
  Model start(size_t f, Index states, Weighting weighting, double smoothing) const;
  OrderScores scores(Weighting weighting, double smoothing, Index least, Index most, const Execution& execution) const;
  Squares squares(size_t f, Model model, const Ahead& ahead) const;
  // The error of the models of all folds; infinite if a model does not have this number of states.
  HeldOutError error_of(Index states, Weighting weighting, double smoothing, const Execution& execution) const;

  Options options_;
  Index all_;  // number of folds, with those that are not used
  Ahead ahead_;
  std::vector<Fold> folds_;
};

}  // namespace tokid
