// Turns the numbers of a report into a verdict in plain words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "report/evidence.hpp"
#include "report/origin.hpp"

namespace tokid {

const char* to_string(Trust trust) {
  return trust == Trust::good ? "good" : trust == Trust::look_closer ? "look closer" : "don't trust";
}

namespace report {

namespace {

double least(const Vector& fits) {
  double result = std::numeric_limits<double>::infinity();
  for (const double fit : fits) result = std::isnan(fit) ? result : std::min(result, fit);
  return result;
}

// "experiments 3, 5–9 and 12", 'experiments "17" (row 16) and "20" (row 19)'; a long list is shortened
std::string experiment_list(const Evidence& found, const std::vector<Index>& experiments) {
  constexpr size_t most = 6;
  std::vector<Index> rows;
  std::vector<std::string> texts;
  bool named = false;
  for (const Index n : experiments) {
    rows.push_back(found.rows[size_t(n)]);
    texts.push_back(found.experiment(n));
    named = named || texts.back() != std::to_string(rows.back());
  }
  if (!named) return fmt::format("experiment{}", step_list(rows).substr(4));
  const char* noun = texts.size() == 1 ? "experiment" : "experiments";
  if (texts.size() <= most) return fmt::format("{} {}", noun, words::listed(texts));
  const size_t all = texts.size();
  texts.resize(most);
  return fmt::format("{} {} and more ({} in all)", noun, fmt::join(texts, ", "), all);
}

std::string capital(std::string text) {
  text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

// Collects the reasons against the model, and sorts them by their severity. The most severe reason determines the
// status.
class Assessment {
 public:
  Assessment(const Model& model, const Evidence& found, const ReportOptions& options)
      : model_(model),
        found_(found),
        options_(options),
        simulation_(found.validation.simulation.fit),
        one_step_(found.validation.one_step.fit),
        deciding_(found.deciding.fit.fit) {
    for (const Index j : found.constant_outputs)
      simulation_(j) = one_step_(j) = deciding_(j) = std::numeric_limits<double>::quiet_NaN();
  }

  Verdict verdict() {
    verdict_.trust = Trust::good;
    verdict_.horizon = found_.deciding.steps;
    if (!fits()) return std::move(verdict_);
    test_data();
    regressions();
    for (const std::string& text : in_words(found_.differences)) against(Trust::look_closer, capital(text) + ".");
    innovations();
    std::stable_sort(reasons_.begin(), reasons_.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    for (auto& [trust, text] : reasons_) verdict_.reasons.push_back(std::move(text));
    verdict_.summary = summary();
    return std::move(verdict_);
  }

 private:
  void against(Trust trust, std::string reason) {
    verdict_.trust = std::max(verdict_.trust, trust);
    reasons_.emplace_back(trust, std::move(reason));
  }

  std::string tested() const {
    const Index n = found_.experiments;
    switch (options_.evaluation) {
      case Evaluation::held_out:
        return fmt::format("{} held-out experiment{}", n, n == 1 ? "" : "s");
      case Evaluation::training:
        return fmt::format("the {} that the model was identified from", plural(n, "experiment"));
      default:
        return fmt::format("{} given", plural(n, "experiment"));
    }
  }

  std::string summary() const {
    const Validation& v = found_.validation;
    std::string text;
    if (v.simulation.samples > 0)
      text = fmt::format("Simulation fit {} on {}", percent_range(simulation_), tested());
    else
      text = fmt::format("No simulation could be compared on {}", tested());
    if (v.one_step.samples > 0) text += fmt::format("; one-step prediction fit {}", percent_range(one_step_));
    text += '.';
    if (verdict_.horizon > 0) text += fmt::format(" {}", why_not_simulation());
    if (!remark_.empty()) text += " " + remark_;
    return text;
  }

  std::string why_not_simulation() const {
    const DecidingHorizon& h = found_.deciding;
    std::string text =
        fmt::format("Evaluated by predictions {} ahead, fit {}: ", plural(h.steps, "step"), percent_range(deciding_));
    const char* noise = h.stated ? "the noise that the model states" : "noise as large as its innovations";
    const double exact = least(of_moving(h.expected_simulation));
    return text + fmt::format("{} would spoil the simulation of an exact model too ({}).", noise,
                              exact < 0 ? "fit below 0 %" : fmt::format("fit {}", percent(exact)));
  }

  // Replaces the fits of constant outputs by NaN.
  Vector of_moving(Vector fits) const {
    for (const Index j : found_.constant_outputs)
      if (j < fits.size()) fits(j) = std::numeric_limits<double>::quiet_NaN();
    return fits;
  }

  // Does the noise that the model states explain all fits that are not good? It does if an exact model with this noise
  // would have nearly the same errors. Noise is no explanation for very small fits, and not if the model states much
  // more noise than the data have.
  bool noise_explains(const Vector& found, const Vector& expected) const {
    if (!found_.deciding.stated || expected.size() == 0 || found_.validation.squares.ratio < 1 / counts::overconfident)
      return false;
    for (Index j = 0; j < found.size(); ++j)
      if (found(j) < bounds::good_fit &&
          !(found(j) >= bounds::useless_fit && 100 - found(j) <= bounds::as_expected * (100 - expected(j))))
        return false;
    return true;
  }

  // Is each input the same in all training experiments?
  bool inputs_unknown() const {
    return options_.evaluation != Evaluation::given && Index(found_.weak_inputs.size()) == model_.inputs &&
           std::all_of(found_.weak_inputs.begin(), found_.weak_inputs.end(),
                       [](const WeakInput& weak) { return weak.always; });
  }

  std::string name_of_worst(const Vector& fits) const {
    Index worst = 0;
    for (Index j = 1; j < fits.size(); ++j)
      if (fits(j) < fits(worst) || std::isnan(fits(worst))) worst = j;
    return found_.names.output(worst);
  }

  void assess_simulation() {
    const Validation& v = found_.validation;
    const double simulation = least(simulation_), ahead = least(of_moving(v.horizon.fit));
    if (v.simulation.samples == 0) {
      against(Trust::look_closer, "Nothing was simulated: the initial states could not be estimated.");
      return;
    }
    if (!v.simulation.rmse.allFinite()) {
      against(Trust::distrust, "The simulation overflows: the model is unstable over its steps.");
      return;
    }
    if (simulation >= bounds::good_fit || std::isinf(simulation)) return;
    const std::string output = name_of_worst(simulation_);
    const double exact = least(of_moving(found_.deciding.expected_simulation));
    const std::string promise =
        found_.deciding.stated && std::isfinite(exact) && exact >= bounds::good_fit
            ? fmt::format("; with the noise that the model states, an exact model would reach {}", percent(exact))
            : "";
    if (noise_explains(simulation_, found_.deciding.expected_simulation))
      against(Trust::look_closer,
              fmt::format("The simulation fits output {} to {}, and the noise that the model states allows no more.",
                          output, percent(simulation)));
    else if (simulation < bounds::poor_fit && simulation >= 0 && ahead >= bounds::good_fit && !inputs_unknown())
      against(Trust::look_closer,
              fmt::format(
                  "The simulation fits output {} to {} only{}. Predictions {} ahead fit {}: use the model only with "
                  "its observer, and only for predictions over as many steps.",
                  output, percent(simulation), promise, plural(found_.horizon, "step"),
                  percent_range(of_moving(v.horizon.fit))));
    else if (simulation < 0)
      against(Trust::distrust,
              fmt::format("The simulation of output {} is worse than the mean of the output (fit {}){}.", output,
                          percent(simulation), promise));
    else if (simulation < bounds::poor_fit)
      against(Trust::distrust,
              fmt::format("The simulation fits output {} to {} only{}.", output, percent(simulation), promise));
    else
      against(Trust::look_closer, fmt::format("The simulation fits output {} to {}; {:.0f} % or more would be good{}.",
                                              output, percent(simulation), bounds::good_fit, promise));
  }

  void assess_predictions() {
    const DecidingHorizon& h = found_.deciding;
    const double fit = least(deciding_);
    const std::string found = fmt::format("Predictions {} ahead fit output {} to {}", plural(h.steps, "step"),
                                          name_of_worst(deciding_), percent(fit));
    const std::string exact = fmt::format("those of an exact model would fit {}", percent_range(of_moving(h.expected)));
    if (!h.fit.rmse.allFinite())
      against(Trust::distrust, fmt::format("The predictions {} ahead overflow.", plural(h.steps, "step")));
    else if (fit < bounds::good_fit && noise_explains(deciding_, h.expected))
      against(Trust::look_closer, fmt::format("{}, and the noise that the model states allows no more.", found));
    else if (fit < bounds::poor_fit)
      against(Trust::distrust, fmt::format("{} only; {}.", found, exact));
    else if (fit < bounds::good_fit)
      against(Trust::look_closer, fmt::format("{}; {}.", found, exact));
    if (h.inputs < bounds::inputs_show)
      against(Trust::look_closer,
              fmt::format(
                  "The effect of the inputs within {} is less than {:.1f} times the errors of the predictions: these "
                  "data hardly test the effect of the inputs.",
                  plural(h.steps, "step"), bounds::inputs_show));
  }

  // Assesses the fits. False: nothing could be compared, so that the other checks are left out.
  bool fits() {
    const Validation& v = found_.validation;
    if (v.simulation.samples == 0 && v.one_step.samples == 0) {
      verdict_.trust = Trust::distrust;
      verdict_.summary = fmt::format("Nothing was tested: no output of {} could be compared with the model.", tested());
      verdict_.reasons = {"No output sample has both a measured and a computed value."};
      return false;
    }
    if (Index(found_.constant_outputs.size()) == model_.outputs) {
      verdict_.trust = Trust::distrust;
      verdict_.summary = fmt::format("Nothing was tested: no output moves in {}.", tested());
      verdict_.reasons = {"Constant outputs say nothing about the model, however well it reproduces them."};
      return false;
    }
    for (const Index j : found_.constant_outputs)
      against(
          Trust::look_closer,
          fmt::format(
              "Output {} is constant in these data, and its fit says nothing: RMS error {} in the one-step "
              "predictions{}.",
              found_.names.output(j), figure(v.one_step.rmse(j), 3),
              v.simulation.samples > 0 ? fmt::format(", {} in the simulation", figure(v.simulation.rmse(j), 3)) : ""));
    const double one_step = least(one_step_);
    if (v.one_step.samples > 0 && !v.one_step.rmse.allFinite())
      against(Trust::distrust, "The predictions overflow: the observer does not follow these data.");
    else if (v.one_step.samples > 0 && one_step < bounds::poor_fit) {
      const bool noise = noise_explains(one_step_, found_.deciding.expected_one_step);
      against(noise ? Trust::look_closer : Trust::distrust,
              fmt::format("One-step predictions fit output {} to {} only{}.", name_of_worst(one_step_),
                          percent(one_step), noise ? ", and the noise that the model states allows no more" : ""));
    }
    if (found_.deciding.steps > 0)
      assess_predictions();
    else
      assess_simulation();
    if (!found_.error_peaks.empty())
      against(Trust::look_closer, fmt::format("One-step errors at {} are more than {:.0f} times the median.",
                                              step_list(found_.error_peaks), bounds::error_peak));
    if (!found_.beyond_noise.empty())
      against(Trust::look_closer,
              fmt::format(
                  "One-step errors at {} are more than {:.0f} times the errors of the identification at these steps.",
                  step_list(found_.beyond_noise), bounds::beyond_noise));
    if (!found_.outliers.empty())
      against(Trust::look_closer,
              fmt::format(
                  "Errors of {} are more than {:.0f} times the median of all experiments: look for other conditions, a "
                  "failed sensor, or a model that is not valid there.",
                  experiment_list(found_, found_.outliers), bounds::outlier));
    const double share = 1 - double(found_.untested.size()) / double(std::max<Index>(1, model_.steps()));
    if (share < bounds::coverage)
      against(Trust::look_closer, fmt::format("The data test only {} of the model's {}; they do not test {}.",
                                              model_.steps() - Index(found_.untested.size()),
                                              plural(model_.steps(), "step"), step_list(found_.untested)));
    return true;
  }

  void test_data() {
    const Index from = found_.samples, unknowns = found_.unknowns;
    if (options_.evaluation == Evaluation::training) {
      if (from > 0 && from < 3 * unknowns)
        against(Trust::look_closer,
                fmt::format("Tested only on training data, {} for {} unknowns per output and step: such a fit proves "
                            "little. Hold experiments back, or measure new ones.",
                            plural(found_.identified_from, "experiment"), unknowns));
      else if (from == 0)
        against(Trust::look_closer,
                "Tested only on training data, and the number of training experiments is not known: test on new "
                "experiments.");
    } else {
      if (found_.noisy && from > 0 && from < 2 * unknowns)
        against(Trust::look_closer,
                fmt::format("Identified from {} for {} unknowns per output and step: noise is hardly averaged out of "
                            "the model. Use {} or more.",
                            plural(found_.identified_from, "experiment"), unknowns, 3 * unknowns));
    }
    if (found_.missing_share > bounds::many_missing)
      against(Trust::look_closer, fmt::format("{:.0f} % of the samples are missing.", 100 * found_.missing_share));
    if (found_.experiments < bounds::few_tested)
      against(Trust::look_closer,
              fmt::format("Only {} tested.", found_.experiments == 1 ? "one experiment was" : "two experiments were"));
  }

  // Does the window of step k contain a step at which this input is nearly the same in all experiments?
  bool explains(const WeakInput& weak, Index k) const {
    const auto first = std::lower_bound(weak.steps.begin(), weak.steps.end(), k - found_.lags);
    return weak.always || (first != weak.steps.end() && *first <= k);
  }

  std::string constancy(const WeakInput& weak) const {
    if (weak.always) return fmt::format("input {} is the same in all experiments", found_.names.input(weak.input));
    return fmt::format("input {} is nearly the same in all experiments at {}", found_.names.input(weak.input),
                       step_list(weak.steps));
  }
  std::string spread(const WeakInput& weak) const {
    return fmt::format("its spread over the experiments falls to {} % of the usual one", figure(100 * weak.spread, 2));
  }

  void regressions() {
    // Only the data of the identification can explain the condition of its regressions.
    const bool own = options_.evaluation != Evaluation::given;
    std::vector<Index> explained, unexplained;
    std::vector<const WeakInput*> causes;
    for (const Index k : found_.ill) {
      bool any = false;
      for (const WeakInput& weak : found_.weak_inputs)
        if (own && explains(weak, k)) {
          any = true;
          if (std::find(causes.begin(), causes.end(), &weak) == causes.end()) causes.push_back(&weak);
        }
      (any ? explained : unexplained).push_back(k);
    }
    const auto ill = [](const std::vector<Index>& steps) {
      return fmt::format("{} {} ill-conditioned", capital(step_list(steps)), steps.size() == 1 ? "is" : "are");
    };
    const auto against_steps = [&](const std::vector<Index>& steps, const std::string& why) {
      against(Trust::look_closer,
              fmt::format("Condition numbers reach {} at {}, against a median of {}: {}. Expect few correct digits of "
                          "the matrices there.",
                          figure(found_.condition_max, 2), step_list(steps), figure(found_.condition_median, 2), why));
    };
    if (!explained.empty()) {
      std::vector<std::string> briefly, fully;
      for (const WeakInput* weak : causes) {
        briefly.push_back(constancy(*weak));
        fully.push_back(weak->always ? constancy(*weak) : fmt::format("{} ({})", constancy(*weak), spread(*weak)));
      }
      remark_ = fmt::format("{}: {}.", ill(explained), fmt::join(briefly, ", "));
      against_steps(explained, fmt::format("{}", fmt::join(fully, "; ")));
    }
    if (!unexplained.empty()) {
      remark_ = fmt::format("{}{}{}.", remark_, remark_.empty() ? "" : " ", ill(unexplained));
      against_steps(
          unexplained,
          found_.samples > 0 && found_.samples < 2 * found_.unknowns
              ? fmt::format("{} are few for {} unknowns", plural(found_.identified_from, "experiment"), found_.unknowns)
              : "some inputs or outputs of neighbouring steps are almost dependent over the experiments");
    }
    for (const WeakInput& weak : found_.weak_inputs) {
      if (std::find(causes.begin(), causes.end(), &weak) != causes.end()) continue;
      const std::string text = capital(constancy(weak));
      if (remark_.empty()) remark_ = text + ".";
      const char* effect = options_.evaluation == Evaluation::training ? "its effect there can hardly be identified"
                                                                       : "its effect there is hardly tested";
      if (weak.always)
        against(inputs_unknown() && !(least(deciding_) >= bounds::good_fit) ? Trust::distrust : Trust::look_closer,
                fmt::format("{}: its effect is not known.", text));
      else
        against(Trust::look_closer, fmt::format("{} ({}): {}.", text, spread(weak), effect));
    }
    if (found_.noisy && !found_.deficient.empty() && Index(found_.deficient.size()) > found_.lags)
      against(Trust::look_closer, fmt::format("The regressions of {} lack full rank: some effects can't be "
                                              "separated, and the solution of smallest norm is used.",
                                              step_list(found_.deficient)));
  }

  void innovations() {
    const Conclusions& c = found_.conclusions;
    const auto add = [&](const char* test, const Conclusion& conclusion) {
      if (conclusion.result == TestResult::against)
        against(Trust::look_closer, fmt::format("{}: {}.", test, in_words(conclusion)));
    };
    add("Whiteness of the innovations", c.whiteness);
    add("Inputs and innovations", c.independence);
    add("Effects of the inputs", c.gains);
    add("Squared innovations", c.nis);
  }

  const Model& model_;
  const Evidence& found_;
  const ReportOptions& options_;
  Vector simulation_, one_step_, deciding_;  // fits of the outputs; NaN for constant outputs
  Verdict verdict_;
  std::vector<std::pair<Trust, std::string>> reasons_;
  std::string remark_;  // a sentence on single steps for the summary
};

}  // namespace

Verdict verdict_of(const Model& model, const Evidence& found, const ReportOptions& options) {
  return Assessment(model, found, options).verdict();
}

}  // namespace report

Verdict verdict(const Model& model, const Ensemble& data, const ReportOptions& options) {
  const report::Tested tested = report::tested(model, data, options);
  return report::verdict_of(model, report::evidence(model, tested), tested.options);
}

}  // namespace tokid
