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
#include "model/initial_state.hpp"
#include "model/step_by_step.hpp"

namespace tokid {

namespace {

// The number of samples that a median needs for an accuracy of about 6 %.
constexpr Index enough = 400;
// The median of a single step counts by this share, because it has fewer samples. It matters at steps with more noise
// than their neighbours.
constexpr double share_of_step = 0.75;
// Median error of a normal distribution with the standard deviation 1.
constexpr double normal_median = 0.674489750196;
// Samples with an error above a multiple of the median error are outlying. The multiple is 6 standard deviations of a
// normal distribution. It is larger for distributions with heavier tails, but at most 13.5 standard deviations.
constexpr double far = 6.0 / normal_median, farthest = 20.0;
// One normal error in a hundred is above this multiple of the median error. The share of such errors shows the tails.
constexpr double in_tail = 2.5758293035489 / normal_median;
// Errors of a distribution with these tails are outlying in one ensemble of a thousand.
constexpr double false_alarms = 1e-3;
// Errors below this share of the output's spread are too small to matter.
constexpr double of_consequence = 0.002;
// A fault can hide the next one, so faults are found one after the other. After this number of rounds, all samples that
// are far off count as outlying.
constexpr int most_rounds = 20;

double median_size(const Eigen::Ref<const Vector>& errors) {
  std::vector<double> sizes;
  for (const double e : errors)
    if (!std::isnan(e)) sizes.push_back(std::abs(e));
  return statistics::median(std::move(sizes));
}

// Median of |t| for Student's t.
double student_median(double freedom) { return statistics::student_quantile(0.75, freedom); }

// Multiple of the median error that one of `samples` errors exceeds in one ensemble of a thousand. The errors have the
// distribution of Student's t with the given share above `in_tail`.
double far_in_tails(double share, double samples) {
  double least = 1.0, most = 1e3;  // degrees of freedom
  const auto share_of = [](double nu) { return statistics::student_two_sided(in_tail * student_median(nu), nu); };
  if (!(share > share_of(most))) return far;
  for (int i = 0; i < 40; ++i) {
    const double middle = std::sqrt(least * most);
    (share_of(middle) > share ? least : most) = middle;
  }
  const double multiple = statistics::student_quantile(1 - false_alarms / samples / 2, most) / student_median(most);
  return std::clamp(multiple, far, farthest);
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
      begins_anywhere_(has_initial_estimate(model, initial_state_of(model, data, options.initial_state))),
      spread_(output_spread(model, data)),
      window_(estimation_window(model)),
      shown_(1 + ceil_div(model.states(), std::max<Index>(1, model.outputs))),
      together_(ceil_div(enough, std::max<Index>(1, data.experiments()))),
      is_misfit_(size_t(data.experiments()), false),
      gap_(size_t(data.experiments()), -1),
      start_(size_t(data.experiments()), -1),
      until_certain_(size_t(data.experiments()), 0),
      unreliable_(size_t(data.experiments())),
      usual_(Matrix::Constant(data.steps(), data.outputs(), nan)),
      far_(Vector::Constant(data.outputs(), far)),
      in_tail_(Matrix::Zero(data.experiments(), data.outputs())),
      tested_(in_tail_) {
  const auto& misfits = options.misfits;
  for (Index n = 0; n < data.experiments(); ++n)
    is_misfit_[size_t(n)] = std::find(misfits.begin(), misfits.end(), data.experiment_label(n)) != misfits.end();
}

bool OutlyingSampleCollector::of_no_consequence(const Matrix& innovation) const {
  for (Index j = 0; j < innovation.cols(); ++j)
    if ((innovation.col(j).array().abs() > of_consequence * spread_(j)).any())
      return false;  // also for a missing sample (NaN)
  return true;
}

void OutlyingSampleCollector::add(Index k, const Matrix& innovation) {
  if (quiet_ && of_no_consequence(innovation)) {
    ++skipped_;
    return;
  }
  // At the first error of consequence, the skipped steps are predicted again.
  if (std::exchange(quiet_, false) && skipped_ > 0)
    predict_each(model_, data_, initial_state_, [&](Index before, const Matrix& skipped) {
      if (before < k) collect(before, skipped);
    });
  collect(k, innovation);
}

void OutlyingSampleCollector::collect(Index k, const Matrix& innovation) {
  if (block_.empty()) begin_ = k;
  block_.push_back(innovation);
  restarts_.emplace_back();
  for (Index n = 0; n < innovation.rows(); ++n) {
    Index& gap = gap_[size_t(n)];
    if (innovation.row(n).array().isNaN().all()) {
      if (gap >= 0) ++gap;
    } else {
      if (gap < 0) start_[size_t(n)] = k;
      // If samples before the first prediction are missing, the other samples may determine an unknown state only
      // weakly.
      const bool begins = gap < 0 && data_.samples().row(n).head(k * data_.channels()).hasNaN();
      if (begins || gap > 1) restarts_.back().push_back(n);
      gap = 0;
    }
    // The first predictions from the mean of unknown initial states have the errors of this mean. They are not tested,
    // until a window of outputs has determined the state.
    const bool uncertain = begins_anywhere_ && k < start_[size_t(n)] + window_;
    if (uncertain) unreliable_[size_t(n)].push_back(k);
    if (uncertain || is_misfit_[size_t(n)]) block_.back().row(n).setConstant(nan);
  }
  if (Index(block_.size()) < together_) return;
  test_block(0);
  previous_ = std::move(block_);
  block_.clear();
  restarts_.clear();
}

bool OutlyingSampleCollector::is_far(Index k, Index j, double error) const {
  return error > far_(j) * usual_(k, j) && error > of_consequence * spread_(j);
}

// Tests the steps of the block from `from` on. The steps before `from` are tested already. They are still part of the
// medians.
void OutlyingSampleCollector::test_block(size_t from) {
  const Index N = data_.experiments(), m = data_.outputs();
  Vector own(N * Index(block_.size()));
  for (Index j = 0; j < m; ++j) {
    for (size_t i = 0; i < block_.size(); ++i) own.segment(Index(i) * N, N) = block_[i].col(j);
    const double of_block = median_size(own);
    // The median over two experiments can't show which of the two errors is wrong.
    for (size_t i = from; i < block_.size(); ++i) {
      double& usual = usual_(begin_ + Index(i), j);
      usual = std::fmax(of_block, N > 2 ? share_of_step * median_size(block_[i].col(j)) : nan);
      const auto errors = block_[i].col(j).array().abs();
      tested_.col(j).array() += (errors >= 0).cast<double>();  // also for a missing sample (NaN)
      in_tail_.col(j).array() += (errors > in_tail * usual).cast<double>();
    }
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

void OutlyingSampleCollector::adapt_to_tails() {
  const Index N = data_.experiments();
  for (Index j = 0; j < data_.outputs(); ++j) {
    // The experiments with the largest shares are left out, because something else may be wrong with them.
    std::vector<std::pair<double, Index>> shares;
    for (Index n = 0; n < N; ++n)
      if (tested_(n, j) > 0) shares.emplace_back(in_tail_(n, j) / tested_(n, j), n);
    std::sort(shares.begin(), shares.end());
    shares.resize(shares.size() - shares.size() / 10);
    double above = 0.0, all = 0.0;
    for (const auto& [share, n] : shares) above += in_tail_(n, j), all += tested_(n, j);
    // Two standard errors are subtracted, so that a normal distribution is not taken for another.
    if (all > 0) far_(j) = far_in_tails((above - 2 * std::sqrt(above)) / all, tested_.sum());
  }
  std::erase_if(flags_, [&](const Flag& flag) { return !is_far(flag.step, flag.output, flag.error); });
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
  if (quiet_) return {};
  if (!block_.empty()) {
    // The last steps are too few for a median, and are tested together with the steps before them.
    const size_t tested = previous_.size();
    begin_ -= Index(tested);
    block_.insert(block_.begin(), previous_.begin(), previous_.end());
    test_block(tested);
    block_.clear();
  }
  adapt_to_tails();
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
                      .numbers = {{"error", o.error}, {"usual", o.usual}, {"weight", o.weight}}});
  }
  if (outlying.size() > most_reported)
    result.push_back({.kind = Finding::Kind::more_outlying_samples,
                      .numbers = {{"count", double(outlying.size() - most_reported)}}});
  return result;
}

}  // namespace tokid
