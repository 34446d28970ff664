// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/finding.hpp"

namespace tokid {

// An experiment that does not fit the model of the other experiments, because its innovations are too large.
struct Outlier {
  Index experiment = 0;
  double ratio = 0.0;  // size of its innovations by a model of the others, over the typical size
  std::string name = {};  // name of the experiment; empty where the data give none
  // The output with the largest innovations, and other outputs with innovations that are too large.
  std::vector<FindingChannel> outputs = {};
  double weight = 1.0;    // weight in the identification: 1: as any other, 0: dropped
  bool held_out = false;  // true: an experiment that was held out for validation
};

}  // namespace tokid
