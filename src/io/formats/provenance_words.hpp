// The provenance of a model in words, for people. For files, see provenance_text.hpp.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "tokid/provenance.hpp"

namespace tokid::io {

// Labels and their texts: "Options", those that are not at their defaults; "Chosen", what an identification of noisy
// data chose; "Refined" and "Corrected". Without what is not known.
std::vector<std::pair<std::string, std::string>> provenance_words(const Provenance& provenance);

}  // namespace tokid::io
