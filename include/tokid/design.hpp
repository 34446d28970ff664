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

enum class InputKind {
  gaussian,    // independent, standard deviation a/3, drawn again if beyond ±a
  binary,      // ±a; flips of single signs make them as orthogonal over a few windows as possible
  multisine,   // sums of sines of equal size up to 0.8 of the Nyquist frequency, phases spread over the experiments
  orthogonal,  // the columns of every window are orthogonal across the experiments
  optimised,   // optimised on a preliminary model: a descent lowers the condition numbers of the windows
};

const char* to_string(InputKind kind);

// Standard deviations of the noise, in the units of the channels. `input`: unrecorded signal that acts on the inputs.
// `output`: measurement noise of the outputs.
struct NoiseLevel {
  double input = 0.0, output = 0.0;
};

struct PlanOptions {
  Index states = 0, inputs = 0, outputs = 0;       // n, r, m
  Index steps = 0;                                 // T
  Index lags = 0;                                  // p with p·m ≥ n; 0: ⌈n/m⌉
  Index experiments = 0;                           // N; 0: the recommended number
  std::optional<InputKind> kind = {};              // empty: optimised with a model, else orthogonal
  std::vector<double> amplitude = {1.0};           // a: |u| ≤ a for each input, or one for all; 1e-60 to 1e60
  std::optional<NoiseLevel> noise = {};            // empty: not known
  std::optional<InitialState> initial_state = {};  // empty: that of the model, else zero
  // a mean motion will be removed: one experiment more, inputs with zero mean over the experiments
  bool nominal = false;
  // These two shares set the recommended number of experiments. `excess`: the part of the one-step mean square error
  // that the estimated coefficients add to the noise. `markov_error`: the relative error of the Markov parameters.
  double excess = 0.1;
  double markov_error = 0.1;
  // The recommendation allows this condition number for a window of white columns, (√N + √L) / (√N - √L).
  double white_condition = 10.0;
  Index hold = 0;          // orthogonal: steps between exchanges of unused directions; 0: by the rule in docs/math.md
  Index iterations = 120;  // optimised: at each of three stages, fewer for large plans
  double dt = 0.0;         // [s]; 0: the model's, else 1
  Channels names = {};     // peak and RMS of the inputs
  std::uint64_t seed = 1;
  Execution execution = {};
};

struct ExperimentPlan {
  Index lags = 0;      // p
  Index unknowns = 0;  // L = r + p·(r+m), per output and step
  Index minimum = 0;   // L, plus one for a mean motion
  Index recommended = 0;
  std::vector<std::string> reasons;  // reasons for both numbers and for steps without a full regression
  InputKind kind = InputKind::orthogonal;
  Ensemble inputs;       // N × T with r inputs and no outputs
  Vector peak, rms;      // (r) of the inputs
  Index first_step = 0;  // first step with a regression
  // Relative increase of the one-step mean square error of new data, because N experiments estimate the coefficients: L
  // / (N - L - 1). Infinite without degrees of freedom.
  double excess = 0.0;
  // (T) condition number of [u_{k-p} … u_k] with columns of norm 1. NaN without a regression. Where windows are very
  // large, most steps have NaN, and there is a warning.
  std::vector<double> input_condition;

  // The following fields need a preliminary model; without one they are empty, zero or NaN. Forecasts start from zero
  // state at the first step of the model.
  Index first_forecast = 0;  // first step with a forecast: first_step, or p steps after a later first step of the model
  std::vector<double> condition;  // (T) condition number of W_k as in GtvArxStep::condition; NaN without a forecast
  std::vector<Index> rank;        // (T)
  double start_condition = std::numeric_limits<double>::quiet_NaN();  // largest condition number before the descent
  Vector output_peak;  // (m) largest |y| over experiments and steps, without noise
  // The following fields need the noise levels as well.
  // RMS one-step error of the best coefficients over the RMS of the outputs
  double noise_floor = std::numeric_limits<double>::quiet_NaN();
  // expected RMS error of D_k and h_{k,k-1} … h_{k,k-p} over the RMS of their entries
  double markov_error = std::numeric_limits<double>::quiet_NaN();

  Findings findings;
};

// Recommends a number of experiments and makes inputs for them. \throws std::invalid_argument that names the option,
// the value found and the value needed: sizes, p·m < n, too few experiments or steps, or more than can be handled
ExperimentPlan plan(const PlanOptions& options);

// The same with a preliminary model. The model must have the stated sizes and dt; sizes and dt of zero, and names, are
// taken from the model. Its steps must reach T. \throws also where the noise requires so many experiments that the
// caller must state their number
ExperimentPlan plan(const Model& preliminary, const PlanOptions& options = {});

}  // namespace tokid
