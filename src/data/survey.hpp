// One look at all samples of an ensemble, or of a stretch of its steps: ranges, gaps, inputs at rest, digests.
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
  Index present = 0;  // samples that are there
  double min = std::numeric_limits<double>::infinity(), max = -std::numeric_limits<double>::infinity();
};

struct Survey {
  std::vector<ChannelRange> channel;  // (d) inputs first
  std::vector<std::vector<Index>> zero,
      same;                                // (r) steps at which the input is zero, or otherwise the same, everywhere
  std::vector<std::vector<Index>> absent;  // (d) steps at which every experiment lacks the sample
  Index missing = 0;                       // within the lengths of the experiments

  // Of later steps, which that survey counts from `begin` on.
  void append(const Survey& later, Index begin);
};

// "input u1", "output y2" of channel c, inputs first.
std::string channel_name(const Channels& names, Index inputs, Index c);

// Of the steps begin … end-1, which it counts from zero on. \throws std::invalid_argument that names the channel, the
// experiment and the step, counted from `origin` on, of an infinite value
Survey survey(const Ensemble& ensemble, Index begin, Index end, Index origin = 0);

// \throws std::invalid_argument that names a channel of which all samples are missing
void check_presence(const Survey& survey, const Channels& names, Index inputs, Index samples);

// Squares and ratios of samples must stay within the range of double precision, ratios of their squares too.
// \throws std::invalid_argument
void check_magnitudes(const Survey& survey, const Channels& names, Index inputs);

// Inputs that are the same in every experiment identify nothing at those steps, and nothing at the phases of a period
// > 0 at which they are zero; nor do outputs that never move.
Findings findings_of_inputs(const Survey& survey, const Channels& names);
Findings findings_of_inputs(const Survey& survey, const Channels& names, Index period, Index steps);
Findings findings_of_outputs(const Survey& survey, const Channels& names);

// Where every experiment has a gap, and steps lend each other theirs, the model is a guess.
Findings findings_of_absence(const Survey& survey, const Channels& names);

// Experiments that share no step can't tell what one step does from what the others do. Looks at all samples.
Findings findings_of_overlap(const Ensemble& ensemble);

// Fingerprints are digests of the digests of all steps, so that they can be taken apart from each other.
std::uint64_t digest(const Ensemble& ensemble, Index k);
std::string fingerprint(Index experiments, Index inputs, Index outputs, const std::vector<std::uint64_t>& digests);

// For messages between processes.
template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, Survey>
void fields(Archive& archive, S& s) { archive(s.channel, s.zero, s.same, s.absent, s.missing); }

}  // namespace tokid
