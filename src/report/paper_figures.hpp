// The paper's seven figures, and two of the Kalman study.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "report/chart.hpp"
#include "tokid/paper.hpp"

namespace tokid::report {

std::vector<Figure> paper_figures(const Paper& paper);         // figure-1 … figure-7
std::vector<Figure> kalman_figures(const KalmanStudy& study);  // kalman-error, kalman-gain
std::string experiments_name(Index experiments);               // "N = 50", "N → ∞"

}  // namespace tokid::report
