// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/example.hpp"

#include "python.hpp"

namespace tokid::python {

void bind_example(nb::module_& module) {
  module.def("oscillator", &oscillator, nb::arg("steps"), nb::arg("dt") = 0.05);
  module.def("rotating_tube", &rotating_tube, nb::arg("steps"), nb::arg("dt") = 0.1);
  module.def(
      "with_noise",
      [](const Model& system, double process_noise, double measurement_noise) {
        ExperimentOptions options;
        options.process_noise = process_noise;
        options.measurement_noise = measurement_noise;
        return with_noise(system, options);
      },
      no_gil);
  module.def(
      "experiments",
      [](const Model& system, Index count, const Ensemble* inputs, std::uint64_t seed, double process_noise,
         double measurement_noise, Index free_responses, InitialState initial_state) {
        const ExperimentOptions options{count, seed, process_noise, measurement_noise, free_responses, initial_state};
        return inputs ? experiments(system, *inputs, options) : experiments(system, options);
      },
      nb::arg("system"), nb::arg("count"), nb::arg("inputs").none(), nb::arg("seed"), nb::arg("process_noise"),
      nb::arg("measurement_noise"), nb::arg("free_responses"), nb::arg("initial_state"), no_gil);
}

}  // namespace tokid::python
