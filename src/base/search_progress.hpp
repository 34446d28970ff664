// The progress of a search whose amount of work is not known beforehand.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <mutex>
#include <string>

#include "tokid/parallel.hpp"

namespace tokid {

// Counts units of work that take about the same time, such as iterations of one fold. Each unit finishes the same share
// of the work that is left. So the share neither stands still nor reaches its end, however much work the search takes.
class SearchProgress {
 public:
  // `usual`: usual number of units.
  SearchProgress(const Execution& execution, double usual) : execution_(execution), usual_(usual) {}
  SearchProgress(const SearchProgress&) = delete;
  SearchProgress& operator=(const SearchProgress&) = delete;

  void begin(const std::string& stage) {
    const std::lock_guard lock(mutex_);
    stage_ = stage;
  }
  // The progress of work in which each report counts as so many units. Several threads may report at the same time.
  Progress counted(double units = 1.0) {
    if (!execution_.progress) return {};
    return [this, units](const ProgressReport&) {
      const std::lock_guard lock(mutex_);
      done_ += units;
      execution_.progress({1 - std::exp(-done_ / usual_), stage_});
    };
  }

 private:
  Execution execution_;
  double usual_, done_ = 0.0;
  std::string stage_;
  std::mutex mutex_;
};

}  // namespace tokid
