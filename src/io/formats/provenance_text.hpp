// The provenance of a model as JSON text, for files, the tool and Python. docs/formats.md describes it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "tokid/provenance.hpp"

namespace tokid::io {

// Empty if nothing is known. A provenance that was read from a text gives the same text again, apart from members that
// have changed.
std::string provenance_text(const Provenance& provenance);

// Reads any text. Provenance::text keeps members that this version does not know.
Provenance provenance_of(const std::string& text, const std::string& program_version = {});

}  // namespace tokid::io
