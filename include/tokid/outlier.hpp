// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "tokid/types.hpp"

namespace tokid {

// An experiment whose residuals show that it does not fit the model of the other experiments.
struct Outlier {
  Index experiment = 0;
  double ratio = 0.0;       // size of its leave-one-out residuals over the usual size
  std::string explanation;  // possible cause: a change that makes it fit, in words; empty: none was found
  std::string name;         // name of the experiment; empty where the data give none
};

}  // namespace tokid
