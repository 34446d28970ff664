// The data sets of files, with the names and shapes of docs/formats.md.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/formats/fields.hpp"
#include "tokid/model.hpp"

namespace tokid::io {

const Names& ensemble_names();
const Names& model_names();

bool is_ensemble(const Names& found);
bool is_model(const Names& found);
bool is_update_state(const Names& found);
bool is_controller(const Names& found);

// The required arrays come last. A file that lost its end therefore lacks a required array, and is refused.
Arrays arrays_of(const Ensemble& ensemble, Layout layout);
Arrays arrays_of(const Model& model, Layout layout);

// The two parts of a model's arrays. The size of the small arrays depends little on the number of steps. The step
// arrays have a row for each step, padded to `states` states and `singular_values` singular values. They begin with the
// nominal trajectory.
Arrays small_arrays_of(const Model& model);
Arrays nominal_arrays_of(const Model& model);
Arrays step_arrays_of(const Model& model, Index states, Index singular_values, Layout layout);
Index singular_value_count(const Model& model);  // the largest number of any step

// Checks that the lists of the ensemble have the right sizes, because a file with other sizes could not be read.
// \throws IoError
void check_sizes(const Ensemble& ensemble);

// An ensemble without its samples. The samples may still be in the file.
struct EnsembleOutline {
  Index experiments = 0, steps = 0, inputs = 0, outputs = 0;
  double dt = 1.0;
  bool dt_stated = false;
  Channels names;
  std::optional<InitialState> initial_state;
  std::vector<Index> length;
  std::vector<std::string> experiment_names;
  FreeResponse free;
  std::vector<std::string> remarks;
};
EnsembleOutline outline_of(const Fields& fields, bool outputs_required);

Ensemble ensemble_of(const Fields& fields, bool outputs_required);
Model model_of(const Fields& fields);

// The channel names and units, which ensembles and models share.
void add_channels(const Channels& channels, Arrays& arrays);
Channels channels_of(const Fields& fields);

// Reads the text of a model's provenance. Any text is accepted, unless it is too long or too deeply nested. \throws
// IoError
Provenance checked_provenance(const std::string& text, const std::string& program_version = {});

inline size_t size(Index n) { return static_cast<size_t>(n); }  // an index as an entry of a shape
Array scalar(double value);
Array scalar(Index value);
Array scalar(const std::string& value);
Array list(const std::vector<Index>& values);

}  // namespace tokid::io
