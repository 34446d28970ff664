// Before there is data: how many experiments, and with which inputs.
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
  gaussian,    // independent, of standard deviation a/3, drawn again beyond ±a
  binary,      // ±a, signs as near to orthogonal over a few windows as flips of single signs bring them
  multisine,   // sums of sines of equal size up to 0.8 of the Nyquist frequency, phases spread over the experiments
  orthogonal,  // columns of all windows orthogonal across the experiments
  optimised,   // on a preliminary model: the smallest condition numbers of the windows that a descent finds
};

const char* to_string(InputKind kind);

// Standard deviations, in the units of the channels: of what acts on the inputs beside what is recorded, and of the
// measurement of the outputs.
struct NoiseLevel {
  double input = 0.0, output = 0.0;
};

struct PlanOptions {
  Index states = 0, inputs = 0, outputs = 0;       // n, r, m
  Index steps = 0;                                 // T
  Index lags = 0;                                  // p with p·m ≥ n; 0: ⌈n/m⌉
  Index experiments = 0;                           // N; 0: as many as recommended
  std::optional<InputKind> kind = {};              // empty: optimised with a model, else orthogonal
  std::vector<double> amplitude = {1.0};           // a: |u| ≤ a for each input, or one for all; 1e-60 to 1e60
  std::optional<NoiseLevel> noise = {};            // empty: not known
  std::optional<InitialState> initial_state = {};  // empty: as the model says, else zero
  bool nominal = false;  // a mean motion will be removed: one experiment more, inputs of mean zero over the experiments
  // Shares that set the recommended number: of the one-step mean square error that the estimated coefficients add to
  // the noise, and the relative error of the Markov parameters.
  double excess = 0.1;
  double markov_error = 0.1;
  // Condition number of a window of white columns, (√N + √L) / (√N - √L), that the recommendation allows.
  double white_condition = 10.0;
  Index hold = 0;          // orthogonal: steps between exchanges of resting directions; 0: by a rule, see docs/math.md
  Index iterations = 120;  // optimised: at each of three stages, fewer for large plans
  double dt = 0.0;         // [s]; 0: the model's, else 1
  Channels names = {};     // of the inputs
  std::uint64_t seed = 1;
  Execution execution = {};
};

struct ExperimentPlan {
  Index lags = 0;      // p
  Index unknowns = 0;  // L = r + p·(r+m), per output and step
  Index minimum = 0;   // L, and one more for a mean motion
  Index recommended = 0;
  std::vector<std::string> reasons;  // of both numbers, and of the steps that have no full regression
  InputKind kind = InputKind::orthogonal;
  Ensemble inputs;       // N × T with r inputs and no outputs
  Vector peak, rms;      // (r) of the inputs
  Index first_step = 0;  // first step with a regression
  // Expected share of the one-step mean square error of new data that N experiments add to that of the best
  // coefficients, L / (N - L - 1); infinite without degrees of freedom.
  double excess = 0.0;
  // (T) of [u_{k-p} … u_k], columns of norm 1; NaN without a regression, and, with a warning, at most of the steps
  // where windows are very large
  std::vector<double> input_condition;

  // With a preliminary model only; else empty, zero or NaN. Forecasts begin at rest where the model begins.
  Index first_forecast = 0;       // first step whose window is forecast: first_step, or p after a model begins later
  std::vector<double> condition;  // (T) of W_k as GtvArxStep::condition measures it; NaN without a forecast
  std::vector<Index> rank;        // (T)
  double start_condition = std::numeric_limits<double>::quiet_NaN();  // worst condition before the descent
  Vector output_peak;  // (m) largest |y| over experiments and steps, without noise
  // With the noise levels as well.
  double noise_floor = std::numeric_limits<double>::quiet_NaN();   // RMS one-step error of the best coefficients over
                                                                   // the RMS of the outputs
  double markov_error = std::numeric_limits<double>::quiet_NaN();  // expected error of D_k and h_{k,k-1} … h_{k,k-p},
                                                                   // root mean square over that of themselves

  Findings findings;
};

// The number of experiments and inputs for them. \throws std::invalid_argument that names the option, what was found
// and what is needed: sizes, p·m < n, too few experiments or steps, more of them than can be handled
ExperimentPlan plan(const PlanOptions& options);

// The same on a preliminary model, which must have the stated sizes and dt (those that are zero are taken from it, as
// are the names) and steps up to T. \throws also where the noise asks for so many experiments that they should be
// asked for
ExperimentPlan plan(const Model& preliminary, const PlanOptions& options = {});

}  // namespace tokid
