// Confidence bounds of estimates, by a bootstrap over experiments. The bounds measure random errors, and confidence()
// adds the bias of smoothing over time. They do not include another bias, for example of a lag order that is too small.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <complex>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tokid/io.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Each entry alone has its true value between `lower` and `upper` with the probability `level`. NaN without an
// estimate.
struct Interval {
  Matrix estimate;
  Matrix deviation;  // standard error
  Matrix lower, upper;
};

// Bounds of h_{k,k-γ}, γ = 0 … band, where h_{k,k} = D_k.
struct MarkovBounds {
  Index inputs = 0, outputs = 0, band = 0;
  Index k_begin = 0;           // pulses before this step have no estimate
  std::vector<Interval> step;  // (T) of (m × (band+1)·r): block γ of step k is h_{k,k-γ}; NaN for k-γ < k_begin
};
// The relative error of the pulse responses that noise causes, for each output and input as in
// Similarity::relative_error, over the responses with bounds. NaN without a response.
struct RelativeError {
  Matrix expected;  // (m × r) ‖standard errors‖ / ‖estimates‖: RMS of the relative error
  // (m × r) ‖half widths of the intervals‖ / ‖estimates‖. The relative error is below it with the probability `level`
  // or more, because no sum of squared normal errors with a given mean has longer tails than a single one.
  Matrix limit;
};
RelativeError relative_error(const MarkovBounds& bounds);

struct OutputBounds {
  std::vector<Interval> step;  // (T) of (N × m); NaN where there is no output
};

// Eigenvalues of the closed loop Ā_k = A_k + G_k C_k in a reference frame (reference_frame()). In this frame the states
// are defined by outputs alone. The eigenvalues are therefore the same for every model of the system.
struct ClosedLoopOptions {
  Index reference_step = -1;  // s; -1: the first step of full dimension
  Index rows = 0;             // block rows of the frame; 0: estimation_window(model)
};
struct Spectrum {
  Index begin = 0;                            // step of the first entry
  std::vector<Eigen::VectorXcd> eigenvalues;  // (n) at each step; NaN where A + G·C is not finite
};
// \throws std::invalid_argument where step s has no state or too few block rows
Spectrum closed_loop_spectrum(const Model& model, const ClosedLoopOptions& options = {});

// An eigenvalue is not clearly simple if another one is nearer than half the sum of their standard errors. Its bounds
// are then infinite, and `simple` is false. Every deadbeat observer has eigenvalues that are exactly zero, and noise
// does not move them. They do not count as near, unless the distance is at the level of rounding errors, as in data
// without noise.
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

// Bounds by a bootstrap over experiments
//
// The bootstrap works for any identification method f. Replicate b gives the experiments new random weights w = 1 ±
// spread, half of them with each sign. An experiment of a linear system multiplied by √w is an experiment of the same
// system, and counts w times in sums of squares. The usual bootstrap draws experiments with replacement. It would use
// only about 0.63 N different experiments, too few for regressions that need nearly all of them. The deviations of the
// replicates from the result of f are divided by `spread`. They are also multiplied by √((N+2)/(N-L)), because a fit of
// L regressors makes the residuals too small. This factor is exact for Gaussian regressors.
using Identifier = std::function<Model(const Ensemble&)>;
using Functional = std::function<Vector(const Model&)>;  // NaN where the model has no value

