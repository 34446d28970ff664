// Matrix and index types of Eigen.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "tokid/version.hpp"  // checks that Eigen allocates memory as in the build of the library

namespace tokid {

using Index = Eigen::Index;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;
using ConstMatrixRef = Eigen::Ref<const Matrix>;

}  // namespace tokid
