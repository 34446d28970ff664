// Turns the numbers of a report into a verdict in plain words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>

#include "model/comparison.hpp"
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

// "2 of 3 outputs"
std::string count_of(Index count, Index all, std::string_view noun) {
  return fmt::format("{} of {}", count, plural(all, noun));
}

// The figures that decided a test of the innovations, and their bounds.
struct Decision {
  std::string found, needed;
};

// The gains have their figures as shares of the simulated output. `gains`: of all inputs of the model.
Decision gains_decision(const Conclusion& c, const InputGains& gains) {
  using Reason = Conclusion::Reason;
  double error = 0.0, interval = 0.0;  // the largest ones, as shares of the simulated output
  for (size_t i = 0; i < c.channels.size(); ++i) {
    const double share = std::min(1.0, gains.share(c.channels[i].index));
    error = std::max(error, std::abs(c.errors[i]) * share);
    interval = std::max(interval, share > 0 ? c.intervals[i] * share : 0.0);
  }
  const auto share_text = [](double share) {
    return std::isfinite(share) ? fmt::format("{} %", figure(100 * share, 3)) : std::string("all");
  };
  if (c.reason == Reason::gains_unknown)
    return {fmt::format("99 % interval of ± {} of the simulation", share_text(interval)),
            fmt::format("± {:.0f} % or less", 100 * counts::gain_unknown)};
  if (c.reason == Reason::gains_wrong)
    return {fmt::format("significant error of {} of the simulation", share_text(error)),
            fmt::format("no significant error, or one below {:.0f} %", 100 * counts::gain)};
  if (c.reason == Reason::gains_lost_in_noise)
    return {fmt::format("99 % interval of ± {} of the simulation, no significant error", share_text(interval)),
            fmt::format("± {:.0f} % or less, and no significant error of {:.0f} % or more", 100 * counts::gain_unknown,
                        100 * counts::gain)};
  return {
      fmt::format("99 % interval of ± {} of the effect, no significant error", share_text(c.numbers.at("interval"))),
      fmt::format("no significant error of {:.0f} % of the simulation or more", 100 * counts::gain)};
}

// The reason of the conclusion selects the words, so that they state the rule that decided.
Decision decision(const Conclusion& c, const Validation& v) {
  using Reason = Conclusion::Reason;
  const auto number = [&](const char* key) { return c.numbers.at(key); };
  const std::string by_chance = fmt::format("p of {} or more", unlikely);
  const std::string small = fmt::format("a correlation below {:.1f}", counts::correlation);
  switch (c.reason) {
    case Reason::white:
    case Reason::inputs_explain_nothing:
      return {probability(number("p")), by_chance};
    case Reason::correlated:
    case Reason::inputs_explain_part:
      return {fmt::format("{}, correlation {}", probability(number("p")), figure(number("correlation"), 3)),
              fmt::format("{}, or {}", by_chance, small)};
    case Reason::correlated_on_average:
      return {
          fmt::format("correlation {} on average over the steps, beyond its bound", figure(number("correlation"), 3)),
          fmt::format("no correlation beyond 1.5 times its bound, or {}", small)};
    case Reason::size_as_stated:
    case Reason::size_of_experiments:
      return {fmt::format("{} times, {}", figure(number("ratio"), 3), probability(number("p"))),
              fmt::format("{:.0f} times the stated covariance or less, for p of {} or more", NormalisedSquares::wild,
                          unlikely)};
    case Reason::size_slightly_smaller:
    case Reason::size_smaller:
    case Reason::size_slightly_larger:
    case Reason::size_larger:
    case Reason::size_overconfident:
      return {
          fmt::format("{} times, {}", figure(number("ratio"), 3), probability(number("p"))),
          fmt::format("{:.0f} times the stated covariance or less, for p below {}", counts::overconfident, unlikely)};
    default:
      return gains_decision(c, v.gains);
  }
}