struct BootstrapOptions {
  double level = 0.95;
  Index replicates = 200;  // B ≥ 2
  std::uint64_t seed = 1;
  double spread = 0.3;  // 0 < spread < 1
  // true: each replicate removes its weighted mean motion and stores it in the model; `f` gets departures
  bool nominal = false;
  Index period = 0;  // P: the steps k, k+P, … share their mean motion
  // L; 0: the median rank of the model's regressions. If N is not larger than this rank, and the method is not tvera, L
  // is n + r. With a period, L is divided by the number of steps of a phase.
  Index unknowns = 0;
  Execution execution = {};
};
struct Bootstrap {
  Interval interval;     // (entries × 1)
  Matrix covariance;     // (entries × 1): covariance of each entry with the next one, for real and imaginary parts
  Index replicates = 0;  // number of replicates with a successful identification
  Index unknowns = 0;    // L, plus one for a mean motion
  double freedom = 0.0;  // degrees of freedom of Student's t
};
// \throws std::invalid_argument for options out of range, an infinite sample, or too few experiments for a degree of
// freedom, std::runtime_error where fewer than half of the replicates could be identified
Bootstrap bootstrap(const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options = {});
// The same for a model that is known already. Its values are the estimates. `f` may therefore start from the model, and
// need not reproduce it: the replicates are compared with their mean.
Bootstrap bootstrap(const Model& model, const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options = {});

// The eigenvalues of `found` in the order of `reference`. The two nearest eigenvalues form the first pair, the two
// nearest of the rest the second pair, and so on.
Eigen::VectorXcd matched(const Eigen::VectorXcd& found, const Eigen::VectorXcd& reference);

// Bounds for a model and its training data

struct ConfidenceOptions {
  double level = 0.95;
  Index replicates = 200;  // B of the bootstrap
  std::uint64_t seed = 1;
  Index band = 0;             // γ = 0 … band < T; 0: twice estimation_window(model)
  Index reference_step = -1;  // step s for the eigenvalues, as in ClosedLoopOptions
  Execution execution = {};
};

struct Confidence {
  double level = 0.95, dt = 1.0;
  Index experiments = 0, lags = 0;
  Index replicates = 0;  // successful replicates of the bootstrap
  double freedom = 0.0;  // degrees of freedom of Student's t
  // λ whose bias widens the intervals; 0: no bias is included
  double smoothing = 0.0;
  Vector bias;  // (T) bias of the Markov parameters over their scatter, RMS at each step; empty if not included
  Channels names;
  MarkovBounds markov;
  // Mean outputs (N × m) for the inputs of the N experiments used.
  OutputBounds simulated;
  SpectrumBounds spectrum;  // empty without a reference frame
  Findings findings;
};

// Computes the bounds of a model by the bootstrap. If EM made the model, each replicate continues EM from the model;
// otherwise it is identified with the options and the orders of the model. With smoothing over time, a model with a
// tenth of λ is identified as well. The squared differences from it, averaged over five steps, add to the variances,
// because λ has a bias. `data` must be the ensemble of the identification, including the held-out experiments, which
// the function does not use. \throws std::invalid_argument for options out of range, an infinite sample, fewer
// experiments than the bootstrap needs, a number of experiments that differs from the identification, or a model that
// was not identified
Confidence confidence(const Model& model, const Ensemble& data, const ConfidenceOptions& options = {});

// Bounds of a function of the model, by the bootstrap as in confidence(), with the bias of smoothing. The function must
// not depend on the coordinates of the states, because the replicates have other coordinates. Its entries may be those
// of `steps` equal parts, one after the other; the bias is then averaged over five parts. Replicates of EM
// take up to ten times the iterations of confidence(), because functions such as poles depend on what the data hardly
// show.
struct FunctionBounds {
  Interval interval;       // (entries × 1); NaN where half of the replicates have no value
  Index replicates = 0;    // successful
  double freedom = 0.0;    // degrees of freedom of Student's t
  double smoothing = 0.0;  // λ whose bias is included; 0: none
  Findings findings;
};
// Uses level, replicates, seed and execution of the options. \throws std::invalid_argument as confidence(), and for
// fewer experiments than the bootstrap needs, a function without entries, or a number of entries that is no multiple of
// `steps`
FunctionBounds function_bounds(const Model& model, const Ensemble& data, const Functional& function,
                               const ConfidenceOptions& options = {}, Index steps = 1);

// Writes .npz, .h5 or .mat; docs/formats.md has the names and shapes. \throws IoError
void save_confidence(const Confidence& confidence, const std::filesystem::path& path, const WriteOptions& options = {});

}  // namespace tokid
