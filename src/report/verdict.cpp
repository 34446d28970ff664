// Turns the numbers of a report into the checks of a verdict, with their reasons in plain words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <optional>

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

std::vector<double> values_of(const Vector& fits) { return {fits.begin(), fits.end()}; }

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
  using Kind = Check::Kind;
  using Rule = CheckFigure::Rule;
  using Untested = Check::Untested;

  // A check that has passed until something speaks against the model.
  static Check check(Kind kind, CheckFigure figure) {
    Check result;
    result.kind = kind;
    result.figures.push_back(std::move(figure));
    result.result = Trust::good;
    return result;
  }
  static Check untested(Check check, Untested why) {
    check.result.reset();
    check.untested = why;
    return check;
  }
  static void against(Check& check, Trust trust, std::string reason) {
    check.result = std::max(check.result.value_or(trust), trust);
    check.reasons.push_back({trust, std::move(reason)});
  }
  // An exception that keeps a small fit from leading to distrust removes this limit.
  void add(Check check) {
    for (CheckFigure& figure : check.figures)
      if (check.result && *check.result != Trust::distrust &&
          std::any_of(figure.values.begin(), figure.values.end(), [&](double v) { return v < figure.distrust; }))
        figure.distrust = std::numeric_limits<double>::quiet_NaN();
    verdict_.checks.push_back(std::move(check));
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
    text += '.' + of_cross_validation();
    if (verdict_.horizon > 0) text += fmt::format(" {}", why_not_simulation());
    const bool allowed = std::any_of(verdict_.checks.begin(), verdict_.checks.end(), [](const Check& c) {
      return (c.kind == Kind::simulation_fit || c.kind == Kind::prediction_fit) && c.one_suffices;
    });
    if (allowed) text += " The noise does not permit a better fit.";
    if (!remark_.empty()) text += " " + remark_;
    return text;
  }

  std::string why_not_simulation() const {
    const DecidingHorizon& h = found_.deciding;
    std::string text = fmt::format("The model is evaluated by predictions {} ahead (fit {}): ", plural(h.steps, "step"),
                                   percent_range(deciding_));
    const char* noise = h.stated ? "the noise that the model states" : "noise as large as its innovations";
    const double exact = least(of_moving(h.expected_simulation));
    return text + fmt::format("{} would make even the simulation of an exact model bad ({}).", noise,
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

  // A small fit passes if the noise explains it and cross-validation finds no better regression. The noise that a model
  // states is no proof alone, and a regression is no proof of itself.
  void allow_noise(Check& check, const Fit& of, const Vector& found, const Vector& expected) const {
    if (check.kept() || !of.rmse.allFinite() || !noise_explains(found, expected)) return;
    if (model_.method == "regression" || regression_check().result != Trust::good) return;
    CheckFigure figure{"error_over_exact", {}, Rule::at_most, bounds::as_expected};
    for (Index j = 0; j < found.size(); ++j)
      if (found(j) < bounds::good_fit) figure.values.push_back((100 - found(j)) / (100 - expected(j)));
    check.one_suffices = !figure.values.empty();
    if (check.one_suffices) check.figures.push_back(std::move(figure));
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

  // The figures of fits. An overflow is worse than every fit.
  static CheckFigure fit_figure(const Vector& fits, const Fit& of, double bound) {
    CheckFigure figure{"fit", values_of(fits), Rule::at_least, bound, bounds::poor_fit};
    for (Index j = 0; of.samples > 0 && j < fits.size(); ++j)
      if (!std::isfinite(of.rmse(j))) figure.values[size_t(j)] = -std::numeric_limits<double>::infinity();
    return figure;
  }

  Check simulation_check() const {
    const Validation& v = found_.validation;
    const double simulation = least(simulation_), ahead = least(of_moving(v.horizon.fit));
    Check result = check(Kind::simulation_fit, fit_figure(simulation_, v.simulation, bounds::good_fit));
    allow_noise(result, v.simulation, simulation_, found_.deciding.expected_simulation);
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
              "No output varies over the simulated steps, so the fit of the simulation has no meaning.");
      return result;
    }
    if (result.kept()) return result;
    const std::string output = name_of_worst(simulation_);
    const double exact = least(of_moving(found_.deciding.expected_simulation));
    const std::string promise =
        found_.deciding.stated && std::isfinite(exact) && exact >= bounds::good_fit
            ? fmt::format("; with the noise that the model states, an exact model would reach {}", percent(exact))
            : "";
    if (noise_explains(simulation_, found_.deciding.expected_simulation))
      against(
          result, Trust::look_closer,
          fmt::format(
              "The simulation fit of output {} is {}, and the noise that the model states does not permit a better fit.",
              output, percent(simulation)));
    else if (simulation < bounds::poor_fit && simulation >= 0 && ahead >= bounds::good_fit && !inputs_unknown())
      against(result, Trust::look_closer,
              fmt::format(
                  "The simulation fit of output {} is only {}{}. Predictions {} ahead have a fit of {}: use the model "
                  "only with its observer, and only for predictions over as many steps.",
                  output, percent(simulation), promise, plural(found_.horizon, "step"),
                  percent_range(of_moving(v.horizon.fit))));
    else if (simulation < 0)
      against(result, Trust::distrust,
              fmt::format("The simulation of output {} is worse than the mean of the output (fit {}){}.", output,
                          percent(simulation), promise));
    else if (simulation < bounds::poor_fit)
      against(result, Trust::distrust,
              fmt::format("The simulation fit of output {} is only {}{}.", output, percent(simulation), promise));
    else
      against(result, Trust::look_closer,
              fmt::format("The simulation fit of output {} is {}; {:.0f} % or more would be good{}.", output,
                          percent(simulation), bounds::good_fit, promise));
    return result;
  }

  Check prediction_check() const {
    const DecidingHorizon& h = found_.deciding;
    const double fit = least(deciding_);
    const std::string ahead = plural(h.steps, "step") + " ahead";
    Check result = check(Kind::prediction_fit, fit_figure(deciding_, h.fit, bounds::good_fit));
    result.numbers = {{"horizon", double(h.steps)}};
    allow_noise(result, h.fit, deciding_, h.expected);
    const std::string found =
        fmt::format("For output {}, the fit of predictions {} is {}", name_of_worst(deciding_), ahead, percent(fit));
    const std::string exact =
        fmt::format("predictions of an exact model would have a fit of {}", percent_range(of_moving(h.expected)));
    if (!h.fit.rmse.allFinite())
      against(result, Trust::distrust, fmt::format("The predictions {} overflow.", ahead));
    else if (std::isinf(fit))
      against(
          result, Trust::look_closer,
          fmt::format("No output varies over the steps of the predictions {}, so their fit has no meaning.", ahead));
    else if (result.kept())
      return result;
    else if (noise_explains(deciding_, h.expected))
      against(result, Trust::look_closer,
              fmt::format("{}, and the noise that the model states does not permit a better fit.", found));
    else if (fit < bounds::poor_fit)
      against(result, Trust::distrust, fmt::format("{}, which is too small; {}.", found, exact));
    else
      against(result, Trust::look_closer, fmt::format("{}; {}.", found, exact));
    return result;
  }

  Check input_effect_check() const {
    const DecidingHorizon& h = found_.deciding;
    Check result = check(Kind::input_effect, {"effect_over_error", {h.inputs}, Rule::at_least, bounds::inputs_show});
    if (!result.kept())
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
    Check outputs = check(Kind::outputs, {"varying", {double(moving)}, Rule::at_least, double(model_.outputs)});
    if (v.simulation.samples == 0 && v.one_step.samples == 0) {
      outputs.figures.front().values.clear();
      nothing_tested(std::move(outputs),
                     fmt::format("Nothing was tested: no output of {} could be compared with the model.", tested()),
                     "No output sample has both a measured and a computed value.");
      return false;
    }
    if (moving == 0) {
      nothing_tested(std::move(outputs), fmt::format("Nothing was tested: no output varies in {}.", tested()),
                     "Constant outputs do not test a model, however well the model reproduces them.");
      return false;
    }
    for (const Index j : found_.constant_outputs)
      against(outputs, Trust::look_closer,
              fmt::format(
                  "Output {} is constant in these data, so its fit has no meaning. Its RMS error is {} in the one-step "
                  "predictions{}.",
                  found_.names.output(j), figure(v.one_step.rmse(j), 3),
                  v.simulation.samples > 0 ? fmt::format(" and {} in the simulation", figure(v.simulation.rmse(j), 3))
                                           : ""));
    add(std::move(outputs));
    add(one_step_check());
    if (found_.deciding.steps > 0) {
      add(prediction_check());
      add(input_effect_check());
    } else {
      add(simulation_check());
    }
    add(regression_check());
    add(error_peak_check());
    add(beyond_noise_check());
    add(outlier_check());
    add(coverage_check());
    return true;
  }

  Check one_step_check() const {
    const Validation& v = found_.validation;
    Check result = check(Kind::one_step_fit, fit_figure(one_step_, v.one_step, bounds::poor_fit));
    allow_noise(result, v.one_step, one_step_, found_.deciding.expected_one_step);
    if (v.one_step.samples == 0) return untested(std::move(result), Untested::no_predictions);
    const double one_step = least(one_step_);
    if (v.one_step.rmse.allFinite() && std::isinf(one_step))
      return untested(std::move(result), Untested::no_varying_output);
    if (!v.one_step.rmse.allFinite())
      against(result, Trust::distrust, "The predictions overflow: the observer does not follow these data.");
    else if (!result.kept()) {
      const bool noise = noise_explains(one_step_, found_.deciding.expected_one_step);
      against(result, noise ? Trust::look_closer : Trust::distrust,
              fmt::format("The one-step prediction fit of output {} is only {}{}.", name_of_worst(one_step_),
                          percent(one_step),
                          noise ? ", and the noise that the model states does not permit a better fit" : ""));
    }
    return result;
  }

  // "3.9, 4.6 and 6.3 %"
  static std::string percents(const auto& errors) {
    std::vector<std::string> texts;
    for (const double error : errors) texts.push_back(figure(100 * error, 2));
    return words::listed(texts) + " %";
  }

  static std::string steps_ahead(const std::vector<Index>& horizons) {
    std::vector<std::string> texts;
    for (const Index h : horizons) texts.push_back(std::to_string(h));
    return fmt::format("{} step{} ahead", words::listed(texts), horizons.back() == 1 ? "" : "s");
  }

  // Simple regressions are rivals that every model must stand up to.
  Check regression_check() const {
    Check result = check(Kind::regression, {"error_over_regression", {}, Rule::at_most, bounds::over_regression});
    if (!options_.comparison) return untested(std::move(result), Untested::no_cross_validation);
    const RegressionComparison& c = *options_.comparison;
    std::vector<Index> worse;  // horizons at which the regression is better, and the errors there
    std::vector<double> of_model, of_regression;
    for (Index i = 0; i < c.model.error.size(); ++i) {
      const double ratio = c.model.error(i) / c.regression.error(i);
      if (!std::isnan(ratio)) result.figures.front().values.push_back(ratio);
      if (!(ratio > bounds::over_regression)) continue;
      worse.push_back(c.horizons[size_t(i)]);
      of_model.push_back(c.model.error(i));
      of_regression.push_back(c.regression.error(i));
    }
    if (result.figures.front().values.empty()) return untested(std::move(result), Untested::no_cross_validation);
    if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format("A regression with {} predicts held-out experiments better {}: its errors are {} of the "
                          "departures from the mean motion, those of the model {}.",
                          plural(c.lags, "lag"), steps_ahead(worse), percents(of_regression), percents(of_model)));
    return result;
  }

  // What cross-validation says, which the fit on training data cannot.
  std::string of_cross_validation() const {
    if (!options_.comparison || options_.evaluation != Evaluation::training) return "";
    const RegressionComparison& c = *options_.comparison;
    if (!c.model.standard_error.allFinite() || !c.regression.error.allFinite()) return "";
    const bool itself = model_.method == "regression";
    return fmt::format(" In cross-validation, the errors {} are {} of the departures from the mean motion (± {}){}.",
                       steps_ahead(c.horizons), percents(c.model.error), percents(c.model.standard_error),
                       itself ? "" : fmt::format(", and those of a regression {}", percents(c.regression.error)));
  }

  // Where the largest of the values is; empty if none is known.
  static std::optional<Index> largest(const std::vector<double>& values) {
    std::optional<Index> most;
    for (size_t i = 0; i < values.size(); ++i)
      if (!std::isnan(values[i]) && (!most || values[i] > values[size_t(*most)])) most = Index(i);
    return most;
  }

  // A check of the largest of some errors.
  static Check largest_check(Kind kind, const char* quantity, const std::vector<double>& errors, double bound) {
    Check result = check(kind, {quantity, {}, Rule::at_most, bound});
    if (const std::optional<Index> most = largest(errors)) result.figures.front().values = {errors[size_t(*most)]};
    return result;
  }

  // Leaves out a check of too few errors for their median. The upper median of one or two values is the largest of
  // them, so that none can exceed a multiple of it.
  static bool few_errors(Check& check, const std::vector<double>& errors) {
    constexpr Index fewest = 3;
    const Index known = std::count_if(errors.begin(), errors.end(), [](double v) { return !std::isnan(v); });
    if (known >= fewest || (known > 0 && !check.kept())) return false;
    check.numbers["count"] = double(known);
    check.numbers["fewest"] = double(fewest);
    check = untested(std::move(check), Untested::few_errors);
    return true;
  }

  Check error_peak_check() const {
    Check result = largest_check(Kind::error_peaks, "error_over_limit", found_.step_excess, 1.0);
    if (const auto step = largest(found_.step_excess)) result.numbers["step"] = double(*step);
    if (few_errors(result, found_.step_excess)) return result;
    if (!result.kept())
      against(
          result, Trust::look_closer,
          fmt::format("One-step errors at {} are more than {:.0f} times the median error of all steps, more than by "
                      "chance.",
                      step_list(found_.error_peaks), bounds::error_peak));
    return result;
  }

  Check beyond_noise_check() const {
    Check result = largest_check(Kind::beyond_noise, "error_over_stated", found_.noise_excess, bounds::beyond_noise);
    const std::optional<Index> step = largest(found_.noise_excess);
    if (!step)
      return untested(std::move(result),
                      model_.has(&Step::has_innovation_cov) ? Untested::uncertain_covariance : Untested::no_covariance);
    result.numbers["step"] = double(*step);
    if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format(
                  "One-step errors at {} are more than {:.0f} times the errors of the identification at these steps.",
                  step_list(found_.beyond_noise), bounds::beyond_noise));
    return result;
  }

  Check outlier_check() const {
    const std::vector<double> excess(found_.fits.excess.begin(), found_.fits.excess.end());
    std::vector<Index> outlying;
    for (Index n = 0; n < found_.experiments; ++n)
      if (found_.fits.outlying(n)) outlying.push_back(n);
    Check result = largest_check(Kind::outliers, "error_over_limit", excess, 1.0);
    if (const auto worst = largest(excess))
      result.experiment = {found_.rows[size_t(*worst)], found_.experiment_names[size_t(*worst)]};
    if (few_errors(result, excess)) return result;
    if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format(
                  "Errors of {} are more than {:.0f} times the median of all experiments. Check whether the conditions "
                  "differ, a sensor failed, or the model is not valid for these experiments.",
                  experiment_list(found_, outlying), outlying_experiment));
    return result;
  }

  Check coverage_check() const {
    const Index tested = model_.steps() - Index(found_.untested.size());
    const double share = 1 - double(found_.untested.size()) / double(std::max<Index>(1, model_.steps()));
    Check result = check(Kind::coverage, {"share", {share}, Rule::at_least, bounds::coverage});
    result.numbers = {{"tested", double(tested)}, {"steps", double(model_.steps())}};
    if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format("The data test only {} of the model's {}; the data do not test {}.", tested,
                          plural(model_.steps(), "step"), step_list(found_.untested)));
    return result;
  }

  void test_data() {
    add(training_check());
    Check missing = check(Kind::missing, {"share", {found_.missing_share}, Rule::at_most, bounds::many_missing});
    if (!missing.kept())
      against(missing, Trust::look_closer,
              fmt::format("{:.0f} % of the samples are missing.", 100 * found_.missing_share));
    add(std::move(missing));
    Check experiments =
        check(Kind::experiments, {"count", {double(found_.experiments)}, Rule::at_least, double(bounds::few_tested)});
    if (!experiments.kept())
      against(experiments, Trust::look_closer,
              fmt::format("The model was tested on only {}.",
                          found_.experiments == 1 ? "one experiment" : "two experiments"));
    add(std::move(experiments));
  }

  // The fit on training data proves little if they were few. Noise is hardly averaged out of a model from few data.
  Check training_check() const {
    const Index from = found_.samples, unknowns = found_.unknowns;
    const bool training = options_.evaluation == Evaluation::training;
    Check result = check(
        Kind::samples,
        {"experiments_per_unknown", {}, Rule::at_least, double(training ? bounds::training_samples : bounds::samples)});
    result.numbers = {{"training", training ? 1.0 : 0.0}};
    if (from > 0 && unknowns > 0) result.figures.front().values = {double(from) / double(unknowns)};
    if (from == 0 && !training) return untested(std::move(result), Untested::unknown_experiments);
    if (from > 0 && unknowns == 0) return untested(std::move(result), Untested::no_lag_order);
    if (!training && !found_.noisy) return untested(std::move(result), Untested::without_noise);
    if (from == 0)
      against(
          result, Trust::look_closer,
          "The model was tested only on training data, and the number of training experiments is not known. Test the "
          "model on new experiments.");
    else if (training && !result.kept())
      against(result, Trust::look_closer,
              fmt::format("The model was tested only on its training data: {} for {} unknowns per output and step. "
                          "A good fit on so few data proves little. Hold experiments out, or measure new experiments.",
                          plural(found_.identified_from, "experiment"), unknowns));
    else if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format("The model was identified from {} for {} unknowns per output and step: averaging hardly "
                          "reduces the noise of the model. Use {} experiments or more.",
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
    return fmt::format("its spread over the experiments falls to {} % of the median of all steps",
                       figure(100 * weak.spread, 2));
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
    Check result = check(Kind::condition, {"condition", {found_.condition_max}, Rule::at_most, found_.condition_limit});
    if (std::isnan(found_.condition_max)) return untested(std::move(result), Untested::no_regressions);
    const auto ill = [](const std::vector<Index>& steps) {
      return fmt::format("{} {} ill-conditioned", capital(step_list(steps)), steps.size() == 1 ? "is" : "are");
    };
    const auto against_steps = [&](const std::vector<Index>& steps, const std::string& why) {
      against(
          result, Trust::look_closer,
          fmt::format("Condition numbers reach {} at {}, but their median is {}: {}. The matrices of these steps have "
                      "few correct digits.",
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
              : "some inputs or outputs of neighbouring steps are almost linearly dependent in all experiments");
    }
    return result;
  }

  // The reasons of condition_check() name an input that explains an ill-conditioned step.
  Check weak_input_check(const std::vector<const WeakInput*>& causes) {
    const double varying = double(found_.assessed_inputs - Index(found_.weak_inputs.size()));
    Check result = check(Kind::inputs, {"varying", {varying}, Rule::at_least, double(found_.assessed_inputs)});
    result.numbers = {{"inputs", double(model_.inputs)}, {"over_time", found_.inputs_over_time ? 1.0 : 0.0}};
    if (std::any_of(found_.input_spread.begin(), found_.input_spread.end(), [](double v) { return !std::isnan(v); }))
      result.figures.push_back({"spread", found_.input_spread, Rule::at_least, bounds::weak_input});
    result.figures.push_back({"dependent", {double(found_.dependent_inputs.size())}, Rule::at_most, 0.0});
    if (model_.inputs == 0) return untested(std::move(result), Untested::no_inputs);
    if (found_.assessed_inputs == 0) return untested(std::move(result), Untested::few_input_samples);
    if (!result.kept()) result.result = Trust::look_closer;
    for (const WeakInput& weak : found_.weak_inputs) {
      if (std::find(causes.begin(), causes.end(), &weak) != causes.end()) continue;
      const std::string text = capital(constancy(weak));
      if (remark_.empty()) remark_ = text + ".";
      const char* effect = options_.evaluation == Evaluation::training
                               ? "its effect at these steps can hardly be identified"
                               : "its effect at these steps is hardly tested";
      if (weak.always)
        against(result,
                inputs_unknown() && !(least(deciding_) >= bounds::good_fit) ? Trust::distrust : Trust::look_closer,
                fmt::format("{}: its effect is not known.", text));
      else
        against(result, Trust::look_closer, fmt::format("{} ({}): {}.", text, spread(weak), effect));
    }
    // Predictions under the same dependence can be good, whatever the model says about the effects of the inputs.
    for (const std::string& text : in_words(found_.dependent_inputs))
      against(result, Trust::look_closer, capital(text) + ".");
    return result;
  }

  Check rank_check() const {
    Check result = check(Kind::rank, {"steps", {}, Rule::at_most, double(found_.lags)});
    if (!model_.has(&Step::has_rank)) return untested(std::move(result), Untested::no_ranks);
    result.figures.front().values = {double(found_.deficient.size())};
    if (!found_.noisy) return untested(std::move(result), Untested::without_noise);
    if (!result.kept())
      against(result, Trust::look_closer,
              fmt::format("The regressions of {} do not have full rank: some effects can't be separated from each "
                          "other, and tokid uses the solution of smallest norm.",
                          step_list(found_.deficient)));
    return result;
  }

  void differences() {
    Check result = check(Kind::channels, {"differences", {double(found_.differences.size())}, Rule::at_most, 0.0});
    for (const std::string& text : in_words(found_.differences))
      against(result, Trust::look_closer, capital(text) + ".");
    add(std::move(result));
  }

  void innovations() {
    for (Check& check : innovation_checks(found_.conclusions, found_.validation))
      add(check.kind == Kind::gains && check.result == Trust::good && !found_.dependent_inputs.empty()
              ? untested(std::move(check), Untested::dependent_inputs)
              : std::move(check));
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

Verdict verdict(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
                ReportOptions options) {
  const report::Tested tested = report::tested(result, data, identified, std::move(options));
  return report::verdict_of(result.model, report::evidence(result.model, tested), tested.options);
}

}  // namespace tokid
