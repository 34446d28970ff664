// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/outliers.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>

#include "base/statistics.hpp"
#include "data/rows.hpp"
#include "diagnose/outliers/explanation.hpp"
#include "diagnose/outliers/sketch.hpp"

namespace tokid {

namespace {

// The model of all experiments is not used if its residuals of the unflagged experiments are larger than the residuals
// of the regressions by this factor.
constexpr double distorted = 2.0;
constexpr size_t most_explained = 5;

// Layouts with the most lags for one step at a time, and for more steps together if this permits more lags.
std::vector<Sketch::Layout> layouts(const Ensemble& e, const OutlierOptions& o) {
  const Index d = e.channels(), present = e.inputs() + (o.nominal ? 1 : 0);
  std::vector<Sketch::Layout> result;
  Index before = 0;
  for (Index together = 1; together <= most_together(o); together *= 2) {
    Index most = std::min(o.lags, std::max<Index>(1, (most_regressors - present) / d));
    for (; most > 0; --most) {
      if (e.steps() < most + fewest_places * together) continue;
      std::vector<double> rows;
      for (Index i = 0; i < 5; ++i)
        rows.push_back(double(e.complete_rows(most + i * (e.steps() - 1 - most) / 4, most).size()));
      if (statistics::median(rows) * double(together) >= rows_each * double(most * d + present)) break;
    }
    if (most > before) result.push_back({most, together});
    before = std::max(before, most);
    if (most >= o.lags) break;
  }
  return result;
}

std::vector<Outlier> outliers_of(const Ensemble& e, Sketch& sketch) {
  const Index count = e.experiments();
  // The model is fitted to the experiments with the smallest residuals. Large outliers in the fit could hide themselves
  // or each other.
  std::vector<Index> order;
  const auto sort = [&] {
    order.clear();
    for (Index n = 0; n < count; ++n)
      if (sketch.is_evaluated(n)) order.push_back(n);
    std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return sketch.ratio(a) > sketch.ratio(b); });
  };
  sort();
  std::vector<Index> out(order.begin(), order.begin() + std::min<Index>(Index(order.size()), (count + 9) / 10)), found;
  for (int round = 0; round < 4; ++round) {
    sketch.evaluate(marks_of(count, out));
    sort();
    found.clear();
    for (const Index n : order)
      if (sketch.ratio(n) > sketch.threshold(n)) found.push_back(n);
    std::vector<Index> next = found;
    if (const Index most = std::max<Index>(1, count / 4); Index(next.size()) > most) next.resize(size_t(most));
    if (found.empty() || next == out) break;
    out = std::move(next);
  }
  std::vector<Outlier> result;
  for (size_t i = 0; i < found.size(); ++i)
    result.push_back({found[i], std::max(sketch.ratio(found[i]), sketch.plain_ratio(found[i])),
                      i < most_explained ? explanation(e, sketch, found[i]) : std::nullopt,
                      e.experiment_name(found[i])});
  return result;
}

// Removes flagged experiments that `model` predicts about as well as the other experiments. If `model` predicts the
// other experiments clearly worse than the regressions do, an outlier may have distorted `model`. No experiment is then
// removed.
std::vector<Outlier> confirmed(std::vector<Outlier> flagged, const Ensemble& e, const Model& model,
                               const Vector& usual_residual) {
  const Prediction prediction = predict(model, e);
  const Index count = e.experiments(), m = e.outputs();
  Matrix size(count, m);
  for (Index n = 0; n < count; ++n)
    for (Index j = 0; j < m; ++j) {
      std::vector<double> own;
      for (const Matrix& innovation : prediction.innovations)
        if (!std::isnan(innovation(n, j))) own.push_back(std::abs(innovation(n, j)));
      size(n, j) = trimmed_mean(std::move(own));
    }
  const auto is_flagged = [&](Index n) {
    return std::any_of(flagged.begin(), flagged.end(), [n](const Outlier& o) { return o.experiment == n; });
  };
  Vector typical(m);
  for (Index j = 0; j < m; ++j) {
    std::vector<double> others;
    for (Index n = 0; n < count; ++n)
      if (!is_flagged(n) && !std::isnan(size(n, j))) others.push_back(size(n, j));
    typical(j) = statistics::median(std::move(others));
    if (!(typical(j) <= distorted * usual_residual(j))) return flagged;
  }
  std::erase_if(flagged, [&](const Outlier& o) {
    return (size.row(o.experiment).transpose().array() <= of_consequence * typical.array()).all();
  });
  return flagged;
}

}  // namespace

void explain(std::vector<Outlier>& outliers, const Ensemble& e, const OutlierOptions& o,
             const std::vector<Index>& wrong) {
  if (outliers.empty()) return;
  for (const Sketch::Layout& layout : layouts(e, o)) {
    Sketch sketch(e, o, layout);
    if (!sketch.usable()) continue;
    sketch.evaluate(marks_of(e.experiments(), wrong));
    for (size_t i = 0; i < std::min(outliers.size(), most_explained); ++i)
      if (!outliers[i].explanation && sketch.is_evaluated(outliers[i].experiment))
        outliers[i].explanation = explanation(e, sketch, outliers[i].experiment);
  }
}

std::vector<Outlier> outliers(const Ensemble& e, const OutlierOptions& o) {
  if (e.experiments() < fewest_experiments(o)) return {};
  const auto evaluated = [&](const Sketch::Layout& layout) {
    auto sketch = std::make_unique<Sketch>(e, o, layout);
    if (sketch->usable()) sketch->evaluate(marks_of(e.experiments(), {}));
    return sketch->usable() ? std::move(sketch) : nullptr;
  };
  std::unique_ptr<Sketch> best, first;
  Index lags = 0;
  for (const Sketch::Layout& layout : layouts(e, o)) {
    auto own = evaluated(layout);
    if (!own) continue;
    if (!first) first = evaluated({1, layout.together});
    if (!best || own->error() < best->error()) best = std::move(own), lags = layout.lags;
  }
  std::vector<Outlier> result;
  if (best) result = outliers_of(e, *best);
  // With many lags, only noise determines some directions of the windows. An outlier may move along these directions,
  // and the regression cannot evaluate it there. A regression with one lag has no such directions.
  if (first && lags > 1) {
    std::vector<Outlier> alone;
    for (Outlier& other : outliers_of(e, *first)) {
      const auto same = std::find_if(result.begin(), result.end(),
                                     [&](const Outlier& x) { return x.experiment == other.experiment; });
      if (same == result.end())
        alone.push_back(std::move(other));
      else if (!same->explanation || same->ratio < other.ratio)
        *same = std::move(other);
    }
    // But a model with one lag is too simple, and its predictions may be wrong for inputs of another kind. The model of
    // all experiments can therefore remove outliers that only the regression with one lag has found. Outliers of the
    // regression with more lags remain, because they may have distorted the model of all experiments.
    if (o.model && !alone.empty()) alone = confirmed(std::move(alone), e, *o.model, best->usual_residual());
    std::move(alone.begin(), alone.end(), std::back_inserter(result));
  }
  std::stable_sort(result.begin(), result.end(), [](const Outlier& a, const Outlier& b) { return a.ratio > b.ratio; });
  return result;
}

}  // namespace tokid
