// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/provenance.hpp"

#include <algorithm>
#include <stdexcept>

namespace tokid {

IdentifyOptions identify_options(const Provenance& provenance) {
  if (provenance.options) {
    IdentifyOptions options = *provenance.options;
    const std::optional<FeedthroughChoice>& known = provenance.feedthrough;
    if (known && known->reason == FeedthroughChoice::Reason::stated) options.feedthrough = known->present;
    return options;
  }
  if (!provenance.unread.empty()) throw std::invalid_argument(provenance.unread);
  if (provenance.refinement) return {};  // a known model after EM: no option was stated
  throw std::invalid_argument(
      "options of the model: none found, because tokid did not identify it. Use an identified model");
}

void note_data(Provenance& provenance, const std::string& fingerprint) {
  std::vector<std::string>& known = provenance.data;
  if (std::find(known.begin(), known.end(), fingerprint) == known.end()) known.push_back(fingerprint);
}

bool has_seen(const Provenance& provenance, const Ensemble& data) {
  return std::find(provenance.data.begin(), provenance.data.end(), fingerprint(data)) != provenance.data.end();
}

FeedthroughChoice feedthrough_choice(const Provenance& provenance) {
  if (provenance.feedthrough) return *provenance.feedthrough;
  const std::optional<bool> asked = provenance.options ? provenance.options->feedthrough : std::nullopt;
  using Reason = FeedthroughChoice::Reason;
  return {.present = asked.value_or(true), .reason = asked ? Reason::stated : Reason::unknown};
}

bool has_feedthrough(const Provenance& provenance) { return feedthrough_choice(provenance).present; }

}  // namespace tokid
