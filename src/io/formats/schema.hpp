// The names and shapes of docs/formats.md.
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

// Required arrays come last, so that a file that lost its end is never taken for a complete one.
Arrays arrays_of(const Ensemble& ensemble, Layout layout);
Arrays arrays_of(const Model& model, Layout layout);

// The two parts of a model's arrays. The small ones, including the counts, do not grow with the number of steps. The
// others have a row for each step, padded to so many states and singular values.
Arrays small_arrays_of(const Model& model);
Arrays step_arrays_of(const Model& model, Index states, Index singular_values, Layout layout);
Index singular_value_count(const Model& model);  // the largest of any step

// Checks that lists of the ensemble have its sizes, because such a file could not be read. \throws IoError
void check_sizes(const Ensemble& ensemble);

// An ensemble without its samples, which may still be in the file.
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

// Reads the text of a model's provenance. It may be any text that is not too deep or too long to use. \throws IoError
Provenance checked_provenance(const std::string& text, const std::string& program_version = {});

inline size_t size(Index n) { return static_cast<size_t>(n); }  // in a shape
Array scalar(double value);
Array scalar(Index value);
Array scalar(const std::string& value);
Array list(const std::vector<Index>& values);

}  // namespace tokid::io
