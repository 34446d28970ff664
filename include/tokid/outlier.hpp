// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "tokid/finding.hpp"

namespace tokid {

// An experiment that does not fit the model of the other experiments, because its residuals are too large.
struct Outlier {
  Index experiment = 0;
  double ratio = 0.0;  // size of its leave-one-out residuals over the typical size
  std::optional<Explanation> explanation = {};
  std::string name = {};  // name of the experiment; empty where the data give none
};

}  // namespace tokid
