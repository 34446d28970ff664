// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "base/words.hpp"
#include "data/check.hpp"

namespace tokid {

namespace {

// The inputs or the outputs of a run.
struct Part {
  const char* symbol;   // "u", "y"
  const char* channel;  // "input", "output"
  Index channels;
};

std::string subject(Index n, const std::string& name) { return "experiment " + words::experiment(n, name); }

// Row k of the result holds the samples of step k.
Matrix matrix_of(std::span<const double> samples, const Part& part, const std::string& run) {
  const Index count = Index(samples.size());
  if (part.channels == 0 && count > 0)
    throw std::invalid_argument(fmt::format("{} of {}: {} found, none needed, because there is no {}", part.symbol, run,
                                            words::plural(count, "sample"), part.channel));
  if (part.channels > 0 && count % part.channels != 0)
    throw std::invalid_argument(fmt::format("{} of {}: {} found, a multiple of {} needed: one for each {} at each step",
                                            part.symbol, run, words::plural(count, "sample"), part.channels,
                                            part.channel));
  if (part.channels == 0) return {};
  return Eigen::Map<const Matrix>(samples.data(), part.channels, count / part.channels).transpose();
}

Matrix matrix_of(const std::vector<std::vector<double>>& rows, const Part& part, const std::string& run) {
  Matrix result(Index(rows.size()), part.channels);
  for (size_t k = 0; k < rows.size(); ++k) {
    if (Index(rows[k].size()) != part.channels)
      throw std::invalid_argument(fmt::format("{} of {}: {} found at step {}, {} needed: one for each {}", part.symbol,
                                              run, words::plural(Index(rows[k].size()), "sample"), k, part.channels,
                                              part.channel));
    result.row(Index(k)) = Eigen::Map<const Eigen::RowVectorXd>(rows[k].data(), part.channels);
  }
  return result;
}

void check_columns(const ConstMatrixRef& samples, const Part& part, const std::string& run) {
  if (samples.cols() == part.channels || (part.channels == 0 && samples.size() == 0)) return;
  throw std::invalid_argument(fmt::format("{} of {}: {} x {} samples found, {} needed. Rows are steps{}", part.symbol,
                                          run, samples.rows(), samples.cols(), words::plural(part.channels, "column"),
                                          samples.rows() == part.channels ? ": transpose the matrix" : ""));
}

}  // namespace

Runs::Runs(Index inputs, Index outputs, RunsOptions options)
    : inputs_(inputs), outputs_(outputs), options_(std::move(options)) {
  const Ensemble none(0, 0, inputs, outputs, options_.dt.value_or(1.0));  // checks the sizes and dt
  check_names(options_.names, inputs, outputs);
}

void Runs::add(const ConstMatrixRef& u, const ConstMatrixRef& y, const std::string& name) {
  const std::string run = subject(size(), name);
  check_columns(u, {"u", "input", inputs_}, run);
  check_columns(y, {"y", "output", outputs_}, run);
  if (inputs_ > 0 && outputs_ > 0 && u.rows() != y.rows())
    throw std::invalid_argument(
        fmt::format("{}: {} of inputs and {} of outputs found, equal numbers needed. Mark missing samples by NaN", run,
                    words::plural(u.rows(), "step"), words::plural(y.rows(), "step")));
  const Index steps = inputs_ > 0 ? u.rows() : y.rows();
  if (steps == 0) throw std::invalid_argument(fmt::format("{}: no step found, at least one needed", run));
  Run added{name, Matrix(inputs_ + outputs_, steps)};
  if (inputs_ > 0) added.samples.topRows(inputs_) = u.transpose();
  if (outputs_ > 0) added.samples.bottomRows(outputs_) = y.transpose();
  for (Index k = 0; k < steps; ++k)
    for (Index c = 0; c < added.samples.rows(); ++c)
      if (std::isinf(added.samples(c, k)))
        throw std::invalid_argument(infinite_sample(options_.names, inputs_, c, words::experiment(size(), name), k));
  runs_.push_back(std::move(added));
}

void Runs::add(std::span<const double> u, std::span<const double> y, const std::string& name) {
  const std::string run = subject(size(), name);
  const Matrix inputs = matrix_of(u, {"u", "input", inputs_}, run),
               outputs = matrix_of(y, {"y", "output", outputs_}, run);
  add(ConstMatrixRef(inputs), ConstMatrixRef(outputs), name);
}

void Runs::add(const std::vector<std::vector<double>>& u, const std::vector<std::vector<double>>& y,
               const std::string& name) {
  const std::string run = subject(size(), name);
  const Matrix inputs = matrix_of(u, {"u", "input", inputs_}, run),
               outputs = matrix_of(y, {"y", "output", outputs_}, run);
  add(ConstMatrixRef(inputs), ConstMatrixRef(outputs), name);
}

Ensemble Runs::ensemble() const {
  if (runs_.empty()) throw std::invalid_argument("runs: no run found, at least one needed");
  Index steps = 0;
  for (const Run& run : runs_) steps = std::max(steps, run.samples.cols());
  Ensemble result(size(), steps, inputs_, outputs_, options_.dt.value_or(1.0));
  result.dt_stated = options_.dt.has_value();
  result.names = options_.names;
  result.initial_state = options_.initial_state;
  std::vector<std::string> names;
  std::vector<Index> length;
  for (size_t n = 0; n < runs_.size(); ++n) {
    const Run& run = runs_[n];
    result.samples().row(Index(n)).head(run.samples.size()) =
        Eigen::Map<const Eigen::RowVectorXd>(run.samples.data(), run.samples.size());
    names.push_back(run.name.empty() ? std::to_string(n) : run.name);
    length.push_back(run.samples.cols());
  }
  if (std::any_of(length.begin(), length.end(), [&](Index l) { return l < steps; })) result.length = std::move(length);
  set_experiment_names(result, std::move(names));
  return result;
}

}  // namespace tokid
