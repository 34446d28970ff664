// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/notes.hpp"

#include <algorithm>

#include "base/json.hpp"
#include "base/words.hpp"
#include "io/formats/csv_lines.hpp"

namespace tokid::io {

namespace {

std::string trimmed(std::string_view text) { return std::string(stripped(text)); }

// Reads a number or a flat list. JSON objects are not read, because no note needs an object and large objects are slow
// to read.
Json value_of_note(std::string_view text) {
  const JsonMeasure found = measure_json(text);
  return found.depth <= 1 && found.keys == 0 ? parse_json(text) : Json(Json::value_t::discarded);
}

template <typename T>
void take(const Note& note, const std::string& key, T& to) {
  const auto is_whole = [](const auto& count) { return count.is_number_integer(); };
  try {
    const Json& json = note.value;
    const bool valid = !std::is_same_v<T, std::vector<Index>> || std::all_of(json.begin(), json.end(), is_whole);
    if (valid) return static_cast<void>(to = json.get<typename std::decay_t<T>>());
  } catch (const Json::exception&) {
  }
  fail("line {}: {} = '{}' found, a value in JSON's notation needed", note.line, key, words::quoted(note.text));
}

// A repeated note must have the same value.
void check_repeated(std::map<std::string, Note>& lines, const std::string& key, const Note& note) {
  const auto [before, is_new] = lines.try_emplace(key, note);
  const Note& first = before->second;
  if (is_new || first.text == note.text || (!first.value.is_discarded() && first.value == note.value)) return;
  fail("line {}: {} = '{}' found, but line {} has {} = '{}'; one of them needed", note.line, key,
       words::quoted(note.text), first.line, key, words::quoted(first.text));
}

}  // namespace

void read_note(Index line, const std::string& text, Notes& notes) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos) return;
  const std::string key = trimmed(std::string_view(text).substr(0, equals));
  const std::map<std::string, Names*> lists{{"input_names", &notes.channels.input_names},
                                            {"output_names", &notes.channels.output_names},
                                            {"input_units", &notes.channels.input_units},
                                            {"output_units", &notes.channels.output_units}};
  const auto list = lists.find(key);
  notes.has_checksum |= key == "checksum";
  if (list == lists.end() && key != "dt" && key != "length" && key != "initial_state") return;
  Note note{line, trimmed(std::string_view(text).substr(equals + 1)), {}};
  note.value = value_of_note(note.text);
  check_repeated(notes.lines, key, note);
  if (key == "dt") take(note, key, notes.dt.emplace());
  if (key == "length") take(note, key, notes.length);
  if (key == "initial_state") notes.initial_state = initial_state_from(note.text.substr(0, 80));
  if (list != lists.end()) take(note, key, *list->second);
}

}  // namespace tokid::io
