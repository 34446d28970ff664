// The provenance of a model: how it was identified, and from which data.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/corrections.hpp"
#include "tokid/options.hpp"

namespace tokid {

// A refinement by EM.
struct EmRun {
  double smoothing = 0.0;  // λ
  Index iterations = 0;
};

struct Provenance {
  std::optional<IdentifyOptions> options = {};  // without execution and choices; empty: see identify_options()
  Index experiments = 0;                        // used for the identification; 0: not known
  std::vector<std::string> data = {};           // fingerprints of the data that the model was made from
  bool dt_stated = true;                        // true: the data stated their sample time
  std::optional<NoisyChoices> choices = {};     // from noisy data, where all steps are in one regression
  std::optional<EmRun> refinement = {};         // the last refinement by EM
  Corrections corrections = {};                 // what was done about outliers before the identification
  // The choice of the identification. Empty: the choice is the option; earlier versions stored no choice.
  std::optional<FeedthroughChoice> feedthrough = {};
  std::string version = {};  // version of the program that made the model

  // The text of a file, if the members above do not give the same text. It may contain options of a newer version.
  std::string text = {};
  std::string unread = {};  // reason why the text has no options that this version knows
};

// The options that a model was identified with. Options that its text does not contain have their defaults.
// \throws std::invalid_argument where the model has no options, or an option is unknown or has a value of the wrong
// type
IdentifyOptions identify_options(const Provenance& provenance);

// note_data() adds the fingerprint of data. has_seen() is true if the fingerprint of these data was added.
void note_data(Provenance& provenance, const std::string& fingerprint);
bool has_seen(const Provenance& provenance, const Ensemble& data);
// The choice about feedthrough. Of models of earlier versions only the option is known, and of a known model nothing.
FeedthroughChoice feedthrough_choice(const Provenance& provenance);
// False: the model was identified with D = 0, as the user stated or the data decided.
bool has_feedthrough(const Provenance& provenance);

}  // namespace tokid
