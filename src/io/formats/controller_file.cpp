// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/controller_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <stdexcept>

#include "io/formats/files.hpp"
#include "io/formats/schema.hpp"

namespace tokid {

namespace {

using namespace io;

const Names& controller_names() {
  static const Names names{"k_begin",         "dt",
                           "state_dim",       "controller_gain",
                           "input_gain",      "system",
                           "feedforward",     "u_nominal",
                           "y_nominal",       "u_reference",
                           "y_reference",     "output_weight",
                           "input_weight",    "input_rate_weight",
                           "terminal_weight", "input_names",
                           "output_names",    "input_units",
                           "output_units",    "model",
                           "expected_cost",   "presumes_zero_state"};
  return names;
}

bool is_finite(const ExpectedCost& cost) {
  return std::isfinite(cost.outputs) && std::isfinite(cost.inputs) && std::isfinite(cost.input_rates) &&
         std::isfinite(cost.measurement_noise);
}

// Refuses what controller_of() refuses.
void check_to_write(const Controller& c) {
  c.check();
  if (c.begin < 0) throw std::invalid_argument(fmt::format("controller: begin {} found, 0 or more needed", c.begin));
  if (!(c.dt > 0)) throw std::invalid_argument(fmt::format("controller: dt {} found, a positive number needed", c.dt));
  const auto check_matrix = [](const char* name, const Matrix& matrix) {
    if (!matrix.allFinite())
      throw std::invalid_argument(
          fmt::format("controller: a number that is not finite found in its {}, finite ones needed", name));
  };
  const auto check_matrices = [&](const char* name, const std::vector<Matrix>& matrices) {
    for (const Matrix& matrix : matrices) check_matrix(name, matrix);
  };
  check_matrices("gains", c.K);
  check_matrices("gains", c.L);
  check_matrix("feedforward", c.feedforward);
  for (const Matrix* nominal : {&c.u_nominal, &c.y_nominal}) check_matrix("nominal trajectory", *nominal);
  for (const Matrix* reference : {&c.u_reference, &c.y_reference}) check_matrix("reference", *reference);
  check_matrices("output weights", c.weights.output);
  check_matrices("input weights", c.weights.input);
  check_matrices("input-rate weights", c.weights.input_rate);
  check_matrix("terminal weight", c.weights.terminal);
  if (!c.predicted) return;
  const ExpectedCost& cost = *c.predicted;
  for (const double part : {cost.outputs, cost.inputs, cost.input_rates, cost.measurement_noise})
    if (part < 0)
      throw std::invalid_argument(
          fmt::format("controller: an expected cost of {} found, numbers from 0 on needed", part));
}

// The matrices side by side, each padded with zeros to rows × columns.
Array stack_of(const std::vector<Matrix>& matrices, Index rows, Index columns, Layout layout) {
  Array array{{matrices.size(), size(rows), size(columns)}, {}};
  std::vector<double> values(checked_product(array.shape), 0.0);
  for (size_t s = 0; s < matrices.size(); ++s)
    for (Index i = 0; i < matrices[s].rows(); ++i)
      for (Index j = 0; j < matrices[s].cols(); ++j)
        values[(s * size(rows) + size(i)) * size(columns) + size(j)] = matrices[s](i, j);
  array.values = std::move(values);
  return layout == Layout::matlab ? permuted(array, {1, 2, 0}) : array;
}

Array array_of(const Matrix& matrix) {
  std::vector<double> values;
  for (Index i = 0; i < matrix.rows(); ++i)
    for (Index j = 0; j < matrix.cols(); ++j) values.push_back(matrix(i, j));
  return {{size(matrix.rows()), size(matrix.cols())}, std::move(values)};
}

Arrays arrays_of(const Controller& c, Layout layout) {
  const Index m = c.outputs, r = c.u_nominal.cols();
  std::vector<Index> states;
  for (const Matrix& K : c.K) states.push_back(K.cols());
  Arrays arrays;
  const auto add_stack = [&](const char* name, const std::vector<Matrix>& matrices, Index rows, Index columns) {
    if (!matrices.empty()) arrays.emplace_back(name, stack_of(matrices, rows, columns, layout));
  };
  const auto add = [&](const char* name, const Matrix& matrix) {
    if (matrix.size() > 0) arrays.emplace_back(name, array_of(matrix));
  };
  arrays.emplace_back("k_begin", scalar(c.begin));
  arrays.emplace_back("dt", scalar(c.dt));
  arrays.emplace_back("system", scalar(fmt::format("{:016x}", c.system)));
  if (!c.model_name.empty()) arrays.emplace_back("model", scalar(c.model_name));
  if (c.predicted && is_finite(*c.predicted)) {
    const ExpectedCost& cost = *c.predicted;
    arrays.emplace_back("expected_cost",
                        Array{{4}, std::vector{cost.outputs, cost.inputs, cost.input_rates, cost.measurement_noise}});
    arrays.emplace_back("presumes_zero_state", scalar(Index(cost.presumes_zero_state)));
  }
  add_channels(c.names, arrays);
  add_stack("output_weight", c.weights.output, m, m);
  add_stack("input_weight", c.weights.input, r, r);
  add_stack("input_rate_weight", c.weights.input_rate, r, r);
  add("terminal_weight", c.weights.terminal);
  add("u_reference", c.u_reference);
  add("y_reference", c.y_reference);
  add("feedforward", c.feedforward);
  add_stack("input_gain", c.L, r, r);
  arrays.emplace_back("u_nominal", array_of(c.u_nominal));
  arrays.emplace_back("y_nominal", array_of(c.y_nominal));
  arrays.emplace_back("state_dim", list(states));
  add_stack("controller_gain", c.K, r, *std::max_element(states.begin(), states.end()));
  return arrays;
}

// The matrices of a stack, without the columns from columns[s] on, which are padding.
std::vector<Matrix> matrices_of(const Fields& fields, const char* name, Index rows, const std::vector<Index>& columns) {
  const Array array = fields.stack(name);
  const Index width = Index(array.shape[2]), widest = *std::max_element(columns.begin(), columns.end());
  if (array.shape[0] != columns.size() || Index(array.shape[1]) != rows || width != widest)
    fail("data set '{}': {} steps of {} x {} found, {} steps of {} x {} needed", name, array.shape[0], array.shape[1],
         width, columns.size(), rows, widest);
  const auto& values = std::get<std::vector<double>>(array.values);
  std::vector<Matrix> matrices;
  for (size_t s = 0; s < columns.size(); ++s) {
    Matrix matrix(rows, columns[s]);
    for (Index i = 0; i < rows; ++i)
      for (Index j = 0; j < matrix.cols(); ++j)
        matrix(i, j) = values[(s * size(rows) + size(i)) * size(width) + size(j)];
    if (!matrix.allFinite()) fail("data set '{}': infinite or missing values found, finite values needed", name);
    matrices.push_back(std::move(matrix));
  }
  return matrices;
}

// Weights have one matrix, or one for each step.
std::vector<Matrix> weights_of(const Fields& fields, const char* name, Index channels, size_t steps) {
  if (!fields.has(name)) return {};
  const size_t found = fields.stack_shape(name)[0];
  return matrices_of(fields, name, channels, std::vector<Index>(found == 1 ? 1 : steps, channels));
}

Matrix trajectory_of(const Fields& fields, const char* name, Index rows, Index columns) {
  Matrix matrix = fields.matrix(name);
  if (matrix.rows() != rows || matrix.cols() != columns)
    fail_shape(name, fields.shape(name), fmt::format("({}, {})", rows, columns));
  if (!matrix.allFinite()) fail("data set '{}': infinite or missing values found, finite values needed", name);
  return matrix;
}

Controller controller_of(const Fields& fields) {
  Controller c;
  c.begin = fields.integer("k_begin");
  c.dt = fields.number("dt");
  const std::string system = fields.text("system");
  if (const char* const end = system.data() + system.size();
      std::from_chars(system.data(), end, c.system, 16).ptr != end || system.size() != 16)
    fail("data set 'system': '{}' found, 16 hexadecimal digits needed", system);
  c.names = channels_of(fields);
  if (c.begin < 0) fail("data set 'k_begin': {} found, 0 or more needed", c.begin);
  if (!(c.dt > 0)) fail("data set 'dt': {} found, a positive number needed", c.dt);
  const Matrix y_nominal = fields.matrix("y_nominal"), u_nominal = fields.matrix("u_nominal");
  const Index S = y_nominal.rows(), m = y_nominal.cols(), r = u_nominal.cols();
  if (S < 1 || m < 1 || r < 1)
    fail("data sets 'u_nominal' and 'y_nominal': {} x {} and {} x {} found, at least one step, input and output needed",
         u_nominal.rows(), r, S, m);
  c.outputs = m;
  c.u_nominal = trajectory_of(fields, "u_nominal", S, r);
  c.y_nominal = trajectory_of(fields, "y_nominal", S, m);
  constexpr Index many = 1'000'000;
  c.K = matrices_of(fields, "controller_gain", r, fields.integers("state_dim", size(S), 0, many));
  if (fields.has("input_gain")) c.L = matrices_of(fields, "input_gain", r, std::vector<Index>(size(S), r));
  if (fields.has("feedforward")) c.feedforward = trajectory_of(fields, "feedforward", S, r);
  if (fields.has("u_reference")) c.u_reference = trajectory_of(fields, "u_reference", S, r);
  if (fields.has("y_reference")) c.y_reference = trajectory_of(fields, "y_reference", S, m);
  c.weights.output = weights_of(fields, "output_weight", m, size(S));
  c.weights.input = weights_of(fields, "input_weight", r, size(S));
  c.weights.input_rate = weights_of(fields, "input_rate_weight", r, size(S));
  if (fields.has("terminal_weight")) c.weights.terminal = trajectory_of(fields, "terminal_weight", m, m);
  if (fields.has("model")) c.model_name = fields.text("model");
  if (fields.has("expected_cost")) {
    const std::vector<double>& cost = fields.list("expected_cost", 4);
    for (const double part : cost)
      if (!(part >= 0) || std::isinf(part))
        fail("data set 'expected_cost': {} found, finite numbers from 0 on needed", part);
    c.predicted = {cost[0], cost[1], cost[2], cost[3], fields.integer("presumes_zero_state") != 0};
  }
  return c;
}

}  // namespace

void save_controller(const Controller& controller, const std::filesystem::path& path, const WriteOptions& options) {
  check_to_write(controller);
  save_arrays(path, options, [&](Layout layout) { return arrays_of(controller, layout); });
}

Controller load_controller(const std::filesystem::path& path) {
  Controller controller;
  load_arrays(path, controller_names(), [&](const Fields& fields) {
    if (!is_controller(fields.names()))
      fail("{} found, a controller of tokid lqr ('controller_gain') needed",
           is_model(fields.names())          ? "a model"
           : is_ensemble(fields.names())     ? "an ensemble"
           : is_update_state(fields.names()) ? "a state file"
                                             : "another file");
    controller = controller_of(fields);
  });
  return controller;
}

}  // namespace tokid
