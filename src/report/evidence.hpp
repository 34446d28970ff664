// The figures of a report: computed once, and used by the verdict, the tables and the plots.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "base/words.hpp"
#include "diagnose/conclusions.hpp"
#include "report/bounds.hpp"
#include "report/horizon.hpp"
#include "report/origin.hpp"
#include "tokid/report.hpp"
#include "tokid/validate.hpp"

namespace tokid::report {

using words::figure, words::percent, words::percent_range, words::plural, words::probability, words::step_list;

// An input that hardly differs between the experiments at some steps, or at all of them.
struct WeakInput {
  Index input = 0;
  std::vector<Index> steps;
  double spread = 0.0;  // the smallest over those steps, relative to the input's median spread
  bool always = false;  // equal in all experiments at every step
};

struct Evidence {
  Validation validation;
  Conclusions conclusions;
  DecidingHorizon deciding;
  Prediction prediction;  // one step
  Ensemble simulated;
  Channels names;  // of the model, or of the data where the model has none
  Index horizon = 1;
  Index experiments = 0, missing = 0;         // tested; missing samples within the lengths
  std::vector<Index> rows;                    // (N) of these, in the given data
  std::vector<std::string> experiment_names;  // (N) of the same; empty for those without a name
  double missing_share = 0.0;                 // of the samples within the lengths
  bool noisy = false;                         // innovations beyond rounding errors
  Index lags = 0, unknowns = 0;               // p, and the largest of unknowns(); 0 if the model has no lag order
  Index identified_from = 0;                  // experiments; 0: not known
  Index samples = 0;  // of the identification for each unknown: its experiments, over all periods
  double condition_median = 0.0, condition_max = 0.0;
  std::vector<Index> ill, deficient;  // steps k: ill-conditioned; rank below the number of unknowns
  std::vector<WeakInput> weak_inputs;
  std::vector<Index> error_peaks;       // steps whose one-step error stands out from the others
  std::vector<Index> beyond_noise;      // steps whose one-step error stands out from the model's own innovations there
  std::vector<Index> outliers;          // experiments whose error stands out
  std::vector<Index> constant_outputs;  // outputs that do not move in the data, so that their fits mean nothing
  std::vector<Index> untested;          // steps of the model without a comparison
  std::vector<double> step_error;       // (T) RMS one-step error over outputs, relative to their spread; NaN where none
  std::vector<double> experiment_error;  // (N) the same at the chosen horizon, or one step ahead without a simulation
  Findings findings;                     // those of the options and of the validation, each once
  Findings differences;                  // between the data's and the model's sample time and names

  // Tested experiment n, in the form of words::experiment().
  std::string experiment(Index n) const { return words::experiment(rows[size_t(n)], experiment_names[size_t(n)]); }
};
// \throws as report_page
Evidence evidence(const Model& model, const Tested& tested);

Verdict verdict_of(const Model& model, const Evidence& found, const ReportOptions& options);

// The median of the finite values; NaN if there are none.
double finite_median(std::vector<double> values);

}  // namespace tokid::report
