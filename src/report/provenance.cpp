// SPDX-License-Identifier: BSD-3-Clause
#include "provenance.hpp"

#include <stdexcept>

#include "tokid/identify.hpp"

namespace tokid::report {

Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options) {
  Tested result{data, options};
  if (options.evaluation != Evaluation::automatic) return result;
  result.options.evaluation = has_seen(model, data) ? Evaluation::training : Evaluation::given;
  try {
    const IdentifyOptions identification = identify_options(model);
    Split parts = split(data, identification.hold_out, identification.period);
    if (result.options.evaluation == Evaluation::given && has_seen(model, parts.training)) {
      result.data = std::move(parts.held_out);
      result.options.evaluation = Evaluation::held_out;
    }
  } catch (const std::invalid_argument&) {
    // Nothing was held out, or the data are too few for such a share: not those of the identification.
  }
  return result;
}

}  // namespace tokid::report