// Makes the checks in their order. The most severe check determines the status.
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
    verdict_.horizon = found_.deciding.steps;
    if (fits()) {
      test_data();
      regressions();
      differences();
      innovations();
      verdict_.summary = summary();
    }
    std::vector<std::pair<Trust, std::string>> reasons;
    verdict_.trust = Trust::good;
    for (const Check& check : verdict_.checks) {
      verdict_.trust = std::max(verdict_.trust, check.result.value_or(Trust::good));
      for (const VerdictReason& reason : check.reasons) reasons.emplace_back(reason.trust, reason.text);
    }
    std::stable_sort(reasons.begin(), reasons.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    for (auto& [trust, text] : reasons) verdict_.reasons.push_back(std::move(text));
    return std::move(verdict_);
  }

 private:
  using Check = VerdictCheck;

  // A check that has passed until something speaks against the model.
  static Check check(std::string name, std::string subject, std::string found, std::string needed) {
    return {std::move(name), std::move(subject), std::move(found), std::move(needed), Trust::good, {}};
  }
  static Check untested(std::string name, std::string subject, std::string why, std::string needed) {
    return {std::move(name), std::move(subject), std::move(why), std::move(needed), std::nullopt, {}};
  }
  static void against(Check& check, Trust trust, std::string reason) {
    check.result = std::max(check.result.value_or(trust), trust);
    check.reasons.push_back({trust, std::move(reason)});
  }
  void add(Check check) { verdict_.checks.push_back(std::move(check)); }

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

  // The bound of the fits that decide.
  static std::string good_fit() { return fmt::format("{:.0f} % or more for every output", bounds::good_fit); }

  Check simulation_check() const {
    const Validation& v = found_.validation;
    const double simulation = least(simulation_), ahead = least(of_moving(v.horizon.fit));
    Check result = check("simulation_fit", "Simulation fit, which decides", percent_range(simulation_), good_fit());
    if (v.simulation.samples == 0) {
      against(result, Trust::look_closer, "Nothing was simulated: the initial states could not be estimated.");
      return result;
    }
    if (!v.simulation.rmse.allFinite()) {
      against(result, Trust::distrust, "The simulation overflows: the model is unstable over its steps.");
      return result;
    }
    if (std::isinf(simulation)) {
      against(result, Trust::look_closer,
              "No output varies over the simulated steps, so that the fit of the simulation says nothing.");
      return result;
    }
    if (simulation >= bounds::good_fit) return result;
    const std::string output = name_of_worst(simulation_);
    const double exact = least(of_moving(found_.deciding.expected_simulation));
    const std::string promise =
        found_.deciding.stated && std::isfinite(exact) && exact >= bounds::good_fit
            ? fmt::format("; with the noise that the model states, an exact model would reach {}", percent(exact))
            : "";
    if (noise_explains(simulation_, found_.deciding.expected_simulation))
      against(result, Trust::look_closer,
              fmt::format("The simulation fits output {} to {}, and the noise that the model states allows no more.",
                          output, percent(simulation)));
    else if (simulation < bounds::poor_fit && simulation >= 0 && ahead >= bounds::good_fit && !inputs_unknown())
      against(result, Trust::look_closer,
              fmt::format(
                  "The simulation fits output {} to {} only{}. Predictions {} ahead fit {}: use the model only with "
                  "its observer, and only for predictions over as many steps.",
                  output, percent(simulation), promise, plural(found_.horizon, "step"),
                  percent_range(of_moving(v.horizon.fit))));
    else if (simulation < 0)
      against(result, Trust::distrust,
              fmt::format("The simulation of output {} is worse than the mean of the output (fit {}){}.", output,
                          percent(simulation), promise));
    else if (simulation < bounds::poor_fit)
      against(result, Trust::distrust,
              fmt::format("The simulation fits output {} to {} only{}.", output, percent(simulation), promise));
    else
      against(result, Trust::look_closer,
              fmt::format("The simulation fits output {} to {}; {:.0f} % or more would be good{}.", output,
                          percent(simulation), bounds::good_fit, promise));
    return result;
  }

  Check prediction_check() const {
    const DecidingHorizon& h = found_.deciding;
    const double fit = least(deciding_);
    const std::string ahead = plural(h.steps, "step") + " ahead";
    Check result = check("prediction_fit", fmt::format("Prediction fit {}, which decides", ahead),
                         percent_range(deciding_), good_fit());
    const std::string found =
        fmt::format("Predictions {} fit output {} to {}", ahead, name_of_worst(deciding_), percent(fit));
    const std::string exact = fmt::format("those of an exact model would fit {}", percent_range(of_moving(h.expected)));
    if (!h.fit.rmse.allFinite())
      against(result, Trust::distrust, fmt::format("The predictions {} overflow.", ahead));
    else if (std::isinf(fit))
      against(
          result, Trust::look_closer,
          fmt::format("No output varies over the steps of the predictions {}, so that their fit says nothing.", ahead));
    else if (fit < bounds::good_fit && noise_explains(deciding_, h.expected))
      against(result, Trust::look_closer,
              fmt::format("{}, and the noise that the model states allows no more.", found));
    else if (fit < bounds::poor_fit)
      against(result, Trust::distrust, fmt::format("{} only; {}.", found, exact));
    else if (fit < bounds::good_fit)
      against(result, Trust::look_closer, fmt::format("{}; {}.", found, exact));
    return result;
  }

  Check input_effect_check() const {
    const DecidingHorizon& h = found_.deciding;
    Check result = check("input_effect", "Effect of the inputs on the predictions, relative to the prediction error",
                         figure(h.inputs, 3), fmt::format("{:.1f} or more", bounds::inputs_show));
    if (h.inputs < bounds::inputs_show)
      against(result, Trust::look_closer,
              fmt::format(
                  "The effect of the inputs within {} is less than {:.1f} times the errors of the predictions: these "
                  "data hardly test the effect of the inputs.",
                  plural(h.steps, "step"), bounds::inputs_show));
    return result;
  }

  // Ends the assessment if nothing could be compared.
  void nothing_tested(Check check, std::string summary, std::string reason) {
    against(check, Trust::distrust, std::move(reason));
    add(std::move(check));
    verdict_.summary = std::move(summary);
  }

  // Assesses the fits. False: nothing could be compared, so that the other checks are left out.
  bool fits() {
    const Validation& v = found_.validation;
    const Index moving = model_.outputs - Index(found_.constant_outputs.size());
    Check outputs = check("outputs", "Outputs that vary and have samples to compare",
                          count_of(moving, model_.outputs, "output"), "all");
    if (v.simulation.samples == 0 && v.one_step.samples == 0) {
      outputs.found = "no samples";
      nothing_tested(std::move(outputs),
                     fmt::format("Nothing was tested: no output of {} could be compared with the model.", tested()),
                     "No output sample has both a measured and a computed value.");
      return false;
    }
    if (moving == 0) {
      nothing_tested(std::move(outputs), fmt::format("Nothing was tested: no output varies in {}.", tested()),
                     "Constant outputs say nothing about the model, however well it reproduces them.");
      return false;
    }
    for (const Index j : found_.constant_outputs)
      against(
          outputs, Trust::look_closer,
          fmt::format(
              "Output {} is constant in these data, and its fit says nothing: RMS error {} in the one-step "
              "predictions{}.",
              found_.names.output(j), figure(v.one_step.rmse(j), 3),
              v.simulation.samples > 0 ? fmt::format(", {} in the simulation", figure(v.simulation.rmse(j), 3)) : ""));
    add(std::move(outputs));
    add(one_step_check());
    if (found_.deciding.steps > 0) {
      add(prediction_check());
      add(input_effect_check());
    } else {
      add(simulation_check());
    }
    add(error_peak_check());
    add(beyond_noise_check());
    add(outlier_check());
    add(coverage_check());
    return true;
  }

  Check one_step_check() const {
    const Validation& v = found_.validation;
    const std::string needed = fmt::format("{:.0f} % or more for every output", bounds::poor_fit);
    if (v.one_step.samples == 0) return untested("one_step_fit", "One-step prediction fit", "no predictions", needed);
    Check result = check("one_step_fit", "One-step prediction fit", percent_range(one_step_), needed);
    const double one_step = least(one_step_);
    if (v.one_step.rmse.allFinite() && std::isinf(one_step))
      return untested("one_step_fit", "One-step prediction fit", "no output varies over the predicted steps", needed);
    if (!v.one_step.rmse.allFinite())
      against(result, Trust::distrust, "The predictions overflow: the observer does not follow these data.");
    else if (one_step < bounds::poor_fit) {
      const bool noise = noise_explains(one_step_, found_.deciding.expected_one_step);
      against(result, noise ? Trust::look_closer : Trust::distrust,
              fmt::format("One-step predictions fit output {} to {} only{}.", name_of_worst(one_step_),
                          percent(one_step), noise ? ", and the noise that the model states allows no more" : ""));
    }
    return result;
  }

  // "0.43 at step 12", the largest of the values. At least one of them is known.
  static std::string largest(const std::vector<double>& values, const std::function<std::string(Index)>& name) {
    Index most = -1;
    for (size_t i = 0; i < values.size(); ++i)
      if (!std::isnan(values[i]) && (most < 0 || values[i] > values[size_t(most)])) most = Index(i);
    return fmt::format("{} at {}", figure(values[size_t(most)], 3), name(most));
  }
  static std::string step_name(Index k) { return fmt::format("step {}", k); }

  // Why the largest of some errors is not compared with their median; empty if it is. The upper median of one or two
  // values is the largest of them, so that none can exceed a multiple of it.
  static std::string no_median(const std::vector<double>& values, std::string_view noun) {
    constexpr Index fewest = 3;
    const Index known = std::count_if(values.begin(), values.end(), [](double v) { return !std::isnan(v); });
    if (known == 0) return "no errors known";
    return known < fewest ? fmt::format("errors of {} only, at least {} needed", plural(known, noun), fewest) : "";
  }

  Check error_peak_check() const {
    const char* subject = "Largest one-step error of a step, relative to its limit";
    const std::string needed = fmt::format(
        "1 or less; the limit is the largest of {:.0f} times the median, {:.0f} % of the spread of the "
        "outputs and {:.0f} times what the model states",
        bounds::error_peak, 100 * bounds::error_floor, bounds::error_stated);
    if (const std::string why = no_median(found_.step_excess, "step"); !why.empty() && found_.error_peaks.empty())
      return untested("error_peaks", subject, why, needed);
    Check result = check("error_peaks", subject, largest(found_.step_excess, step_name), needed);
    if (!found_.error_peaks.empty())
      against(result, Trust::look_closer,
              fmt::format("One-step errors at {} are more than {:.0f} times the median.", step_list(found_.error_peaks),
                          bounds::error_peak));
    return result;
  }

  Check beyond_noise_check() const {
    const char* subject = "Largest one-step error of a step, relative to that of the identification";
    const std::string needed = fmt::format("{:.0f} or less", bounds::beyond_noise);
    if (std::all_of(found_.noise_excess.begin(), found_.noise_excess.end(), [](double e) { return std::isnan(e); }))
      return untested("beyond_noise", subject,
                      model_.has(&Step::has_innovation_cov) ? "no covariance that is certain enough"
                                                            : "the model states no covariance",
                      needed);
    Check result = check("beyond_noise", subject, largest(found_.noise_excess, step_name), needed);
    if (!found_.beyond_noise.empty())
      against(result, Trust::look_closer,
              fmt::format(
                  "One-step errors at {} are more than {:.0f} times the errors of the identification at these steps.",
                  step_list(found_.beyond_noise), bounds::beyond_noise));
    return result;
  }

  Check outlier_check() const {
    const char* subject = "Largest error of an experiment, in simulation or prediction, relative to its limit";
    const std::string needed = fmt::format(
        "1 or less; the limit is the larger of {:.0f} times the median and {:.0f} % of the spread of the "
        "outputs",
        outlying_experiment, 100 * least_outlying_error);
    const std::vector<double> excess(found_.fits.excess.begin(), found_.fits.excess.end());
    std::vector<Index> outlying;
    for (Index n = 0; n < found_.experiments; ++n)
      if (found_.fits.outlying(n)) outlying.push_back(n);
    if (const std::string why = no_median(excess, "experiment"); !why.empty() && outlying.empty())
      return untested("outliers", subject, why, needed);
    Check result =
        check("outliers", subject,
              largest(excess, [&](Index n) { return fmt::format("experiment {}", found_.experiment(n)); }), needed);
    if (!outlying.empty())
      against(result, Trust::look_closer,
              fmt::format(
                  "Errors of {} are more than {:.0f} times the median of all experiments: look for other conditions, a "
                  "failed sensor, or a model that is not valid there.",
                  experiment_list(found_, outlying), outlying_experiment));
    return result;
  }

  Check coverage_check() const {
    const Index tested = model_.steps() - Index(found_.untested.size());
    Check result = check("coverage", "Steps of the model that the data test", count_of(tested, model_.steps(), "step"),
                         fmt::format("{:.0f} % or more", 100 * bounds::coverage));
    const double share = 1 - double(found_.untested.size()) / double(std::max<Index>(1, model_.steps()));
    if (share < bounds::coverage)
      against(result, Trust::look_closer,
              fmt::format("The data test only {} of the model's {}; they do not test {}.", tested,
                          plural(model_.steps(), "step"), step_list(found_.untested)));
    return result;
  }

  void test_data() {
    add(training_check());
    Check missing = check("missing", "Missing samples",
                          found_.missing == 0 ? "none" : fmt::format("{} %", figure(100 * found_.missing_share, 2)),
                          fmt::format("{:.0f} % or less", 100 * bounds::many_missing));
    if (found_.missing_share > bounds::many_missing)
      against(missing, Trust::look_closer,
              fmt::format("{:.0f} % of the samples are missing.", 100 * found_.missing_share));
    add(std::move(missing));
    Check experiments = check("experiments", "Experiments tested", fmt::format("{}", found_.experiments),
                              fmt::format("{} or more", bounds::few_tested));
    if (found_.experiments < bounds::few_tested)
      against(experiments, Trust::look_closer,
              fmt::format("Only {} tested.", found_.experiments == 1 ? "one experiment was" : "two experiments were"));
    add(std::move(experiments));
  }

  // The fit on training data proves little if they were few. Noise is hardly averaged out of a model from few data.
  Check training_check() const {
    const Index from = found_.samples, unknowns = found_.unknowns;
    const bool training = options_.evaluation == Evaluation::training;
    const char* subject = "Experiments of the identification for each unknown";
    const std::string needed =
        fmt::format("{} or more{}", training ? bounds::training_samples : bounds::samples,
                    training ? ", because the model is tested on the data that it was identified from" : "");
    if (from == 0 && !training) return untested("samples", subject, "not known", needed);
    if (from > 0 && unknowns == 0) return untested("samples", subject, "the model has no lag order", needed);
    if (!training && !found_.noisy) return untested("samples", subject, "data without noise", needed);
    Check result =
        check("samples", subject, from == 0 ? "not known" : figure(double(from) / double(unknowns), 3), needed);
    if (from == 0)
      against(result, Trust::look_closer,
              "Tested only on training data, and the number of training experiments is not known: test on new "
              "experiments.");
    else if (training && from < bounds::training_samples * unknowns)
      against(result, Trust::look_closer,
              fmt::format("Tested only on training data, {} for {} unknowns per output and step: such a fit proves "
                          "little. Hold experiments back, or measure new ones.",
                          plural(found_.identified_from, "experiment"), unknowns));
    else if (!training && from < bounds::samples * unknowns)
      against(result, Trust::look_closer,
              fmt::format("Identified from {} for {} unknowns per output and step: noise is hardly averaged out of "
                          "the model. Use {} or more.",
                          plural(found_.identified_from, "experiment"), unknowns, bounds::training_samples * unknowns));
    return result;
  }

  // Does the window of step k contain a step at which this input is nearly the same in all experiments?
  bool explains(const WeakInput& weak, Index k) const {
    const auto first = std::lower_bound(weak.steps.begin(), weak.steps.end(), k - found_.lags);
    return weak.always || (first != weak.steps.end() && *first <= k);
  }

  std::string constancy(const WeakInput& weak) const {
    if (weak.always)
      return fmt::format("input {} is {}", found_.names.input(weak.input),
                         found_.inputs_over_time ? "constant in these data" : "the same in all experiments");
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
    add(condition_check(explained, unexplained, causes));
    add(weak_input_check(causes));
    add(rank_check());
  }

  Check condition_check(const std::vector<Index>& explained, const std::vector<Index>& unexplained,
                        const std::vector<const WeakInput*>& causes) {
    const char* subject = "Largest condition number of a regression";
    const std::string needed = fmt::format("{} or less", figure(found_.condition_limit, 3));
    if (std::isnan(found_.condition_max)) return untested("condition", subject, "the model has none", needed);
    Check result = check("condition", subject, figure(found_.condition_max, 3), needed);
    const auto ill = [](const std::vector<Index>& steps) {
      return fmt::format("{} {} ill-conditioned", capital(step_list(steps)), steps.size() == 1 ? "is" : "are");
    };
    const auto against_steps = [&](const std::vector<Index>& steps, const std::string& why) {
      against(result, Trust::look_closer,
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
          found_.samples > 0 && found_.samples < bounds::samples * found_.unknowns
              ? fmt::format("{} are few for {} unknowns", plural(found_.identified_from, "experiment"), found_.unknowns)
              : "some inputs or outputs of neighbouring steps are almost dependent over the experiments");
    }
    return result;
  }

  // The reasons of condition_check() name an input that explains an ill-conditioned step.
  Check weak_input_check(const std::vector<const WeakInput*>& causes) {
    const char* subject = found_.inputs_over_time ? "Inputs that vary over time or between the experiments"
                                                  : "Inputs that vary between the experiments at every step";
    if (model_.inputs == 0) return untested("inputs", subject, "the model has no inputs", "all");
    if (found_.assessed_inputs == 0)
      return untested("inputs", subject,
                      found_.inputs_over_time ? "too few samples of the inputs"
                                              : "samples of fewer than 3 experiments at every step",
                      "all");
    const Index varying = found_.assessed_inputs - Index(found_.weak_inputs.size());
    Check result = check("inputs", subject, count_of(varying, found_.assessed_inputs, "input"), "all");
    if (found_.assessed_inputs < model_.inputs)
      result.found +=
          fmt::format(", too few samples of {}", plural(model_.inputs - found_.assessed_inputs, "other input"));
    if (!causes.empty()) result.result = Trust::look_closer;
    for (const WeakInput& weak : found_.weak_inputs) {
      if (std::find(causes.begin(), causes.end(), &weak) != causes.end()) continue;
      const std::string text = capital(constancy(weak));
      if (remark_.empty()) remark_ = text + ".";
      const char* effect = options_.evaluation == Evaluation::training ? "its effect there can hardly be identified"
                                                                       : "its effect there is hardly tested";
      if (weak.always)
        against(result,
                inputs_unknown() && !(least(deciding_) >= bounds::good_fit) ? Trust::distrust : Trust::look_closer,
                fmt::format("{}: its effect is not known.", text));
      else
        against(result, Trust::look_closer, fmt::format("{} ({}): {}.", text, spread(weak), effect));
    }
    return result;
  }

  Check rank_check() const {
    const char* subject = "Regressions without full rank";
    const std::string needed = fmt::format("{} or fewer, the lag order", found_.lags);
    if (!model_.has(&Step::has_rank)) return untested("rank", subject, "the model has no ranks", needed);
    const std::string steps = plural(Index(found_.deficient.size()), "step");
    if (!found_.noisy) return untested("rank", subject, steps + ", which is usual without noise", needed);
    Check result = check("rank", subject, steps, needed);
    if (!found_.deficient.empty() && Index(found_.deficient.size()) > found_.lags)
      against(result, Trust::look_closer,
              fmt::format("The regressions of {} lack full rank: some effects can't be separated, and the solution of "
                          "smallest norm is used.",
                          step_list(found_.deficient)));
    return result;
  }

  void differences() {
    Check result = check(
        "channels", "Sample time and names of the channels",
        found_.differences.empty() ? "those of the model" : plural(Index(found_.differences.size()), "difference"),
        "those of the model");
    for (const std::string& text : in_words(found_.differences))
      against(result, Trust::look_closer, capital(text) + ".");
    add(std::move(result));
  }

  void innovations() {
    const Conclusions& c = found_.conclusions;
    const auto test = [&](const char* subject, const Conclusion& conclusion, std::string_view rule) {
      const char* name = to_string(conclusion.test);
      if (conclusion.result == TestResult::untested) {
        add(untested(name, subject, in_words(conclusion), std::string(rule)));
        return;
      }
      if (const auto p = conclusion.numbers.find("p"); p != conclusion.numbers.end() && std::isnan(p->second)) {
        add(untested(name, subject, "too few samples for a probability", std::string(rule)));
        return;
      }
      Decision decided = decision(conclusion, found_.validation);
      Check result = check(name, subject, std::move(decided.found), std::move(decided.needed));
      if (conclusion.result == TestResult::against)
        against(result, Trust::look_closer, fmt::format("{}: {}.", subject, in_words(conclusion)));
      add(std::move(result));
    };
    test("Whiteness of the innovations", c.whiteness, "no correlation in time");
    test("Inputs and innovations", c.independence, "no correlation with past and present inputs");
    test("Effects of the inputs", c.gains, "those of the model");
    test("Squared innovations", c.nis, "those that the model states");
  }

  const Model& model_;
  const Evidence& found_;
  const ReportOptions& options_;
  Vector simulation_, one_step_, deciding_;  // fits of the outputs; NaN for constant outputs
  Verdict verdict_;
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
