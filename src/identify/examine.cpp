// SPDX-License-Identifier: BSD-3-Clause
#include "identify/examine.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "base/nan.hpp"
#include "choose/unseen.hpp"
#include "data/rows.hpp"
#include "data/subjects.hpp"
#include "diagnose/misfits.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

namespace {

// Rounds of models without the experiments that were found so far.
constexpr int most_searches = 5;
// Fewest experiments that show which one is wrong.
constexpr Index fewest_experiments = 5;
// Fewest experiments of a fold that are compared with each other.
constexpr Index fewest_in_fold = 5;
// Innovations are rounding errors if they are below this share of the outputs.
constexpr double rounding_level = 1e-9;
// An experiment with a larger ratio than this, among those of its fold, is examined by further models.
constexpr double conspicuous = 2.0;
// With more experiments than this, an experiment does not distort its own model, so that no other models are needed.
// With more than twice as many steps as this, models of the steps in the middle show whether an experiment fits.
constexpr Index most_held_out = 1000, most_examined_steps = 1024;
// Most outliers with a finding of their own.
constexpr size_t most_reported = 5;
// An experiment with a smaller weight is dropped.
constexpr double least_weight = 1e-6;
// A downweighted sample is moved to this many standard deviations from its prediction (Huber).
constexpr double huber = 1.345, median_of_normal = 0.674489750196;

// If the innovations of more experiments are too large, the model may be too simple for their kind of inputs. Nothing
// then shows that the experiments are wrong.
Index most_found(Index experiments) { return std::max<Index>(1, experiments / 8); }
Index most_treated(Index experiments) { return experiments / 4; }

// (N) The largest entry of each row; NaN entries do not count.
Vector largest_of_rows(const Matrix& a) {
  return a.array().isNaN().select(0.0, a.array()).matrix().rowwise().maxCoeff();
}

// These rows, the largest first, at most `most`.
std::vector<Index> largest_of(std::vector<Index> rows, const Vector& sizes, Index most) {
  std::stable_sort(rows.begin(), rows.end(), [&](Index a, Index b) { return sizes(a) > sizes(b); });
  if (Index(rows.size()) > most) rows.resize(size_t(most));
  return rows;
}

std::vector<Index> rows_above(const Vector& sizes, double bound) {
  std::vector<Index> rows;
  for (Index n = 0; n < sizes.size(); ++n)
    if (sizes(n) > bound) rows.push_back(n);
  return rows;
}

struct Misfits {
  Unseen unseen;         // by models without the suspected experiments
  Matrix misfit, ratio;  // (N × m)

