// Matrices and indices as Eigen has them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "tokid/version.hpp"  // checks that Eigen allocates here as it did when the library was built

namespace tokid {

using Index = Eigen::Index;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;
using ConstMatrixRef = Eigen::Ref<const Matrix>;

}  // namespace tokid
