// Plans of experiments: the number of experiments, and inputs for them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Kinds of inputs, within the limit ±a of PlanOptions::amplitude.
enum class InputKind {
  gaussian,    // normal random numbers, standard deviation a/3; numbers beyond ±a are drawn again
  binary,      // ±a; single signs are flipped until the columns of some windows are as orthogonal as possible
  multisine,   // sums of equal sines up to 0.8 of the Nyquist frequency; other phases in each experiment
  orthogonal,  // the columns of every window are orthogonal across the experiments
  optimised,   // a descent on a preliminary model lowers the condition numbers of the windows
};

const char* to_string(InputKind kind);

// Standard deviations of the noise, in the units of the channels. `input`: a signal that adds to the inputs but is not
// recorded. `output`: measurement noise of the outputs.
struct NoiseLevel {
  double input = 0.0, output = 0.0;
};

struct PlanOptions {
  Index states = 0, inputs = 0, outputs = 0;  // n, r, m
  Index steps = 0;                            // T
  Index lags = 0;                             // p with p·m ≥ n; 0: ⌈n/m⌉
  Index experiments = 0;                      // N; 0: the recommended number
  std::optional<InputKind> kind = {};         // empty: optimised with a model, else orthogonal
  std::vector<double> amplitude = {1.0};      // a: |u| ≤ a; one entry for each input or one for all; 1e-60 to 1e60
  std::optional<NoiseLevel> noise = {};       // empty: not known
  std::optional<InitialState> initial_state = {};  // empty: as the model has it, else zero
  // true: the identification will remove a mean motion. The plan then has one more experiment, and inputs with zero
  // mean over the experiments.
  bool nominal = false;
  // These two shares set the recommended number of experiments. `excess`: the part of the one-step mean square error
  // that the estimated coefficients add to the noise. `markov_error`: the relative error of the Markov parameters.
  double excess = 0.1;
  double markov_error = 0.1;
  // The recommended N keeps the condition number (√N + √L) / (√N - √L) of a window with white columns below this value.
  // L: ExperimentPlan::unknowns.
  double white_condition = 10.0;
  Index hold = 0;          // orthogonal inputs: steps between exchanges of unused directions; 0: chosen
  Index iterations = 120;  // optimised inputs: iterations of each of three stages; large plans use fewer
  double dt = 0.0;         // [s]; 0: dt of the model, else 1
  Channels names = {};     // peak and RMS of the inputs
  std::uint64_t seed = 1;
  Execution execution = {};
};

struct ExperimentPlan {
  Index lags = 0;      // p
  Index unknowns = 0;  // L = r + p·(r+m), per output and step
  Index minimum = 0;   // L, or L + 1 if a mean motion will be removed
  Index recommended = 0;
  std::vector<std::string> reasons;  // for `minimum` and `recommended`, and for steps without a full regression
  InputKind kind = InputKind::orthogonal;
  Ensemble inputs;       // N × T with r inputs and no outputs
  Vector peak, rms;      // (r) of the inputs
  Index first_step = 0;  // first step with a regression
  // Relative increase of the one-step mean square error of new data, because the coefficients are estimated from N
  // experiments: L / (f - 1) for f degrees of freedom. Infinite for f ≤ 1.
  double excess = 0.0;
  // (T) condition number of [u_{k-p} … u_k] with columns scaled to norm 1. NaN without a regression. If windows are
  // very large, only some steps are computed, the others are NaN, and a finding reports this.
  std::vector<double> input_condition;

  // The following fields need a preliminary model; without one they are empty, zero or NaN. Forecasts are simulations
  // of the planned experiments; they start from the zero state at the first step of the model.
  // first step with a forecast of W_k: first_step, or p steps after a later begin of the model
  Index first_forecast = 0;
  std::vector<double> condition;  // (T) condition number of W_k as in GtvArxStep::condition; NaN without a forecast
  std::vector<Index> rank;        // (T) rank of W_k
  // optimised inputs: largest condition number before the descent
  double start_condition = std::numeric_limits<double>::quiet_NaN();
  Vector output_peak;  // (m) largest |y| over experiments and steps, without noise
  // The following fields also need the noise levels.
  // RMS one-step error with the best coefficients, over the RMS of the outputs
  double noise_floor = std::numeric_limits<double>::quiet_NaN();
  // expected RMS error of D_k and h_{k,k-1} … h_{k,k-p} over the RMS of their entries
  double markov_error = std::numeric_limits<double>::quiet_NaN();

  Findings findings;
};

// Recommends a number of experiments and makes inputs for them. \throws std::invalid_argument for sizes out of range,
// p·m < n, or too few or too many experiments or steps; the message names the option, its value and the needed value
ExperimentPlan plan(const PlanOptions& options);

// Makes a plan with a preliminary model. Sizes and dt that the options state must be those of the model. Sizes and dt
// of zero are taken from the model, and so are the names. The model must have all T steps. \throws also if the noise
// requires a very large number of experiments. The caller must then state `experiments`.
ExperimentPlan plan(const Model& preliminary, const PlanOptions& options = {});

}  // namespace tokid
