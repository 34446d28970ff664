// Thresholds of the verdict and of the tables. The page of a report states them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/types.hpp"

namespace tokid::report::bounds {

inline constexpr double good_fit = 80.0, poor_fit = 50.0;  // [%]
inline constexpr double useless_fit = 10.0;                // [%] the noise can excuse fits from here on only
inline constexpr double expected_fit = 90.0;               // [%] an exact model predicts well with this fit or more …
inline constexpr double like_one_step = 1.25;     // … or with errors up to this multiple of its one-step errors
inline constexpr double as_expected = 1.25;       // noise explains errors up to this multiple of an exact model's
inline constexpr double inputs_show = 0.5;        // least effect of the inputs within a horizon, relative to errors
inline constexpr double over_regression = 1.15;   // error of predictions relative to that of a regression
inline constexpr double ill_conditioned = 1e8;    // condition number, with or without noise
inline constexpr double worse_than_usual = 30.0;  // with noise: multiple of the median condition number …
inline constexpr double worth_a_word = 1e3;       // … and least condition number
inline constexpr double weak_input = 0.02;        // spread of an input relative to its median spread
inline constexpr double error_peak = 5.0;         // one-step error of a step relative to the median of the steps …
inline constexpr double error_floor = 0.05;       // … and relative to the spread of the outputs …
inline constexpr double error_stated = 2.0;       // … and relative to the error that the model states for the step
inline constexpr double beyond_noise = 5.0;       // one-step error relative to the identification at this step
inline constexpr double coverage = 0.9;           // least share of the model's steps that the data test
inline constexpr double false_effect = 0.5;       // error of the effect of an input beyond its interval
inline constexpr double chance = 0.01;            // expected number of steps with a weak input or error peak by chance
inline constexpr double many_missing = 0.1;       // share of all samples
inline constexpr Index training_samples = 3;      // experiments per unknown, if these test the model
inline constexpr Index samples = 2;               // experiments per unknown, with noise
inline constexpr Index few_tested = 3;            // fewer tested experiments than this are few

}  // namespace tokid::report::bounds
