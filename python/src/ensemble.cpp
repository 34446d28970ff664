// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/ensemble.hpp"

#include <array>
#include <cmath>
#include <limits>

#include "arrays.hpp"
#include "call.hpp"
#include "data/axes.hpp"
#include "results.hpp"
#include "tokid/remarks.hpp"
#include "words.hpp"

namespace tokid::python {

RESULT(ChannelSummary, "ChannelSummary", FIELD(samples), FIELD(missing), FIELD(mean), FIELD(std), FIELD(min),
       FIELD(max))

namespace {

using Names = std::vector<std::string>;

std::optional<std::string> initial_state(const Ensemble& e) {
  return e.initial_state ? std::optional<std::string>(to_string(*e.initial_state)) : std::nullopt;
}

void set_initial_state(Ensemble& e, const std::optional<std::string>& text) {
  e.initial_state = text ? std::optional(initial_state_from(*text)) : std::nullopt;
}

// The free responses (Nf, Tf, m); None if there are none.
std::optional<NumPyArray> free_outputs(nb::handle self) {
  auto& free = nb::cast<Ensemble&>(self).free;
  if (free.experiments == 0) return std::nullopt;
  const Index m = free.steps > 0 ? free.y.cols() / free.steps : 0;
  const std::array<size_t, 3> shape{size_t(free.experiments), size_t(free.steps), size_t(m)};
  const std::array<std::int64_t, 3> strides{1, free.experiments * m, free.experiments};
  return NumPyArray(free.y.data(), 3, shape.data(), self, strides.data());
}

// Sets samples beyond the lengths to NaN. It does not write a sample that is NaN already, because other threads may be
// reading. The caller holds the GIL.
void clear_beyond_lengths(Ensemble& e) {
  for (size_t n = 0; n < e.length.size(); ++n)
    for (Index c = e.length[n] * e.channels(); c < e.steps() * e.channels(); ++c) {
      double& sample = e.samples()(Index(n), c);
      if (!std::isnan(sample)) sample = std::numeric_limits<double>::quiet_NaN();
    }
}

}  // namespace

void bind_ensemble(nb::module_& module) {
  nb::class_<Ensemble> ensemble(module, "Ensemble",
                                "The ensemble of the library; tokid.Ensemble is what users see of it.");
  def_channels(ensemble);
  ensemble
      .def(
          "__init__",
          [](Ensemble* self, Index experiments, Index steps, Index inputs, Index outputs, double dt, bool unset) {
            new (self) Ensemble(experiments, steps, inputs, outputs, dt,
                                unset ? Ensemble::Samples::unset : Ensemble::Samples::missing);
          },
          nb::arg("experiments"), nb::arg("steps"), nb::arg("inputs"), nb::arg("outputs"), nb::arg("dt"),
          nb::arg("unset") = false, no_gil)
      .def_prop_ro("experiments", &Ensemble::experiments)
      .def_prop_ro("steps", &Ensemble::steps)
      .def_prop_ro("inputs", &Ensemble::inputs)
      .def_prop_ro("outputs", &Ensemble::outputs)
      .def_rw("dt", &Ensemble::dt)
      .def_rw("dt_stated", &Ensemble::dt_stated)
      .def_rw("reader_remarks", &Ensemble::remarks)
      .def(
          "remarks", [](const Ensemble& e) { return in_python(in_words(remarks(e))); }, no_gil)
      .def(
          "swapped_axes",
          [](const Ensemble& e) -> std::optional<std::string> {
            const std::optional<Finding> found = swapped_axes(e);
            return found ? std::optional(in_python(in_words(*found))) : std::nullopt;
          },
          no_gil)
      .def_prop_rw(
          "length", [](const Ensemble& e) { return e.length; },
          [](Ensemble& e, std::vector<Index> length) { set_length(e, std::move(length)); })
      .def_prop_rw(
          "experiment_names", [](const Ensemble& e) { return e.experiment_names; },
          [](Ensemble& e, Names names) { set_experiment_names(e, std::move(names)); })
      .def("experiment", &Ensemble::experiment)
      .def("clear_beyond_lengths", &clear_beyond_lengths)
      .def_prop_rw("initial_state", &initial_state, &set_initial_state, nb::for_setter(nb::arg().none()))
      .def_prop_rw("free_y", &free_outputs, [](Ensemble& e, const AnyArray& y) { e.free = free_response_of(y); })
      .def("write_inputs", [](Ensemble& e, const AnyArray& u) { write_samples(u, e, 0); })
      .def("write_outputs", [](Ensemble& e, const AnyArray& y) { write_samples(y, e, e.inputs()); })
      .def("u",
           [](nb::handle self) {
             auto& e = nb::cast<Ensemble&>(self);
             return samples_view(e, 0, e.inputs(), self);
           })
      .def("y",
           [](nb::handle self) {
             auto& e = nb::cast<Ensemble&>(self);
             return samples_view(e, e.inputs(), e.outputs(), self);
           })
      .def("outputs_copied", &outputs_of)
      .def("missing", &missing_samples, no_gil)
      .def("check", &Ensemble::check, nb::arg("outputs_needed") = true, no_gil)
      .def("subset", &Ensemble::subset, no_gil)
      .def("stretch", nb::overload_cast<const Ensemble&, Index, Index>(&stretch), no_gil)
      .def("cut", nb::overload_cast<const Ensemble&, Index>(&cut), no_gil)
      .def("split",
           [](const Ensemble& e, double fraction, Index period) {
             Split parts = without_gil([&] { return split(e, fraction, period); });
             return std::pair(std::move(parts.training), std::move(parts.held_out));
           })
      .def(
          "fingerprint", [](const Ensemble& e) { return fingerprint(e); }, no_gil)
      .def("channel_summary", &channel_summary, no_gil)
      .def("nominal",
           [](const Ensemble& e) {
             Nominal nominal = without_gil([&] { return nominal_trajectory(e); });
             return std::pair(std::move(nominal.u), std::move(nominal.y));
           })
      .def(
          "departures", [](const Ensemble& e) { return departures(e, nominal_trajectory(e)); }, no_gil);
}

}  // namespace tokid::python
