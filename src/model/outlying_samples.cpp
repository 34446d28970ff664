// SPDX-License-Identifier: BSD-3-Clause
#include "model/outlying_samples.hpp"
#include "data/subjects.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "model/step_by_step.hpp"

namespace tokid {

namespace {

// The number of samples that a median needs for an accuracy of about a fifth.
constexpr Index enough = 40;
// Samples with an error above this multiple of the median error are outlying. This is 13 standard deviations of a
// normal distribution.
constexpr double far = 20.0;
// Errors below this share of the output's spread are too small to matter.
constexpr double of_consequence = 0.05;
// A fault can hide the next one, so faults are found one after the other. After this number of rounds, all samples that
// are far off count as outlying.
constexpr int most_rounds = 20;

double median_size(const Eigen::Ref<const Vector>& errors) {
  std::vector<double> sizes;
  for (const double e : errors)
    if (!std::isnan(e)) sizes.push_back(std::abs(e));
  return statistics::median(std::move(sizes));
}

}  // namespace

Vector output_spread(const Model& model, const Ensemble& data) {
  const bool departures = model.y_nominal.rows() > 0;
  Vector spread(data.outputs());
  for (Index j = 0; j < data.outputs(); ++j) {
    const auto over_samples = [&](auto&& use) {
      Index count = 0;
      for (Index k = 0; k < data.steps(); ++k)
        for (const double value : data.output(k).col(j))
          if (!std::isnan(value)) use(k < model.y_nominal.rows() ? value - model.y_nominal(k, j) : value), ++count;
      return double(count);
    };
    double sum = 0.0, squares = 0.0;
    const double count = over_samples([&](double y) { sum += y; });
    const double mean = departures || count == 0 ? 0.0 : sum / count;
    over_samples([&](double y) { squares += (y - mean) * (y - mean); });
    spread(j) = squares > 0 ? std::sqrt(squares / count) : 1.0;
  }
  return spread;
}

OutlyingSampleCollector::OutlyingSampleCollector(const Model& model, const Ensemble& data,
                                                 const ValidateOptions& options)
    : model_(model),
      data_(data),
      initial_state_(options.initial_state),
      spread_(output_spread(model, data)),
      window_(estimation_window(model)),
      shown_(1 + ceil_div(model.states(), std::max<Index>(1, model.outputs))),
      together_(ceil_div(enough, std::max<Index>(1, data.experiments()))),
      is_misfit_(size_t(data.experiments()), false),
      gap_(size_t(data.experiments()), -1),
      until_certain_(size_t(data.experiments()), 0),
      unreliable_(size_t(data.experiments())),
      usual_(Matrix::Constant(data.steps(), data.outputs(), nan)) {
  const auto& misfits = options.misfits;
  for (Index n = 0; n < data.experiments(); ++n)
    is_misfit_[size_t(n)] = std::find(misfits.begin(), misfits.end(), data.experiment_label(n)) != misfits.end();
}

void OutlyingSampleCollector::add(Index k, const Matrix& innovation) {
  if (block_.empty()) begin_ = k;
  block_.push_back(innovation);
  restarts_.emplace_back();
  for (Index n = 0; n < innovation.rows(); ++n) {
    Index& gap = gap_[size_t(n)];
    if (innovation.row(n).array().isNaN().all()) {
      if (gap >= 0) ++gap;
    } else {
      // If samples before the first prediction are missing, the other samples may determine an unknown state only
      // weakly.
      const bool begins = gap < 0 && data_.samples().row(n).head(k * data_.channels()).hasNaN();
      if (begins || gap > 1) restarts_.back().push_back(n);
      gap = 0;
    }
    if (is_misfit_[size_t(n)]) block_.back().row(n).setConstant(nan);
  }
  if (Index(block_.size()) < together_) return;
  test_block(0);
  previous_ = std::move(block_);
  block_.clear();
  restarts_.clear();
}

bool OutlyingSampleCollector::is_far(Index k, Index j, double error) const {
  return error > far * usual_(k, j) && error > of_consequence * spread_(j);
}

// Tests the steps of the block from `from` on. The steps before `from` are tested already. They are still part of the
// medians.
void OutlyingSampleCollector::test_block(size_t from) {
  const Index N = data_.experiments(), m = data_.outputs();
  Vector own(N * Index(block_.size()));
  for (Index j = 0; j < m; ++j) {
    for (size_t i = 0; i < block_.size(); ++i) own.segment(Index(i) * N, N) = block_[i].col(j);
    // Most data have no error that is large enough. Then the medians are not needed.
    if (!(own.array().isNaN().select(0.0, own.array().abs()).maxCoeff() > of_consequence * spread_(j))) continue;
    const double of_block = median_size(own);
    // The median over two experiments can't show which of the two errors is wrong.
    for (size_t i = from; i < block_.size(); ++i)
      usual_(begin_ + Index(i), j) = std::fmax(of_block, N > 2 ? median_size(block_[i].col(j)) : nan);
  }
  for (size_t i = from; i < block_.size(); ++i) {
    const Index k = begin_ + Index(i);
    for (const Index n : restarts_[i - from]) until_certain_[size_t(n)] = shown_;
    for (Index n = 0; n < N; ++n) {
      const auto far_off = [&](Index j) { return is_far(k, j, std::abs(block_[i](n, j))); };
      bool any = false;
      for (Index j = 0; j < m; ++j) any = any || far_off(j);
      Index& left = until_certain_[size_t(n)];
      if (!any) {
        if (left > 0 && !block_[i].row(n).array().isNaN().all()) --left;
      } else if (left > 0) {
        left = shown_;
        unreliable_[size_t(n)].push_back(k);
      } else {
        for (Index j = 0; j < m; ++j)
          if (far_off(j)) flags_.push_back({n, k, j, std::abs(block_[i](n, j))});
      }
    }
  }
}

std::vector<OutlyingSampleCollector::Flag> OutlyingSampleCollector::first_of(std::vector<Flag> flags) const {
  std::sort(flags.begin(), flags.end(), [](const Flag& a, const Flag& b) {
    return std::pair(a.experiment, a.step) < std::pair(b.experiment, b.step);
  });
  std::vector<Flag> first;
  for (const Flag& flag : flags) {
    const bool may_follow = !first.empty() && first.back().experiment == flag.experiment &&
                            flag.step != first.back().step && flag.step <= first.back().step + window_;
    if (!may_follow) first.push_back(flag);
  }
  return first;
}

std::vector<OutlyingSampleCollector::Flag> OutlyingSampleCollector::predicted_again(
    const Ensemble& part, const std::vector<Index>& rows) const {
  std::vector<Flag> flags;
  predict_each(model_, part, initial_state_, [&](Index k, const Matrix& innovation) {
    for (Index i = 0; i < innovation.rows(); ++i) {
      const Index n = rows[size_t(i)];
      if (std::binary_search(unreliable_[size_t(n)].begin(), unreliable_[size_t(n)].end(), k)) continue;
      for (Index j = 0; j < innovation.cols(); ++j)
        if (is_far(k, j, std::abs(innovation(i, j)))) flags.push_back({n, k, j, std::abs(innovation(i, j))});
    }
  });
  return flags;
}

std::vector<OutlyingSamples> OutlyingSampleCollector::found() {
  if (!block_.empty()) {
    // The last steps are too few for a median, and are tested together with the steps before them.
    const size_t tested = previous_.size();
    begin_ -= Index(tested);
    block_.insert(block_.begin(), previous_.begin(), previous_.end());
    test_block(tested);
    block_.clear();
  }
  std::vector<Index> rows;
  for (const Flag& flag : flags_) rows.push_back(flag.experiment);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  Ensemble part = data_.subset(rows);
  std::map<std::pair<Index, Index>, OutlyingSamples> found;  // by experiment and output
  for (int round = 0; !flags_.empty(); ++round) {
    for (const Flag& flag : round < most_rounds ? first_of(flags_) : flags_) {
      const auto [n, k, j, error] = flag;
      const std::pair key(n, j);
      OutlyingSamples& o =
          found.try_emplace(key, OutlyingSamples{n, j, {}, 0.0, 0.0, data_.experiment_name(n)}).first->second;
      o.steps.push_back(k);
      if (error > o.error) o.error = error, o.usual = usual_(k, j);
      const auto row = std::lower_bound(rows.begin(), rows.end(), n) - rows.begin();
      part.y(Index(row), k, j) = nan;
    }
    if (round == most_rounds) break;
    flags_ = predicted_again(part, rows);
  }
  std::vector<OutlyingSamples> result;
  for (auto& [key, samples] : found) {
    std::sort(samples.steps.begin(), samples.steps.end());
    result.push_back(std::move(samples));
  }
  return result;
}

std::vector<OutlyingSamples> outlying_samples(const Model& model, const Ensemble& data,
                                              const ValidateOptions& options) {
  if (ends_early(model, data.steps())) return outlying_samples(continued(model, data.steps()), data, options);
  OutlyingSampleCollector collector(model, data, options);
  predict_each(model, data, options.initial_state,
               [&](Index k, const Matrix& innovation) { collector.add(k, innovation); });
  return collector.found();
}

std::vector<OutlyingSamples> outlying_in(const Ensemble& all, const Ensemble& part, Index first,
                                         std::vector<OutlyingSamples> outlying) {
  std::map<std::string, Index> rows;
  for (Index n = 0; n < all.experiments(); ++n) rows.emplace(all.experiment_label(n), n);
  for (OutlyingSamples& samples : outlying) {
    samples.experiment = rows.at(part.experiment_label(samples.experiment));
    samples.name = all.experiment_name(samples.experiment);
    for (Index& k : samples.steps) k += first;
  }
  return outlying;
}

Findings findings_of(const std::vector<OutlyingSamples>& outlying, const Channels& names) {
  constexpr size_t most_reported = 5;
  Findings result;
  for (size_t i = 0; i < std::min(most_reported, outlying.size()); ++i) {
    const OutlyingSamples& o = outlying[i];
    result.push_back({.kind = Finding::Kind::samples_outlying,
                      .channels = {output_channel(names, o.output)},
                      .experiments = {{o.experiment, o.name}},
                      .steps = o.steps,
                      .numbers = {{"error", o.error}, {"usual", o.usual}}});
  }
  if (outlying.size() > most_reported)
    result.push_back({.kind = Finding::Kind::more_outlying_samples,
                      .numbers = {{"count", double(outlying.size() - most_reported)}}});
  return result;
}

}  // namespace tokid
