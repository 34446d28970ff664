// Models as C99 source: the observer of a model, and a controller, for machines without this library.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "tokid/control.hpp"

namespace tokid {

struct DeployOptions {
  std::string name = {};          // NAME: the names in C begin with it; empty: that of the file, or "observer"
  std::string header = {};        // file name of the header, for #include; empty: NAME.h
  bool single_precision = false;  // true: float, false: double
  bool start_from_zero = false;   // an unknown initial state without an estimate counts as zero
};

struct Operations {
  Index multiplications = 0, additions = 0, divisions = 0;  // subtractions are additions
};
std::string in_words(const Operations& count);  // "44 multiplications, 46 additions, 1 division"

struct DeployedCode {
  std::string name;            // NAME
  std::string header, source;  // texts of the header, and of the file that includes it
  Index table_bytes = 0;       // of all constant tables
  Index state_bytes = 0;       // of one NAME_state, if the alignment of a number is its size
  Index stored_steps = 0;      // different steps: equal ones are in the tables once
  Operations step;             // most operations of a NAME_step() with all outputs
  Operations step_missing;     // the same if outputs are missing
  Operations control;          // most operations of a NAME_control(); zero without a controller
};

// Writes the observer x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) (9) as C99: constant tables, a struct for the
// state, and the functions NAME_init() and NAME_step(). They give what OnlineObserver gives with samples_missing =
// false, up to rounding. In particular, the innovation of a missing output (NaN) is estimated from those of the other
// outputs by innovation_cov. The code solves no regression, and therefore
// - an input must not be missing: NAME_step() then returns a status code and leaves the state as it was;
// - the state must be known at the first step: zero or x0_mean. Other models need start_from_zero.
// A step after the end of a model without period returns a status code, and so does a step or an input with a result
// beyond the range of the numbers: whenever the status is NAME_ok, the state and all results are finite, but for the
// innovations of missing outputs.
// With a controller of this model there is also NAME_control(), which gives u_k from x̂_k before y_k is known.
// The code allocates no memory, and includes <float.h> and <stdint.h> alone. It calls no function of a library, but
// compilers may insert calls of memcpy() and memset(). With -ffast-math or -ffinite-math-only it does not compile,
// because missing samples are NaN.
// \throws std::invalid_argument for a name that C does not accept, a model that is not consistent or has no step, an
// innovation_cov that is no covariance, an unknown initial state without start_from_zero, numbers that are not finite
// or beyond the range of float, or a controller of another model
DeployedCode deploy(const Model& model, const DeployOptions& options = {}, const Controller* controller = nullptr);

// The header that belongs to a source file: FILE.h for FILE.c.
// \throws IoError for another extension, or a file name that is not made of letters, digits, '_', '-' and '.'
std::filesystem::path deployed_header(const std::filesystem::path& source);

// Writes the texts of deploy() into the files FILE.c and FILE.h, which appear together or not at all. Without
// options.name, NAME is FILE. \throws as deploy() and deployed_header(), WriteError
DeployedCode save_deployed(const Model& model, const std::filesystem::path& source, DeployOptions options = {},
                           const Controller* controller = nullptr);

}  // namespace tokid
