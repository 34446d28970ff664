// Results → pages: whether a model can be trusted, and what became of the paper's example.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/identify.hpp"
#include "tokid/paper.hpp"

namespace tokid {

// What the data of a report are to the model; the verdict depends on it.
enum class Evaluation {
  automatic,  // found out by doing one regression of the identification anew; of data of which some had been held out,
              // these alone are tested
  given,      // other data, as far as is known
  held_out,   // experiments kept back from the identification
  training    // the experiments of the identification themselves
};

struct ReportOptions {
  std::string model_name, data_name;  // of the files, shown as text
  Evaluation evaluation = Evaluation::automatic;
  Index identified_from = 0;                       // experiments of the identification; 0: not known
  Findings findings = {};                          // of the identification, and others that belong on the page
  Index horizon = 10;                              // H of the H-step predictions and their fit
  std::optional<InitialState> initial_state = {};  // as in PredictOptions
  Index experiments = 24;                          // at most so many in the plots; all of them count in the figures
  Index points = 1200;                             // at most so many per curve: least and largest of each stretch
};

enum class Trust { good, look_closer, distrust };
const char* to_string(Trust trust);  // "good", "look closer", "don't trust"

// The first thing on the page: one sentence of figures, and why the status is what it is.
struct Verdict {
  Trust trust = Trust::distrust;
  std::string summary;
  std::vector<std::string> reasons;  // against the model, the gravest first; empty where nothing is
  // The steps ahead by which the fits were judged; 0: by simulation. Predictions are judged where the noise that the
  // model states spoils the simulation of an exact model too.
  Index horizon = 0;
};
// \throws as report_page
Verdict verdict(const Model& model, const Ensemble& data, const ReportOptions& options = {});

struct ReportPage {
  Verdict verdict;
  std::string html;
};
// A self-contained page in HTML, which loads nothing: tables for every reader, plots where JavaScript runs. Its data
// are a few megabytes at most, whatever the size of the ensemble; what was left out is stated on it.
// \throws std::invalid_argument where channels disagree, or no step of the data has a model
ReportPage report_page(const Model& model, const Ensemble& data, const ReportOptions& options = {});

// The page of a model that was just identified from these data with these options: on the experiments that were held
// out, where there are some, and with the warnings of the identification.
ReportPage identification_page(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
                               ReportOptions options = {});

// The paper's figures with their captions, Appendix B and the Kalman study on one page, which loads nothing and needs
// no JavaScript.
std::string paper_page(const Paper& paper, const KalmanStudy& study);
// All of the figures' data, as JSON text.
std::string paper_json(const Paper& paper, const KalmanStudy& study);
// Each figure as an SVG file of its own.
struct PaperFile {
  std::string name, text;
};
std::vector<PaperFile> paper_figure_files(const Paper& paper, const KalmanStudy& study);

}  // namespace tokid
