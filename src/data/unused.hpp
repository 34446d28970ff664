// Says which experiments were left out, if the others do not permit a computation.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

#include "tokid/ensemble.hpp"

namespace tokid {

// The sentences of findings_of(used_experiments(ensemble), ensemble), each after "; ". Empty if all experiments are
// used.
std::string remark_on_unused(const Ensemble& ensemble);

// Runs work on the used experiments of the ensemble. If the work refuses them, the message also says which experiments
// are not among them. The numbers in the message of the work alone would not be those of the caller's data.
template <class Work>
auto with_remark_on_unused(const Ensemble& ensemble, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    const std::string remark = remark_on_unused(ensemble);
    if (remark.empty()) throw;
    throw std::invalid_argument(error.what() + remark);
  }
}

}  // namespace tokid
