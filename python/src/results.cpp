// SPDX-License-Identifier: BSD-3-Clause
#include "results.hpp"

#include "arrays.hpp"
#include "words.hpp"

namespace tokid::python {

namespace results {

nb::object cast(const std::string& value) { return nb::str(value.c_str(), value.size()); }
nb::object cast(const char* value) { return nb::str(value); }
nb::object cast(bool value) { return nb::bool_(value); }
nb::object cast(Index value) { return nb::int_(value); }
nb::object cast(double value) { return nb::float_(value); }
nb::object cast(const Vector& value) { return nb::cast(array_of(value)); }
nb::object cast(const Matrix& value) { return nb::cast(array_of(value)); }
nb::object cast(const std::vector<double>& value) { return nb::cast(array_of(value, {value.size()})); }
nb::object cast(nb::object value) { return value; }

}  // namespace results

nb::any make(const char* type, std::initializer_list<Field> fields) {
  nb::dict keywords;
  for (const Field& field : fields) keywords[field.name] = field.value;
  return any(nb::module_::import_("tokid.results").attr(type)(**keywords));
}

namespace {

const char* name(Weighting weighting) {
  return weighting == Weighting::one_step     ? "one-step"
         : weighting == Weighting::many_steps ? "many-steps"
                                              : "projection";
}

const char* name(Pooling over) {
  return over == Pooling::experiments ? "experiments" : over == Pooling::time ? "time" : "nothing";
}

nb::any object_of(const TimeVariation& v) {
  return make("TimeVariation", {{"smoothing", v.smoothing}, {"period", v.period}});
}

nb::any object_of(const Whiteness& w) {
  return make("Whiteness",
              {{"p", w.p}, {"z", w.z}, {"correlation", w.correlation}, {"bound", w.bound}, {"over", name(w.over)}});
}

nb::any object_of(const Independence& i) {
  return make("Independence",
              {{"p", i.p}, {"first", i.first}, {"z", i.z}, {"correlation", i.correlation}, {"over", name(i.over)}});
}

nb::any object_of(const NormalisedSquares& s) {
  return make("NormalisedSquares",
              {{"ratio", s.ratio}, {"p", s.p}, {"normal", s.normal}, {"step", s.step}, {"step_p", s.step_p}});
}

nb::any object_of(const NominalTest& t) {
  nb::list departures;
  for (const NominalTest::Departure& d : t.departures)
    departures.append(make("Departure", {{"channel", d.channel}, {"steps", d.steps}}));
  return make("NominalTest", {{"statistic", t.statistic},
                              {"threshold", t.threshold},
                              {"step_statistic", t.step_statistic},
                              {"step_threshold", t.step_threshold},
                              {"constant_statistic", t.constant_statistic},
                              {"constant_threshold", t.constant_threshold},
                              {"departures", departures},
                              {"significant", t.significant}});
}

nb::any object_of(const InitialStateTest& t) {
  return make("InitialStateTest", {{"statistic", t.statistic},
                                   {"threshold", t.threshold},
                                   {"decision", to_string(t.decision)},
                                   {"reason", t.reason}});
}

nb::any object_of(const LagOrderErrors& e) {
  return make("LagOrderErrors", {{"steps", e.steps}, {"error", e.error}, {"mean", e.mean}, {"best", e.best}});
}

nb::any object_of(const SmoothingTrial& t) {
  return make("SmoothingTrial", {{"lags", t.lags}, {"smoothing", t.smoothing}, {"error", t.error}});
}

nb::any object_of(const SmoothingChoice& c) {
  nb::list trials;
  for (const SmoothingTrial& t : c.trials) trials.append(object_of(t));
  return make("SmoothingChoice",
              {{"trials", trials}, {"lags", c.lags}, {"smoothing", c.smoothing}, {"error", c.error}});
}

nb::any object_of(const OrderScores& s) {
  return make("OrderScores", {{"states", s.states},
                              {"one_step", s.one_step},
                              {"ahead", s.ahead},
                              {"simulation", s.simulation},
                              {"horizon", OrderScores::horizon},
                              {"cross_validated", s.cross_validated},
                              {"smoothing", s.smoothing},
                              {"weighting", name(s.weighting)},
                              {"price", s.price},
                              {"smallest", s.smallest},
                              {"uncertainty", s.uncertainty},
                              {"best", s.best}});
}

nb::any object_of(const RefinementTrial& t) {
  return make("RefinementTrial", {{"states", t.states},
                                  {"smoothing", t.smoothing},
                                  {"iterations", t.iterations},
                                  {"error", t.error},
                                  {"log_likelihood", t.log_likelihood}});
}

nb::any object_of(const Jump& j) {
  return make("Jump", {{"step", j.step}, {"loss", j.loss ? nb::object(nb::float_(*j.loss)) : nb::none()}});
}

nb::any object_of(const HeldOutErrors& e) {
  return make("HeldOutErrors", {{"error", e.error}, {"standard_error", e.standard_error}});
}

nb::any object_of(const RegressionComparison& c) {
  return make("RegressionComparison", {{"horizons", c.horizons},
                                       {"experiments", c.experiments},
                                       {"first_step", c.first_step},
                                       {"model", object_of(c.model)},
                                       {"regression", object_of(c.regression)},
                                       {"lags", c.lags},
                                       {"smoothing", c.smoothing}});
}

nb::any object_of(const RefinementChoice& c) {
  nb::list trials;
  for (const RefinementTrial& t : c.trials) trials.append(object_of(t));
  nb::list jumps;
  for (const Jump& j : c.jumps) jumps.append(object_of(j));
  return make("RefinementChoice", {{"trials", trials},
                                   {"states", c.states},
                                   {"smoothing", c.smoothing},
                                   {"iterations", c.iterations},
                                   {"error", c.error},
                                   {"one_step", c.one_step},
                                   {"jumps", jumps},
                                   {"ahead_ratio", c.ahead.ratio},
                                   {"ahead_model_share", c.ahead.model_share}});
}

nb::any object_of(const Finding::Channel& c) {
  return make("FindingChannel", {{"side", c.output ? "output" : "input"}, {"index", c.index}, {"name", c.name}});
}

nb::any object_of(const Finding::Experiment& e) {
  return make("FindingExperiment",
              {{"row", e.row}, {"name", e.name.empty() ? nb::object(nb::none()) : results::cast(e.name)}});
}

nb::any object_of(const Finding& f);

nb::any object_of(const Finding::Term& t) {
  return make("FindingTerm", {{"channel", object_of(t.channel)}, {"lag", t.lag}, {"factor", t.factor}});
}

template <class T>
nb::list objects_of(const std::vector<T>& values) {
  nb::list list;
  for (const T& value : values) list.append(object_of(value));
  return list;
}

nb::dict dict_of(const std::map<std::string, double>& numbers) {
  nb::dict dict;
  for (const auto& [name, value] : numbers) dict[results::cast(name)] = results::cast(value);
  return dict;
}

nb::any object_of(const Outlier& o) {
  return make("Outlier", {{"experiment", o.experiment},
                          {"name", o.name.empty() ? nb::object(nb::none()) : results::cast(o.name)},
                          {"ratio", o.ratio},
                          {"outputs", objects_of(o.outputs)},
                          {"weight", o.weight},
                          {"held_out", o.held_out}});
}

nb::any object_of(const Conclusion& c) {
  return make("Conclusion", {{"result", to_string(c.result)},
                             {"reason", to_string(c.reason)},
                             {"channels", objects_of(c.channels)},
                             {"numbers", dict_of(c.numbers)},
                             {"errors", c.errors},
                             {"intervals", c.intervals},
                             {"pooled", c.pooled},
                             {"text", in_words(c)}});
}

nb::dict object_of(const Conclusions& conclusions) {
  nb::dict dict;
  for (const Conclusion& c : conclusions.all()) dict[to_string(c.test)] = object_of(c);
  return dict;
}

nb::any object_of(const Finding& f) {
  nb::list groups;
  for (const auto& group : f.groups) groups.append(objects_of(group));
  return make("Finding", {{"kind", to_string(f.kind)},
                          {"severity", to_string(severity(f.kind))},
                          {"scope", to_string(f.scope)},
                          {"channels", objects_of(f.channels)},
                          {"experiments", objects_of(f.experiments)},
                          {"steps", f.steps},
                          {"numbers", dict_of(f.numbers)},
                          {"text", in_python(in_words(f))},
                          {"terms", objects_of(f.terms)},
                          {"groups", nb::object(groups)},
                          {"names", texts(f.names)},
                          {"detail", f.detail},
                          {"file", f.file}});
}

}  // namespace

nb::any object_of(const Fit& f) { return make("Fit", {{"fit", f.fit}, {"rmse", f.rmse}, {"samples", f.samples}}); }

nb::any object_of(const OutlyingSamples& o) {
  return make("OutlyingSamples", {{"experiment", o.experiment},
                                  {"name", o.name.empty() ? nb::object(nb::none()) : results::cast(o.name)},
                                  {"output", o.output},
                                  {"steps", o.steps},
                                  {"error", o.error},
                                  {"usual", o.usual},
                                  {"weight", o.weight}});
}

nb::any object_of(const Similarity& s) {
  return make("ModelDifference", {{"relative_error", s.relative_error},
                                  {"largest", s.max_difference},
                                  {"begin", s.begin},
                                  {"end", s.end},
                                  {"band", s.band}});
}

namespace {

// An array of another type than double, which holds the values exactly.
template <class Values>
nb::object array_as(const char* type, const Values& values) {
  return results::cast(values).attr("astype")(type);
}

}  // namespace

nb::any object_of(const ExperimentFits& f) {
  return make("ExperimentFits", {{"simulation_fit", f.simulation_fit},
                                 {"one_step_fit", f.one_step_fit},
                                 {"simulation_rmse", f.simulation_rmse},
                                 {"one_step_rmse", f.one_step_rmse},
                                 {"simulation_samples", array_as("int64", Matrix(f.simulation_samples.cast<double>()))},
                                 {"one_step_samples", array_as("int64", Matrix(f.one_step_samples.cast<double>()))},
                                 {"over_median", f.over_median},
                                 {"simulation_error", f.simulation_error},
                                 {"one_step_error", f.one_step_error},
                                 {"simulation_limit", f.simulation_limit},
                                 {"one_step_limit", f.one_step_limit},
                                 {"excess", f.excess},
                                 {"outlying", array_as("bool", Vector((f.excess.array() > 1).cast<double>()))},
                                 {"worst_first", f.worst_first},
                                 {"worst_output", nb::object(nb::cast(f.worst_output))}});
}

nb::any object_of(const Validation& v, const Channels& names) {
  nb::list outlying;
  for (const OutlyingSamples& o : v.outlying) outlying.append(object_of(o));
  return make("Validation",
              {{"simulation", object_of(v.simulation)},
               {"one_step", object_of(v.one_step)},
               {"horizon", object_of(v.horizon)},
               {"noisy", v.noisy},
               {"whiteness_p", v.whiteness_p},
               {"whiteness", object_of(v.whiteness)},
               {"independence", object_of(v.independence)},
               {"feedback", object_of(v.feedback)},
               {"squares", object_of(v.squares)},
               {"gains", make("InputGains",
                              {{"error", v.gains.error}, {"deviation", v.gains.deviation}, {"share", v.gains.share}})},
               {"conclusions", object_of(conclusions(v, names))},
               {"outlying", outlying},
               {"first_predicted", v.first_predicted},
               {"first_simulated", v.first_simulated},
               {"findings", list_of(v.findings)}});
}

nb::any object_of(const NoisyChoices& c) {
  return make("NoisyChoices", {{"variation", object_of(c.variation)},
                               {"state_smoothing", c.state_smoothing},
                               {"weighting", name(c.weighting)},
                               {"refinement_smoothing", c.refinement_smoothing},
                               {"refinement_iterations", c.refinement_iterations},
                               {"jumps", c.variation.jumps},
                               {"delays", c.delays}});
}

nb::any object_of(const FeedthroughChoice& c) {
  return make("FeedthroughChoice", {{"present", c.present},
                                    {"reason", to_string(c.reason)},
                                    {"response_p", c.response_p},
                                    {"feedback_p", c.feedback_p}});
}

nb::any object_of(const LikelihoodChoice& c) {
  return make("LikelihoodChoice",
              {{"smoothing", c.smoothing}, {"log_likelihood", c.log_likelihood}, {"error", c.error}, {"best", c.best}});
}

nb::any object_of(const Verdict& v) {
  nb::list checks;
  for (const VerdictCheck& c : v.checks) {
    nb::list reasons;
    for (const VerdictReason& reason : c.reasons)
      reasons.append(make("VerdictReason", {{"trust", to_string(reason.trust)}, {"text", reason.text}}));
    nb::list figures;
    for (const CheckFigure& figure : c.figures)
      figures.append(make("CheckFigure", {{"name", figure.name},
                                          {"values", figure.values},
                                          {"rule", to_string(figure.rule)},
                                          {"bound", figure.bound},
                                          {"distrust", figure.distrust}}));
    const CheckWords words = in_words(c);
    checks.append(make("VerdictCheck",
                       {{"name", to_string(c.kind)},
                        {"subject", words.subject},
                        {"found", words.found},
                        {"needed", words.needed},
                        {"result", c.result ? nb::cast(to_string(*c.result)) : nb::none()},
                        {"untested", c.untested ? nb::cast(to_string(*c.untested)) : nb::none()},
                        {"figures", figures},
                        {"one_suffices", c.one_suffices},
                        {"numbers", nb::object(dict_of(c.numbers))},
                        {"experiment", c.experiment ? nb::object(object_of(*c.experiment)) : nb::object(nb::none())},
                        {"conclusion", c.reason ? nb::cast(to_string(*c.reason)) : nb::none()},
                        {"reasons", reasons}}));
  }
  return make("Verdict", {{"trust", to_string(v.trust)},
                          {"summary", v.summary},
                          {"reasons", v.reasons},
                          {"checks", checks},
                          {"horizon", v.horizon}});
}

nb::any object_of(const Identification& i) {
  nb::list outliers;
  for (const Outlier& o : i.outliers) outliers.append(object_of(o));
  return make("Identification", {{"experiments", i.experiments},
                                 {"steps", i.steps},
                                 {"lags", i.plan.lags},
                                 {"variation", object_of(i.plan.choices.variation)},
                                 {"state_smoothing", i.plan.choices.state_smoothing},
                                 {"min_experiments", i.min_experiments},
                                 {"rank_deficient_steps", i.rank_deficient_steps},
                                 {"condition_max", i.condition_max},
                                 {"nominal_test", object_of(i.nominal_test)},
                                 {"initial_state_test", object_of(i.initial_state_test)},
                                 {"feedthrough", object_of(i.plan.feedthrough)},
                                 {"lag_order_errors", object_of(i.lag_order_errors)},
                                 {"smoothing_choice", object_of(i.smoothing_choice)},
                                 {"order_scores", object_of(i.order_scores)},
                                 {"refinement", object_of(i.refinement)},
                                 {"comparison", i.comparison ? nb::object(object_of(*i.comparison)) : nb::none()},
                                 {"choices", i.plan.coupled ? nb::object(object_of(i.plan.choices)) : nb::none()},
                                 {"together", i.plan.coupled},
                                 {"noisy", i.plan.noisy},
                                 {"nominal", i.plan.nominal},
                                 {"singular_value_gap", i.singular_value_gap},
                                 {"held_out", i.held_out},
                                 {"held_out_experiments", i.held_out_experiments},
                                 {"validation", object_of(i.validation, i.model.names)},
                                 {"outliers", outliers},
                                 {"copies", i.copies.groups},
                                 {"findings", list_of(i.findings)},
                                 {"seconds", i.seconds}});
}

nb::list list_of(const Findings& findings) { return objects_of(findings); }

nb::list texts(const std::vector<std::string>& texts) {
  nb::list list;
  for (const std::string& text : texts) list.append(results::cast(text));
  return list;
}

}  // namespace tokid::python
