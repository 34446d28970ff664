// Modes of a time-varying model: natural frequency, damping and shape with the time frozen, and Floquet multipliers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <complex>
#include <vector>

#include "tokid/model.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid {

// Eigenvalues of A_k depend on the coordinates, which may differ at each step. Frozen modes therefore use coordinates
// that the outputs define. O_j = observability(model, j, W) maps the state at step j to the outputs of W steps, with
// the inputs at zero. Outputs are divided by the size of their pulse responses. A window of outputs has the same
// meaning at every step, so O_j⁺ O_{j+1} A_j maps states at step j to states at step j, and its eigenvalues are those
// of every model of the system. The window and its successor are centred at step k = j + W/2. The mean of these maps
// over the W+1 steps around k is the frozen A of step k, in coordinates z = Qᵀ O_j x_j with an orthonormal basis Q of
// the window at k. Near the ends, the mean has fewer steps.
//
// The error is of first order in the variation over 1/|s|. For a lightly damped mode of positions and velocities, it is
// of second order in the frequency. docs/how-to/modes.md derives both.

struct ModesOptions {
  Index window = 0;   // W, even; 0: the steps that determine a state, at least 2⌈n/m⌉
  double slow = 0.1;  // a mode is valid up to this variation
  Execution execution = {};
};

// Modes at the steps begin … begin+S-1, with n columns: the columns follow modes over time. A conjugate pair has two
// columns, the one with positive imaginary part first. Columns are sorted by their median |s|.
struct Modes {
  Index begin = 0;   // first step
  double dt = 1.0;   // [s]
  Index window = 0;  // W
  double slow = 0.1;
  // (S × n) s = log(z)/dt [1/s] of the eigenvalues z of the frozen A. Frequencies above π/dt appear below it
  // (aliasing). |z| below 1e-12 counts as 1e-12. NaN where the outputs of a window in the mean do not determine the
  // state.
  Eigen::MatrixXcd poles;
  // (S) of (m × n): the outputs of each mode, the largest one 1
  std::vector<Eigen::MatrixXcd> shapes;
  // (S × n) relative change of pole and shape during 1/|s|: the largest √(|s_j/s_k - 1|² + sin²θ) over the steps j up
  // to ρ = max(1, ⌈1/(2|s_k| dt)⌉) steps from k, divided by |s_k| ρ dt. θ is the angle between the shapes at j and k.
  // Near the ends, ρ is the distance to the farthest step. NaN with a single step.
  Matrix variation;
  // (S × n) the largest |s'_j/s_j - 1| over the steps j up to W/2 from k, with the pole s' of half the window, or of
  // twice if half does not determine the state. NaN where there is no other window.
  Matrix window_change;
  // (S × n): variation ≤ slow, window_change not above 3 slow, and |s| < π/dt. Half a window has more noise, hence
  // the 3. Samples do not show faster modes: z is a negative real number, or the mode decays within a step. Frozen
  // modes that are not valid describe the motion poorly.
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> valid;

  Index steps() const { return poles.rows(); }  // S
  Index count() const { return poles.cols(); }  // n
  // False for the second one of a conjugate pair at row k. A pair is one mode, so tables and pictures show its first.
  bool leads(Index k, Index i) const { return !(poles(k, i).imag() < 0); }
};
// A periodic model has modes at all P steps of a period.
// \throws std::invalid_argument for an odd or too short window, a negative limit, or a model with fewer than W+1 steps
Modes modes(const Model& model, const ModesOptions& options = {});

Matrix natural_frequencies(const Modes& modes);  // (S × n) |s| [rad/s]
Matrix damping_ratios(const Modes& modes);       // (S × n) -Re s/|s|; NaN for s = 0

// The frozen system at step k, as a model of one step with period 1, in the coordinates z of above. C fits the window:
// its block i is C Aⁱ. D is the mean of D_i over the same steps i around k. B fits the outputs after pulses at these
// steps: C Aᵍ B is close to the mean of C_{i+1+g} A_{i+g} … A_{i+1} B_i for each g below W/2. If W/2 steps do not
// determine the state, g goes up to W-1, and B of the last W/2 steps is that of earlier ones. Equal to the model if
// that is time-invariant.
// \throws std::invalid_argument as modes(), and for a step without modes or without the whole state in the window
Model frozen_system(const Model& model, Index k, const ModesOptions& options = {});
// The frozen systems of several steps. What they have in common is computed once. \throws as frozen_system()
std::vector<Model> frozen_systems(const Model& model, const std::vector<Index>& steps,
                                  const ModesOptions& options = {});

// C (e^{iω dt} I - A)⁻¹ B + D (m × r) of a time-invariant step at each frequency ω [rad/s]. Infinite or very large at a
// pole. \throws std::invalid_argument unless A is square
std::vector<Eigen::MatrixXcd> frequency_response(const Step& system, double dt, const Vector& frequencies);

// The eigenvalues of A_{k+P-1} … A_k of a periodic model. They are the same for each k and in all coordinates, and say
// exactly how the state grows over a period, at any speed of variation. Orthogonal iteration separates them. Only
// products within a block of similar multipliers are formed, so small multipliers keep their digits beside large ones.
struct Floquet {
  Eigen::VectorXcd multipliers;  // (n) in decreasing size; infinite or zero outside the range of numbers
  // (n) log(multiplier)/(P dt) [1/s]: rates of growth, and frequencies between ±π/(P dt). Right outside the range of
  // numbers, too. The real part is -infinity for a multiplier of zero.
  Eigen::VectorXcd exponents;
  // (n) relative errors of the multipliers by rounding, from ε to 1: the differences from those of the transposed
  // matrices in reverse order, which are equal but have other rounding errors. They also show if the iteration ended
  // before the multipliers were separate.
  Vector error;
};
// \throws std::invalid_argument without a period
Floquet floquet(const Model& model);
// The multipliers and the exponents of floquet() without their errors, which takes half of the time.
Eigen::VectorXcd floquet_multipliers(const Model& model);
Eigen::VectorXcd floquet_exponents(const Model& model);

// Bounds of frequencies and damping ratios, by function_bounds(). A mode of a replicate is the one with the
// nearest pole. The intervals include the error of freezing the time that grows with the window, as far as it exceeds
// its standard error: the change with half the window, or with twice, shows it. They are infinite if the model is too
// short for twice the window. Damping ratios are between -1 and 1. They err in first order of the variation v: the
// decay of velocities differs by v from that of positions. Their intervals therefore include v (1-ζ²).
struct ModeBounds {
  Modes modes;
  Interval frequency;  // (S × n) [rad/s]
  Interval damping;    // (S × n)
  // (n × 1) [1/s] parts of the Floquet exponents; empty without a period. The parts of a replicate are those of its
  // nearest multipliers. Imaginary parts may exceed ±π/(P dt), where a branch of the logarithm ends. NaN for a
  // multiplier of zero.
  Interval exponents_real, exponents_imag;
  double level = 0.95;
  Index replicates = 0;  // successful
  Findings findings;
};
// \throws std::invalid_argument as modes() and function_bounds()
ModeBounds mode_bounds(const Model& model, const Ensemble& data, const ModesOptions& options = {},
                       const ConfidenceOptions& confidence = {});

}  // namespace tokid
