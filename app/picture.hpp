// A small picture of an ensemble: each channel over time, the spread over the experiments, gaps and odd experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid::app {

// Can the terminal show block characters? Yes if the locale of the environment (LC_ALL, LC_CTYPE, LANG) uses UTF-8.
bool shows_blocks();

// Lines of at most 100 columns with the mean of each channel over time, its standard deviation over the experiments,
// and the share of missing samples, where there are any; then odd experiments. At most 12 channels. With blocks: U+2581
// … U+2588; else ASCII.
std::string picture(const Ensemble& ensemble, bool blocks);

// The same for all channels, as a page of HTML with drawings (SVG), in light and dark colours. `name`: of the data.
std::string picture_page(const Ensemble& ensemble, const std::string& name);

// An experiment that differs from the others.
struct Odd {
  Index experiment = 0;
  std::string why;  // "T [degC] is 5.2 times as far from the median as usual"
};
// Compares the distance from the median over the experiments, channel by channel, with that of the other experiments,
// and the lengths. Needs five experiments.
std::vector<Odd> odd_experiments(const Ensemble& ensemble);

}  // namespace tokid::app
