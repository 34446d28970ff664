// Results → pages: a report on whether a model can be trusted, and the results of the paper's example.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

// Confidence bands of the pulse and step responses on a page.
struct ResponseBands {
  double level = 0.95;
  Index replicates = 0;       // successful replicates of the bootstrap
  std::vector<Index> starts;  // (S) the steps at which the inputs begin to act
  Index length = 0;           // L: the outputs are those of the steps start … start+L-1
  // (S) of (L × m·r): column j + m·i is output j for input i
  std::vector<Matrix> pulse_lower, pulse_upper, step_lower, step_upper;
  std::vector<Matrix> pulse, step;  // the responses of the model itself, which tell the bands of other models
  Findings findings;
};
// The bands of a model, by function_bounds(). `identified`: the ensemble of its identification.
// \throws as function_bounds()
ResponseBands response_bands(const Model& model, const Ensemble& identified, const ConfidenceOptions& options = {});

// A model with the name that the page shows.
struct NamedModel {
  std::string name;
  Model model;
};

struct ReportOptions {
  std::string model_name, data_name;  // names of the files, shown as text
  Evaluation evaluation = Evaluation::automatic;
  Index identified_from = 0;                       // number of experiments of the identification; 0: not known
  Findings findings = {};                          // findings of the identification and others for the page
  Index horizon = 10;                              // H of the H-step predictions and their fit
  std::optional<InitialState> initial_state = {};  // as in PredictOptions
  Index experiments = 24;                          // most experiments in the plots; the fits use all of them
  Index points = 1200;                             // most points per curve: minimum and maximum of each stretch
  // Other models of the same channels: the page has their fits over the same samples, and their curves.
  std::vector<NamedModel> compare = {};
  // Bands of the model of the page, whose findings the page has too. Empty: the page has responses without bands.
  std::optional<ResponseBands> bands = {};
};

enum class Trust { good, look_closer, distrust };
const char* to_string(Trust trust);  // "good", "look closer", "don't trust"

// Why a check did not pass, with its own severity.
struct VerdictReason {
  Trust trust = Trust::look_closer;
  std::string text;
};

// A check of the verdict, in words.
struct VerdictCheck {
  std::string name;           // "simulation_fit", …; docs/formats.md lists the names
  std::string subject;        // what is checked
  std::string found, needed;  // the figure of these data, and its bound; `found` gives the reason of an untested check
  std::optional<Trust> result;  // good: passed; empty: not tested
  // Why it did not pass. Empty if it passed, or if another check has the reason.
  std::vector<VerdictReason> reasons;
};

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

struct ReportPage {
  Verdict verdict;
  std::string html;
};
// Makes a self-contained HTML page, which loads nothing: tables for every reader, plots if JavaScript runs. Its data
// are a few megabytes at most, for any size of the ensemble; the page states which data it leaves out.
// \throws std::invalid_argument where channels disagree, no step of the data has a model, or the bands are those of
// another model
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
