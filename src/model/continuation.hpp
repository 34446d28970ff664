// The steps and the nominal trajectory of a model, also after its last step if the model is periodic.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// Does a periodic model go on after its last step?
inline bool goes_on(const Model& model) { return model.period > 0 && model.steps() >= model.period; }

// Does the model have the step k?
inline bool has_step(const Model& model, Index k) {
  return k >= model.k_begin && (k < model.k_end() || goes_on(model));
}

// Step k of continued(model, k + 1).
inline const Step& step_at(const Model& model, Index k) {
  if (k < model.k_end()) return model.at(k);
  return model.step[size_t(model.steps() - model.period + (k - model.k_end()) % model.period)];
}

// n_k for k_begin ≤ k, and for k ≤ k_end unless the model is periodic.
inline Index states_at(const Model& model, Index k) {
  return has_step(model, k) ? step_at(model, k).states() : model.n(k);
}

// The row of a nominal trajectory for step k: that of u_nominal or y_nominal of continued(model, k + 1). -1 if the
// trajectory is zero there.
inline Index nominal_row(const Model& model, const Matrix& trajectory, Index k) {
  const Index known = trajectory.rows();
  if (k < known) return k;
  if (!goes_on(model) || known < model.period) return -1;
  return known - model.period + (k - known) % model.period;
}

// Turns samples (N × channels) into departures from a row of a nominal trajectory, which is zero outside its rows.
template <class Trajectory, class Samples>
void subtract_nominal(const Trajectory& trajectory, Index row, Samples&& samples) {
  if (row >= 0 && row < trajectory.rows()) samples.rowwise() -= trajectory.row(row);
}

}  // namespace tokid
