// SPDX-License-Identifier: BSD-3-Clause
#include "model/samples.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "model/channels.hpp"
#include "model/continuation.hpp"
#include "tokid/linalg.hpp"

namespace tokid::kalman {

namespace {

// The available samples as flags, step by step, inputs before outputs.
std::vector<bool> pattern(const Ensemble& data, Index n, Index begin, Index end, Tail tail) {
  std::vector<bool> present;
  size_t last = 0;
  for (Index k = begin; k < end; ++k) {
    for (Index i = 0; i < data.inputs(); ++i) present.push_back(std::isfinite(data.u(n, k, i)));
    bool any = false;
    for (Index j = 0; j < data.outputs(); ++j) {
      present.push_back(std::isfinite(data.y(n, k, j)));
      any = any || present.back();
    }
    if (any || tail == Tail::keep) last = present.size();
  }
  present.resize(last);
  return present;
}

Alike alike(const std::vector<bool>& present, Index inputs, Index outputs) {
  Alike group;
  group.end = Index(present.size()) / (inputs + outputs);
  auto there = present.begin();
  for (Index t = 0; t < group.end; ++t) {
    group.unknowns.emplace_back();
    group.outputs.emplace_back();
    for (Index i = 0; i < inputs; ++i, ++there)
      if (!*there) group.unknowns.back().push_back(i);
    for (Index j = 0; j < outputs; ++j, ++there)
      if (*there) group.outputs.back().push_back(j);
  }
  return group;
}

// The inputs or the outputs of one step. The squares and the number of samples are added to `square` and `count`.
Matrix arranged(const Matrix& samples, const Matrix& nominal, Index k, const std::vector<Index>& experiments,
                Vector& square, Vector& count) {
  Matrix result = samples(experiments, Eigen::all);
  subtract_nominal(nominal, k, result);
  for (Index j = 0; j < result.cols(); ++j)
    for (Index i = 0; i < result.rows(); ++i) {
      double& value = result(i, j);
      if (!std::isfinite(value)) {
        value = 0.0;
        continue;
      }
      square(j) += value * value;
      count(j) += 1;
    }
  return result;
}

}  // namespace

Samples samples_of(const Model& model, const Ensemble& data, Tail tail, Index steps) {
  check_channels(model, data, true);
  Samples samples;
  samples.experiments = samples.rows = data.experiments();
  samples.one = Vector::Ones(samples.rows);
  samples.steps = std::max<Index>(0, std::min(model.k_end(), data.steps()) - model.k_begin);
  if (steps >= 0) samples.steps = std::min(samples.steps, steps);
  const Index begin = model.k_begin, end = begin + samples.steps;
  std::map<std::vector<bool>, std::vector<Index>> patterns;
  for (Index n = 0; n < data.experiments(); ++n) patterns[pattern(data, n, begin, end, tail)].push_back(n);
  for (const auto& [present, rows] : patterns) {
    Alike group = alike(present, data.inputs(), data.outputs());
    group.first = Index(samples.experiment.size());
    group.count = Index(rows.size());
    samples.experiment.insert(samples.experiment.end(), rows.begin(), rows.end());
    samples.groups.push_back(std::move(group));
  }
  Vector u_count = Vector::Zero(data.inputs()), y_count = Vector::Zero(data.outputs());
  samples.u_square = u_count;
  samples.y_square = y_count;
  for (Index k = begin; k < end; ++k) {
    samples.u.push_back(arranged(data.input(k), model.u_nominal, k, samples.experiment, samples.u_square, u_count));
    samples.y.push_back(arranged(data.output(k), model.y_nominal, k, samples.experiment, samples.y_square, y_count));
  }
  samples.outputs = y_count.sum();
  samples.u_square.array() /= u_count.array().max(1.0);
  samples.y_square.array() /= y_count.array().max(1.0);
  return samples;
}

std::optional<Samples> with_fewer_rows(const Samples& samples) {
  if (samples.groups.size() != 1 || samples.steps == 0) return std::nullopt;
  const Alike& group = samples.groups.front();
  const Index r = samples.u[0].cols(), m = samples.y[0].cols(), width = 1 + group.end * (r + m);
  if (samples.rows < 2 * width) return std::nullopt;
  for (Index t = 0; t < group.end; ++t)
    if (!group.unknowns[size_t(t)].empty() || Index(group.outputs[size_t(t)].size()) < m) return std::nullopt;
  // The rows come in blocks, so that not all samples are copied at once.
  linalg::RowStack stack(width);
  for (Index begin = 0; begin < samples.rows; begin += width) {
    const Index count = std::min(width, samples.rows - begin);
    Matrix block(count, width);
    block.col(0) = samples.one.segment(begin, count);
    for (Index t = 0; t < group.end; ++t) {
      const Index at = 1 + t * (r + m);
      block.middleCols(at, r) = samples.u[size_t(t)].middleRows(begin, count);
      block.middleCols(at + r, m) = samples.y[size_t(t)].middleRows(begin, count);
    }
    stack.add(block);
  }
  const Matrix factor = stack.factor();
  Samples fewer = samples;
  fewer.rows = fewer.groups.front().count = factor.rows();
  fewer.experiment.clear();
  fewer.one = factor.col(0);
  for (Index t = 0; t < samples.steps; ++t) {
    const Index at = 1 + t * (r + m);
    fewer.u[size_t(t)] = t < group.end ? Matrix(factor.middleCols(at, r)) : Matrix::Zero(fewer.rows, r);
    fewer.y[size_t(t)] = t < group.end ? Matrix(factor.middleCols(at + r, m)) : Matrix::Zero(fewer.rows, m);
  }
  return fewer;
}

}  // namespace tokid::kalman
