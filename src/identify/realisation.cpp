// SPDX-License-Identifier: BSD-3-Clause
#include "identify/realisation.hpp"
#include "base/integers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace tokid {

namespace {

// Block columns of H_k for noisy data: twice as many gained nothing in any system tried, half as many lost.
constexpr Index noisy_columns = 48;

}  // namespace

TveraOptions tvera_options(const IdentifyOptions& options, Index p, Index m, bool noisy) {
  const Index n = options.states;
  TveraOptions o;
  o.rows = options.rows > 0 ? options.rows : std::max(p + 1, ceil_div(n, m) + 1);
  // A single input, or a single direction of the inputs, may have to reach every state by itself: n columns, as n input
  // steps always suffice. With noise, more columns show the states better, slow and unstable ones above all.
  const Index most = noisy ? noisy_columns : n > 0 ? n : p * m;
  o.cols = options.cols > 0 ? options.cols : std::max(p, most);
  return o;
}

void note_regressions(const GtvArx& arx, Model& model) {
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const GtvArxStep& regression = arx.step[size_t(k)];
    Step& step = model.at(k);
    step.set_innovation_cov(arx.residual_cov(k));
    step.set_condition(regression.condition);
    step.set_rank(regression.rank);
    step.set_lags(regression.lags);
  }
}

Model in_frame(Model model, const IdentifyOptions& options, Index lags, std::string& told) {
  const Index rows = std::max<Index>(lags, ceil_div(std::max<Index>(1, model.states()), model.outputs));
  if (options.frame == Frame::smooth) return smooth_frame(model, rows);
  if (options.frame != Frame::reference) return model;
  const Index step = options.reference_step >= 0 ? options.reference_step : model.full_begin();
  FramedModel framed = reference_frame(model, step, rows);
  told = fmt::format("reference frame of step {}: steps {} to {} are in it, the others keep their own coordinates",
                     step, framed.begin, framed.end - 1);
  return std::move(framed.model);
}

void check_finite(const Model& model) {
  for (const Step& step : model.step)
    for (const Step::View& a : {step.A(), step.B(), step.C(), step.D(), step.G(),
                                step.has_innovation_cov() ? step.innovation_cov() : step.D()})
      if (!a.allFinite())
        throw std::overflow_error(
            "the model is not finite: samples or their ratios are beyond the range of double precision; scale the "
            "data");
}

}  // namespace tokid
