// Follows eigenvalues over time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/types.hpp"

namespace tokid::modes_of {

// The column of each row in the assignment of smallest total cost (Hungarian method). cost (n × n) must be finite.
std::vector<Index> assignment(const Matrix& cost);

// The poles (n) and shapes (m × n) of one step; NaN poles where there are none.
struct StepModes {
  Eigen::VectorXcd poles;
  Eigen::MatrixXcd shapes;
};

// Sorts the columns of each spectrum, so that a column follows a mode. The poles of the next step are predicted from
// those before, so that modes whose frequencies cross keep their columns.
void follow(std::vector<StepModes>& spectra);

// Sorts the columns by their median |s|, and the pole with the larger imaginary part first.
void sort_columns(std::vector<StepModes>& spectra);

// The sine of the angle between two shapes: 0 if one is a complex multiple of the other.
double sine(const Eigen::VectorXcd& a, const Eigen::VectorXcd& b);

}  // namespace tokid::modes_of
