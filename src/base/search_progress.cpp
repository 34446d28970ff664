// SPDX-License-Identifier: BSD-3-Clause
#include "base/search_progress.hpp"

#include <algorithm>
#include <cmath>

namespace tokid {

SearchProgress::SearchProgress(const Execution& execution, double from, double to)
    : execution_(execution), from_(from), to_(to) {}

void SearchProgress::begin(const std::string& stage, double usual, double later, Amount amount) {
  const std::lock_guard lock(mutex_);
  if (usual_ == 0.0) began_ = TimeLeft::Clock::now();
  stage_ = stage;
  usual_ = usual;
  later_ = later;
  part_ = 0.0;
  amount_ = amount;
  report();
}

void SearchProgress::rename(const std::string& stage) {
  const std::lock_guard lock(mutex_);
  stage_ = stage;
}

void SearchProgress::end() {
  const std::lock_guard lock(mutex_);
  share_ = 1.0;
  usual_ = later_ = 0.0;
  report();
}

Progress SearchProgress::counted(double units) {
  if (!execution_.progress) return {};
  return [this, units](const ProgressReport&) { advance(units); };
}

double SearchProgress::left() const {
  if (!(usual_ > 0)) return later_;
  return (amount_ == Amount::known ? std::max(0.0, usual_ - part_) : usual_ * std::exp(-part_ / usual_)) + later_;
}

void SearchProgress::advance(double units) {
  const std::lock_guard lock(mutex_);
  done_ += units;
  part_ += units;
  share_ += (1 - share_) * units / (left() + units);
  report();
}

void SearchProgress::report() {
  if (!execution_.progress) return;
  ProgressReport now{.share = from_ + (to_ - from_) * share_, .stage = stage_, .stage_share = share_};
  if (timed_ > 0) {
    now.open = done_ < timed_;
    const double elapsed = std::chrono::duration<double>(TimeLeft::Clock::now() - began_).count();
    if (!now.open) now.seconds_left = elapsed / done_ * left() + afterwards_;
  }
  execution_.progress(now);
}

}  // namespace tokid
