// Surveys all samples of an ensemble, or of a stretch of its steps: ranges, gaps, inputs at rest, digests.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

struct ChannelRange {
  Index present = 0;  // samples that are not missing
  double min = std::numeric_limits<double>::infinity(), max = -std::numeric_limits<double>::infinity();
};

struct Survey {
  std::vector<ChannelRange> channel;  // (d) inputs first
  // (r) steps at which the input is zero in all experiments, or has one other value in all experiments
  std::vector<std::vector<Index>> zero, same;
  // (r) steps at which only one of several experiments has a sample of the input, unless this sample is zero
  std::vector<std::vector<Index>> alone;
  std::vector<std::vector<Index>> absent;  // (d) steps at which every experiment lacks the sample
  Index missing = 0;                       // within the lengths of the experiments

  // Appends the survey of later steps. Step 0 of `later` is step `begin` of this survey.
  void append(const Survey& later, Index begin);
};

// Surveys the steps begin … end-1 and counts them from zero. \throws std::invalid_argument for an infinite value. The
// message names the channel, the experiment and the step. Step 0 of the ensemble has the number `origin` there.
Survey survey(const Ensemble& ensemble, Index begin, Index end, Index origin = 0);

// The message for an infinite sample of channel c (inputs first) at step k of an experiment, given by its row or name.
std::string infinite_sample(const Channels& names, Index inputs, Index c, const std::string& experiment, Index k);

// \throws std::invalid_argument if all samples of a channel are missing
void check_presence(const Survey& survey, const Channels& names, Index inputs, Index samples);

// Squares and ratios of samples, and the squares of ratios, must stay within the range of double precision.
// \throws std::invalid_argument
void check_magnitudes(const Survey& survey, const Channels& names, Index inputs);

// Reports steps at which an input is the same in every experiment, or at which only one experiment has a sample of it,
// because its effect there can't be identified. With a
// period, reports the phases at which an input is always zero. findings_of_outputs() reports outputs that never change.
Findings findings_of_inputs(const Survey& survey, const Channels& names);
Findings findings_of_inputs(const Survey& survey, const Channels& names, Index period, Index steps);
Findings findings_of_outputs(const Survey& survey, const Channels& names);

// Reports steps at which a channel has no sample in any experiment. If the steps are coupled, the model is only
// interpolated there.
Findings findings_of_absence(const Survey& survey, const Channels& names);

// Reports experiments that have no step in common: such experiments can't be compared. Reads all samples.
Findings findings_of_overlap(const Ensemble& ensemble);

// A fingerprint is a digest of the digests of all steps, so that each step can be digested by itself.
std::uint64_t digest(const Ensemble& ensemble, Index k);
std::string fingerprint(Index experiments, Index inputs, Index outputs, const std::vector<std::uint64_t>& digests);

// Serialises a survey for messages between processes.
template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, Survey>
void fields(Archive& archive, S& s) { archive(s.channel, s.zero, s.same, s.alone, s.absent, s.missing); }

}  // namespace tokid
