// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <optional>

#include "arrays.hpp"
#include "call.hpp"
#include "io/formats/provenance_text.hpp"
#include "model/step_fields.hpp"
#include "results.hpp"
#include "words.hpp"

namespace tokid::python {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

const StepField& field_of(const std::string& name) {
  for (const StepField& field : step_fields::all)
    if (name == field.name) return field;
  throw nb::key_error(name.c_str());
}

size_t count(const Model& model, const std::string& name) { return has(model, field_of(name)) ? model.step.size() : 0; }

ReadOnlyArray matrix(nb::handle self, const std::string& name, size_t s) {
  const Model& model = nb::cast<const Model&>(self);
  if (s >= count(model, name)) throw nb::index_error(name.c_str());
  return view_of((model.step[s].*field_of(name).view)(), self);
}

std::pair<Index, Index> stacked_size(const Model& model, const std::string& name) {
  const StepField& field = field_of(name);
  return {padded_size(model, field.rows, model.states()), padded_size(model, field.cols, model.states())};
}

// The matrices of all steps (S × rows × cols), in the order of C, padded with zeros.
NumPyArray stack(const Model& model, const std::string& name) {
  const auto [rows, cols] = stacked_size(model, name);
  const size_t steps = count(model, name), size = size_t(rows * cols);
  std::vector<double> values(steps * size, 0.0);
  for (size_t s = 0; s < steps; ++s) {
    const Step::View a = (model.step[s].*field_of(name).view)();
    if (a.rows() > rows || a.cols() > cols)
      throw std::invalid_argument("model: " + name + " has other sizes than the state dimensions need");
    Eigen::Map<RowMajor>(values.data() + s * size, rows, cols).topLeftCorner(a.rows(), a.cols()) = a;
  }
  return array_of(std::move(values), {steps, size_t(rows), size_t(cols)});
}

// Makes steps with these state dimensions and with zeros in all matrices. The last dimension is that of the state after
// the last step.
void set_state_dim(Model& model, const std::vector<Index>& state_dim) {
  model.step.clear();
  for (size_t s = 0; s + 1 < state_dim.size(); ++s)
    model.step.emplace_back(state_dim[s], state_dim[s + 1], model.inputs, model.outputs);
}

void need_entries(const Model& model, const std::string& name, size_t found) {
  if (found != model.step.size())
    throw std::invalid_argument(
        fmt::format("model: {} entries of {} found, {} needed", found, name, model.step.size()));
}

void set_matrices(Model& model, const std::string& name, const std::vector<Matrix>& matrices) {
  const StepField& field = field_of(name);
  if (field.optional && matrices.empty()) return;
  need_entries(model, name, matrices.size());
  for (size_t s = 0; s < matrices.size(); ++s) {
    const Matrix& a = matrices[s];
    const Index rows = size(model.step[s], field.rows), cols = size(model.step[s], field.cols);
    if (a.rows() != rows || a.cols() != cols)
      throw std::invalid_argument(
          fmt::format("model: {}[{}] is {} x {}, {} x {} needed", name, s, a.rows(), a.cols(), rows, cols));
    field.set(model.step[s], a);
  }
}

// The inverse of stack().
void set_stack(Model& model, const std::string& name,
               const nb::ndarray<const double, nb::ndim<3>, nb::c_contig>& whole) {
  const StepField& field = field_of(name);
  if (field.optional && whole.shape(0) == 0) return;
  need_entries(model, name, whole.shape(0));
  const Index rows = Index(whole.shape(1)), cols = Index(whole.shape(2));
  for (size_t s = 0; s < whole.shape(0); ++s) {
    Step& step = model.step[s];
    const Index used_rows = size(step, field.rows), used_cols = size(step, field.cols);
    if (used_rows > rows || used_cols > cols)
      throw std::invalid_argument("model: " + name + " is smaller than the state dimensions need");
    field.set(step, Eigen::Map<const RowMajor>(whole.data() + s * size_t(rows * cols), rows, cols)
                        .topLeftCorner(used_rows, used_cols));
  }
}

// Sets a value at all steps; an empty list changes nothing. The setters are only for models that no user has yet,
// because views of the old values become invalid.
template <class Value>
void set_all(Model& model, const char* name, void (Step::*set)(Value), const std::vector<Value>& values) {
  if (values.empty()) return;
  need_entries(model, name, values.size());
  for (size_t s = 0; s < values.size(); ++s) (model.step[s].*set)(values[s]);
}

// The singular values of all steps, one after the other, and their number at each step.
nb::tuple singular_values_joined(const Model& model) {
  std::vector<double> values;
  std::vector<size_t> sizes;
  for (const Step& step : model.step) {
    if (!step.has_singular_values()) continue;
    const auto found = step.singular_values();
    values.insert(values.end(), found.begin(), found.end());
    sizes.push_back(size_t(found.size()));
  }
  return nb::make_tuple(Vector(Vector::Map(values.data(), Index(values.size()))), sizes);
}

void set_singular_values(Model& model, const nb::ndarray<const double, nb::ndim<1>, nb::c_contig>& values,
                         const std::vector<size_t>& sizes) {
  if (sizes.empty()) return;
  need_entries(model, "singular_values", sizes.size());
  size_t begin = 0;
  for (size_t s = 0; s < sizes.size(); ++s) {
    if (sizes[s] > values.shape(0) - begin)
      throw std::invalid_argument("singular_values: fewer values found than the sum of their sizes, as many needed");
    model.step[s].set_singular_values(Eigen::Map<const Vector>(values.data() + begin, Index(sizes[s])));
    begin += sizes[s];
  }
}

// The Markov parameters (S, band, m, r): entry γ-1 of step s is h_{k,k-γ}, with k = k_begin + s. It is NaN if k-γ is
// before the model.
auto markov_parameters(const Model& model, Index band) {
  const std::vector<Matrix> h = without_gil([&] { return pulse_responses(model, band); });
  const auto entry = [&](Index s, Index g, Index j, Index i) { return h[size_t(s)](j, g * model.inputs + i); };
  return array_of_entries(entry, h.size(), band, model.outputs, model.inputs);
}

}  // namespace

