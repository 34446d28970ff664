// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/uncertainty.hpp"

namespace tokid {

Spectrum closed_loop_spectrum(const Model& model, const ClosedLoopOptions& options) {
  const Index step = options.reference_step >= 0 ? options.reference_step : model.full_begin();
  const FramedModel framed = reference_frame(model, step, options.rows > 0 ? options.rows : estimation_window(model));
  Spectrum result{framed.begin, {}};
  for (Index k = framed.begin; k + 1 < framed.end; ++k)  // x_k and x_{k+1} are in the frame
    result.eigenvalues.push_back(linalg::eigenvalues(framed.model.at(k).closed_loop()));
  return result;
}

}  // namespace tokid
