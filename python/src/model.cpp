// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <array>
#include <optional>

#include "arrays.hpp"
#include "call.hpp"

namespace tokid::python {

namespace {

// The lists of matrices, with their sizes: n states, x of them at the next step, r inputs and m outputs.
struct List {
  const char* name;
  std::vector<Matrix> Model::*matrices;
  char rows, cols;
};
constexpr std::array lists{List{"A", &Model::A, 'x', 'n'}, List{"B", &Model::B, 'x', 'r'},
                           List{"C", &Model::C, 'm', 'n'}, List{"D", &Model::D, 'm', 'r'},
                           List{"G", &Model::G, 'x', 'm'}, List{"innovation_cov", &Model::innovation_cov, 'm', 'm'},
                           List{"Q", &Model::Q, 'x', 'x'}, List{"R", &Model::R, 'm', 'm'},
                           List{"K", &Model::K, 'n', 'm'}};

const List& list_of(const std::string& name) {
  for (const List& list : lists)
    if (name == list.name) return list;
  throw nb::key_error(name.c_str());
}

Index size_of(const Model& model, char what) {
  return what == 'n' || what == 'x' ? model.states() : what == 'r' ? model.inputs : model.outputs;
}

ReadOnlyArray matrix(nb::handle self, const std::string& name, size_t s) {
  const Model& model = nb::cast<const Model&>(self);
  return view_of((model.*list_of(name).matrices).at(s), self);
}

NumPyArray stack(const Model& model, const std::string& name) {
  const List& list = list_of(name);
  return stacked(model.*list.matrices, size_of(model, list.rows), size_of(model, list.cols));
}

void set_matrices(Model& model, const std::string& name, const std::vector<AnyArray>& arrays) {
  std::vector<Matrix>& matrices = model.*list_of(name).matrices;
  matrices.clear();
  for (const AnyArray& array : arrays) matrices.push_back(matrix_of(array));
}

// The inverse of stack(), by the state dimensions of the model.
void set_stack(Model& model, const std::string& name,
               const nb::ndarray<const double, nb::ndim<3>, nb::c_contig>& whole) {
  const List& list = list_of(name);
  const Index rows = Index(whole.shape(1)), cols = Index(whole.shape(2));
  const auto size = [&model](char what, size_t s) {
    return what == 'n' || what == 'x' ? model.state_dim.at(s + (what == 'x')) : size_of(model, what);
  };
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  std::vector<Matrix> matrices;
  matrices.reserve(whole.shape(0));
  for (size_t s = 0; s < whole.shape(0); ++s) {
    const Index used_rows = size(list.rows, s), used_cols = size(list.cols, s);
    if (used_rows > rows || used_cols > cols) throw std::invalid_argument(name + ": smaller than the state dimensions");
    matrices.emplace_back(Eigen::Map<const RowMajor>(whole.data() + s * size_t(rows * cols), rows, cols)
                              .topLeftCorner(used_rows, used_cols));
  }
  model.*list.matrices = std::move(matrices);
}

// Singular values of all steps behind each other, and how many each step has.
nb::tuple singular_values_joined(const Model& model) {
  std::vector<double> values;
  std::vector<size_t> sizes;
  for (const Vector& step : model.singular_values) {
    values.insert(values.end(), step.data(), step.data() + step.size());
    sizes.push_back(size_t(step.size()));
  }
  const size_t count = values.size();
  return nb::make_tuple(array_of(std::move(values), {count}), sizes);
}

void set_singular_values(Model& model, const nb::ndarray<const double, nb::ndim<1>, nb::c_contig>& values,
                         const std::vector<size_t>& sizes) {
  std::vector<Vector> steps;
  size_t begin = 0;
  for (const size_t size : sizes) {
    if (size > values.shape(0) - begin) throw std::invalid_argument("singular_values: fewer than their sizes");
    steps.emplace_back(Eigen::Map<const Vector>(values.data() + begin, Index(size)));
    begin += size;
  }
  model.singular_values = std::move(steps);
}

// (S, band, m, r): entry γ-1 of step s is h_{k,k-γ}, k = k_begin + s; NaN where that begins before the model.
NumPyArray markov_parameters(const Model& model, Index band) {
  const std::vector<Matrix> h = without_gil([&] { return pulse_responses(model, band); });
  const size_t S = h.size(), blocks = size_t(band), m = size_t(model.outputs), r = size_t(model.inputs);
  std::vector<double> values;
  values.reserve(S * blocks * m * r);
  for (const Matrix& step : h)
    for (size_t g = 0; g < blocks; ++g)
      for (size_t j = 0; j < m; ++j)
        for (size_t i = 0; i < r; ++i) values.push_back(step(Index(j), Index(g * r + i)));
  return array_of(std::move(values), {S, blocks, m, r});
}

// (T, N, m) → (N, T, m), in the order of C
NumPyArray by_experiment(const std::vector<Matrix>& steps, Index N, Index m) {
  const size_t T = steps.size();
  std::vector<double> values(size_t(N) * T * size_t(m));
  for (size_t k = 0; k < T; ++k)
    for (Index j = 0; j < m; ++j)
      for (Index n = 0; n < N; ++n) values[(size_t(n) * T + k) * size_t(m) + size_t(j)] = steps[k](n, j);
  return array_of(std::move(values), {size_t(N), T, size_t(m)});
}

}  // namespace

void bind_model(nb::module_& module) {
  nb::enum_<InitialState>(module, "InitialState")
      .value("zero", InitialState::zero)
      .value("unknown", InitialState::unknown);

  nb::class_<Model>(module, "Model", "The model of the library; tokid.Model is what users see of it.")
      .def(nb::init<>())
      .def("matrix", &matrix)
      .def("count", [](const Model& model, const std::string& name) { return (model.*list_of(name).matrices).size(); })
      .def("stack", &stack)
      .def("stacked_size",
           [](const Model& model, const std::string& name) {
             const List& list = list_of(name);
             return std::pair(size_of(model, list.rows), size_of(model, list.cols));
           })
      .def("set_matrices", &set_matrices)
      .def("set_stack", &set_stack)
      .def(
          "copy", [](const Model& model) { return Model(model); }, nb::call_guard<nb::gil_scoped_release>())
      .def("singular_values",
           [](nb::handle self, size_t s) { return view_of(nb::cast<const Model&>(self).singular_values.at(s), self); })
      .def("singular_values_count", [](const Model& model) { return model.singular_values.size(); })
      .def("singular_values_joined", &singular_values_joined)
      .def("set_singular_values", &set_singular_values)
      .def_rw("inputs", &Model::inputs)
      .def_rw("outputs", &Model::outputs)
      .def_rw("k_begin", &Model::k_begin)
      .def_rw("dt", &Model::dt)
      .def_rw("state_dim", &Model::state_dim)
      .def_rw("period", &Model::period)
      .def_rw("frame", &Model::frame)
      .def_rw("method", &Model::method)
      .def_rw("initial_state", &Model::initial_state)
      .def_rw("condition", &Model::condition)
      .def_rw("rank", &Model::rank)
      .def_rw("lags", &Model::lags)
      .def_rw("options", &Model::options)
      .def_rw("version", &Model::version)
      .def_prop_rw(
          "input_names", [](const Model& m) { return m.names.input_names; },
          [](Model& m, std::vector<std::string> names) { m.names.input_names = std::move(names); })
      .def_prop_rw(
          "output_names", [](const Model& m) { return m.names.output_names; },
          [](Model& m, std::vector<std::string> names) { m.names.output_names = std::move(names); })
      .def_prop_rw(
          "input_units", [](const Model& m) { return m.names.input_units; },
          [](Model& m, std::vector<std::string> names) { m.names.input_units = std::move(names); })
      .def_prop_rw(
          "output_units", [](const Model& m) { return m.names.output_units; },
          [](Model& m, std::vector<std::string> names) { m.names.output_units = std::move(names); })
      .def_prop_rw(
          "u_nominal", [](nb::handle self) { return view_of(nb::cast<const Model&>(self).u_nominal, self); },
          [](Model& m, const AnyArray& u) { m.u_nominal = matrix_of(u); })
      .def_prop_rw(
          "y_nominal", [](nb::handle self) { return view_of(nb::cast<const Model&>(self).y_nominal, self); },
          [](Model& m, const AnyArray& y) { m.y_nominal = matrix_of(y); })
      .def_prop_rw(
          "x0_mean", [](nb::handle self) { return view_of(nb::cast<const Model&>(self).x0_mean, self); },
          [](Model& m, const AnyArray& x) { m.x0_mean = vector_of(x); })
      .def_prop_rw(
          "x0_cov", [](nb::handle self) { return view_of(nb::cast<const Model&>(self).x0_cov, self); },
          [](Model& m, const AnyArray& x) { m.x0_cov = matrix_of(x); })
      .def_prop_ro("steps", &Model::steps)
      .def_prop_ro("states", &Model::states)
      .def_prop_ro("full_begin", &Model::full_begin)
      .def_prop_ro("full_end", &Model::full_end)
      .def("check", &Model::check)
      .def(
          "simulate",
          [](const Model& model, const Ensemble& inputs, const std::optional<AnyArray>& x0) {
            const Matrix start = x0 ? matrix_of(*x0) : Matrix();
            return without_gil([&] { return simulate(model, inputs, start); });
          },
          nb::arg("inputs"), nb::arg("x0").none())
      .def(
          "simulate_data",
          [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
            return without_gil([&] { return simulate_data(model, data, initial_state); });
          },
          nb::arg("data"), nb::arg("initial_state").none())
      .def("simulation_remarks", &simulation_remarks, nb::arg("inputs"), nb::arg("simulated"), nb::arg("estimate"),
           nb::call_guard<nb::gil_scoped_release>())
      .def(
          "predict",
          [](const Model& model, const Ensemble& data, Index horizon, std::optional<InitialState> initial_state,
             bool initial_estimate) {
            const PredictOptions options{horizon, initial_state, initial_estimate};
            return without_gil([&] { return predict(model, data, options).y; });
          },
          nb::arg("data"), nb::arg("horizon"), nb::arg("initial_state").none(), nb::arg("initial_estimate"))
      .def("prediction_remarks", &prediction_remarks, nb::arg("data"), nb::arg("predicted"),
           nb::call_guard<nb::gil_scoped_release>())
      .def(
          "innovations",
          [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
            const auto found = without_gil([&] { return model_innovations(model, data, initial_state); });
            return by_experiment(found, data.experiments(), data.outputs());
          },
          nb::arg("data"), nb::arg("initial_state").none())
      .def("estimate_state",
           [](const Model& model, const Ensemble& data, Index k, Index window) {
             return array_of(without_gil([&] { return Matrix(estimate_state(model, data, k, window)); }));
           })
      .def("estimation_window", &estimation_window)
      .def("differences", &differences)
      .def("in_order",
           [](const Model& model, const Ensemble& data) {
             return without_gil([&] { return in_order(data, complete(model.names, model.inputs, model.outputs)); });
           })
      .def("markov", &markov_parameters)
      .def("pulse_response",
           [](const Model& model, Index k, Index i) { return array_of(Matrix(pulse_response(model, k, i))); })
      .def("gain_pulse_response",
           [](const Model& model, Index k, Index i) { return array_of(Matrix(gain_pulse_response(model, k, i))); })
      .def("observability",
           [](const Model& model, Index k, Index rows) { return array_of(Matrix(observability(model, k, rows))); })
      .def("deadbeat_products",
           [](const Model& model, Index p) {
             std::vector<double> norms = without_gil([&] { return deadbeat_products(model, p); });
             const size_t count = norms.size();
             return array_of(std::move(norms), {count});
           })
      .def("kalman_observer", [](const Model& model) { return without_gil([&] { return kalman_observer(model); }); })
      .def("deadbeat_observer",
           [](Model model, double tolerance) {
             DeadbeatGain gain = without_gil([&] { return deadbeat_gain(model, tolerance); });
             model.G = std::move(gain.G);
             return std::pair(std::move(model), gain.steps);
           })
      .def("from_step", &from_step)
      .def("continued", &continued)
      .def("transform",
           [](const Model& model, const std::vector<AnyArray>& S) {
             std::vector<Matrix> matrices;
             for (const AnyArray& s : S) matrices.push_back(matrix_of(s));
             return transform(model, matrices);
           })
      .def("smooth_frame",
           [](const Model& model, Index rows) { return without_gil([&] { return smooth_frame(model, rows); }); })
      .def("reference_frame",
           [](const Model& model, Index s, Index rows) {
             return without_gil([&] { return reference_frame(model, s, rows).model; });
           })
      .def("align", [](const Model& model, const Model& reference,
                       Index rows) { return without_gil([&] { return align(model, reference, rows).model; }); })
      .def("difference",
           [](const Model& model, const Model& other, Index band) {
             return without_gil([&] { return kinematically_similar(model, other, 0.0, band).max_difference; });
           })
      .def("identify_options", &identify_options);
}

}  // namespace tokid::python
