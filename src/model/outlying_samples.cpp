// SPDX-License-Identifier: BSD-3-Clause
#include "model/outlying_samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

// Samples that a median needs, for a scatter of it by a fifth.
constexpr Index enough = 40;
// Multiples of the median size: 13 standard deviations of a normal distribution.
constexpr double far = 20.0;
// Of the spread of the output: less than this is of no consequence.
constexpr double of_consequence = 0.05;

double median_size(const Eigen::Ref<const Vector>& errors) {
  std::vector<double> sizes;
  for (const double e : errors)
    if (!std::isnan(e)) sizes.push_back(std::abs(e));
  return statistics::median(std::move(sizes));
}

}  // namespace

Vector output_spread(const Model& model, const Ensemble& data) {
  Vector spread(data.outputs());
  for (Index j = 0; j < data.outputs(); ++j) {
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (Index k = 0; k < data.steps(); ++k)
      for (const double value : data.output(k).col(j)) {
        if (std::isnan(value)) continue;
        const double y = k < model.y_nominal.rows() ? value - model.y_nominal(k, j) : value;
        sum += y;
        squares += y * y;
        ++count;
      }
    const double mean = model.y_nominal.rows() > 0 || count == 0 ? 0.0 : sum / double(count);
    const double variance = count > 0 ? squares / double(count) - mean * mean : 0.0;
    spread(j) = variance > 0 ? std::sqrt(variance) : 1.0;
  }
  return spread;
}

OutlyingSampleCollector::OutlyingSampleCollector(const Model& model, const Ensemble& data, Vector spread,
                                                 const std::vector<std::string>& misfits)
    : data_(data),
      spread_(std::move(spread)),
      window_(estimation_window(model)),
      together_((enough + data.experiments() - 1) / std::max<Index>(1, data.experiments())),
      uncertain_until_(size_t(data.experiments()), 0),
      gap_(size_t(data.experiments()), 0) {
  for (Index n = 0; n < data.experiments(); ++n)
    if (std::find(misfits.begin(), misfits.end(), data.experiment_label(n)) != misfits.end())
      uncertain_until_[size_t(n)] = data.steps();
}

void OutlyingSampleCollector::add(Index k, const Matrix& innovation) {
  if (block_.empty()) begin_ = k;
  block_.push_back(innovation);
  for (Index n = 0; n < innovation.rows(); ++n) {
    Index& gap = gap_[size_t(n)];
    Index& until = uncertain_until_[size_t(n)];
    if (k < until) block_.back().row(n).setConstant(nan);
    if (innovation.row(n).hasNaN()) {
      ++gap;
    } else if (gap > 0) {
      // What was lost in a gap takes as long to be found again, and no less than a state takes.
      until = std::max(until, k + gap + window_);
      gap = 0;
      block_.back().row(n).setConstant(nan);
    }
  }
  if (Index(block_.size()) == together_) judge_block();
}

void OutlyingSampleCollector::judge_block() {
  Vector own(data_.experiments() * Index(block_.size()));
  for (Index j = 0; j < data_.outputs(); ++j) {
    for (size_t i = 0; i < block_.size(); ++i)
      own.segment(Index(i) * data_.experiments(), data_.experiments()) = block_[i].col(j);
    // No error that would count: most blocks of most data.
    if (!(own.array().isNaN().select(0.0, own.array().abs()).maxCoeff() > of_consequence * spread_(j))) continue;
    const double of_block = median_size(own);
    for (size_t i = 0; i < block_.size(); ++i) {
      const auto errors = block_[i].col(j);
      // A median of two is no witness against either.
      const double of_step = data_.experiments() > 2 ? median_size(errors) : 0.0;
      const double usual = std::max(of_block, std::isnan(of_step) ? 0.0 : of_step);
      for (Index n = 0; n < errors.size(); ++n) {
        const double error = std::abs(errors(n));
        if (!(error > far * usual && error > of_consequence * spread_(j))) continue;
        OutlyingSamples& o =
            found_.try_emplace({n, j}, OutlyingSamples{n, j, {}, 0.0, 0.0, data_.experiment_name(n)}).first->second;
        o.steps.push_back(begin_ + Index(i));
        if (error > o.error) o.error = error, o.usual = usual;
      }
    }
  }
  block_.clear();
}

std::vector<OutlyingSamples> OutlyingSampleCollector::found() {
  if (!block_.empty()) judge_block();
  std::vector<OutlyingSamples> result;
  for (auto& [key, samples] : found_) result.push_back(std::move(samples));
  return result;
}

std::vector<std::string> warnings_of(const std::vector<OutlyingSamples>& outlying, const Ensemble& data) {
  constexpr size_t most_told = 5;
  std::vector<std::string> result;
  for (const OutlyingSamples& o : outlying) {
    if (result.size() == most_told) {
      result.push_back(fmt::format("{} of experiments with samples far off their predictions",
                                   words::plural(Index(outlying.size() - most_told), "more output")));
      break;
    }
    result.push_back(fmt::format(
        "experiment {}, output {}: {} up to {:.3g} off {} (usual: {:.2g}), at {}. Mark faulty samples as missing: they "
        "weigh on the model",
        o.name.empty() ? std::to_string(o.experiment) : fmt::format("\"{}\"", words::quoted(o.name)),
        data.names.output(o.output), words::plural(Index(o.steps.size()), "sample"), o.error,
        o.steps.size() == 1 ? "its prediction" : "their predictions", o.usual, words::step_list(o.steps)));
  }
  return result;
}

}  // namespace tokid
