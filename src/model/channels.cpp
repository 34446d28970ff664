// SPDX-License-Identifier: BSD-3-Clause
#include "model/channels.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "data/axes.hpp"
#include "data/check.hpp"

namespace tokid {

void check_channels(const Model& model, const Ensemble& data, bool with_outputs) {
  model.check();
  with_remark_on_axes(data, [&] {
    if (data.inputs() != model.inputs)
      throw std::invalid_argument(fmt::format("inputs: {} found, the model has {}", data.inputs(), model.inputs));
    if (with_outputs && data.outputs() != model.outputs)
      throw std::invalid_argument(fmt::format("outputs: {} found, the model has {}", data.outputs(), model.outputs));
  });
  check_samples(data, with_outputs);
}

}  // namespace tokid
