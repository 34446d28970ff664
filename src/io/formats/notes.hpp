// Comments before the header of a table: "# name = value".
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>

#include "base/json.hpp"
#include "io/arrays.hpp"

namespace tokid::io {

struct Note {
  Index line = 0;
  std::string text;
  Json value;  // discarded if the text is no number and no flat list
};

struct Notes {
  std::optional<double> dt;
  std::optional<InitialState> initial_state;
  Channels channels;
  std::vector<Index> length;
  std::map<std::string, Note> lines;  // by name
  bool has_checksum = false;          // there is a line with a checksum after the first line
};

// Reads the text of a comment, after its #. Other texts than notes are ignored. \throws IoError for a value of the
// wrong kind, and for a note that differs from an earlier one
void read_note(Index line, const std::string& text, Notes& notes);

}  // namespace tokid::io
