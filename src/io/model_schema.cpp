// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "schema.hpp"

namespace tokid::io {

namespace {

// ---- stacks of one matrix for each step ----

enum class Axis { next_states, states, inputs, outputs };  // n_{k+1}, n_k, r, m

struct Stack {
  const char* name;
  std::vector<Matrix> Model::*list;
  Axis rows, columns;
  bool required;
};

constexpr Stack stacks[] = {{"K", &Model::K, Axis::states, Axis::outputs, false},
                            {"R", &Model::R, Axis::outputs, Axis::outputs, false},
                            {"Q", &Model::Q, Axis::next_states, Axis::next_states, false},
                            {"innovation_cov", &Model::innovation_cov, Axis::outputs, Axis::outputs, false},
                            {"G", &Model::G, Axis::next_states, Axis::outputs, true},
                            {"D", &Model::D, Axis::outputs, Axis::inputs, true},
                            {"C", &Model::C, Axis::outputs, Axis::states, true},
                            {"B", &Model::B, Axis::next_states, Axis::inputs, true},
                            {"A", &Model::A, Axis::next_states, Axis::states, true}};

Index used(const Model& model, Axis axis, size_t s) {
  switch (axis) {
    case Axis::next_states:
      return model.state_dim[s + 1];
    case Axis::states:
      return model.state_dim[s];
    case Axis::inputs:
      return model.inputs;
    default:
      return model.outputs;
  }
}

Index padded(const Model& model, Axis axis, Index states) {
  return axis == Axis::inputs ? model.inputs : axis == Axis::outputs ? model.outputs : states;
}

Array stack_array(const std::vector<Matrix>& list, Index rows, Index columns, Layout layout) {
  Array array{{list.size(), size(rows), size(columns)}, {}};
  std::vector<double> values(checked_product(array.shape), 0.0);
  for (size_t s = 0; s < list.size(); ++s)
    for (Index i = 0; i < list[s].rows(); ++i)
      for (Index j = 0; j < list[s].cols(); ++j)
        values[(s * size(rows) + size(i)) * size(columns) + size(j)] = list[s](i, j);
  array.values = std::move(values);
  return layout == Layout::matlab ? permuted(array, {1, 2, 0}) : array;
}

std::vector<Matrix> read_stack(const Fields& fields, const Stack& stack, const Model& model, size_t steps,
                               Index states) {
  const Index rows = padded(model, stack.rows, states), columns = padded(model, stack.columns, states);
  const Array array = fields.stack(stack.name);
  const Shape needed{steps, size(rows), size(columns)};
  if (array.shape != needed)
    fail("data set '{}': {} steps of {} x {} found, {} steps of {} x {} needed", stack.name, array.shape[0],
         array.shape[1], array.shape[2], steps, rows, columns);
  const auto& values = std::get<std::vector<double>>(array.values);
  std::vector<Matrix> list;
  for (size_t s = 0; s < steps; ++s) {
    Matrix& matrix = list.emplace_back(used(model, stack.rows, s), used(model, stack.columns, s));
    for (Index i = 0; i < matrix.rows(); ++i)
      for (Index j = 0; j < matrix.cols(); ++j)
        matrix(i, j) = values[(s * size(rows) + size(i)) * size(columns) + size(j)];
  }
  return list;
}

// ---- the rest ----

Array matrix_array(const Matrix& matrix) {
  std::vector<double> values;
  for (Index i = 0; i < matrix.rows(); ++i)
    for (Index j = 0; j < matrix.cols(); ++j) values.push_back(matrix(i, j));
  return {{size(matrix.rows()), size(matrix.cols())}, std::move(values)};
}

// Steps have different numbers of singular values: NaN fills up.
Array singular_values_array(const std::vector<Vector>& list, Index longest) {
  Matrix padded_values =
      Matrix::Constant(static_cast<Index>(list.size()), longest, std::numeric_limits<double>::quiet_NaN());
  for (size_t s = 0; s < list.size(); ++s)
    padded_values.row(static_cast<Index>(s)).head(list[s].size()) = list[s].transpose();
  return matrix_array(padded_values);
}

std::vector<Vector> singular_values_of(const Fields& fields, size_t steps) {
  const Matrix padded_values = fields.matrix("singular_values");
  if (padded_values.rows() != static_cast<Index>(steps))
    fail_shape("singular_values", fields.shape("singular_values"), fmt::format("({}, values)", steps));
  std::vector<Vector> list;
  for (Index s = 0; s < padded_values.rows(); ++s) {
    Index count = padded_values.cols();
    while (count > 0 && std::isnan(padded_values(s, count - 1))) --count;
    list.emplace_back(padded_values.row(s).head(count).transpose());
  }
  return list;
}

struct TextField {
  const char* name;
  std::string Model::*text;
};
constexpr TextField text_fields[] = {
    {"frame", &Model::frame}, {"method", &Model::method}, {"options", &Model::options}, {"version", &Model::version}};

struct CountField {
  const char* name;
  std::vector<Index> Model::*list;
};
constexpr CountField count_fields[] = {{"rank", &Model::rank}, {"lags", &Model::lags}};

struct NominalField {
  const char* name;
  Matrix Model::*trajectory;
  Index Model::*channels;
};
constexpr NominalField nominal_fields[] = {{"u_nominal", &Model::u_nominal, &Model::inputs},
                                           {"y_nominal", &Model::y_nominal, &Model::outputs}};

void add_diagnostics(const Model& model, Arrays& arrays) {
  if (!model.condition.empty()) arrays.emplace_back("condition", Array{{model.condition.size()}, model.condition});
  for (const auto& [name, field] : count_fields)
    if (!(model.*field).empty()) arrays.emplace_back(name, list(model.*field));
}

void read_diagnostics(const Fields& fields, size_t steps, Model& model) {
  if (fields.has("singular_values")) model.singular_values = singular_values_of(fields, steps);
  if (fields.has("condition")) model.condition = fields.list("condition", steps);
  constexpr Index many = Index{1} << 52;
  for (const auto& [name, field] : count_fields)
    if (fields.has(name)) model.*field = fields.integers(name, steps, 0, many);
}

void add_initial_estimate(const Model& model, Arrays& arrays) {
  if (model.x0_mean.size() > 0)
    arrays.emplace_back("x0_mean", Array{{size(model.x0_mean.size())},
                                         std::vector<double>(model.x0_mean.begin(), model.x0_mean.end())});
  if (model.x0_cov.size() > 0) arrays.emplace_back("x0_cov", matrix_array(model.x0_cov));
}

void read_initial_estimate(const Fields& fields, Model& model) {
  const Index n = model.state_dim.front();
  if (fields.has("x0_mean")) {
    const auto& values = fields.list("x0_mean", size(n));
    model.x0_mean = Eigen::Map<const Vector>(values.data(), n);
  }
  if (fields.has("x0_cov")) {
    model.x0_cov = fields.matrix("x0_cov");
    if (model.x0_cov.rows() != n || model.x0_cov.cols() != n)
      fail_shape("x0_cov", fields.shape("x0_cov"), fmt::format("({}, {})", n, n));
  }
}

void read_nominal(const Fields& fields, Model& model) {
  for (const auto& [name, trajectory, channels] : nominal_fields) {
    if (!fields.has(name)) continue;
    model.*trajectory = fields.matrix(name);
    if ((model.*trajectory).cols() != model.*channels)
      fail_shape(name, fields.shape(name), fmt::format("(steps, {})", model.*channels));
  }
}

}  // namespace

const Names& model_names() {
  static const Names names = [] {
    Names all{"state_dim", "k_begin", "dt",          "period",       "initial_state", "singular_values", "condition",
              "x0_mean",   "x0_cov",  "input_names", "output_names", "input_units",   "output_units"};
    for (const auto& stack : stacks) all.emplace_back(stack.name);
    for (const auto& field : text_fields) all.emplace_back(field.name);
    for (const auto& field : count_fields) all.emplace_back(field.name);
    for (const auto& field : nominal_fields) all.emplace_back(field.name);
    return all;
  }();
  return names;
}

bool is_model(const Names& found) { return contains(found, "A") && contains(found, "state_dim"); }

Index singular_value_count(const Model& model) {
  Index longest = 0;
  for (const Vector& values : model.singular_values) longest = std::max(longest, values.size());
  return longest;
}

Arrays small_arrays_of(const Model& model) {
  Arrays arrays;
  for (const auto& [name, field] : text_fields)
    if (!(model.*field).empty()) arrays.emplace_back(name, scalar(model.*field));
  arrays.emplace_back("initial_state", scalar(std::string(to_string(model.initial_state))));
  arrays.emplace_back("k_begin", scalar(model.k_begin));
  arrays.emplace_back("dt", scalar(model.dt));
  if (model.period > 0) arrays.emplace_back("period", scalar(model.period));
  add_channels(model.names, arrays);
  add_diagnostics(model, arrays);
  add_initial_estimate(model, arrays);
  arrays.emplace_back("state_dim", list(model.state_dim));
  return arrays;
}

Arrays step_arrays_of(const Model& model, Index states, Index singular_values, Layout layout) {
  Arrays arrays;
  if (!model.singular_values.empty())
    arrays.emplace_back("singular_values", singular_values_array(model.singular_values, singular_values));
  for (const auto& [name, trajectory, channels] : nominal_fields)
    if ((model.*trajectory).rows() > 0) arrays.emplace_back(name, matrix_array(model.*trajectory));
  for (const auto& stack : stacks) {
    const auto& matrices = model.*stack.list;
    if (stack.required || !matrices.empty())
      arrays.emplace_back(stack.name, stack_array(matrices, padded(model, stack.rows, states),
                                                  padded(model, stack.columns, states), layout));
  }
  return arrays;
}

Arrays arrays_of(const Model& model, Layout layout) {
  Arrays arrays = small_arrays_of(model);
  for (auto& entry : step_arrays_of(model, model.states(), singular_value_count(model), layout))
    arrays.push_back(std::move(entry));
  return arrays;
}

Model model_of(const Fields& fields) {
  const Shape a = fields.stack("A").shape;
  const size_t steps = a[0];
  const auto states = static_cast<Index>(a[1]);
  Model model;
  model.outputs = static_cast<Index>(fields.stack("C").shape[1]);
  model.inputs = static_cast<Index>(fields.stack("B").shape[2]);
  model.state_dim = fields.integers("state_dim", steps + 1, 0, states);
  if (fields.has("k_begin")) model.k_begin = fields.integer("k_begin");
  if (fields.has("dt")) model.dt = fields.number("dt");
  if (fields.has("period")) model.period = fields.integer("period");
  if (fields.has("initial_state")) model.initial_state = initial_state_from(fields.text("initial_state"));
  for (const auto& [name, field] : text_fields)
    if (fields.has(name)) model.*field = fields.text(name);
  check_options(model.options);
  model.names = channels_of(fields);
  for (const auto& stack : stacks)
    if (stack.required || fields.has(stack.name)) model.*stack.list = read_stack(fields, stack, model, steps, states);
  read_diagnostics(fields, steps, model);
  read_nominal(fields, model);
  read_initial_estimate(fields, model);
  model.check();
  return model;
}

}  // namespace tokid::io
