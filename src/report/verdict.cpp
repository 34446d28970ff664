// Figures → plain words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "evidence.hpp"
#include "provenance.hpp"

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

// Reasons in the order of their gravity; each pulls the status down as far as it must.
class Judge {
 public:
  Judge(const Model& model, const Evidence& found, const ReportOptions& options)
      : model_(model), found_(found), options_(options) {}

  Verdict judge() {
    verdict_.trust = Trust::good;
    if (!fits()) return std::move(verdict_);
    test_data();
    regressions();
    whiteness();
    for (std::string text : found_.differences) {
      text[0] = 'T';  // "the data's …"
      against(Trust::look_closer, text + ".");
    }
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
      text = fmt::format("Simulation fit {} on {}", percent_range(v.simulation.fit), tested());
    else
      text = fmt::format("No simulation could be compared on {}", tested());
    if (v.one_step.samples > 0) text += fmt::format("; one-step prediction fit {}", percent_range(v.one_step.fit));
    text += ".";
    if (!remark_.empty()) text += " " + remark_;
    return text;
  }

  // Nothing else counts where nothing could be compared.
  bool fits() {
    const Validation& v = found_.validation;
    if (v.simulation.samples == 0 && v.one_step.samples == 0) {
      verdict_.trust = Trust::distrust;
      verdict_.summary = fmt::format("Nothing was tested: no output of {} could be compared with the model.", tested());
      verdict_.reasons = {"No output sample has both a measured and a computed value."};
      return false;
    }
    const double simulation = least(v.simulation.fit), one_step = least(v.one_step.fit);
    const auto name = [&](const Vector& fits) {
      Index worst = 0;
      for (Index j = 1; j < fits.size(); ++j)
        if (fits(j) < fits(worst) || std::isnan(fits(worst))) worst = j;
      return found_.names.output(worst);
    };
    if (v.one_step.samples > 0 && !v.one_step.rmse.allFinite())
      against(Trust::distrust, "The predictions overflow: the observer does not follow these data.");
    else if (v.one_step.samples > 0 && one_step < bounds::poor_fit)
      against(Trust::distrust,
              fmt::format("One-step predictions fit output {} to {} only.", name(v.one_step.fit), percent(one_step)));
    if (v.simulation.samples == 0)
      against(Trust::look_closer, "Nothing was simulated: no initial state could be found for it.");
    else if (!v.simulation.rmse.allFinite())
      against(Trust::distrust, "The simulation overflows: the model is unstable over its steps.");
    else if (simulation < 0)
      against(Trust::distrust, fmt::format("The simulation of output {} is worse than none at all (fit {}){}.",
                                           name(v.simulation.fit), percent(simulation),
                                           one_step >= bounds::good_fit
                                               ? fmt::format("; predictions with the observer in the loop are not ({})",
                                                             percent_range(v.one_step.fit))
                                               : ""));
    else if (simulation < bounds::poor_fit && one_step >= bounds::good_fit)
      against(
          Trust::look_closer,
          fmt::format("Simulated outputs leave the measured ones (output {}: {}), one-step predictions don't ({}): use "
                      "the model with its observer in the loop, not alone.",
                      name(v.simulation.fit), percent(simulation), percent_range(v.one_step.fit)));
    else if (simulation < bounds::poor_fit)
      against(Trust::distrust,
              fmt::format("The simulation fits output {} to {} only.", name(v.simulation.fit), percent(simulation)));
    else if (simulation < bounds::good_fit)
      against(Trust::look_closer, fmt::format("The simulation fits output {} to {}; {:.0f} % or more would be good.",
                                              name(v.simulation.fit), percent(simulation), bounds::good_fit));
    if (!found_.error_peaks.empty())
      against(Trust::look_closer, fmt::format("One-step errors at {} are more than {:.0f} times the median.",
                                              step_list(found_.error_peaks), bounds::error_peak));
    return true;
  }

  void test_data() {
    const Index from = found_.identified_from, unknowns = found_.unknowns;
    if (options_.evaluation == Evaluation::training) {
      if (from > 0 && from < 3 * unknowns)
        against(Trust::look_closer,
                fmt::format("Tested on training data alone, {} for {} unknowns per output and step: such a fit proves "
                            "little. Hold experiments back, or measure new ones.",
                            plural(from, "experiment"), unknowns));
      else if (from == 0)
        against(Trust::look_closer, "Tested on training data alone, and the number of experiments is not known.");
    } else {
      if (found_.noisy && from > 0 && from < 2 * unknowns)
        against(Trust::look_closer,
                fmt::format("Identified from {} for {} unknowns per output and step: noise enters the model almost "
                            "undamped; {} or more would be better.",
                            plural(from, "experiment"), unknowns, 3 * unknowns));
    }
    if (found_.missing_share > bounds::many_missing)
      against(Trust::look_closer, fmt::format("{:.0f} % of the samples are missing.", 100 * found_.missing_share));
    if (found_.experiments < bounds::few_tested)
      against(Trust::look_closer,
              fmt::format("Only {} tested.", found_.experiments == 1 ? "one experiment was" : "two experiments were"));
  }