  // The experiments that do not fit, the largest ratio first.
  std::vector<Index> rows() const {
    return largest_of(rows_above(largest_of_rows(misfit), 1.0), largest_of_rows(ratio), misfit.rows());
  }
};

// The experiments that may not fit. Each fold is compared with itself, because an experiment that does not fit distorts
// the models of all folds but its own.
std::vector<Index> suspects(const Ensemble& used, const Plan& plan, const Execution& execution) {
  const Index N = used.experiments(), groups = fold_count(N);
  const std::vector<char> none(size_t(N), 0);
  const std::optional<Unseen> first = unseen(used, plan, none, execution);
  if (!first) return {};
  const Sizes sizes = innovation_sizes(first->innovations, none, N / groups >= fewest_in_fold ? groups : 0);
  const Vector ratio = largest_of_rows(sizes.ratio);
  return largest_of(rows_above(ratio, conspicuous), ratio, std::max<Index>(1, N / 5));
}

// Innovations that are rounding errors show nothing.
void clear_rounding(const Ensemble& used, const Innovations& innovations, Matrix& misfit, Matrix& ratio) {
  Matrix error = Matrix::Zero(misfit.rows(), misfit.cols()), size = error;
  for (Index k = 0; k < Index(innovations.size()); ++k) {
    const Eigen::ArrayXXd e = innovations[size_t(k)].array().abs(), y = used.output(k).array().abs();
    error = error.array().max(e.isNaN().select(0.0, e));
    size = size.array().max(y.isNaN().select(0.0, y));
  }
  const auto shows = error.array() > rounding_level * size.array();
  misfit = shows.select(misfit, 0.0);
  ratio = shows.select(ratio, nan);
}

// Innovations of all experiments, if models were identified without those with 1 in `out` (N).
using Innovate = std::function<std::optional<Unseen>(const std::vector<char>& out)>;

// Examines all experiments without those that are suspected, until the same experiments are found again.
std::optional<Misfits> misfits_of(const Ensemble& used, std::vector<Index> suspected, const Innovate& innovate) {
  const Index N = used.experiments();
  std::optional<Misfits> result;
  for (int round = 0; round < most_searches; ++round) {
    const std::vector<char> out = marks_of(N, suspected);
    std::optional<Unseen> now = innovate(out);
    if (!now) return result;
    Sizes sizes = innovation_sizes(now->innovations, out);
    Matrix misfits = misfit(sizes, now->response, out);
    clear_rounding(used, now->innovations, misfits, sizes.ratio);
    result = {std::move(*now), std::move(misfits), std::move(sizes.ratio)};
    std::vector<Index> found =
        largest_of(result->rows(), largest_of_rows(result->ratio), std::max<Index>(1, most_treated(N)));
    if (found.empty() || marks_of(N, found) == marks_of(N, suspected)) break;
    suspected = std::move(found);
  }
  return result;
}

// Clears experiments that do not fit only because all experiments of their kind were suspected. Half of the suspects
// are predicted by models that were identified with the other half. If these models predict them as well as the models
// without suspects predict the other experiments, nothing is wrong with them.
void clear(const Ensemble& used, const Innovate& innovate, Misfits& found) {
  const Index N = found.misfit.rows();
  const std::vector<Index> rows = found.rows();
  if (rows.size() < 2) return;
  Innovations innovations = found.unseen.innovations;
  for (const size_t half : {0u, 1u}) {
    std::vector<Index> left_out;
    for (size_t i = half; i < rows.size(); i += 2) left_out.push_back(rows[i]);
    const std::optional<Unseen> now = innovate(marks_of(N, left_out));
    if (!now) return;
    for (size_t k = 0; k < innovations.size(); ++k)
      for (const Index n : left_out) innovations[k].row(n) = now->innovations[k].row(n);
  }
  const std::vector<char> out = marks_of(N, rows);
  Sizes sizes = innovation_sizes(innovations, out);
  Matrix again = misfit(sizes, found.unseen.response, out);
  clear_rounding(used, innovations, again, sizes.ratio);
  for (const Index n : rows)
    if (largest_of_rows(again.row(n))(0) <= 1) found.misfit.row(n).setZero();
}

// The outputs where the innovations of an experiment are too large, the largest first; at least the one with the
// largest innovations.
std::vector<FindingChannel> wrong_outputs(const Misfits& found, Index n, const Channels& names) {
  std::vector<Index> outputs;
  for (Index j = 0; j < found.ratio.cols(); ++j)
    if (!std::isnan(found.ratio(n, j))) outputs.push_back(j);
  std::sort(outputs.begin(), outputs.end(), [&](Index a, Index b) { return found.ratio(n, a) > found.ratio(n, b); });
  std::vector<FindingChannel> result;
  for (const Index j : outputs)
    if (result.empty() || found.misfit(n, j) > 1) result.push_back(output_channel(names, j));
  return result;
}

// The experiments that do not fit, and the outputs where they do not.
Examined named(const Misfits& found, const Ensemble& used) {
  const std::vector<Index> rows = found.rows();
  if (Index(rows.size()) > most_found(used.experiments())) return {{}, rows};
  const Vector ratio = largest_of_rows(found.ratio);
  Examined result;
  for (const Index n : rows)
    result.outliers.push_back({.experiment = n,
                               .ratio = ratio(n),
                               .name = used.experiment_name(n),
                               .outputs = wrong_outputs(found, n, used.names)});
  return result;
}

// The steps by which experiments are examined, from a step on that begins a period.
struct Stretch {
  std::shared_ptr<const Ensemble> samples;  // refers to the data if all steps are used
  Plan plan;
};
Stretch middle_of(const Ensemble& used, const Plan& plan) {
  const Index period = std::max<Index>(1, plan.choices.variation.period),
              length = std::max(most_examined_steps, 2 * period);
  if (used.steps() <= 2 * length) return {{std::shared_ptr<const Ensemble>(), &used}, plan};
  const Index begin = (used.steps() - length) / 2 / period * period;
  Stretch result{std::make_shared<Ensemble>(stretch(used, begin, begin + length)), plan};
  result.plan.initial_state = InitialState::unknown;
  return result;
}

}  // namespace

Examined examined(const Ensemble& used, const Model& model, const Plan& plan, const Execution& execution) {
  if (used.experiments() < fewest_experiments) return {};
  if (used.experiments() > most_held_out) {
    const Unseen all = seen(used, model, plan);
    return named(*misfits_of(used, {}, [&](const std::vector<char>&) { return all; }), used);
  }
  const Stretch middle = middle_of(used, plan);
  const Ensemble& data = *middle.samples;
  const Innovate innovate = [&](const std::vector<char>& out) {
    return unseen(data, middle.plan, out, {execution.threads, {}});
  };
  const std::vector<Index> suspected = suspects(data, middle.plan, share(execution, 0.0, 0.7));
  if (suspected.empty()) return {};
  std::optional<Misfits> found = misfits_of(data, suspected, innovate);
  if (!found) return {};
  for (const Index n : found->rows())
    if (excites_more(data, n, plan.lags, plan.nominal)) found->misfit.row(n).setZero();
  clear(data, innovate, *found);
  return named(*found, used);
}

