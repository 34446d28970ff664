// Chooses the orders, weightings, λ and EM of an identification from noisy data by cross-validation error.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "base/search_progress.hpp"
#include "choose/held_out_error.hpp"
#include "tokid/choices.hpp"
#include "tokid/em.hpp"
#include "tokid/subspace.hpp"

namespace tokid {

// A larger order must reduce the error of subspace models by the factor `worth_it`. If the errors are uncertain, the
// required factor is higher, but at most `most_uncertain`.
inline constexpr double worth_it = 1.005, most_uncertain = 1.02;

// After so many iterations, no further stage of EM begins.
inline constexpr Index most_iterations = 480;
// Goes on with EM from the end of one stage to that of another, in the same stages as cross-validation has. `from`,
// `to`: iterations.
Model refined(Model model, const Ensemble& data, Index from, Index to, const RefineOptions& options);
// The number of steps that EM uses: all, unless the steps share their matrices and a part has enough samples for these.
Index refined_steps(const Ensemble& data, Index period);
// The iterations at the end of the next stage.
Index next_stage_end(Index iterations);
// Was EM best after so few iterations that more are not tried?
bool stopped_early(Index iterations, const RefineOptions& options);

struct RefinementOfFolds {
  RefinementChoice choice;
  std::vector<Model> models;  // of the folds that validate EM, by EM if it is used
};

class Folds {
 public:
  // The number of folds that validate EM, of so many experiments. EM takes longer than all other choices, so that it is
  // not validated on more folds than the comparisons need.
  static Index refined_folds(Index experiments);

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
  // The models of the folds that validate EM, with these scores and without EM.
  std::vector<Model> models_of(const OrderScores& scores) const;
  // Of the predictions by these models of the first folds, of the experiments that each fold holds out.
  std::vector<Squares> squares(const std::vector<Model>& models, const Ahead& ahead) const;
  // Chooses the λ of EM and its iterations by the likelihood and the errors of held-out experiments. EM starts from
  // subspace models with the weighting of the scores. `or_fewer`: fewer states are used if the likelihood is
  // hardly lower and the errors are at most `most_uncertain` larger. One number that fails is passed over. `smoothing`:
  // the λ of EM, if it is stated. `work` counts iterations of one fold.
  RefinementOfFolds choose_refinement(Index states, bool or_fewer, const OrderScores& scores,
                                      std::optional<double> smoothing, SearchProgress& work) const;

 private:
  class Likelihood;
  class RefinementSearch;
  struct Fold {
    Split data;
    GtvArx arx;
    std::map<Weighting, PredictorFactors> factors;
  };
  void factorise(Index future);
  OrderScores choose_shown_states(std::optional<Index> states, Index most, const Execution& execution) const;
  // The steps share their matrices.
  bool pooled() const { return options_.variation.period > 0; }
  Model start(size_t f, Index states, Weighting weighting, double smoothing) const;
  OrderScores scores(Weighting weighting, double smoothing, Index least, Index most, const Execution& execution) const;
  // The error of the models of the first `count` folds; infinite if a model does not have this number of states.
  // `like`: for each fold, as in squares_of().
  HeldOutError error_of(size_t count, Index states, const std::function<Model(size_t)>& make, const Ahead& ahead,
                        const Execution& execution, const std::vector<Predicted>& like = {}) const;

  Options options_;
  Index experiments_;
  Ahead ahead_;
  std::vector<Fold> folds_;
};

}  // namespace tokid
