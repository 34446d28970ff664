// The pipeline in one call: ensemble → GTV-ARX → Markov parameters → model, and the choice of orders.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"
#include "tokid/validate.hpp"

namespace tokid {

enum class NominalChoice { automatic, none, mean };
enum class Frame { raw, reference, smooth };

struct IdentifyOptions {
  // n; 0: the rank of each H_k where the data are free of noise, else the order that predicts and simulates best
  Index states = 0;
  Index lags = 0;  // p; 0: the smallest leave-one-out error among the orders that the experiments can carry
  std::optional<InitialState> initial_state =
      {};  // empty: as the data say, else by test on the residuals of the first steps
  NominalChoice nominal = NominalChoice::automatic;
  Frame frame = Frame::raw;
  Index reference_step = -1;  // s of the reference frame; -1: the first step of full dimension
  double hold_out = 0.0;      // share of the experiments kept for validation, 0 ≤ share < 1
  Index rows = 0, cols = 0;   // blocks of H_k; 0: max(p, ⌈n/m⌉)+1 and max(p, n), or with noise max(p, 48)
  Execution execution = {};
};

// How the residuals of the steps k < p compare with the later ones, which the initial state can't reach.
struct InitialStateTest {
  double statistic = 0.0;  // largest ratio of an early to the later residual variance, over steps and outputs
  double threshold = 0.0;
  InitialState decision = InitialState::zero;
  std::string reason;
};

// What each order made of the training data; filled where the order was chosen from noisy data.
struct OrderScores {
  std::vector<Index> states;
  std::vector<double> one_step, simulation;  // RMS error over that of the departures, mean of the logs over outputs
  Index best = 0;  // the smallest order within 2 % of the smallest sum of both and of n (r+m) / (N m) for each
};

struct Identification {
  Model model;
  Index experiments = 0, steps = 0;  // used for identification
  Index lags = 0;                    // p
  Index min_experiments = 0;         // N_min at this p, one more where a nominal trajectory is estimated
  Index rank_deficient_steps = 0;
  double condition_max = 0.0;
  NominalTest nominal_test;  // filled where the choice was automatic
  InitialStateTest initial_state_test;
  LagOrderErrors lag_order_errors;  // filled where p was chosen
  OrderScores order_scores;
  bool noisy = false;     // residuals beyond rounding errors
  bool held_out = false;  // else `validation` is on the training data
  Validation validation;
  std::vector<std::string> warnings;
  double seconds = 0.0;
};

// \throws std::invalid_argument that names what the data lack: experiments (and which p would do), steps, excitation
Identification identify(const Ensemble& ensemble, const IdentifyOptions& options = {});

}  // namespace tokid
