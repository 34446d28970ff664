// How far estimates may lie from the truth: confidence bounds from the factors of the regressions, and by a bootstrap
// over experiments. Both measure scatter; a bias, as of a lag order that is too small, is not in them.
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

// Each entry of the truth lies between `lower` and `upper` with the probability `level`, taken by itself. Infinite
// where no degree of freedom tells the noise, NaN where there is no estimate.
struct Interval {
  Matrix estimate;
  Matrix deviation;  // standard error
  Matrix lower, upper;
};

struct BoundsOptions {
  double level = 0.95;  // 0 < level < 1
  Execution execution = {};
};

// From the factors of the regressions
//
// The coefficients M_s of different steps have uncorrelated errors of covariance residual_cov ⊗ X·Xᵀ (GtvArx). To
// first order, an output of the recursion (17) changes with them by Σ_s W_{k,s} dM_s φ_s, where φ_s is the window that
// the recursion itself sees at step s, and W_{k,s} what an innovation at s adds to the output at k: I for k = s, else
// -h°_{k,s}. The interval is that of Student's t, whose degrees of freedom are those of the steps, weighted as their
// variances are (Welch, Satterthwaite). All \throw std::invalid_argument where `arx` holds no noise shapes.

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
// Outputs of the recursion for given inputs: from zero initial states, or, with k_begin = p, from the first p samples
// of each experiment. The bounds are those of the mean output of the system, or, with `noise`, of one that is measured.
struct SimulationBoundsOptions {
  double level = 0.95;
  bool noise = false;
  Execution execution = {};
};
// `data` are departures from the nominal trajectory, where one was removed. \throws std::invalid_argument where
// channels disagree or the level is outside 0 … 1
OutputBounds simulation_bounds(const GtvArx& arx, const Ensemble& data, const SimulationBoundsOptions& options = {});

// One-step predictions of the recursion, and where a new measurement will lie with the probability `level`.
OutputBounds prediction_bounds(const GtvArx& arx, const Ensemble& data, const BoundsOptions& options = {});

// Eigenvalues of the closed loop Ā_k = A_k + G_k C_k in a reference frame (reference_frame()), which depend on outputs
// alone and so are the same for every model of the system.
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

// First-order bounds say nothing of an eigenvalue that is not clearly simple: whose neighbour is nearer than half the
// standard errors of both together. It has infinite bounds and `simple` = 0. Imaginary parts of simple real eigenvalues
// are zero, and known to be. So are the zeros that every deadbeat observer has: neighbours that no noise moves do not
// count, unless, as without any noise, rounding alone tells them apart.
struct SpectrumBounds {
  Index begin = 0;
  struct Step {
    Eigen::VectorXcd eigenvalues;                  // (n)
    Interval real, imaginary;                      // (n × 1)
    Vector covariance;                             // (n) of real and imaginary part
    Eigen::Array<bool, Eigen::Dynamic, 1> simple;  // (n)
  };
  std::vector<Step> step;
};
// `model` is the realisation of `arx` with these options, as tvera() returns it, or in any other coordinates; blocks
// and sizes of the channels tell how errors of Markov parameters enter it. \throws std::invalid_argument as above, or
// where `model` does not go with `arx`
SpectrumBounds closed_loop_bounds(const GtvArx& arx, const Model& model, const TveraOptions& realisation,
                                  const ClosedLoopOptions& options = {});

// By a bootstrap over experiments
//
// Whatever way of identification f is given, replicate b identifies with experiments of weights w = 1 ± spread, half of
// them with each sign, drawn anew: an experiment of a linear system, multiplied by √w, is one of the same system, and
// counts w times in sums of squares. Drawing experiments with replacement would leave about 0.63 N different ones, too
// few for regressions that need nearly all of them. The deviations from f's result are divided by `spread`, and, as
// residuals of L regressors are too small, multiplied by √((N+2)/(N-L)), which is exact for Gaussian regressors.
using Identifier = std::function<Model(const Ensemble&)>;
using Functional = std::function<Vector(const Model&)>;  // NaN for what the model does not have

struct BootstrapOptions {
  double level = 0.95;
  Index replicates = 200;  // B ≥ 2
  std::uint64_t seed = 1;
  double spread = 0.3;   // 0 < spread < 1
  bool nominal = false;  // remove the (weighted) mean motion and put it into each model; `f` then gets departures
  Index period = 0;      // the steps of a period share their mean motion
  // L; 0: the median rank of the model's regressions, or, for other methods than tvera with N no larger, n + r
  Index unknowns = 0;
  Execution execution = {};
};
struct Bootstrap {
  Interval interval;     // (entries × 1)
  Matrix covariance;     // (entries × 1): with the next entry, as of real and imaginary parts that stand together
  Index replicates = 0;  // that could be identified
  Index unknowns = 0;    // L, and one more for a mean motion
  double freedom = 0.0;  // of Student's t
};
// \throws std::invalid_argument for options out of range or experiments that leave no degree of freedom,
// std::runtime_error where fewer than half of the replicates could be identified
Bootstrap bootstrap(const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options = {});

// The experiments multiplied by the roots of their weights (N), free responses included with the mean weight.
// \throws std::invalid_argument for negative weights or a wrong number
Ensemble weighted(Ensemble data, const Vector& weights);

// The eigenvalues of `found`, each put in the place of the one of `reference` that it belongs to: pairs are formed from
// the nearest on.
Eigen::VectorXcd matched(const Eigen::VectorXcd& found, const Eigen::VectorXcd& reference);

// Of a model and the experiments that it was identified from

enum class BoundsMethod { factors, bootstrap };
const char* to_string(BoundsMethod method);

struct ConfidenceOptions {
  double level = 0.95;
  // empty: the factors, but the bootstrap where steps share a model, which the regressions of single steps don't
  std::optional<BoundsMethod> method = {};
  Index replicates = 200;  // B of the bootstrap
  std::uint64_t seed = 1;
  Index band = 0;             // γ = 0 … band < T; 0: twice the steps whose samples tell a state
  Index reference_step = -1;  // of the eigenvalues, as in ClosedLoopOptions
  Execution execution = {};
};

struct Confidence {
  BoundsMethod method = BoundsMethod::factors;
  double level = 0.95, dt = 1.0;
  Index experiments = 0, lags = 0;
  Index replicates = 0;  // of the bootstrap that could be identified
  double freedom = 0.0;  // of Student's t: of the median step, or of the bootstrap
  Channels names;
  MarkovBounds markov;
  OutputBounds simulated;   // mean outputs for the inputs of the data; (N × m) of the experiments used
  OutputBounds predicted;   // new measurements one step ahead; of the factors alone
  SpectrumBounds spectrum;  // empty where there is no reference frame, or the factors don't lead to the model
  Findings findings;
};

// From the factors, the estimates are those of the regressions, which the model approximates. By the bootstrap they are
// those of the model: each replicate is identified with its options, all orders held. `data` must be the ensemble that
// the model was identified from; of one of which a part was held out, that part is left aside.
// \throws std::invalid_argument for options out of range, another number of experiments than in the identification,
// or a model that was not identified
Confidence confidence(const Model& model, const Ensemble& data, const ConfidenceOptions& options = {});

// docs/formats.md holds the names and shapes: .npz, .h5, .mat. \throws IoError
void save_confidence(const Confidence& confidence, const std::filesystem::path& path, const WriteOptions& options = {});

}  // namespace tokid
