// The progress of a search whose amount of work is not known beforehand.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mutex>
#include <string>

#include "tokid/parallel.hpp"

namespace tokid {

// Counts work in units that take about the same time, such as iterations of one fold. Only usual amounts of work are
// stated beforehand. If U units are usual for a part and u are done, U·exp(−u/U) are expected to follow. That is about
// U − u at first, and always more than zero. The share moves as if exactly this work followed. So it neither stands
// still nor decreases if the search takes more or less work than usual.
class SearchProgress {
 public:
  // The search takes the progress of `execution` from `from` to `to`.
  explicit SearchProgress(const Execution& execution, double from = 0.0, double to = 1.0);
  SearchProgress(const SearchProgress&) = delete;
  SearchProgress& operator=(const SearchProgress&) = delete;

  // Begins a part. `stage`: its name; empty: the one of `execution`. `usual`: its usual work, or its work if that is
  // known. `later`: the usual work of all later parts of the search. [units]
  enum class Amount { usual, known };
  void begin(const std::string& stage, double usual, double later, Amount amount = Amount::usual);
  void rename(const std::string& stage);
  // Reports that the search is at its end.
  void end();
  // The progress of work in which each report counts as so many units. Several threads may report at the same time.
  Progress counted(double units = 1.0);
  // From now on, reports state the time left, once `units` units are done. A unit is expected to take as long as those
  // so far. `afterwards`: expected time of the work after the search [s].
  void tell_time_after(double units, double afterwards) {
    timed_ = units;
    afterwards_ = afterwards;
  }

 private:
  void advance(double units);
  double left() const;
  void report();

  Execution execution_;
  double from_, to_;
  TimeLeft::Clock::time_point began_ = TimeLeft::Clock::now();
  double share_ = 0.0, done_ = 0.0;  // share of the search; units in all parts
  std::string stage_;
  double usual_ = 0.0, later_ = 0.0, part_ = 0.0;  // of the part; units done in it
  Amount amount_ = Amount::usual;
  double timed_ = 0.0, afterwards_ = 0.0;  // of tell_time_after(); 0: no time left is reported
  std::mutex mutex_;
};

}  // namespace tokid
