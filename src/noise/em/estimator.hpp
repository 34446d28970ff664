// The parameters of a model in EM: their estimate from second moments, and their coordinates for the acceleration.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "model/smoother.hpp"
#include "noise/em/state_coordinates.hpp"

namespace tokid::em {

// The covariances of all phases. The covariance of a phase is `shape` (one for each phase, or one for all) times the
// scale of its segment.
struct Noise {
  std::vector<Matrix> shape;
  Vector scale;                // (segments)
  std::vector<Index> segment;  // (phases)

  bool operator==(const Noise& other) const = default;
  Matrix of(Index phase) const { return scale(segment[size_t(phase)]) * shape[shape.size() == 1 ? 0 : size_t(phase)]; }
};

struct Parameters {
  linalg::MatrixList ab;  // (phases) [A B]: n × (n+r)
  linalg::MatrixList cd;  // (phases) [C D]: m × (n+r)
  Noise process, measurement;
  Vector x0_mean;
  Matrix x0_cov;

  bool operator==(const Parameters& other) const = default;
  bool finite() const;
};

struct EstimatorOptions {
  double smoothing = 0.0;  // λ
  Index period = 0;
  bool estimate_x0 = false;
  bool feedthrough = true;        // false: D = 0 is known, and the start model has D = 0
  bool estimate_matrices = true;  // false: A, B, C and D of the start model are known
  Matrix innovation_cov;          // (m × m)
  // Ascending phases g > 0: no penalty couples the matrices of the phases g-1 and g.
  std::vector<Index> jumps = {};
};

// A phase is a set of steps that share their matrices. With 0 < λ < ∞ a penalty couples the matrices of neighbouring
// phases:
// λ/2 Σ_g tr( V⁻¹ (Θ_{g+1} - Θ_g) W (Θ_{g+1} - Θ_g)ᵀ )
// for Θ = [A B] and for Θ = [C D], each with its own V. W is the diagonal of the second moment of [x; u] at a typical
// step of the start model, summed over the experiments.
class Estimator {
 public:
  // `start` must have a constant state dimension, Q and R, and begin at step 0.
  Estimator(const Model& start, const kalman::Samples& samples, const EstimatorOptions& options);

  const Parameters& start() const { return start_; }
  // Writes A, B, C, D, Q, R of every step, x0_mean and x0_cov to a model with the steps of the start model.
  void write(const Parameters& p, Model& model) const;
  // Sets units, floors and weights of the penalty from the moments of the start model. Here and below, the moments are
  // those of each step, or one sum of them if there is one phase.
  void set_scales(const kalman::Moments& moments, const kalman::Samples& samples);
  double penalty(const Parameters& p) const;  // to be subtracted from the log-likelihood
  // The parameters in other coordinates of the states, in which the penalty is smaller. Empty if there is no penalty on
  // the variation, or if none were found. The likelihood stays nearly the same: a process noise that is constant gets
  // its mean covariance in the new coordinates.
  std::optional<Parameters> with_less_penalty(const Parameters& p) const;
  // The M-step: increases the expected log-likelihood minus the penalty to its maximum, first over the matrices, then
  // over each covariance with these matrices, and last over the scales with this covariance as shape.
  Parameters maximise(const kalman::Moments& moments, const Parameters& p) const;
  // Gives each segment of this many phases its own noise scale.
  void split_noise(Index phases, Parameters& p) const;
  bool noise_is_pooled() const { return pooled_; }
  Index phases() const { return phases_; }
  bool at_floor(const Noise& noise, const Vector& floor) const;
  const Vector& process_floor() const { return process_floor_; }
  const Vector& measurement_floor() const { return measurement_floor_; }

  // Coordinates without bounds, in units in which a step in any direction has about the same effect.
  Vector coordinates(const Parameters& p) const;
  Parameters parameters(const Vector& coordinates, const Parameters& like) const;

 private:
  // The rows of T Θ as independent random walks, for Θ = [A B] or [C D]. T makes T V̄ Tᵀ = diag(w) for the noise V̄ and
  // T V Tᵀ = I for the penalty.
  struct Walks {
    Matrix t;
    Vector noise;             // w
    linalg::MatrixList rows;  // (phases) [R Z] (l × (l+q))
    Matrix stiffness;         // (l × q)
  };
  Walks walks_of(const linalg::MatrixList& roots, const Noise& noise, Index regressors, const Matrix& reference,
                 const Vector& weight) const;
  std::vector<std::pair<Index, Index>> stretches() const;
  linalg::MatrixList phase_roots(const linalg::MatrixList& moments) const;
  void regress(const linalg::MatrixList& process, const linalg::MatrixList& output, const Parameters& p,
               Parameters& next) const;
  void update_noise(const linalg::MatrixList& roots, const Vector& counts, const linalg::MatrixList& coefficients,
                    const Vector& floor, double spent, Noise& noise) const;

  EstimatorOptions options_;
  Index n_, r_, m_, steps_, phases_;
  bool pooled_;
  Parameters start_;
  Variation variation_;
  Vector process_floor_, measurement_floor_;
  Vector moved_, measured_;                               // (phases) number of samples
  double process_spent_ = 0.0, measurement_spent_ = 0.0;  // share of the samples that the coefficients use
  Matrix x0_prior_;                                       // C_0: the mode of the inverse Wishart prior of x0_cov
};

}  // namespace tokid::em
