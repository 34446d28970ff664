// Results → pages: a report on whether a model can be trusted, and the results of the paper's example.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tokid/identify.hpp"
#include "tokid/paper.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid {

// The relation of the data of a report to the model. The verdict depends on it.
enum class Evaluation {
  // tokid compares the fingerprints of the data, and of their training part, with the fingerprints in the model. If the
  // data include held-out experiments, only these are tested.
  automatic,
  given,     // data that the identification did not use, as far as known
  held_out,  // experiments held out from the identification
  training   // the training data
};

// Confidence bands of the pulse, step and frozen frequency responses on a page. The responses of the model itself are
// stored beside them: they identify bands that belong to another model.
struct ResponseBands {
  double level = 0.95;
  Index replicates = 0;       // successful replicates of the bootstrap
  std::vector<Index> starts;  // (S) the steps at which the inputs begin to act
  Index length = 0;           // L: the outputs are those of the steps start … start+L-1
  // (S) of (L × m·r): column j + m·i is output j for input i
  std::vector<Matrix> pulse_lower, pulse_upper, step_lower, step_upper;
  std::vector<Matrix> pulse, step;
  std::vector<Index> frozen_steps;  // (K) steps of the frozen frequency responses
  Vector frequencies;               // (F) of these [rad/s], or [rad per step] without a stated sample time
  // (K) of (F × m·r), in the same columns. The bands have random errors alone, not those of freezing the time.
  std::vector<Matrix> magnitude_lower, magnitude_upper;
  std::vector<Matrix> phase_lower, phase_upper;  // [rad], around `phase`
  std::vector<Matrix> magnitude, phase;
  Findings findings;
};
// The bands of a model, by function_bounds(). `identified`: the ensemble of its identification. `at`: as
// ReportOptions::at. \throws as function_bounds() and report_page()
ResponseBands response_bands(const Model& model, const Ensemble& identified, const ConfidenceOptions& options = {},
                             const std::vector<Index>& at = {});

// A model with the name that the page shows.
struct NamedModel {
  std::string name;
  Model model;
};

struct ReportOptions {
  std::string model_name, data_name;  // names of the files, shown as text
  Evaluation evaluation = Evaluation::automatic;
  Index identified_from = 0;                            // number of experiments of the identification; 0: not known
  std::optional<RegressionComparison> comparison = {};  // of the identification; empty: not known
  Findings findings = {};                               // findings of the identification and others for the page
  Index horizon = 10;                                   // H of the H-step predictions and their fit
  Index first_step = 0;                                 // of the fits, as in ValidateOptions
  std::optional<InitialState> initial_state = {};       // as in PredictOptions
  Index experiments = 24;                               // most experiments in the plots; the fits use all of them
  Index points = 1200;                                  // most points per curve: minimum and maximum of each stretch
  // Other models of the same channels: the page has their fits over the same samples, and their curves.
  std::vector<NamedModel> compare = {};
  // Steps of the pulse, step and frozen frequency responses. Empty: evenly spaced steps, fewer for many channels. A
  // frozen frequency response is shown at those steps at which all modes are valid.
  std::vector<Index> at = {};
  // Bands of the model of the page at the same steps, whose findings the page has too. Empty: the page has responses
  // without bands.
  std::optional<ResponseBands> bands = {};
};

enum class Trust { good, look_closer, distrust };
const char* to_string(Trust trust);  // "good", "look closer", "don't trust"

// Why a check did not pass, with its own severity.
struct VerdictReason {
  Trust trust = Trust::look_closer;
  std::string text;
};

// A figure by which a check decides, and its bound.
struct CheckFigure {
  enum class Rule { at_least, at_most, below };

  std::string name;  // "fit", "p", …; docs/formats.md lists the names
  // Fits have one value for each output, NaN for a constant one. Others have one value. Empty: not known.
  std::vector<double> values = {};
  Rule rule = Rule::at_least;
  double bound = 0.0;
  // Fits: a smaller one leads to distrust. NaN: no such limit, or an exception applies to these data. Noise that the
  // model states explains small fits, and good predictions many steps ahead make up for a simulation that is not good.
  double distrust = std::numeric_limits<double>::quiet_NaN();

  // Is at least one value known, and do all known values keep the bound?
  bool kept() const;
};
const char* to_string(CheckFigure::Rule rule);  // "at least", "at most", "below"

