// The provenance of a model as JSON text, in files, in the tool and in Python: docs/formats.md.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "tokid/provenance.hpp"

namespace tokid::io {

// Empty where nothing is known. A text that was read is written as it was, apart from members that have changed.
std::string provenance_text(const Provenance& provenance);

// Reads any text. What this version does not understand stays in Provenance::text.
Provenance provenance_of(const std::string& text, const std::string& program_version = {});

}  // namespace tokid::io
