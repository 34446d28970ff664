// SPDX-License-Identifier: BSD-3-Clause
#include "provenance.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "tokid/gtv_arx.hpp"

namespace tokid::report {

bool recognised(const Model& model, const Ensemble& data) {
  if (model.lags.empty() || model.innovation_cov.empty()) return false;
  if (data.inputs() != model.inputs || data.outputs() != model.outputs || model.inputs == 0) return false;
  // A step in the middle: nothing there depends on how the ends are treated.
  const Index end = std::min(model.k_end(), data.steps()), k = (model.k_begin + end) / 2;
  if (k < model.k_begin || k >= end) return false;
  const Index p = model.lags[model.at(k)];
  if (p < 1 || k < p) return false;

  const bool nominal = model.y_nominal.rows() > k && model.u_nominal.rows() > k;
  Ensemble window(data.experiments(), p + 1, data.inputs(), data.outputs());
  for (Index j = 0; j <= p; ++j) {
    window.input(j) = data.input(k - p + j);
    window.output(j) = data.output(k - p + j);
    if (!nominal) continue;
    window.input(j).rowwise() -= model.u_nominal.row(k - p + j);
    window.output(j).rowwise() -= model.y_nominal.row(k - p + j);
  }
  GtvArxOptions options;
  options.lags = {p};
  options.initial_state = InitialState::unknown;
  options.spent = nominal ? 1 : 0;
  const GtvArx arx = gtv_arx(window, options);
  const GtvArxStep& step = arx.step[size_t(p)];

  const Matrix &D = model.D[model.at(k)], &covariance = model.innovation_cov[model.at(k)];
  const double difference = (Matrix(arx.D(p)) - D).norm() / std::max(D.norm(), 1e-300);
  // Residuals of noise-free data, or of as many experiments as unknowns, don't tell data apart: the bits of D do.
  const bool telling = step.freedom > 0 && covariance.trace() > 1e-18 * step.output_rms.squaredNorm();
  if (!telling) return difference < 1e-14;
  return difference < 1e-9 && (step.residual_cov - covariance).norm() < 1e-6 * covariance.norm();
}

namespace {

double held_out_share(const Model& model) {
  const auto json = nlohmann::json::parse(model.options, nullptr, false);
  return json.is_object() && json.contains("hold_out") && json["hold_out"].is_number() ? json["hold_out"].get<double>()
                                                                                       : 0.0;
}

}  // namespace

Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options) {
  Tested result{data, options};
  if (options.evaluation != Evaluation::automatic) return result;
  result.options.evaluation = recognised(model, data) ? Evaluation::training : Evaluation::given;
  if (const double share = held_out_share(model); share > 0 && share < 1) {
    try {
      Split parts = split(data, share);
      if (recognised(model, parts.training)) {
        result.data = std::move(parts.held_out);
        result.options.evaluation = Evaluation::held_out;
      }
    } catch (const std::invalid_argument&) {
      // Too few experiments for such a share: not the data of the identification.
    }
  }
  return result;
}

}  // namespace tokid::report
