// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "io/formats/provenance_text.hpp"
#include "io/formats/schema.hpp"
#include "model/step_fields.hpp"

namespace tokid::io {

namespace {

// ---- stacks of one matrix for each step ----

Array stack_array(const Model& model, const StepField& field, Index states, Layout layout) {
  const Index rows = padded_size(model, field.rows, states), columns = padded_size(model, field.cols, states);
  Array array{{model.step.size(), size(rows), size(columns)}, {}};
  std::vector<double> values(checked_product(array.shape), 0.0);
  for (size_t s = 0; s < model.step.size(); ++s) {
    const Step::View matrix = (model.step[s].*field.view)();
    for (Index i = 0; i < matrix.rows(); ++i)
      for (Index j = 0; j < matrix.cols(); ++j)
        values[(s * size(rows) + size(i)) * size(columns) + size(j)] = matrix(i, j);
  }
  array.values = std::move(values);
  return layout == Layout::matlab ? permuted(array, {1, 2, 0}) : array;
}

// Checks the shape before memory is allocated for the steps.
void check_shape(const Fields& fields, const StepField& field, size_t steps, Index states, const Model& model) {
  const Index rows = padded_size(model, field.rows, states), columns = padded_size(model, field.cols, states);
  const Shape found = fields.stack_shape(field.name);
  if (found != Shape{steps, size(rows), size(columns)})
    fail("data set '{}': {} steps of {} x {} found, {} steps of {} x {} needed", field.name, found[0], found[1],
         found[2], steps, rows, columns);
}

void read_stack(const Fields& fields, const StepField& field, Index states, Model& model) {
  const size_t steps = model.step.size();
  const Index rows = padded_size(model, field.rows, states), columns = padded_size(model, field.cols, states);
  const Array array = fields.stack(field.name);
  const auto& values = std::get<std::vector<double>>(array.values);
  Matrix matrix;
  for (size_t s = 0; s < steps; ++s) {
    matrix.resize(tokid::size(model.step[s], field.rows), tokid::size(model.step[s], field.cols));
    for (Index i = 0; i < matrix.rows(); ++i)
      for (Index j = 0; j < matrix.cols(); ++j)
        matrix(i, j) = values[(s * size(rows) + size(i)) * size(columns) + size(j)];
    field.set(model.step[s], matrix);
  }
}

// ---- the rest ----

Array matrix_array(const Matrix& matrix) {
  std::vector<double> values;
  for (Index i = 0; i < matrix.rows(); ++i)
    for (Index j = 0; j < matrix.cols(); ++j) values.push_back(matrix(i, j));
  return {{size(matrix.rows()), size(matrix.cols())}, std::move(values)};
}

// Steps may have different numbers of singular values, so NaN fills the ends of the shorter rows.
Array singular_values_array(const Model& model, Index longest) {
  Matrix padded_values = Matrix::Constant(model.steps(), longest, std::numeric_limits<double>::quiet_NaN());
  for (Index s = 0; s < model.steps(); ++s) {
    const auto values = model.step[size_t(s)].singular_values();
    padded_values.row(s).head(values.size()) = values.transpose();
  }
  return matrix_array(padded_values);
}

void read_singular_values(const Fields& fields, Model& model) {
  const Matrix padded_values = fields.matrix("singular_values");
  if (padded_values.rows() != model.steps())
    fail_shape("singular_values", fields.shape("singular_values"), fmt::format("({}, values)", model.steps()));
  for (Index s = 0; s < padded_values.rows(); ++s) {
    Index count = padded_values.cols();
    while (count > 0 && std::isnan(padded_values(s, count - 1))) --count;
    model.step[size_t(s)].set_singular_values(padded_values.row(s).head(count).transpose());
  }
}

struct TextField {
  const char* name;
  std::string Model::*text;
};
constexpr TextField text_fields[] = {{"frame", &Model::frame}, {"method", &Model::method}};
constexpr const char *provenance_name = "options", *version_name = "version";

struct CountField {
  const char* name;
  bool (Step::*has)() const;
  Index (Step::*get)() const;
  void (Step::*set)(Index);
};
constexpr CountField count_fields[] = {{"rank", &Step::has_rank, &Step::rank, &Step::set_rank},
                                       {"lags", &Step::has_lags, &Step::lags, &Step::set_lags}};

struct NominalField {
  const char* name;
  Matrix Model::*trajectory;
};
constexpr NominalField nominal_fields[] = {{"u_nominal", &Model::u_nominal}, {"y_nominal", &Model::y_nominal}};

void add_diagnostics(const Model& model, Arrays& arrays) {
  if (model.has(&Step::has_condition)) {
    std::vector<double> values = known_values(model, &Step::has_condition, &Step::condition);
    arrays.emplace_back("condition", Array{{values.size()}, std::move(values)});
  }
  for (const CountField& field : count_fields)
    if (model.has(field.has)) arrays.emplace_back(field.name, list(known_values(model, field.has, field.get)));
}

void read_diagnostics(const Fields& fields, Model& model) {
  const size_t steps = model.step.size();
  if (fields.has("singular_values")) read_singular_values(fields, model);
  if (fields.has("condition")) {
    const std::vector<double> values = fields.list("condition", steps);
    for (size_t s = 0; s < steps; ++s) model.step[s].set_condition(values[s]);
  }
  constexpr Index many = Index{1} << 52;
  for (const CountField& field : count_fields) {
    if (!fields.has(field.name)) continue;
    const std::vector<Index> counts = fields.integers(field.name, steps, 0, many);
    for (size_t s = 0; s < steps; ++s) (model.step[s].*field.set)(counts[s]);
  }
}

void add_initial_estimate(const Model& model, Arrays& arrays) {
  if (model.x0_mean.size() > 0)
    arrays.emplace_back("x0_mean", Array{{size(model.x0_mean.size())},
                                         std::vector<double>(model.x0_mean.begin(), model.x0_mean.end())});
  if (model.x0_cov.size() > 0) arrays.emplace_back("x0_cov", matrix_array(model.x0_cov));
}

void read_initial_estimate(const Fields& fields, Model& model) {
  const Index n = model.n(model.k_begin);
  if (fields.has("x0_mean")) {
    const auto& values = fields.list("x0_mean", size(n));
    model.x0_mean = Eigen::Map<const Vector>(values.data(), n);
  }
  if (fields.has("x0_cov")) model.x0_cov = fields.matrix("x0_cov");
}

void read_nominal(const Fields& fields, Model& model) {
  for (const auto& [name, trajectory] : nominal_fields)
    if (fields.has(name)) model.*trajectory = fields.matrix(name);
}

}  // namespace

const Names& model_names() {
  static const Names names = [] {
    Names all{"state_dim", "k_begin", "dt",          "period",       "initial_state", "singular_values", "condition",
              "x0_mean",   "x0_cov",  "input_names", "output_names", "input_units",   "output_units"};
    for (const StepField& field : step_fields::all) all.emplace_back(field.name);
    for (const auto& field : text_fields) all.emplace_back(field.name);
    all.insert(all.end(), {provenance_name, version_name});
    for (const auto& field : count_fields) all.emplace_back(field.name);
    for (const auto& field : nominal_fields) all.emplace_back(field.name);
    return all;
  }();
  return names;
}

bool is_update_state(const Names& found) { return contains(found, "window_factors"); }
bool is_controller(const Names& found) { return contains(found, "controller_gain"); }
bool is_model(const Names& found) { return contains(found, "A") && contains(found, "state_dim"); }

Index singular_value_count(const Model& model) {
  Index longest = 0;
  for (const Step& step : model.step)
    if (step.has_singular_values()) longest = std::max(longest, step.singular_values().size());
  return longest;
}

Arrays small_arrays_of(const Model& model) {
  Arrays arrays;
  const auto add_text = [&](const char* name, const std::string& text) {
    if (!text.empty()) arrays.emplace_back(name, scalar(text));
  };
  for (const auto& [name, field] : text_fields) add_text(name, model.*field);
  add_text(provenance_name, provenance_text(model.provenance));
  add_text(version_name, model.provenance.version);
  arrays.emplace_back("initial_state", scalar(std::string(to_string(model.initial_state))));
  arrays.emplace_back("k_begin", scalar(model.k_begin));
  arrays.emplace_back("dt", scalar(model.dt));
  if (model.period > 0) arrays.emplace_back("period", scalar(model.period));
  add_channels(model.names, arrays);
  add_diagnostics(model, arrays);
  add_initial_estimate(model, arrays);
  arrays.emplace_back("state_dim", list(state_dimensions(model)));
  return arrays;
}

Arrays nominal_arrays_of(const Model& model) {
  Arrays arrays;
  for (const auto& [name, trajectory] : nominal_fields)
    if ((model.*trajectory).rows() > 0) arrays.emplace_back(name, matrix_array(model.*trajectory));
  return arrays;
}

Arrays step_arrays_of(const Model& model, Index states, Index singular_values, Layout layout) {
  Arrays arrays = nominal_arrays_of(model);
  if (model.has(&Step::has_singular_values))
    arrays.emplace_back("singular_values", singular_values_array(model, singular_values));
  // In reverse order, so that A is written last.
  for (auto field = step_fields::all.rbegin(); field != step_fields::all.rend(); ++field)
    if (!field->optional || has(model, *field))
      arrays.emplace_back(field->name, stack_array(model, *field, states, layout));
  return arrays;
}

Arrays arrays_of(const Model& model, Layout layout) {
  Arrays arrays = small_arrays_of(model);
  for (auto& entry : step_arrays_of(model, model.states(), singular_value_count(model), layout))
    arrays.push_back(std::move(entry));
  return arrays;
}

Model model_of(const Fields& fields) {
  const Shape a = fields.stack_shape("A");
  const size_t steps = a[0];
  const auto states = static_cast<Index>(a[1]);
  Model model;
  model.outputs = static_cast<Index>(fields.stack_shape("C")[1]);
  model.inputs = static_cast<Index>(fields.stack_shape("B")[2]);
  const std::vector<Index> state_dim = fields.integers("state_dim", steps + 1, 0, states);
  for (const StepField& field : step_fields::all)
    if (!field.optional || fields.has(field.name)) check_shape(fields, field, steps, states, model);
  model.step.reserve(steps);
  for (size_t s = 0; s < steps; ++s)
    model.step.emplace_back(state_dim[s], state_dim[s + 1], model.inputs, model.outputs);
  if (fields.has("k_begin")) model.k_begin = fields.integer("k_begin");
  if (fields.has("dt")) model.dt = fields.number("dt");
  if (fields.has("period")) model.period = fields.integer("period");
  if (fields.has("initial_state")) model.initial_state = initial_state_from(fields.text("initial_state"));
  for (const auto& [name, field] : text_fields)
    if (fields.has(name)) model.*field = fields.text(name);
  const auto text_in = [&](const char* name) { return fields.has(name) ? fields.text(name) : std::string(); };
  model.provenance = checked_provenance(text_in(provenance_name), text_in(version_name));
  model.names = channels_of(fields);
  for (const StepField& field : step_fields::all)
    if (!field.optional || fields.has(field.name)) read_stack(fields, field, states, model);
  read_diagnostics(fields, model);
  read_nominal(fields, model);
  read_initial_estimate(fields, model);
  model.check();
  return model;
}

}  // namespace tokid::io
