// The observer of a model for samples that arrive step by step. Its predictions are those of predict() to the last bit,
// if no sample is missing, or with samples_missing = true and input_square as predict() computes it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "tokid/model.hpp"

namespace tokid {

struct OnlineObserverOptions {
  std::optional<InitialState> initial_state = {};  // empty: as the model was identified
  bool initial_estimate = true;                    // as PredictOptions::initial_estimate
  // true: samples may be missing. If the model has Q, R and a known or estimated initial state, a Kalman filter for the
  // samples that are present then replaces the observer, as in predict() for data with missing samples. A step takes
  // longer, because the gains depend on the missing samples. false: the observer (9), also where samples are missing.
  bool samples_missing = false;
  // (r) mean squares of the inputs as departures from the nominal trajectory: the variances of missing inputs in the
  // Kalman filter. predict() uses those of its data. Empty: with the Kalman filter, no input may be missing.
  Vector input_square = {};
};

// What one step shows. NaN where the state is not known, and where a sample is missing.
struct Observation {
  Vector prediction;  // (m) ŷ_{k|k-1}, with u_k
  Vector innovation;  // (m) y_k - ŷ_{k|k-1}
  // ε_kᵀ S_k⁻¹ ε_k over the available outputs, S_k = innovation_cov, or the covariance in the Kalman filter. Its mean
  // is the number of these outputs if S_k is right. NaN if the model has no covariance, or the innovation is not known.
  double normalised_square = std::numeric_limits<double>::quiet_NaN();
  Index outputs = 0;  // number of available outputs
};

// Runs x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) (9) from step 0 on, with the rules of predict() for unknown
// initial states and missing samples. Inputs and outputs are those of the data: the nominal trajectory of the model is
// subtracted and added. Steps before the model begins are allowed; they show nothing. A periodic model goes on after
// its last step.
// step() and predict() allocate no memory, with two exceptions: a step that estimates an unknown state from the samples
// before it, and, in the Kalman filter, a step with another number of states or of missing inputs than the step before.
class OnlineObserver {
 public:
  // \throws std::invalid_argument if the model is not consistent, if it has no step, or for a wrong size of
  // input_square
  explicit OnlineObserver(Model model, const OnlineObserverOptions& options = {});
  ~OnlineObserver();
  OnlineObserver(OnlineObserver&&) noexcept;
  OnlineObserver& operator=(OnlineObserver&&) noexcept;

  // Advances from step k to k+1 with the samples u_k (r) and y_k (m); NaN for a missing sample. The result is valid
  // until the next step.
  // \throws std::invalid_argument for a wrong number of samples, an infinite sample, a step after the end of the model,
  // or a missing input in the Kalman filter without input_square. The observer then remains as it was
  const Observation& step(const Eigen::Ref<const Vector>& u, const Eigen::Ref<const Vector>& y);

  Index k() const;           // the next step
  bool knows_state() const;  // is x̂_k known?
  // x̂_k (n_k) given the samples before step k; NaN where it is not known, empty before the model begins.
  Vector state() const;
  void copy_state(Eigen::Ref<Vector> x) const;  // the same without an allocation; x has n_k entries
  Index states() const;                         // n_k; 0 before the model begins

  // ŷ_{k+h|k-1} (H × m) for h = 0 … H-1, from the inputs u_k … u_{k+H-1} (H × r) and the samples before step k. NaN
  // where the state is not known, and after a missing input (NaN). Not for several threads at once, because the states
  // ahead are computed in memory of the observer.
  // \throws std::invalid_argument for a wrong shape, an infinite input, or steps outside the model
  Matrix predict(const ConstMatrixRef& inputs) const;
  void predict(const ConstMatrixRef& inputs, Eigen::Ref<Matrix> outputs) const;  // the same without an allocation

  void reset();  // back to step 0
  // The run so far as bytes, and the same run in an observer of the same model and options. For machines of the same
  // kind. \throws std::invalid_argument for damaged bytes, or a run of other A_k, B_k, C_k, D_k, of another kind of
  // observer, or of one that begins at another step
  std::string saved() const;
  void restore(std::string_view bytes);
  const Model& model() const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
