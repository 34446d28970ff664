// The numbers of a report. They are computed once and used by the verdict, the tables and the plots.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "base/words.hpp"
#include "diagnose/conclusions.hpp"
#include "model/input_correlation.hpp"
#include "report/bounds.hpp"
#include "report/horizon.hpp"
#include "report/origin.hpp"
#include "tokid/report.hpp"
#include "tokid/validate.hpp"

namespace tokid::report {

using words::figure, words::percent, words::percent_range, words::plural, words::probability, words::step_list;

// An input that is nearly the same in all experiments at some steps, or at all steps.
struct WeakInput {
  Index input = 0;
  std::vector<Index> steps;
  double spread = 0.0;  // the smallest spread at these steps, relative to the input's median spread
  bool always = false;  // equal in all experiments at every step
};

struct Evidence {
  Validation validation;
  Conclusions conclusions;
  DecidingHorizon deciding;
  Prediction prediction;               // one step ahead
  InputCorrelation input_correlation;  // lags from -test_lags to test_lags; without entries if not tested
  Ensemble simulated;
  Channels names;  // names of the model, or of the data if the model has no names
  Index horizon = 1;
  Index experiments = 0, missing = 0;  // number of tested experiments; number of missing samples within their lengths
  std::vector<Index> rows;             // (N) rows of the tested experiments in the given data
  std::vector<std::string> experiment_names;  // (N) names of the tested experiments; empty without a name
  double missing_share = 0.0;                 // share of missing samples within the lengths
  bool noisy = false;                         // innovations are larger than rounding errors
  Index lags = 0, unknowns = 0;  // lag order p, and the largest of unknowns(); 0 if the model has no lag order
  Index identified_from = 0;     // number of experiments of the identification; 0: not known
  Index samples = 0;             // samples of the identification for each unknown: experiments times periods
  double condition_median = 0.0, condition_max = 0.0;
  double condition_limit = 0.0;       // larger condition numbers are ill
  std::vector<Index> ill, deficient;  // ill-conditioned steps k; steps k with a rank below the number of unknowns
  std::vector<WeakInput> weak_inputs;
  Findings dependent_inputs;  // inputs that follow from other samples at most steps: their effects cannot be told apart
  // (r) the smallest spread of each input over the experiments at a step, relative to its median over the steps. NaN:
  // too few samples, a spread that small by chance, or differences over time count.
  std::vector<double> input_spread;
  bool inputs_over_time = false;        // periodic model: weak inputs are constant over time and experiments
  Index assessed_inputs = 0;            // number of inputs with enough samples to find out whether they are weak
  std::vector<Index> error_peaks;       // steps whose one-step error is much larger than at the other steps
  std::vector<Index> beyond_noise;      // steps whose one-step error is much larger than the model states for this step
  std::vector<Index> constant_outputs;  // outputs that are constant in the data, so that their fits mean nothing
  std::vector<Index> untested;          // steps of the model without a comparison
  std::vector<double> step_error;  // (T) RMS one-step error over outputs, relative to their spread; NaN if not compared
  std::vector<double> step_excess;   // (T) step_error relative to the limit of error_peaks
  std::vector<double> noise_excess;  // (T) one-step error relative to what the model states; NaN if not known
  ExperimentFits fits;               // of the tested experiments (N)
  Findings findings;                 // findings of the options and of the validation, each once
  Findings differences;              // of sample time and names between data and model, or of the order of axes

  // Tested experiment n, in the form of words::experiment().
  std::string experiment(Index n) const { return words::experiment(rows[size_t(n)], experiment_names[size_t(n)]); }
};
// The options of the validation on which the evidence rests.
ValidateOptions validate_options(const Tested& tested);
// `compared`: compare(model, tested.data, validate_options(tested)). \throws as report_page
Evidence evidence(const Model& model, const Tested& tested, Comparison compared);
Evidence evidence(const Model& model, const Tested& tested);

Verdict verdict_of(const Model& model, const Evidence& found, const ReportOptions& options);

// The median of the finite values; NaN if there are none.
double finite_median(std::vector<double> values);

}  // namespace tokid::report
