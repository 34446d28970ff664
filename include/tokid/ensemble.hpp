// An ensemble: N repeated experiments of T steps in one matrix.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/linalg.hpp"

namespace tokid {

// What the user knows about the state of every experiment at k = 0.
enum class InitialState { zero, unknown };

const char* to_string(InitialState state);
// \throws std::invalid_argument unless the text is "zero" or "unknown"
InitialState initial_state_from(const std::string& text);

// Names and units of the channels. Empty lists mean the names u1…ur, y1…ym without units.
struct Channels {
  std::vector<std::string> input_names, output_names;
  std::vector<std::string> input_units, output_units;

  std::string input(Index i) const;   // "u1" or the given name
  std::string output(Index j) const;  // "y1" or the given name
};

// Fills empty lists with default names and empty units, for r inputs and m outputs.
Channels complete(const Channels& names, Index inputs, Index outputs);

// Free responses: experiments without input, from unknown initial states that are not zero. Step 0 is that of the
// ensemble.
struct FreeResponse {
  Index experiments = 0;  // Nf
  Index steps = 0;        // Tf
  Matrix y;               // (Nf × Tf·m), columns k·m … k·m+m-1 hold y_k
};

// The free responses without a missing sample. TVERA uses all of them in one factorisation, which permits no missing
// sample.
FreeResponse complete(const FreeResponse& free);

// Each row is an experiment, and time runs along the columns. The columns k·d … k·d+d-1, d = r+m, hold u_k (r columns)
// and then y_k (m columns). The regressors of a step are therefore contiguous columns: the window (17), (18). NaN marks
// a missing sample. Runs makes an ensemble from runs in memory, and checks them.
class Ensemble {
 public:
  Ensemble() = default;
  enum class Samples { missing, unset };
  // N × T with every sample missing, or uninitialised (unset). dt counts as stated, also if it is the default. If no
  // sample time is known, set dt_stated = false.
  // \throws std::invalid_argument for a negative size, r + m = 0 or dt ≤ 0
  Ensemble(Index experiments, Index steps, Index inputs, Index outputs, double dt = 1.0,
           Samples samples = Samples::missing);

  Index experiments() const { return samples_.rows(); }  // N
  Index steps() const { return steps_; }                 // T
  Index inputs() const { return inputs_; }               // r
  Index outputs() const { return outputs_; }             // m
  Index channels() const { return inputs_ + outputs_; }  // d = r + m

  // Input i and output j of experiment n at step k. Only debug builds check the indices, and not all of them: they must
  // satisfy 0 ≤ n < N, 0 ≤ k < T, 0 ≤ i < r and 0 ≤ j < m. Writing outside corrupts memory.
  double& u(Index n, Index k, Index i) { return samples_(n, k * channels() + i); }
  double u(Index n, Index k, Index i) const { return samples_(n, k * channels() + i); }
  double& y(Index n, Index k, Index j) { return samples_(n, k * channels() + inputs_ + j); }
  double y(Index n, Index k, Index j) const { return samples_(n, k * channels() + inputs_ + j); }

  const Matrix& samples() const { return samples_; }  // (N × T·d)
  Eigen::Ref<Matrix> samples() { return samples_; }

  // Inputs u_k (N × r) and outputs y_k (N × m) of all experiments at one step.
  auto input(Index k) const { return samples_.middleCols(k * channels(), inputs_); }
  auto input(Index k) { return samples_.middleCols(k * channels(), inputs_); }
  auto output(Index k) const { return samples_.middleCols(k * channels() + inputs_, outputs_); }
  auto output(Index k) { return samples_.middleCols(k * channels() + inputs_, outputs_); }

  // Inputs (T × r) and outputs (T × m) of experiment n at all steps.
  Matrix inputs_of(Index n) const;
  Matrix outputs_of(Index n) const;

  // W_k = [v_{k-p} … v_{k-1} u_k]  (N × p·d + r): the regressors of step k, oldest lag first (18). Needs k ≥ p.
  auto window(Index k, Index p) const { return samples_.middleCols((k - p) * channels(), p * channels() + inputs_); }
  // [W_k Y_k]  (N × (p+1)·d), contiguous.
  auto window_and_output(Index k, Index p) const {
    return samples_.middleCols((k - p) * channels(), (p + 1) * channels());
  }

  Index missing() const;  // number of NaN samples
  // Rows of the experiments that have every sample of [W_k Y_k].
  std::vector<Index> complete_rows(Index k, Index p) const;

  // The experiments in the given rows, with all other members unchanged. Experiments without names get their row
  // numbers as names. If a row occurs twice in the list, the experiments of the subset have no names.
  Ensemble subset(const std::vector<Index>& experiments) const;

  // The given inputs and outputs, in the given order, with all other members unchanged. The same outputs of the free
  // responses are selected.
  Ensemble select(const std::vector<Index>& inputs, const std::vector<Index>& outputs) const;

  // The name of experiment n in the data; empty if the data give none.
  std::string experiment_name(Index n) const;
  // Experiment n as messages name it: its row "16", or its name and its row "\"17\" (row 16)".
  std::string experiment(Index n) const;
  // The name of experiment n, or its row if it has none. An experiment has the same label in the data and in each
  // subset() of the data.
  std::string experiment_label(Index n) const;

  // \throws std::invalid_argument for an infinite value (the message names the channel, experiment and step), a channel
  // without any sample (the message names the channel), sizes that do not match, or two inputs or two outputs of one
  // name.
  // With outputs_needed = false, all outputs may be missing, for example if a model could predict none.
  void check(bool outputs_needed = true) const;

