// Confidence bounds of estimates, from the factors of the regressions or by a bootstrap over experiments. Both measure
// random errors only. They do not include a bias, such as that of a lag order that is too small.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <complex>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/io.hpp"
#include "tokid/model.hpp"
#include "tokid/tvera.hpp"

namespace tokid {

// Each entry of the true value lies between `lower` and `upper` with the probability `level`, taken alone. Bounds are
// infinite if no degree of freedom is left to estimate the noise, and NaN without an estimate.
struct Interval {
  Matrix estimate;
  Matrix deviation;  // standard error
  Matrix lower, upper;
};

struct BoundsOptions {
  double level = 0.95;  // 0 < level < 1
  Execution execution = {};
};

// Bounds from the factors of the regressions
//
// The coefficients M_s of different steps have uncorrelated errors of covariance residual_cov ⊗ X·Xᵀ (GtvArx). To first
// order, these errors change an output of the recursion (17) by Σ_s W_{k,s} dM_s φ_s. φ_s is the window of the
// recursion itself at step s. W_{k,s} is the effect of an innovation at s on the output at k: I for k = s, else
// -h°_{k,s}. The interval is that of Student's t. Its degrees of freedom are those of the steps, weighted by their
// variances (Welch, Satterthwaite). All functions \throw std::invalid_argument if `arx` holds no noise shapes.

// Bounds of h_{k,k-γ}, γ = 0 … band, where h_{k,k} = D_k.
struct MarkovBounds {
  Index inputs = 0, outputs = 0, band = 0;
  Index k_begin = 0;           // pulses before this step have no estimate
  std::vector<Interval> step;  // (T) of (m × (band+1)·r): block γ of step k is h_{k,k-γ}; NaN for k-γ < k_begin
};
// \throws std::invalid_argument for band < 1 or a level outside 0 … 1
MarkovBounds markov_bounds(const GtvArx& arx, Index band, const BoundsOptions& options = {});

struct OutputBounds {
  std::vector<Interval> step;  // (T) of (N × m); NaN where there is no output
};
// Outputs of the recursion for given inputs. It starts from zero initial states, or, with k_begin = p, from the first p
// samples of each experiment. The bounds are those of the mean output of the system, or with `noise` those of a
// measured output.
struct SimulationBoundsOptions {
  double level = 0.95;
  bool noise = false;
  Execution execution = {};
};
// `data` must be departures from the nominal trajectory if one was removed. \throws std::invalid_argument where
// channels disagree or the level is outside 0 … 1
OutputBounds simulation_bounds(const GtvArx& arx, const Ensemble& data, const SimulationBoundsOptions& options = {});

// One-step predictions of the recursion, with the interval that contains a new measurement with the probability
// `level`.
OutputBounds prediction_bounds(const GtvArx& arx, const Ensemble& data, const BoundsOptions& options = {});

// Eigenvalues of the closed loop Ā_k = A_k + G_k C_k in a reference frame (reference_frame()). They depend on outputs
// alone and are thus the same for every model of the system.
struct ClosedLoopOptions {
  double level = 0.95;
  Index reference_step = -1;  // s; -1: the first step of full dimension
  Index rows = 0;             // block rows of the frame; 0: estimation_window(model)
  Execution execution = {};
};
struct Spectrum {
  Index begin = 0;                            // step of the first entry
  std::vector<Eigen::VectorXcd> eigenvalues;  // (n) at each step; NaN where A + G·C is not finite
};
// \throws std::invalid_argument where step s has no state or too few block rows
Spectrum closed_loop_spectrum(const Model& model, const ClosedLoopOptions& options = {});

// First-order bounds do not hold for an eigenvalue that is not clearly simple. Such an eigenvalue has a neighbour that
// is nearer than half the sum of their standard errors. It gets infinite bounds and `simple` = 0. The imaginary part of
// a simple real eigenvalue is exactly zero. So are the zero eigenvalues of every deadbeat observer: neighbours that
// noise does not move are ignored, unless only rounding separates them, as in data without noise.
struct SpectrumBounds {
  Index begin = 0;
  struct Step {
    Eigen::VectorXcd eigenvalues;                  // (n)
    Interval real, imaginary;                      // (n × 1)
    Vector covariance;                             // (n) covariance of real and imaginary part
    Eigen::Array<bool, Eigen::Dynamic, 1> simple;  // (n)
  };
  std::vector<Step> step;
};
// `model` must be the realisation of `arx` with these options, as tvera() returns it, or the same in other coordinates.
// The blocks and the sizes of the channels determine how errors of Markov parameters affect it.
// \throws std::invalid_argument as above, or if `model` does not belong to `arx`
SpectrumBounds closed_loop_bounds(const GtvArx& arx, const Model& model, const TveraOptions& realisation,
                                  const ClosedLoopOptions& options = {});

// Bounds by a bootstrap over experiments
//
// The bootstrap works for any identification method f. Replicate b gives the experiments new random weights w = 1 ±
// spread, half of them with each sign. An experiment of a linear system multiplied by √w is an experiment of the same
// system, and counts w times in sums of squares. Drawing experiments with replacement would leave about 0.63 N
// different ones, too few for regressions that need nearly all of them. The deviations from the result of f are divided
// by `spread`. They are also multiplied by √((N+2)/(N-L)), because the residuals of L regressors are too small. This
// factor is exact for Gaussian regressors.
using Identifier = std::function<Model(const Ensemble&)>;
using Functional = std::function<Vector(const Model&)>;  // NaN where the model has no value

struct BootstrapOptions {
  double level = 0.95;
  Index replicates = 200;  // B ≥ 2
  std::uint64_t seed = 1;
  double spread = 0.3;   // 0 < spread < 1
  bool nominal = false;  // remove the (weighted) mean motion and store it in each model; `f` then gets departures
  Index period = 0;      // P: the steps k, k+P, … share their mean motion
  // L; 0: the median rank of the model's regressions, or n + r for other methods than tvera if N is not larger than
  // that rank. With a period, L is shared among the steps of a phase.
  Index unknowns = 0;
  Execution execution = {};
};
struct Bootstrap {
  Interval interval;     // (entries × 1)
  Matrix covariance;     // (entries × 1): covariance with the next entry, for adjacent real and imaginary parts
  Index replicates = 0;  // number of replicates with a successful identification
  Index unknowns = 0;    // L, plus one for a mean motion
  double freedom = 0.0;  // degrees of freedom of Student's t
};
// \throws std::invalid_argument for options out of range or experiments that leave no degree of freedom,
// std::runtime_error where fewer than half of the replicates could be identified
Bootstrap bootstrap(const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options = {});

// Multiplies the experiments by the square roots of their weights (N), and the free responses by that of the mean
// weight. \throws std::invalid_argument for negative weights or a wrong number
Ensemble weighted(Ensemble data, const Vector& weights);

// The eigenvalues of `found` in the order of `reference`. Pairs are formed from the nearest ones on.
Eigen::VectorXcd matched(const Eigen::VectorXcd& found, const Eigen::VectorXcd& reference);

// Bounds for a model and its training data

enum class BoundsMethod { factors, bootstrap };
const char* to_string(BoundsMethod method);

struct ConfidenceOptions {
  double level = 0.95;
  // empty: the factors, or the bootstrap if steps share a model, because then the regressions of single steps do not
  // describe it
  std::optional<BoundsMethod> method = {};
  Index replicates = 200;  // B of the bootstrap
  std::uint64_t seed = 1;
  Index band = 0;             // γ = 0 … band < T; 0: twice estimation_window(model)
  Index reference_step = -1;  // step s for the eigenvalues, as in ClosedLoopOptions
  Execution execution = {};
};

struct Confidence {
  BoundsMethod method = BoundsMethod::factors;
  double level = 0.95, dt = 1.0;
  Index experiments = 0, lags = 0;
  Index replicates = 0;  // successful replicates of the bootstrap
  double freedom = 0.0;  // degrees of freedom of Student's t, at the median step or of the bootstrap
  Channels names;
  MarkovBounds markov;
  // mean outputs for the inputs of the data; (N × m) of the experiments used
  OutputBounds simulated;
  OutputBounds predicted;  // new measurements one step ahead; only from the factors
  // empty without a reference frame, or if the factors do not reproduce the model
  SpectrumBounds spectrum;
  Findings findings;
};

// Computes the bounds of a model. From the factors, the estimates are those of the regressions, which the model
// approximates. From the bootstrap, they are those of the model: each replicate is identified with the options of the
// model, with fixed orders. `data` must be the ensemble of the identification, including any held-out part, which is
// not used.
// \throws std::invalid_argument for options out of range, a number of experiments that differs from the identification,
// or a model that was not identified
Confidence confidence(const Model& model, const Ensemble& data, const ConfidenceOptions& options = {});

// Writes .npz, .h5 or .mat; docs/formats.md has the names and shapes. \throws IoError
void save_confidence(const Confidence& confidence, const std::filesystem::path& path, const WriteOptions& options = {});

}  // namespace tokid
