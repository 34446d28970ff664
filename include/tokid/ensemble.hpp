// N repeated experiments of T steps as one matrix.
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

// What is known of the state of every experiment at k = 0.
enum class InitialState { zero, unknown };

const char* to_string(InitialState state);
// \throws std::invalid_argument unless the text is "zero" or "unknown"
InitialState initial_state_from(const std::string& text);

// Names and units of the channels. Empty lists stand for u1…ur, y1…ym without units.
struct Channels {
  std::vector<std::string> input_names, output_names;
  std::vector<std::string> input_units, output_units;

  std::string input(Index i) const;   // "u1" or the given name
  std::string output(Index j) const;  // "y1" or the given name
};

// With the default names and empty units where lists are empty, for r inputs and m outputs.
Channels complete(const Channels& names, Index inputs, Index outputs);

// Experiments without input from unknown non-zero initial states, on the time origin of the ensemble.
struct FreeResponse {
  Index experiments = 0;  // Nf
  Index steps = 0;        // Tf
  Matrix y;               // (Nf × Tf·m), columns k·m … k·m+m-1 hold y_k
};

// Those without a missing sample: one factorisation needs all of its columns whole.
FreeResponse complete(const FreeResponse& free);

// Experiments down the rows, time along the columns: columns k·d … k·d+d-1, d = r+m, hold u_k (r columns) and then y_k
// (m columns). The regressors of a step are therefore one contiguous window (17), (18). NaN marks a missing sample.
class Ensemble {
 public:
  Ensemble() = default;
  enum class Samples { missing, unset };
  // N × T with every sample missing, or left to be written. \throws std::invalid_argument for a negative size, r + m =
  // 0 or dt ≤ 0
  Ensemble(Index experiments, Index steps, Index inputs, Index outputs, double dt = 1.0,
           Samples samples = Samples::missing);

  Index experiments() const { return samples_.rows(); }  // N
  Index steps() const { return steps_; }                 // T
  Index inputs() const { return inputs_; }               // r
  Index outputs() const { return outputs_; }             // m
  Index channels() const { return inputs_ + outputs_; }  // d = r + m

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

  // W_k = [v_{k-p} … v_{k-1} u_k]  (N × p·d + r): the regressors of step k, oldest lag first (18). Needs k ≥ p.
  auto window(Index k, Index p) const { return samples_.middleCols((k - p) * channels(), p * channels() + inputs_); }
  // [W_k Y_k]  (N × (p+1)·d), contiguous.
  auto window_and_output(Index k, Index p) const {
    return samples_.middleCols((k - p) * channels(), (p + 1) * channels());
  }

  Index missing() const;  // number of NaN samples
  // The experiments (row numbers) that have every sample of [W_k Y_k].
  std::vector<Index> complete_rows(Index k, Index p) const;

  // The experiments of the given row numbers, with everything else kept. Experiments without names get their row
  // numbers as names. Where a row is chosen twice, the experiments of the subset have no names.
  Ensemble subset(const std::vector<Index>& experiments) const;

  // The given inputs and outputs, in the given order, with everything else kept. Outputs of free responses follow.
  Ensemble select(const std::vector<Index>& inputs, const std::vector<Index>& outputs) const;

  // The name that the data give to experiment n; empty where they give none.
  std::string experiment_name(Index n) const;
  // Experiment n as messages name it: "16", or with its name and its row: "\"17\" (row 16)".
  std::string experiment(Index n) const;
  // The name, or the row where it has none: the same text for an experiment in the data and in a part of them.
  std::string experiment_label(Index n) const;

  // \throws std::invalid_argument that names the channel, experiment and step of an infinite value, or the channel
  // without a single finite sample, or what else is inconsistent.
  // With outputs_needed = false, outputs may be missing altogether, as where nothing could be predicted.
  void check(bool outputs_needed = true) const;

  double dt = 1.0;        // sample time [s]
  bool dt_stated = true;  // false: the data state none, and dt is 1
  Channels names;
  std::optional<InitialState> initial_state;  // empty: not stated with the data
  std::vector<Index> length;                  // (N) valid samples of each experiment; empty: all T
  std::vector<std::string> experiment_names;  // (N) as the data label them; empty: they are known by their rows alone
  FreeResponse free;
  std::vector<std::string> remarks;  // of the reader of a file, for its user; parts of the ensemble go without

 private:
  Index steps_ = 0, inputs_ = 0, outputs_ = 0;
  Matrix samples_;
};