  double dt = 1.0;        // sample time [s]
  bool dt_stated = true;  // false: the data state no sample time, and dt is 1
  Channels names;
  std::optional<InitialState> initial_state;  // empty: not stated with the data
  std::vector<Index> length;                  // (N) number of steps of each experiment; empty: T
  std::vector<std::string> experiment_names;  // (N) as in the data; empty: no names
  FreeResponse free;
  std::vector<std::string> remarks;  // remarks of the file reader for the user; parts of the ensemble have none

 private:
  Index steps_ = 0, inputs_ = 0, outputs_ = 0;
  Matrix samples_;
};

// Sets the length of each experiment, and its samples beyond that length to NaN. An empty list means T for all.
// \throws std::invalid_argument unless the list has one length from 0 to T for each experiment
void set_length(Ensemble& ensemble, std::vector<Index> length);

// The ensemble with its channels in the order of the wanted names. Empty if the channels are in this order already,
// have no names, or if a wanted name is missing. If the ensemble has no outputs, only the names of the inputs are
// wanted.
std::optional<Ensemble> in_order(const Ensemble& ensemble, const Channels& wanted);

// Sets the names of the experiments. If the names are the row numbers 0 … N-1, they carry no information, and the list
// becomes empty. \throws std::invalid_argument unless the list is empty or has N different names, none of them empty
void set_experiment_names(Ensemble& ensemble, std::vector<std::string> names);

// Number of NaN samples within the length of each experiment.
Index missing_samples(const Ensemble& ensemble);

// Statistics of one channel (inputs first), within the length of each experiment; NaN without samples.
struct ChannelSummary {
  Index samples = 0, missing = 0;
  double mean = std::numeric_limits<double>::quiet_NaN();
  double std = std::numeric_limits<double>::quiet_NaN();  // standard deviation over all samples
  double min = std::numeric_limits<double>::quiet_NaN();
  double max = std::numeric_limits<double>::quiet_NaN();
};
ChannelSummary channel_summary(const Ensemble& ensemble, Index channel);

// A division into training data and held-out data. The held-out experiments are spread evenly over the ensemble. If
// conditions drift from the first to the last experiment, both parts then contain all conditions.
struct Split {
  Ensemble training, held_out;
  std::vector<Index> held_out_rows = {};  // rows of the held-out experiments in the original ensemble
};
// Splits an ensemble. If the system is periodic and there is only one experiment, the last steps are held out. They
// begin at a multiple of the period.
// \throws std::invalid_argument unless 0 < fraction < 1 and both parts get at least one experiment, or step
Split split(const Ensemble& ensemble, double fraction, Index period = 0);

// A hash of the samples u and y (XXH3, 64 bits, as 16 hexadecimal digits). Equal samples have the same hash in every
// file format; different samples have different hashes.
std::string fingerprint(const Ensemble& ensemble);

// A hash of the samples u and y of one experiment (XXH3, 128 bits). Different experiments with equal numbers of steps,
// inputs and outputs have different digests. The digest depends on which samples are missing, but not on names and
// lengths. 0 and −0 count as equal.
using Digest = std::array<std::uint64_t, 2>;
std::vector<Digest> experiment_digests(const Ensemble& ensemble);  // (N)

// The steps begin … end-1 of every experiment as a new ensemble. The new ensemble has no free responses. Its initial
// states are unknown, unless begin is 0. \throws std::invalid_argument unless 0 ≤ begin < end ≤ T
Ensemble stretch(const Ensemble& ensemble, Index begin, Index end);

// Consecutive stretches of the given length, each as an experiment; an incomplete last stretch is dropped. This turns
// one long record of a time-invariant system into an ensemble. \throws std::invalid_argument unless 1 ≤ length ≤ T
Ensemble cut(const Ensemble& ensemble, Index length);

// Mean motion: the mean over the experiments at each step, without missing samples.
struct Nominal {
  Matrix u;  // (T × r)
  Matrix y;  // (T × m)
};
Nominal nominal_trajectory(const Ensemble& ensemble);
Ensemble departures(Ensemble ensemble, const Nominal& nominal);
// The departures of free responses from their own mean motion. These departures are free responses of the same system.
// A single free response has no departures.
FreeResponse free_departures(const FreeResponse& free);

// Replaces the mean motion at the steps k, k+P, k+2P … by its mean over these steps, because steps that share a model
// need the same mean motion.
void share_phases(Nominal& nominal, Index period);

// Test: does the mean motion over the experiments differ from zero? The statistic of a channel at a step is t² =
// N·mean²/variance over its N experiments. If the variance at a step is smaller than its average over the steps of the
// channel, the average replaces it. Two tests share a total false-alarm rate of 1 in 1000. The first test uses the mean
// of t² over all channels and steps; it detects a small motion of many steps. The second test uses the largest t²; it
// detects a motion of few steps. Its bound is corrected for the number of channels and steps (Bonferroni). Both bounds
// hold for any correlation in time.
struct NominalTest {
  // A channel (inputs first) and the steps at which its own t² exceeds the bound.
  struct Departure {
    Index channel = 0;
    std::vector<Index> steps;
  };
  double statistic = 0.0;  // mean of t²
  double threshold = 0.0;
  double step_statistic = 0.0;  // the t² that is largest relative to its bound, of one channel at one step
  double step_threshold = 0.0;  // bound of step_statistic; larger for fewer samples at the step
  std::vector<Departure> departures;
  // One model for all steps: F of the constant in a regression of the outputs, and its bound; 0: not tested.
  double constant_statistic = 0.0, constant_threshold = 0.0;
  bool significant = false;  // true if a test is significant
};
NominalTest test_nominal(const Ensemble& ensemble);

}  // namespace tokid
