// SPDX-License-Identifier: BSD-3-Clause
#include "model/units.hpp"

#include <cmath>

#include "data/channel_sizes.hpp"

namespace tokid {

namespace {

Vector powers_of_two(const Vector& sizes) {
  return sizes.unaryExpr([](double size) { return std::ldexp(1.0, std::ilogb(size) + 1); });
}

// x_{k+1} = A x + B u - G (y - ŷ), y = C x + D u, for u = units.input ∘ u' and y = units.output ∘ y'.
void leave_units(Step& step, const Units& units) {
  const Vector per_input = units.input.cwiseInverse(), per_output = units.output.cwiseInverse();
  const auto y = units.output.asDiagonal(), per_y = per_output.asDiagonal(), per_u = per_input.asDiagonal();
  step.B() = step.B() * per_u;
  step.C() = y * step.C();
  step.D() = y * step.D() * per_u;
  step.G() = step.G() * per_y;
  if (step.has_innovation_cov()) step.set_innovation_cov(y * step.innovation_cov() * y);
  if (step.has_R()) step.set_R(y * step.R() * y);
  if (step.has_K()) step.set_K(step.K() * per_y);
}

}  // namespace

Units units_of(const Ensemble& e) {
  return {powers_of_two(channel_sizes(e, 0, e.inputs())), powers_of_two(channel_sizes(e, e.inputs(), e.outputs()))};
}

Ensemble in_units(Ensemble e, const Units& units) {
  const Vector per_u = units.input.cwiseInverse(), per_y = units.output.cwiseInverse();
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k) *= per_u.asDiagonal();
    e.output(k) *= per_y.asDiagonal();
  }
  for (Index k = 0; k < e.free.steps; ++k) e.free.y.middleCols(k * e.outputs(), e.outputs()) *= per_y.asDiagonal();
  return e;
}

Model out_of_units(Model model, const Units& units) {
  // Only the steps of a period share numbers, and copies of other steps would double the memory of a model.
  const std::vector<Step> before = model.period > 0 ? model.step : std::vector<Step>();
  const size_t period = size_t(model.period);
  for (size_t s = 0; s < model.step.size(); ++s)
    if (period > 0 && s >= period && before[s] == before[s - period])
      model.step[s] = Step(model.step[s - period]);  // shares the numbers again
    else
      leave_units(model.step[s], units);
  return model;
}

}  // namespace tokid
