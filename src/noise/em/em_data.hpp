// An ensemble → its samples as EM uses them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "model/samples.hpp"

namespace tokid::em {

// One object serves all refinements with the same data.
class Data {
 public:
  // `like`: a model of constant state dimension from step 0 on. Its nominal trajectory is subtracted.
  Data(const Model& like, const Ensemble& ensemble)
      : all_(kalman::samples_of(like, ensemble)), fewer_(kalman::with_fewer_rows(all_)) {}

  const kalman::Samples& all() const { return all_; }
  // Those whose moments are summed up.
  const kalman::Samples& summed() const { return fewer_ ? *fewer_ : all_; }

 private:
  kalman::Samples all_;
  std::optional<kalman::Samples> fewer_;
};

}  // namespace tokid::em
