// The same data give the same numbers to the last bit: from run to run, for any number of threads, with every
// instruction set.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "linalg/simd.hpp"
#include "noisy.hpp"
#include "tokid/identify.hpp"

namespace tokid {
namespace {

using testing::noisy_experiments;
using testing::random_experiments;
using testing::random_system;

struct Case {
  const char* name;
  Ensemble data;
  IdentifyOptions options = {};
};

// The routes of an identification: with and without noise, with and without what EM makes of it.
std::vector<Case> cases() {
  std::vector<Case> list;
  list.push_back({"from rest", random_experiments(random_system({4, 2, 2}, 30, 0.95, 3), 60, 4)});
  list.push_back({"unknown initial states", random_experiments(random_system({4, 2, 2}, 30, 0.95, 3), 60, 4, 1.0)});
  list.back().options.initial_state = InitialState::unknown;
  list.push_back({"noise, TVERA", noisy_experiments(oscillator(24), 100, 5)});
  list.back().options.method = Method::tvera;
  list.push_back({"noise, steps together, EM", noisy_experiments(oscillator(12), 16, 5)});
  list.back().options.states = 2;  // of its four, for time
  list.push_back({"noise, time-invariant, EM", noisy_experiments(oscillator(24), 12, 6)});
  list.back().options.period = 1;
  list.push_back({"noise, the regression", noisy_experiments(oscillator(24), 20, 7)});
  list.back().options.method = Method::regression;
  return list;
}

void expect_same_bits(const Model& a, const Model& b) {
  EXPECT_EQ(testing::state_dims(a), testing::state_dims(b));
  EXPECT_EQ(a.step, b.step);
  EXPECT_EQ(a.x0_mean, b.x0_mean);
  EXPECT_EQ(a.x0_cov, b.x0_cov);
}

TEST(Reproducibility, SameBitsFromRunToRunAndForAnyNumberOfThreads) {
  for (Case& c : cases()) {
    SCOPED_TRACE(c.name);
    c.options.execution.threads = 1;
    const Identification reference = identify(c.data, c.options);
    for (const int threads : {1, 2, 4}) {
      c.options.execution.threads = threads;
      const Identification result = identify(c.data, c.options);
      expect_same_bits(result.model, reference.model);
      EXPECT_EQ(result.validation.one_step.fit, reference.validation.one_step.fit);
      EXPECT_EQ(result.validation.simulation.fit, reference.validation.simulation.fit);
    }
  }
}

TEST(Reproducibility, SameBitsWithEveryInstructionSet) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const Identification best = identify(c.data, c.options);
    for (const simd::Target target : simd::targets()) {
      SCOPED_TRACE(simd::to_string(target));
      simd::limit_target(target);
      const Identification result = identify(c.data, c.options);
      simd::limit_target(simd::Target::avx512);
      expect_same_bits(result.model, best.model);
      EXPECT_EQ(result.validation.one_step.fit, best.validation.one_step.fit);
      EXPECT_EQ(result.validation.simulation.fit, best.validation.simulation.fit);
    }
  }
}

}  // namespace
}  // namespace tokid
