// Bounds that the verdict and the tables use; the page states them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/types.hpp"

namespace tokid::report::bounds {

inline constexpr double good_fit = 80.0, poor_fit = 50.0;  // [%]
inline constexpr double useless_fit = 10.0;                // [%] for smaller fits noise is no excuse
inline constexpr double expected_fit = 90.0;               // [%] an exact model predicts well from here on …
inline constexpr double like_one_step = 1.25;              // … or with errors up to this multiple of one step's
inline constexpr double as_expected = 1.25;                // errors relative to an exact model's that noise explains
inline constexpr double inputs_show = 0.5;                 // effect of inputs within a horizon relative to its errors
inline constexpr double ill_conditioned = 1e8;             // in any case
inline constexpr double worse_than_usual = 30.0;           // with noise: this multiple of the median condition …
inline constexpr double worth_a_word = 1e3;                // … and larger than this
inline constexpr double weak_input = 0.02;                 // spread of an input over its median spread
inline constexpr double error_peak = 5.0;                  // one-step error of a step over the median of the steps
inline constexpr double error_floor = 0.05;                // … and over the spread of the output …
inline constexpr double error_stated = 2.0;                // … and over the error that the model states for the step
inline constexpr double beyond_noise = 5.0;                // one-step error relative to the identification's at that
                                                           // step
inline constexpr double outlier = 10.0;                    // error of an experiment over the median of all
inline constexpr double coverage = 0.9;                    // share of the model's steps that the data test
inline constexpr double chance = 0.01;                     // of weak inputs by chance
inline constexpr double many_missing = 0.1;                // of all samples
inline constexpr Index few_tested = 3;                     // experiments

}  // namespace tokid::report::bounds