void bind_model(nb::module_& module) {
  nb::enum_<InitialState>(module, "InitialState")
      .value("zero", InitialState::zero)
      .value("unknown", InitialState::unknown);

  nb::class_<Model> type(module, "Model", "The model of the library; tokid.Model is what users see of it.");
  def_channels(type);
  type.def(nb::init<>())
      .def("matrix", &matrix)
      .def("count", &count)
      .def("stack", &stack)
      .def("stacked_size", &stacked_size)
      .def("set_matrices", &set_matrices)
      .def("set_stack", &set_stack)
      .def(
          "copy", [](const Model& model) { return Model(model); }, no_gil)
      .def("singular_values",
           [](nb::handle self, size_t s) {
             const Model& model = nb::cast<const Model&>(self);
             if (s >= model.step.size() || !model.step[s].has_singular_values())
               throw nb::index_error("singular_values");
             return view_of(model.step[s].singular_values(), self);
           })
      .def("singular_values_count",
           [](const Model& model) { return model.has(&Step::has_singular_values) ? model.step.size() : 0; })
      .def("singular_values_joined", &singular_values_joined)
      .def("set_singular_values", &set_singular_values)
      .def_rw("inputs", &Model::inputs)
      .def_rw("outputs", &Model::outputs)
      .def_rw("k_begin", &Model::k_begin)
      .def_rw("dt", &Model::dt)
      .def_prop_rw("state_dim", &state_dimensions, &set_state_dim)
      .def_rw("period", &Model::period)
      .def_rw("frame", &Model::frame)
      .def_rw("method", &Model::method)
      .def_rw("initial_state", &Model::initial_state)
      .def_prop_rw(
          "condition", [](const Model& m) { return known_values(m, &Step::has_condition, &Step::condition); },
          [](Model& m, const std::vector<double>& values) { set_all(m, "condition", &Step::set_condition, values); })
      .def_prop_rw(
          "rank", [](const Model& m) { return known_values(m, &Step::has_rank, &Step::rank); },
          [](Model& m, const std::vector<Index>& values) { set_all(m, "rank", &Step::set_rank, values); })
      .def_prop_rw(
          "lags", [](const Model& m) { return known_values(m, &Step::has_lags, &Step::lags); },
          [](Model& m, const std::vector<Index>& values) { set_all(m, "lags", &Step::set_lags, values); })
      .def_prop_rw(
          "options", [](const Model& m) { return io::provenance_text(m.provenance); },
          [](Model& m, const std::string& text) { m.provenance = io::provenance_of(text, m.provenance.version); })
      .def_prop_rw(
          "version", [](const Model& m) { return m.provenance.version; },
          [](Model& m, const std::string& by) {
            m.provenance = io::provenance_of(io::provenance_text(m.provenance), by);
          })
      .def_rw("u_nominal", &Model::u_nominal)
      .def_rw("y_nominal", &Model::y_nominal)
      .def_rw("x0_mean", &Model::x0_mean)
      .def_rw("x0_cov", &Model::x0_cov)
      .def_prop_ro("steps", &Model::steps)
      .def_prop_ro("states", &Model::states)
      .def_prop_ro("full_begin", &Model::full_begin)
      .def_prop_ro("full_end", &Model::full_end)
      .def("check", &Model::check)
      .def("simulate",
           [](const Model& model, const Ensemble& inputs, const std::optional<Matrix>& x0) {
             return without_gil([&] { return simulate(model, inputs, x0.value_or(Matrix())); });
           })
      .def("simulate_data",
           [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
             return without_gil([&] { return simulate_data(model, data, initial_state); });
           })
      .def(
          "simulation_remarks",
          [](const Model& model, const Ensemble& inputs, const Ensemble& simulated, bool estimate) {
            return in_python(in_words(simulation_remarks(model, inputs, simulated, estimate)));
          },
          no_gil)
      .def("predict",
           [](const Model& model, const Ensemble& data, Index horizon, std::optional<InitialState> initial_state,
              bool initial_estimate) {
             const PredictOptions options{horizon, initial_state, initial_estimate};
             return without_gil([&] { return predict(model, data, options).y; });
           })
      .def(
          "prediction_remarks",
          [](const Model& model, const Ensemble& data, const Ensemble& predicted) {
            return in_python(in_words(prediction_remarks(model, data, predicted)));
          },
          no_gil)
      .def("innovations",
           [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
             const auto found = without_gil([&] { return model_innovations(model, data, initial_state); });
             const auto entry = [&](Index n, Index k, Index j) { return found[size_t(k)](n, j); };
             return array_of_entries(entry, data.experiments(), found.size(), data.outputs());
           })
      .def("estimate_state",
           [](const Model& model, const Ensemble& data, Index k, Index window) {
             return without_gil([&] { return estimate_state(model, data, k, window); });
           })
      .def("estimation_window", &estimation_window)
      .def("in_order",
           [](const Model& model, const Ensemble& data) {
             return without_gil([&] { return in_order(data, complete(model.names, model.inputs, model.outputs)); });
           })
      .def("markov", &markov_parameters)
      .def("pulse_response", &pulse_response)
      .def("gain_pulse_response", &gain_pulse_response)
      .def("observability", &observability)
      .def("deadbeat_products",
           [](const Model& model, Index p) {
             const std::vector<double> norms = without_gil([&] { return deadbeat_products(model, p); });
             return Vector(Vector::Map(norms.data(), Index(norms.size())));
           })
      .def("kalman_observer", [](const Model& model) { return without_gil([&] { return kalman_observer(model); }); })
      .def("deadbeat_observer",
           [](Model model, double tolerance) {
             DeadbeatGain gain = without_gil([&] { return deadbeat_gain(model, tolerance); });
             for (size_t s = 0; s < model.step.size(); ++s) model.step[s].G() = gain.G[s];
             return std::pair(std::move(model), gain.steps);
           })
      .def("cut", nb::overload_cast<Model, Index, Index>(&cut))
      .def("join",
           [](const Model& model, const Model& later, Index k, Index rows) {
             JoinedModel joined = without_gil([&] { return join(model, later, k, rows); });
             return std::pair(std::move(joined.model), joined.misfit);
           })
      .def("from_step", &from_step)
      .def("continued", &continued)
      .def("transform", &transform)
      .def("smooth_frame",
           [](const Model& model, Index rows) { return without_gil([&] { return smooth_frame(model, rows); }); })
      .def("reference_frame",
           [](const Model& model, Index s, Index rows) {
             return without_gil([&] { return reference_frame(model, s, rows).model; });
           })
      .def("align", [](const Model& model, const Model& reference,
                       Index rows) { return without_gil([&] { return align(model, reference, rows).model; }); })
      .def("identify_options", [](const Model& model) { return identify_options(model.provenance); });
  module.def("difference", [](const Model& model, const Model& other, Index band) {
    return without_gil([&] { return kinematically_similar(model, other, 0.0, band); });
  });
}

}  // namespace tokid::python