bool Treatment::knows(const Ensemble& measured, Index experiment) const {
  const std::string label = measured.experiment_label(experiment);
  return std::any_of(corrections.experiments.begin(), corrections.experiments.end(),
                     [&](const Corrections::Experiment& e) { return e.label == label; });
}

namespace {

double weight_of(const Outlier& outlier, OutlierChoice choice) {
  if (choice == OutlierChoice::drop) return 0.0;
  const double weight = 1 / (outlier.ratio * outlier.ratio);
  return weight > least_weight ? std::min(weight, 1.0) : 0.0;
}

bool treat_experiments(const Ensemble& measured, const std::vector<Outlier>& found, OutlierChoice choice,
                       Treatment& treatment) {
  bool any = false;
  for (Outlier outlier : found) {
    if (treatment.knows(measured, outlier.experiment)) continue;
    if (Index(treatment.corrections.experiments.size()) >= most_treated(measured.experiments())) break;
    outlier.weight = weight_of(outlier, choice);
    treatment.corrections.experiments.push_back({measured.experiment_label(outlier.experiment), outlier.weight});
    treatment.outliers.push_back(std::move(outlier));
    any = true;
  }
  return any;
}

// Rows of the experiments with outlying samples, ascending.
std::vector<Index> rows_of(const std::vector<OutlyingSamples>& found) {
  std::vector<Index> rows;
  for (const OutlyingSamples& o : found) rows.push_back(o.experiment);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  return rows;
}

// The predictions of the experiments in these rows by a model, without the outlying samples (rows × T·m).
Ensemble predicted_without(const Ensemble& measured, const Model& model, const std::vector<OutlyingSamples>& found,
                           const Treatment& treatment, const std::vector<Index>& rows) {
  Corrections samples;
  samples.samples = treatment.corrections.samples;
  for (const OutlyingSamples& o : found)
    for (const Index k : o.steps)
      samples.samples.push_back({measured.experiment_label(o.experiment), o.output, k, nan});
  const Ensemble part = corrected(measured.subset(rows), samples).data;
  return predict(ends_early(model, part.steps()) ? continued(model, part.steps()) : model, part,
                 {1, model.initial_state})
      .y;
}

bool treat_samples(const Ensemble& measured, const Found& all, OutlierChoice choice, Treatment& treatment) {
  std::vector<OutlyingSamples> found = all.samples;
  std::erase_if(found, [](const OutlyingSamples& o) { return o.weight < 1; });
  if (found.empty()) return false;
  const std::vector<Index> rows = rows_of(found);
  std::optional<Ensemble> predicted;
  if (choice == OutlierChoice::downweight) predicted = predicted_without(measured, all.model, found, treatment, rows);
  for (OutlyingSamples& o : found) {
    const double kept = huber / median_of_normal * o.usual;
    o.weight = predicted ? kept / o.error : 0.0;
    const auto row = std::lower_bound(rows.begin(), rows.end(), o.experiment) - rows.begin();
    for (const Index k : o.steps) {
      const double expected = predicted ? predicted->y(Index(row), k, o.output) : nan;
      const double value = expected + std::copysign(kept, measured.y(o.experiment, k, o.output) - expected);
      treatment.corrections.samples.push_back({measured.experiment_label(o.experiment), o.output, k, value});
    }
    treatment.samples.push_back(std::move(o));
  }
  return true;
}

}  // namespace

bool treat(const Ensemble& measured, const Found& found, OutlierChoice choice, Treatment& treatment) {
  const bool experiments = treat_experiments(measured, found.outliers, choice, treatment);
  return treat_samples(measured, found, choice, treatment) || experiments;
}

Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported) {
  std::erase_if(outliers, [&](const Outlier& o) {
    return o.weight == 1 && std::count(reported.begin(), reported.end(), o.experiment) > 0;
  });
  // Those that are still used come first.
  std::stable_partition(outliers.begin(), outliers.end(), [](const Outlier& o) { return o.weight == 1; });
  Findings result;
  for (size_t i = 0; i < std::min(most_reported, outliers.size()); ++i) {
    const Outlier& o = outliers[i];
    result.push_back({.kind = Finding::Kind::experiment_outlying,
                      .channels = o.outputs,
                      .experiments = {{o.experiment, o.name}},
                      .numbers = {{"ratio", o.ratio}, {"weight", o.weight}, {"held_out", double(o.held_out)}}});
  }
  if (outliers.size() > most_reported)
    result.push_back({.kind = Finding::Kind::more_outlying_experiments,
                      .numbers = {{"count", double(outliers.size() - most_reported)}}});
  return result;
}

Findings findings_of_untreated(const std::vector<Outlier>& outliers, Index experiments) {
  const auto count = std::count_if(outliers.begin(), outliers.end(), [](const Outlier& o) { return o.weight == 1; });
  if (count == 0) return {};
  return {{.kind = Finding::Kind::outliers_undecided,
           .numbers = {{"count", double(count)}, {"most", double(most_treated(experiments))}}}};
}

}  // namespace tokid
