// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/stream.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

RESULT(Streamed, "Streamed", FIELD(identification), Field("states", s.identification.model.states()), FIELD(block),
       FIELD(blocks), FIELD(overlap), FIELD(missing))

void bind_stream(nb::module_& module) {
  module.def(
      "identify_stream",
      [](const std::filesystem::path& from, const std::filesystem::path& to, IdentifyOptions identify, Index block,
         double memory_per_thread, int threads, nb::object listener) {
        Call call(std::move(listener));
        identify.execution = call.execution(threads);
        return call.run([&] {
          const EnsembleFile file(from);
          StreamOptions options;
          options.identify = identify;
          options.block = block;
          options.memory_per_thread = memory_per_thread;
          return identify_stream(file, to, options);
        });
      },
      nb::arg("data"), nb::arg("model"), nb::arg("options"), nb::kw_only(), nb::arg("block"),
      nb::arg("memory_per_thread"), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
