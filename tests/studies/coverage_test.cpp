// Quick check of the coverage study: 95 % intervals hold the truth in 93 to 97 % of all entries.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/coverage.hpp"

#include <gtest/gtest.h>

namespace tokid::testing {
namespace {

// Entries of one ensemble are correlated, so that the scatter of a coverage is not that of its thousands of entries:
// with four other sets of seeds these coverages lay between 94.0 and 97.0 %.

void expect_nominal(const Coverage& coverage, const char* what, double multiple) {
  EXPECT_GT(coverage.judged, 2000) << what;
  EXPECT_GE(coverage.percent(), 93) << what << ", N = " << multiple << " L";
  EXPECT_LE(coverage.percent(), 97) << what << ", N = " << multiple << " L";
}

struct CoverageCase {
  SystemSize size;
  Index lags;
  double multiple;  // experiments over regressors
  InitialState initial;
};

TEST(Coverage, BootstrapHoldsTheTruthInNinetyFivePercent) {
  const SystemSize size{2, 1, 1};
  const Index steps = 10, p = 2, band = 5;
  const Model system = turning_system(size, steps, 3);
  const TveraOptions o = blocks(p + 1, 3, 2);
  const Identifier f = [&](const Ensemble& e) { return realised(regressions(e, p), o); };
  ClosedLoopOptions loop;
  loop.reference_step = 2;
  loop.rows = p;
  const Spectrum right = closed_loop_spectrum(system, loop);
  constexpr Index first = 2, count = 6;  // steps whose states are in the frame of every model
  for (const double multiple : {2.0, 8.0}) {
    const Index L = minimum_experiments(1, 1, p), experiments = Index(multiple * double(L));
    Random random(17);
    Coverage coverage, eigenvalues;
    for (Index run = 0; run < 150; ++run) {
      const Ensemble data = innovation_experiments(system, experiments, 0.1, random);
      const Ensemble given = innovation_experiments(system, 2, 0.0, random);
      // The larger of the two eigenvalues of every step; the other one is a zero of the deadbeat observer.
      const auto moving = [&](const Spectrum& s, Index i) {
        const Eigen::VectorXcd& e = s.eigenvalues[size_t(first + i - s.begin)];
        return (std::abs(e(0)) > std::abs(e(1)) ? e(0) : e(1)).real();
      };
      const Functional functional = [&](const Model& m) {
        const Vector others = entries(m, given, band);
        const Spectrum s = closed_loop_spectrum(m, loop);
        Vector all(others.size() + count);
        all.head(others.size()) = others;
        for (Index i = 0; i < count; ++i) all(others.size() + i) = moving(s, i);
        return all;
      };
      BootstrapOptions options;
      options.replicates = 60;
      options.unknowns = L;
      options.seed = std::uint64_t(run);
      const Bootstrap found = bootstrap(data, f, functional, options);
      EXPECT_EQ(found.replicates, 60);
      const Vector truth = entries(system, given, band);
      for (Index i = 0; i < truth.size(); ++i) coverage.add(truth(i), found.interval.lower(i), found.interval.upper(i));
      for (Index i = 0; i < count; ++i)
        eigenvalues.add(moving(right, i), found.interval.lower(truth.size() + i),
                        found.interval.upper(truth.size() + i));
    }
    expect_nominal(coverage, "parameters and outputs", multiple);
    EXPECT_GE(eigenvalues.percent(), 93) << multiple;
    EXPECT_LE(eigenvalues.percent(), 97) << multiple;
  }
}

}  // namespace
}  // namespace tokid::testing