// Sets the lengths, and what lies beyond them to NaN. None: all of them have T. \throws std::invalid_argument
// unless there is one from 0 to T for each experiment
void set_length(Ensemble& ensemble, std::vector<Index> length);

// The channels with the names that are wanted, in that order. Nothing: the data have them so already, name no channels,
// or lack one of the names. An ensemble without outputs needs the inputs only.
std::optional<Ensemble> in_order(const Ensemble& ensemble, const Channels& wanted);

// Sets the names of the experiments. Names that are the row numbers 0 … N-1 say nothing: then the list becomes empty.
// \throws std::invalid_argument unless the list is empty or has N different names, none of them empty
void set_experiment_names(Ensemble& ensemble, std::vector<std::string> names);

// Number of NaN samples within the length of each experiment.
Index missing_samples(const Ensemble& ensemble);

// The samples of one channel, inputs first, within the length of each experiment; NaN where there are none.
struct ChannelSummary {
  Index samples = 0, missing = 0;
  double mean = std::numeric_limits<double>::quiet_NaN();
  double std = std::numeric_limits<double>::quiet_NaN();  // about the mean, over all samples
  double min = std::numeric_limits<double>::quiet_NaN();
  double max = std::numeric_limits<double>::quiet_NaN();
};
ChannelSummary channel_summary(const Ensemble& ensemble, Index channel);

// The experiments held out are spread evenly over the ensemble, so that both parts represent an ordered campaign.
struct Split {
  Ensemble training, held_out;
  std::vector<Index> held_out_rows = {};  // of the experiments that were held out, in the ensemble that was split
};
// Of a single record of a system with a period of so many steps its end is held out, from a step of the first phase on.
// \throws std::invalid_argument unless 0 < fraction < 1 and both parts get at least one experiment, or step
Split split(const Ensemble& ensemble, double fraction, Index period = 0);

// 16 hexadecimal digits (XXH3, 64 bits) that tell the samples u and y of one ensemble from those of any other, whatever
// file they came from.
std::string fingerprint(const Ensemble& ensemble);

// 128 bits (XXH3) that tell the samples u and y of one experiment from those of any other with as many steps, inputs
// and outputs. Missing samples count, what names and lengths say does not; 0 and −0 are the same.
using Digest = std::array<std::uint64_t, 2>;
std::vector<Digest> experiment_digests(const Ensemble& ensemble);  // (N)

// The steps begin … end-1 of every experiment as an ensemble of its own, whose initial states are unknown unless it
// begins with the experiments. Free responses stay behind. \throws std::invalid_argument unless 0 ≤ begin < end ≤ T
Ensemble stretch(const Ensemble& ensemble, Index begin, Index end);

// Consecutive stretches of the given length as experiments of their own, unfinished ones left out: what a system that
// does not change with time makes of one long record. \throws std::invalid_argument unless 1 ≤ length ≤ T
Ensemble cut(const Ensemble& ensemble, Index length);

// Mean motion over the experiments at each step, from the samples that are there.
struct Nominal {
  Matrix u;  // (T × r)
  Matrix y;  // (T × m)
};
Nominal nominal_trajectory(const Ensemble& ensemble);
Ensemble departures(Ensemble ensemble, const Nominal& nominal);
// Free responses as departures from their own mean motion, which are free responses too; none of a single one.
FreeResponse free_departures(const FreeResponse& free);

// Gives the steps k, k+P, k+2P … the mean of their motions: steps that share a model depart from one motion.
void share_phases(Nominal& nominal, Index period);

// Is the mean motion over the experiments different from zero? With the mean of a channel over the N experiments of a
// step, t² = N·mean²/variance, where the variance counts as no smaller than its average over the steps of the channel.
// Two tests share the error of one run in a thousand. The mean of t² over all channels and steps sees a small motion
// that lasts; its bound is right for any correlation in time. The largest t² sees a motion of few steps; its bound is
// corrected for the number of channels and steps (Bonferroni), which is right for any correlation too.
struct NominalTest {
  // A channel, inputs first, and the steps at which its own t² is beyond the bound.
  struct Departure {
    Index channel = 0;
    std::vector<Index> steps;
  };
  double statistic = 0.0;  // mean of t²
  double threshold = 0.0;
  double step_statistic = 0.0;  // the t² of one channel at one step that is largest beside its bound
  double step_threshold = 0.0;  // that bound; it grows as the samples of the step become fewer
  std::vector<Departure> departures;
  bool significant = false;  // by either test
};
NominalTest test_nominal(const Ensemble& ensemble);

}  // namespace tokid