  // Inputs that rest where the windows of the given steps reach.
  std::vector<const WeakInput*> causes(const std::vector<Index>& steps) const {
    std::vector<const WeakInput*> result;
    if (options_.evaluation == Evaluation::given) return result;  // other data explain nothing
    for (const WeakInput& weak : found_.weak_inputs) {
      const bool reached = std::any_of(steps.begin(), steps.end(), [&](Index k) {
        const auto first = std::lower_bound(weak.steps.begin(), weak.steps.end(), k - found_.lags);
        return first != weak.steps.end() && *first <= k;
      });
      if (reached) result.push_back(&weak);
    }
    return result;
  }

  std::string rests(const WeakInput& weak) const {
    return fmt::format("input {} is nearly constant at {}", found_.names.input(weak.input), step_list(weak.steps));
  }
  std::string spread(const WeakInput& weak) const {
    return fmt::format("its spread over the experiments falls to {} % of the usual one", figure(100 * weak.spread, 2));
  }

  void regressions() {
    const std::vector<const WeakInput*> explained = causes(found_.ill);
    if (!found_.ill.empty()) {
      std::vector<std::string> briefly, fully;
      for (const WeakInput* weak : explained) {
        briefly.push_back(rests(*weak));
        fully.push_back(fmt::format("{} ({})", rests(*weak), spread(*weak)));
      }
      std::string steps = step_list(found_.ill);
      steps[0] = 'S';
      remark_ = fmt::format("{} {} ill-conditioned{}{}.", steps, found_.ill.size() == 1 ? "is" : "are",
                            briefly.empty() ? "" : ": ", fmt::join(briefly, ", "));
      std::string why = fmt::format("{}", fmt::join(fully, "; "));
      if (why.empty() && found_.identified_from > 0 && found_.identified_from < 2 * found_.unknowns)
        why = fmt::format("{} are few for {} unknowns", plural(found_.identified_from, "experiment"), found_.unknowns);
      if (why.empty()) why = "some inputs or outputs of neighbouring steps are almost dependent over the experiments";
      against(
          Trust::look_closer,
          fmt::format("Condition numbers reach {} at {}, against a median of {}: {}. Expect few correct digits of "
                      "the matrices there.",
                      figure(found_.condition_max, 2), step_list(found_.ill), figure(found_.condition_median, 2), why));
    }
    for (const WeakInput& weak : found_.weak_inputs) {
      if (std::find(explained.begin(), explained.end(), &weak) != explained.end()) continue;
      std::string text = rests(weak);
      text[0] = 'I';
      if (remark_.empty()) remark_ = text + ".";
      const bool given = options_.evaluation == Evaluation::given;
      against(Trust::look_closer, fmt::format("{} ({}): its effect there is hardly tested{}.", text, spread(weak),
                                              given ? "" : ", nor well identified from such data"));
    }
    if (found_.noisy && !found_.deficient.empty() && Index(found_.deficient.size()) > found_.lags)
      against(Trust::look_closer, fmt::format("The regressions of {} lack rank: part of their effects can't be told "
                                              "apart, and the smallest solution stands in.",
                                              step_list(found_.deficient)));
  }

  void whiteness() {
    if (!found_.correlated || found_.correlation < bounds::correlation) return;
    against(Trust::look_closer,
            fmt::format("The innovations are correlated in time ({}, up to {:.2f} at lag {}): the model leaves "
                        "something unexplained that more lags or states might take up.",
                        probability(found_.validation.whiteness_p), found_.correlation, found_.correlation_lag));
  }

  const Model& model_;
  const Evidence& found_;
  const ReportOptions& options_;
  Verdict verdict_;
  std::vector<std::pair<Trust, std::string>> reasons_;
  std::string remark_;  // on single steps, for the summary
};

}  // namespace

Verdict verdict_of(const Model& model, const Evidence& found, const ReportOptions& options) {
  return Judge(model, found, options).judge();
}

}  // namespace report

Verdict verdict(const Model& model, const Ensemble& data, const ReportOptions& options) {
  const report::Tested tested = report::tested(model, data, options);
  return report::verdict_of(model, report::evidence(model, tested.data, tested.options), tested.options);
}

}  // namespace tokid