// A check of the verdict, as numbers.
struct VerdictCheck {
  // What is checked. docs/formats.md lists the figures of each.
  enum class Kind {
    outputs,
    one_step_fit,
    simulation_fit,
    prediction_fit,
    input_effect,
    regression,
    error_peaks,
    beyond_noise,
    outliers,
    coverage,
    samples,
    missing,
    experiments,
    condition,
    inputs,
    rank,
    channels,
    // tests of the innovations
    whiteness,
    independence,
    gains,
    nis
  };

  // Why a check is not tested. innovations: the reason of the conclusion says it.
  enum class Untested {
    no_predictions,
    no_varying_output,
    no_cross_validation,
    few_errors,            // numbers: count, of `fewest` errors
    no_covariance,         // the model states no covariance
    uncertain_covariance,  // for lack of degrees of freedom
    unknown_experiments,   // of the identification
    no_lag_order,
    without_noise,
    no_regressions,
    no_inputs,
    few_input_samples,
    no_ranks,
    no_probability,    // too few samples for a probability
    dependent_inputs,  // the inputs follow from other samples, which alone could explain the outputs
    innovations
  };

  Kind kind = Kind::outputs;
  // The check passes if all figures keep their bounds, or with `one_suffices` if one does.
  std::vector<CheckFigure> figures = {};
  bool one_suffices = false;
  std::map<std::string, double> numbers = {};  // others that belong to the figures, for example the step of the largest
  std::optional<Finding::Experiment> experiment = {};  // the one with the largest error
  std::optional<Conclusion::Reason> reason = {};       // of a test of the innovations
  std::optional<Trust> result = {};                    // good: passed; empty: not tested
  std::optional<Untested> untested = {};               // of a check that is not tested
  // Why it did not pass. Empty if it passed, or if another check has the reason.
  std::vector<VerdictReason> reasons = {};

  bool kept() const;  // Do the figures keep their bounds?
};
const char* to_string(VerdictCheck::Kind kind);        // "simulation_fit", …
const char* to_string(VerdictCheck::Untested reason);  // "no_predictions", …

// A check in words: what is checked, the figures of these data, and their bounds. `found` gives the reason of a check
// that is not tested.
struct CheckWords {
  std::string subject, found, needed;
};
// \throws std::invalid_argument for a test of the innovations without its reason
CheckWords in_words(const VerdictCheck& check);

// The checks of the tests of the innovations: whiteness, independence, gains and nis. `v` has their figures.
std::vector<VerdictCheck> innovation_checks(const Conclusions& conclusions, const Validation& v);

// The verdict, at the top of the page: one sentence of figures, the reasons for the status, and the checks that decide.
struct Verdict {
  Trust trust = Trust::distrust;
  std::string summary;
  std::vector<std::string> reasons;  // reasons against the model, the most serious first; empty if there are none
  // `trust` is the worst result of the checks, and `reasons` are their reasons. If nothing can be compared, the checks
  // end with the one that says so.
  std::vector<VerdictCheck> checks;
  // The prediction horizon of the fits that decide; 0: the simulation decides. Predictions decide if, with the noise of
  // this model, the simulation of an exact model would have a poor fit too.
  Index horizon = 0;
};
// \throws as report_page
Verdict verdict(const Model& model, const Ensemble& data, const ReportOptions& options = {});
// The verdict of identification_page(), without the page.
Verdict verdict(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
                ReportOptions options = {});

struct ReportPage {
  Verdict verdict;
  std::string html;
  Findings findings;  // of the options, the bands, the data and the validation, each once, as on the page
};
// Makes a self-contained HTML page, which loads nothing: tables for every reader, plots if JavaScript runs. Its data
// are a few megabytes at most, for any size of the ensemble; the page states which data it leaves out.
// \throws std::invalid_argument where channels disagree, a sample is infinite, no step of the data has a model, the
// bands are those of another model or of other steps, or `at` has steps without a model or more than the page has room
// for
ReportPage report_page(const Model& model, const Ensemble& data, const ReportOptions& options = {});

// The page of a model that was just identified from these data with these options. It uses the held-out experiments if
// there are any, and shows the warnings of the identification.
ReportPage identification_page(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
                               ReportOptions options = {});

// One page with the paper's figures and captions, Appendix B and the Kalman study. It loads nothing: tables for every
// reader, figures if JavaScript runs.
std::string paper_page(const Paper& paper, const KalmanStudy& study);
// The figures, their data and all numbers, as JSON text. docs/formats.md lists the keys.
std::string paper_json(const Paper& paper, const KalmanStudy& study);

}  // namespace tokid
