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
  std::vector<std::vector<Index>> zero,
      same;                                // (r) steps at which the input is zero, or otherwise the same, everywhere
  std::vector<std::vector<Index>> absent;  // (d) steps at which every experiment lacks the sample
  Index missing = 0;                       // within the lengths of the experiments

  // Appends the survey of later steps. That survey counts its steps from `begin` on.
  void append(const Survey& later, Index begin);
};

// Surveys the steps begin … end-1 and counts them from zero. \throws std::invalid_argument for an infinite value. It
// names the channel, the experiment and the step, counted from `origin` on.
Survey survey(const Ensemble& ensemble, Index begin, Index end, Index origin = 0);

// \throws std::invalid_argument that names a channel with no sample at all
void check_presence(const Survey& survey, const Channels& names, Index inputs, Index samples);

// Squares and ratios of samples, and the squares of ratios, must stay within the range of double precision.
// \throws std::invalid_argument
void check_magnitudes(const Survey& survey, const Channels& names, Index inputs);

// Reports inputs that are the same in every experiment, because they identify nothing at those steps. For a period > 0,
// reports the phases at which an input is always zero. Also reports outputs that never move.
Findings findings_of_inputs(const Survey& survey, const Channels& names);
Findings findings_of_inputs(const Survey& survey, const Channels& names, Index period, Index steps);
Findings findings_of_outputs(const Survey& survey, const Channels& names);

// Reports steps at which every experiment has a gap. If the steps are coupled, the model is a guess there.
Findings findings_of_absence(const Survey& survey, const Channels& names);

// Reports experiments that have no step in common: they cannot separate the effect of one step from that of others.
// Reads all samples.
Findings findings_of_overlap(const Ensemble& ensemble);

// A fingerprint is a digest of the digests of all steps, so that each step can be digested by itself.
std::uint64_t digest(const Ensemble& ensemble, Index k);
std::string fingerprint(Index experiments, Index inputs, Index outputs, const std::vector<std::uint64_t>& digests);

// Serialises a survey for messages between processes.
template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, Survey>
void fields(Archive& archive, S& s) { archive(s.channel, s.zero, s.same, s.absent, s.missing); }

}  // namespace tokid
