// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "tokid/types.hpp"

namespace tokid {

// An experiment that does not obey the model of the others, by the residuals that it has with it.
struct Outlier {
  Index experiment = 0;
  double ratio = 0.0;       // size of its leave-one-out residuals over the usual one
  std::string explanation;  // what would make it as usual, in words; empty: nothing that was tried
  std::string name;         // of the experiment, empty where the data give none
};

}  // namespace tokid
